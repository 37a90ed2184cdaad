"""What stands between measured signals and the joints of a robot, as a YAML file tells it: which motors turn with which
joints, gains from currents to efforts, offsets, and losses of motors that turn with several joints.

A motor turns by the sum of its ratios times joint positions, m = R q; by virtual work what it exerts is Rᵀ y on the
joints. Without any, each joint is measured itself.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.expression import evaluate, format_number
from robot_dynamics.recordings.documents import read_document

SCHEMA = Path(__file__).with_name("drives.schema.json")
EXPECTED = "a YAML file on drives"
DRIVE_PARAMETERS = ("rotor_inertia", "viscous_friction", "coulomb_friction")


@dataclass(frozen=True)
class TableFiles:
    """CSV files of a folder with a column for each motor: names of the files, and their samples per second."""

    position: str
    effort: str
    velocity: str | None = None
    rate: float | None = None


@dataclass(frozen=True, eq=False)
class Drives:
    """How signals of `names` (k motors or joints) stand to `joint_names` (n joints, all independent ones of a robot).

    ratios: R (k, n), k = n, invertible; position_offsets (n,) are added to R⁻¹ m; effort_gains (k,) multiply what is
    measured; effort_offsets (n,) [N m or N] is what drives demand beside the model of the robot, added to predictions;
    coupled: {motor: (3,) rotor inertia, viscous and Coulomb friction by which joints feel each other through it}.
    """

    joint_names: tuple
    names: tuple
    ratios: np.ndarray
    position_offsets: np.ndarray
    effort_gains: np.ndarray
    effort_offsets: np.ndarray
    excludes_gravity: bool = False
    coupling_parameters: dict = field(default_factory=dict)
    tables: TableFiles | None = None

    def to_joint_space(self, position, velocity, effort):
        """Positions, velocities and efforts (N, n) of joints, of those of motors (N, k)."""
        inverse = np.linalg.inv(self.ratios)
        efforts = (effort * self.effort_gains) @ self.ratios
        return position @ inverse.T + self.position_offsets, velocity @ inverse.T, efforts

    @property
    def coupling_ratios(self):
        """{motor: (n,) ratios, the largest of them 1} of the motors that turn with several joints."""
        several = (np.abs(self.ratios) > 0).sum(axis=1) > 1
        return {name: row / row[np.argmax(np.abs(row))]
                for name, row, coupling_parameters in zip(self.names, self.ratios, several, strict=True) if coupling_parameters}  # fmt: skip

    def coupling_regressor(self, velocity, acceleration):
        """(..., n, 3 c): what 1 of each loss of each of c coupled motors demands of the joints.

        Rotor inertia and viscous friction are what joints feel of each other: what a joint feels of itself is a part of
        its own. Coulomb friction is that of the motor, which turns with w q̇.
        """
        columns = []
        for w in self.coupling_ratios.values():
            for rates in (acceleration, velocity):
                columns.append(w * (rates @ w)[..., None] - w * w * rates)
            columns.append(w * np.sign(velocity @ w)[..., None])
        return np.stack(columns, axis=-1) if columns else np.zeros((*velocity.shape, 0))

    def drive_efforts(self, velocity, acceleration):
        """(..., n): efforts that drives demand beside the model of the robot: offsets and coupled losses."""
        losses = [value for name in self.coupling_ratios for value in self.coupling_parameters.get(name, (0.0,) * 3)]
        if not any(losses):
            return np.broadcast_to(self.effort_offsets, velocity.shape)
        return self.effort_offsets + self.coupling_regressor(velocity, acceleration) @ np.array(losses)


def direct_drives(joint_names):
    """The Drives of joints that are measured themselves."""
    n = len(joint_names)
    return Drives(tuple(joint_names), tuple(joint_names), np.eye(n), np.zeros(n), np.ones(n), np.zeros(n))


def load_drives(path, joint_names):
    """The Drives that a YAML file tells for the joints of a robot; None: none. Raises DescriptionError."""
    if path is None:
        return direct_drives(joint_names)
    return _Reader(read_document(Path(path), SCHEMA, EXPECTED), tuple(joint_names)).read()


class _Reader:
    """Reads the document of drives of known joints."""

    def __init__(self, document, joint_names):
        self.document, self.data, self.joint_names = document, document.data, joint_names

    def read(self):
        motors = self.data.get("motors") or {name: {name: 1} for name in self.joint_names}
        names, n = tuple(motors), len(self.joint_names)
        if len(names) != n:
            self.document.fail(("motors",), f"{len(names)} motors drive {n} joints: one for each is needed")
        ratios = np.array([self._vector(self.joint_names, told, "motors", name) for name, told in motors.items()])
        if n and np.linalg.cond(ratios) > 1e9:
            self.document.fail(("motors",), "the joints do not follow from the motors: ratios are dependent")
        coupling_parameters = {name: tuple(self._number(told.get(loss, 0), "coupled", name, loss) for loss in DRIVE_PARAMETERS)
                   for name, told in self.data.get("coupled", {}).items()}  # fmt: skip
        drives = Drives(
            self.joint_names, names, ratios.reshape(n, n), self._told("position_offsets"),
            self._told("effort_gains", names, 1.0), self._told("effort_offsets"),
            self.data.get("effort_excludes_gravity", False), coupling_parameters, self._tables(),
        )  # fmt: skip
        for name in set(coupling_parameters) - set(drives.coupling_ratios):
            self.document.fail(
                ("coupled", name), f"{describe_unknown_name('motor of several joints', name, drives.coupling_ratios)}"
            )
        return drives

    def _told(self, key, names=None, default=0.0):
        return self._vector(names or self.joint_names, self.data.get(key, {}), key, default=default)

    def _vector(self, names, told, *path, default=0.0):
        for name in told:
            if name not in names:
                self.document.fail((*path, name), describe_unknown_name("joint", name, names))
        return np.array([self._number(told.get(name, default), *path, name) for name in names])

    def _number(self, value, *path):
        try:
            return evaluate(value)
        except DescriptionError as error:
            self.document.fail(path, str(error))

    def _tables(self):
        told = dict(self.data.get("tables", {}))
        if not told:
            return None
        if "rate" in told:
            told["rate"] = self._number(told["rate"], "tables", "rate")
            if not 0 < told["rate"] < 1e7:
                self.document.fail(("tables", "rate"), "samples per second are needed")
        return TableFiles(**told)


def write_drives(drives):
    """The YAML text of Drives, which `load_drives` reads back."""

    def mapping(names, values, default):
        pairs = ((name, value) for name, value in zip(names, values, strict=True) if value != default)
        return "{" + ", ".join(f"{json.dumps(name)}: {format_number(value)}" for name, value in pairs) + "}"

    lines = ["# What stands between measured signals and the joints of the model.", "format: 1"]
    if drives.names != drives.joint_names or not np.array_equal(drives.ratios, np.eye(len(drives.names))):
        lines.append("motors:")
        lines += [f"  {json.dumps(name)}: {mapping(drives.joint_names, row, 0)}"
                  for name, row in zip(drives.names, drives.ratios, strict=True)]  # fmt: skip
    for key, names, default in (("position_offsets", drives.joint_names, 0), ("effort_gains", drives.names, 1),
                                ("effort_offsets", drives.joint_names, 0)):  # fmt: skip
        if np.any(getattr(drives, key) != default):
            lines.append(f"{key}: {mapping(names, getattr(drives, key), default)}")
    if drives.excludes_gravity:
        lines.append("effort_excludes_gravity: true")
    if drives.coupling_parameters:
        lines.append("coupled:")
        lines += [
            f"  {json.dumps(name)}: {mapping(DRIVE_PARAMETERS, values, None)}"
            for name, values in drives.coupling_parameters.items()
        ]
    if drives.tables is not None:
        lines.append("tables:")
        told = {key: value for key, value in vars(drives.tables).items() if value is not None}
        lines += [f"  {key}: {format_number(value) if key == 'rate' else json.dumps(value)}"
                  for key, value in told.items()]  # fmt: skip
    return "\n".join(lines) + "\n"
