"""Drives: the conversion from measured signals of motors to the joints of a robot, described by a YAML file.

A motor turns by the sum of its ratios times joint positions, m = R q. By virtual work its torque y acts on the joints
as Rᵀ y. Without a file, each joint is measured itself.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.expression import evaluate, format_number
from robot_dynamics.model.formats.mdh_yaml.document import DOCUMENT_END
from robot_dynamics.recordings.documents import read_document

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument

SCHEMA = Path(__file__).with_name("drives.schema.json")
EXPECTED = "a YAML file of drives"
DRIVE_PARAMETERS = ("rotor_inertia", "viscous_friction", "coulomb_friction")
MAX_CONDITION_NUMBER = 1e9  # of the ratios; beyond it the positions of joints do not follow from those of motors
MAX_RATE = 1e7  # [1/s]

Expression: TypeAlias = float | str  # a number, or an expression such as "pi/2"


@dataclass(frozen=True)
class TableFiles:
    """CSV files of a folder with a column for each motor: names of the files; rate: their samples per second."""

    position: str
    effort: str
    velocity: str | None = None
    rate: float | None = None


@dataclass(frozen=True)
class MotorLimits:
    """Limits of a motor: efforts (k,) that it has at speeds (k,), ascending from 0; velocity: its highest speed."""

    speeds: tuple[float, ...] = (0.0,)
    efforts: tuple[float, ...] = (np.inf,)
    velocity: float = np.inf


@dataclass(frozen=True, eq=False)
class Drives:
    """Conversion from signals of k motors to n joints, k = n.

    Attributes
    ----------
    joint_names : names of the n joints: all independent joints of a robot.
    names : names of the k motors, or of the joints where these are measured themselves.
    ratios : R (k, n), invertible.
    position_offsets : (n,) added to R⁻¹ m [rad or m].
    effort_gains : (k,) factors from measured signals to efforts of the motors.
    effort_offsets : (n,) efforts that the drives need beside the model of the robot [N m or N]; added to predictions.
    excludes_gravity : whether measured efforts exclude gravity.
    coupling_parameters : {motor: (rotor inertia, viscous friction, Coulomb friction)} by which the joints of a motor
        act on each other.
    tables : files of a folder of CSV tables; None: recordings are bags, or single CSV files.
    limits : {motor: limits of its torque and speed}, beside those of the joints in the description.
    """

    joint_names: tuple[str, ...]
    names: tuple[str, ...]
    ratios: Array
    position_offsets: Array
    effort_gains: Array
    effort_offsets: Array
    excludes_gravity: bool = False
    coupling_parameters: dict[str, tuple[float, ...]] = field(default_factory=dict)
    tables: TableFiles | None = None
    limits: dict[str, MotorLimits] = field(default_factory=dict)

    def to_joint_space(self, position: Array, velocity: Array, effort: Array) -> tuple[Array, Array, Array]:
        """Convert positions, velocities and efforts (N, k) of motors to those (N, n) of joints."""
        inverse = np.linalg.inv(self.ratios)
        efforts = (effort * self.effort_gains) @ self.ratios
        return position @ inverse.T + self.position_offsets, velocity @ inverse.T, efforts

    @property
    def coupling_ratios(self) -> dict[str, Array]:
        """{motor: (n,) ratios, the largest of them 1} of the motors that turn with several joints."""
        has_several_joints = (np.abs(self.ratios) > 0).sum(axis=1) > 1
        return {
            name: row / row[np.argmax(np.abs(row))]
            for name, row, is_coupled in zip(self.names, self.ratios, has_several_joints, strict=True)
            if is_coupled
        }

    def coupling_regressor(self, velocity: Array, acceleration: Array) -> Array:
        """Joint efforts for unit values of the `DRIVE_PARAMETERS` of the c motors with several joints.

        Rotor inertia and viscous friction act between joints only: the effect of a joint on itself is a parameter of
        the joint. Coulomb friction is that of the motor, which turns with w q̇.

        Parameters
        ----------
        velocity, acceleration : (..., n) of the joints.

        Returns
        -------
        (..., n, 3 c)
        """
        columns = []
        for w in self.coupling_ratios.values():
            for rates in (acceleration, velocity):
                columns.append(w * (rates @ w)[..., None] - w * w * rates)
            columns.append(w * np.sign(velocity @ w)[..., None])
        return np.stack(columns, axis=-1) if columns else np.zeros((*velocity.shape, 0))

    def drive_efforts(self, velocity: Array, acceleration: Array) -> Array:
        """Joint efforts (..., n) that the drives need beside the model of the robot: offsets and coupling."""
        no_parameters = (0.0,) * len(DRIVE_PARAMETERS)
        parameters = [
            value for name in self.coupling_ratios for value in self.coupling_parameters.get(name, no_parameters)
        ]
        if not any(parameters):
            return np.broadcast_to(self.effort_offsets, velocity.shape)
        efforts: Array = self.effort_offsets + self.coupling_regressor(velocity, acceleration) @ np.array(parameters)
        return efforts


def direct_drives(joint_names: Sequence[str]) -> Drives:
    """The drives of joints that are measured themselves."""
    n = len(joint_names)
    names = tuple(joint_names)
    return Drives(names, names, np.eye(n), np.zeros(n), np.ones(n), np.zeros(n))


def load_drives(path: str | Path | None, joint_names: Sequence[str]) -> Drives:
    """Read drives from a YAML file.

    Parameters
    ----------
    path : path of the file; see `config/drives`. None: the joints are measured themselves.
    joint_names : names of all independent joints of the robot.

    Raises
    ------
    DescriptionError
        Where the file cannot be read, or does not fit its schema or the joints.
    """
    if path is None:
        return direct_drives(joint_names)
    return _DrivesReader(read_document(Path(path), SCHEMA, EXPECTED), tuple(joint_names)).read()


class _DrivesReader:
    """Converts a document to Drives of known joints."""

    def __init__(self, document: YamlDocument, joint_names: tuple[str, ...]) -> None:
        self.document = document
        self.data = document.data
        self.joint_names = joint_names

    def read(self) -> Drives:
        motors = self.data.get("motors") or {name: {name: 1} for name in self.joint_names}
        names = tuple(motors)
        ratios = self._ratios(motors)
        coupling_parameters = self._coupling_parameters()
        drives = Drives(
            joint_names=self.joint_names,
            names=names,
            ratios=ratios,
            position_offsets=self._vector("position_offsets", self.joint_names),
            effort_gains=self._vector("effort_gains", names, default=1.0),
            effort_offsets=self._vector("effort_offsets", self.joint_names),
            excludes_gravity=self.data.get("effort_excludes_gravity", False),
            coupling_parameters=coupling_parameters,
            tables=self._tables(),
            limits=self._limits(names),
        )
        for name in set(coupling_parameters) - set(drives.coupling_ratios):
            message = describe_unknown_name("motor of several joints", name, drives.coupling_ratios)
            self.document.fail(("coupled", name), message)
        return drives

    def _ratios(self, motors: Mapping[str, Mapping[str, Expression]]) -> Array:
        """R (n, n)."""
        n = len(self.joint_names)
        if len(motors) != n:
            self.document.fail(("motors",), f"{len(motors)} motors drive {n} joints: one for each joint is needed")
        rows = [self._entries(self.joint_names, row, ("motors", name)) for name, row in motors.items()]
        ratios = np.array(rows).reshape(n, n)
        if n and np.linalg.cond(ratios) > MAX_CONDITION_NUMBER:
            self.document.fail(("motors",), "the rows of the ratios are dependent: motors do not determine the joints")
        return ratios

    def _coupling_parameters(self) -> dict[str, tuple[float, ...]]:
        return {
            name: tuple(self._number(values.get(key, 0), ("coupled", name, key)) for key in DRIVE_PARAMETERS)
            for name, values in self.data.get("coupled", {}).items()
        }

    def _limits(self, names: tuple[str, ...]) -> dict[str, MotorLimits]:
        """Limits of motors by name."""
        limits = {}
        for name, values in self.data.get("limits", {}).items():
            path = ("limits", name)
            if name not in names:
                self.document.fail(path, describe_unknown_name("motor", name, names))
            numbers = {
                key: self._positive((*path, key), values[key]) for key in ("effort", "velocity") if key in values
            }
            curve = values.get("torque_speed", [])
            speeds = [self._number(point[0], (*path, "torque_speed")) for point in curve]
            efforts = [self._number(point[1], (*path, "torque_speed")) for point in curve]
            if curve and (speeds[0] != 0 or min(np.diff(speeds), default=1.0) <= 0 or min(efforts) < 0):
                self.document.fail(
                    (*path, "torque_speed"),
                    "points [speed, torque] are needed whose speeds ascend from 0, and no torque below 0",
                )
            if curve and "effort" in numbers:
                self.document.fail(
                    (*path, "effort"), "effort is given beside torque_speed: the curve has it at speed 0"
                )
            limits[name] = MotorLimits(
                tuple(speeds) or (0.0,),
                tuple(efforts) or (numbers.get("effort", np.inf),),
                numbers.get("velocity", np.inf),
            )
        return limits

    def _positive(self, path: tuple[str, ...], value: Expression) -> float:
        number = self._number(value, path)
        if not number > 0:
            self.document.fail(path, f"{path[-1]} {number:g}: a number above 0 is needed")
        return number

    def _vector(self, key: str, names: tuple[str, ...], default: float = 0.0) -> Array:
        """The numbers (len(names),) under a key of the document."""
        return self._entries(names, self.data.get(key, {}), (key,), default)

    def _entries(
        self, names: tuple[str, ...], values: Mapping[str, Expression], path: tuple[str, ...], default: float = 0.0
    ) -> Array:
        """The numbers (len(names),) of a mapping from some of the names; path: of the mapping in the document."""
        for name in values:
            if name not in names:
                self.document.fail((*path, name), describe_unknown_name("joint", name, names))
        return np.array([self._number(values.get(name, default), (*path, name)) for name in names])

    def _number(self, value: Expression, path: tuple[str, ...]) -> float:
        try:
            return float(evaluate(value))
        except DescriptionError as error:
            self.document.fail(path, str(error))
            raise

    def _tables(self) -> TableFiles | None:
        table_options = dict(self.data.get("tables", {}))
        if not table_options:
            return None
        if "rate" in table_options:
            rate = self._number(table_options["rate"], ("tables", "rate"))
            if not 0 < rate < MAX_RATE:
                self.document.fail(("tables", "rate"), f"rate {rate:g}: samples per second are needed")
            table_options["rate"] = rate
        return TableFiles(**table_options)


def write_drives(drives: Drives) -> str:
    """The YAML text of drives, for `load_drives` to read."""
    joint_names = drives.joint_names
    lines = [
        "%YAML 1.2",
        "---",
        "# Conversion from measured signals of motors to the joints of the model.",
        "format: 1",
    ]
    if drives.names != joint_names or not np.array_equal(drives.ratios, np.eye(len(drives.names))):
        lines.append("motors:")
        for name, row in zip(drives.names, drives.ratios, strict=True):
            lines.append(f"  {json.dumps(name)}: {_format_mapping(joint_names, row, default=0)}")
    for key, names, values, default in (
        ("position_offsets", joint_names, drives.position_offsets, 0),
        ("effort_gains", drives.names, drives.effort_gains, 1),
        ("effort_offsets", joint_names, drives.effort_offsets, 0),
    ):
        if np.any(values != default):
            lines.append(f"{key}: {_format_mapping(names, values, default)}")
    if drives.excludes_gravity:
        lines.append("effort_excludes_gravity: true")
    if drives.coupling_parameters:
        lines.append("coupled:")
        for name, parameters in drives.coupling_parameters.items():
            lines.append(f"  {json.dumps(name)}: {_format_mapping(DRIVE_PARAMETERS, parameters)}")
    if drives.limits:
        lines.append("limits:")
        lines += [f"  {json.dumps(name)}: {_format_limits(limits)}" for name, limits in drives.limits.items()]
    if drives.tables is not None:
        lines.append("tables:")
        table_options = {key: value for key, value in vars(drives.tables).items() if value is not None}
        for key, value in table_options.items():
            lines.append(f"  {key}: {format_number(value) if key == 'rate' else json.dumps(value)}")
    return "\n".join([*lines, DOCUMENT_END]) + "\n"


def _format_limits(limits: MotorLimits) -> str:
    """YAML text of the limits of a motor."""
    entries = []
    if len(limits.speeds) > 1:
        points = zip(limits.speeds, limits.efforts, strict=True)
        curve = ", ".join(f"[{format_number(speed)}, {format_number(effort)}]" for speed, effort in points)
        entries.append(f"torque_speed: [{curve}]")
    elif np.isfinite(limits.efforts[0]):
        entries.append(f"effort: {format_number(limits.efforts[0])}")
    if np.isfinite(limits.velocity):
        entries.append(f"velocity: {format_number(limits.velocity)}")
    return "{" + ", ".join(entries) + "}"


def _format_mapping(names: Iterable[str], values: Iterable[float], default: float | None = None) -> str:
    """YAML text of the mapping from names to values, without those that have the default."""
    pairs = ((name, value) for name, value in zip(names, values, strict=True) if value != default)
    return "{" + ", ".join(f"{json.dumps(name)}: {format_number(value)}" for name, value in pairs) + "}"
