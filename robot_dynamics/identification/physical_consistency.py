"""The physically consistent robot that is nearest to a fit.

The inertial parameters of a body are physically consistent if its pseudo-inertia [[½ tr(J) 1 - J, MS], [MSᵀ, M]] is
positive semidefinite (Wensing, Kim and Slotine, "Linear matrix inequalities for physically consistent inertial
parameter identification", 2018). This includes the triangle inequality and keeps the centre of mass within the body.
Friction and rotor inertias are zero or positive. Parameters that the motion does not excite stay as near as possible to
the description. The problem is convex.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from robot_dynamics.errors import SingularModelError
from robot_dynamics.identification.description_prior import CHARACTERISTIC_LENGTH, parameter_scales
from robot_dynamics.identification.friction_terms import SHIFT_PARAMETER
from robot_dynamics.identification.identified_robot import identified_drives, identified_robot
from robot_dynamics.newton_euler.friction import FRICTION_PARAMETERS
from robot_dynamics.newton_euler.pseudo_inertia import PSEUDO_INERTIA_ENTRIES, TRIANGLE
from robot_dynamics.newton_euler.regressor import JOINT_PARAMETERS, LINK_PARAMETERS
from robot_dynamics.optional_packages import import_optional

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.identification.fitting import Fit
    from robot_dynamics.identification.identification_model import IdentificationModel
    from robot_dynamics.identification.sample_sums import FitQuality
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.recordings.drives import Drives

PRIOR_WEIGHT = 1.0  # weight of the description, relative to residuals in units of their standard deviation
OFFSET_PRIOR_WEIGHT = 1e-6  # weight of zero for joint offsets and losses of coupled motors
MIN_EIGENVALUE = 1e-7  # smallest eigenvalue of a pseudo-inertia, in units of the scale of its link
DIAGONAL_ENTRIES = (0, 2, 5, 9)


@dataclass(frozen=True, eq=False)
class ConsistentRobot:
    """Physically consistent result of an identification.

    Attributes
    ----------
    robot : Robot
        Robot with the identified inertias, friction and rotor inertias.
    drives : Drives
        Drives with the identified offsets and losses of coupled motors.
    values : (P,) array
        Values of the parameters of the fit that the robot and the drives correspond to.
    distance : float
        RMS of the differences of the parameters of links from the description, in units of the scales of the links.
    """

    robot: Robot
    drives: Drives
    values: Array
    distance: float


@dataclass(frozen=True, eq=False)
class WrittenRobot:
    """A consistent robot with its residuals on the fitted data, and on data for validation if there are any."""

    consistent: ConsistentRobot
    training_quality: FitQuality
    validation_quality: FitQuality | None

    @property
    def distance(self) -> float:
        """Distance from the description, as that of the ConsistentRobot."""
        return self.consistent.distance


@dataclass(frozen=True, eq=False)
class _ConeConstraint:
    """Rows (k, size) and bounds (k,) such that bounds - rows x lies in a cone of clarabel."""

    cone: object
    rows: list[Array]
    bounds: list[float]


def import_convex_solver() -> ModuleType:
    """Import clarabel. Raises MissingPackageError."""
    return import_optional("clarabel", "computing physically consistent inertias")


def fit_consistent_robot(fit: Fit) -> ConsistentRobot:
    """Find the physically consistent robot with the smallest squared residuals.

    Parameters
    ----------
    fit : Fit
        Unconstrained fit, whose weighted squared residuals are minimised under the constraints.

    Returns
    -------
    ConsistentRobot
        Robot and drives with consistent parameters.

    Raises
    ------
    SingularModelError
        If the solver does not converge.
    MissingPackageError
        If clarabel is not installed.

    Notes
    -----
    Source: Wensing, Kim and Slotine, "Linear matrix inequalities for physically consistent inertial parameter
    identification" (2018).
    """
    model = fit.model
    robot = model.dynamics.robot
    names = model.robot_names
    p = len(names)
    b = model.robot_count
    drive_count = len(model.names) - b
    A, y = fit.factors.weighted_system(fit.weights)
    grouping = np.zeros((len(model.names), p + drive_count))
    grouping[:b, :p] = model.robot_grouping_matrix
    grouping[b:, p:] = np.eye(drive_count)
    prior = np.concatenate([model.robot_parameters, np.zeros(drive_count)])
    prior_weights = np.concatenate([np.full(p, PRIOR_WEIGHT), np.full(drive_count, OFFSET_PRIOR_WEIGHT)])
    scale = np.concatenate([parameter_scales(robot), np.ones(len(model.terms) + drive_count)])
    H = A @ grouping * scale
    gradient = -(H.T @ y + prior_weights * prior / scale)
    constraints = [*_joint_constraints(model, scale), *_link_constraints(model, scale)]
    x = _minimize(H.T @ H + np.diag(prior_weights), gradient, constraints) * scale
    values = grouping @ x
    is_link = np.array([name.partition(".")[0] in LINK_PARAMETERS for name in names])
    distance = float(np.sqrt(np.mean(np.square((x - prior) / scale)[:p][is_link])))
    return ConsistentRobot(
        identified_robot(model, dict(zip(names, x[:p].tolist(), strict=True))),
        identified_drives(model, values),
        values,
        distance,
    )


def _joint_constraints(model: IdentificationModel, scale: Array) -> Iterator[_ConeConstraint]:
    """Keep friction and rotor inertias positive, and what is not identified constant: rotor inertias.

    Shifts of Stribeck velocities are zero, so that the efforts of the written robot are those of its columns.
    """
    clarabel = import_convex_solver()
    names = model.robot_names
    columns = [column for column, name in enumerate(names) if name.partition(".")[0] in JOINT_PARAMETERS]
    fit_rotors = _has_rotor_columns(model)
    free = [column for column in columns if fit_rotors or not names[column].startswith("Ia.")]
    constant = sorted(set(columns) - set(free))
    constant += [column for column, name in enumerate(names) if name.startswith(f"{SHIFT_PARAMETER}.")]
    if constant:
        bounds = [-model.robot_parameters[column] / scale[column] for column in constant]
        yield _ConeConstraint(
            clarabel.ZeroConeT(len(constant)), [_unit_row(column, len(scale)) for column in constant], bounds
        )
    yield _ConeConstraint(
        clarabel.NonnegativeConeT(len(free)), [_unit_row(column, len(scale)) for column in free], [0.0] * len(free)
    )
    sums = list(_non_negative_friction(names))
    if sums:
        rows = [np.sum([sign * _unit_row(column, len(scale)) for column, sign in terms], axis=0) for terms in sums]
        yield _ConeConstraint(clarabel.NonnegativeConeT(len(rows)), rows, [0.0] * len(rows))


def _non_negative_friction(names: Sequence[str]) -> Iterator[list[tuple[int, float]]]:
    """Sums of further parameters of friction that are not negative: columns and signs of their terms."""
    columns = {name: column for column, name in enumerate(names)}
    for name, column in columns.items():
        key, _, joint = name.partition(".")
        if key not in FRICTION_PARAMETERS[2:]:
            continue
        symmetric = columns[f"{'Fv' if key == 'Fva' else 'Fs'}.{joint}"]
        stribeck = columns.get(f"Fst.{joint}")
        if key in ("Fva", "Fsa"):
            yield from ([(symmetric, 1.0), (column, sign)] for sign in (1.0, -1.0))
        if key == "Fsa" and stribeck is not None:
            yield from ([(symmetric, 1.0), (stribeck, 1.0), (column, sign)] for sign in (1.0, -1.0))
        if key == "Fst":
            yield [(symmetric, 1.0), (column, 1.0)]
        if key == "mu":
            yield [(column, 1.0)]


def _link_constraints(model: IdentificationModel, scale: Array) -> Iterator[_ConeConstraint]:
    """Keep the pseudo-inertia of each moving link positive definite."""
    robot = model.dynamics.robot
    names = list(model.base_parameters.names)
    for link in robot.links[0 if robot.moving_base else 1 :]:
        yield _pseudo_inertia_constraint(names.index(f"XX.{link.name}"), scale)


def _pseudo_inertia_constraint(first: int, scale: Array) -> _ConeConstraint:
    """Keep the pseudo-inertia of a body positive definite.

    first: column of the first of its LINK_PARAMETERS; scale: of all columns.
    """
    clarabel = import_convex_solver()
    units = (CHARACTERISTIC_LENGTH, CHARACTERISTIC_LENGTH, CHARACTERISTIC_LENGTH, 1.0)  # of rows and columns
    mass = scale[first + 9]
    columns = dict(zip(LINK_PARAMETERS, range(first, first + 10), strict=True))
    rows: list[Array] = []
    bounds: list[float] = []
    for number, ((row, column), entries) in enumerate(zip(TRIANGLE, PSEUDO_INERTIA_ENTRIES, strict=True)):
        constraint = np.zeros(len(scale))
        unit = mass * units[row] * units[column]
        for key, factor in entries.items():
            constraint[columns[key]] = -factor * scale[columns[key]] / unit
        is_diagonal = number in DIAGONAL_ENTRIES
        rows.append(constraint if is_diagonal else constraint * np.sqrt(2))
        bounds.append(-MIN_EIGENVALUE if is_diagonal else 0.0)
    return _ConeConstraint(clarabel.PSDTriangleConeT(4), rows, bounds)


def nearest_consistent_parameters(values: Array, covariance: Array, scale: Array) -> Array:
    """Find the physically consistent parameters of one body that are nearest to estimated ones.

    Parameters
    ----------
    values : (10,) array
        Estimated LINK_PARAMETERS.
    covariance : (10, 10) array
        Covariance of their errors, in which distances are measured.
    scale : (10,) array
        Scales of the parameters, of which the last one is a mass [kg].

    Returns
    -------
    (10,) array
        LINK_PARAMETERS of a body.

    Raises
    ------
    SingularModelError
        If the solver does not converge.
    MissingPackageError
        If clarabel is not installed.
    """
    precision = np.asarray(np.linalg.pinv(covariance / scale / scale[:, None], hermitian=True), dtype=float)
    x: Array = _minimize(precision, -precision @ (values / scale), [_pseudo_inertia_constraint(0, scale)]) * scale
    return x


def _has_rotor_columns(model: IdentificationModel) -> bool:
    """Whether rotor inertias are identified: each has a column, or is grouped with the parameters of a link."""
    return all(index in model.parameter_indices for index in model.base_parameters.independent)


def _unit_row(column: int, size: int) -> Array:
    row = np.zeros(size)
    row[column] = -1.0
    return row


def _minimize(P: Array, q: Array, constraints: list[_ConeConstraint]) -> Array:
    """Minimise ½ xᵀ P x + qᵀ x under cone constraints. Raises SingularModelError if the solver does not converge."""
    clarabel = import_convex_solver()
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    A = sparse.csc_matrix(np.array([row for constraint in constraints for row in constraint.rows]))
    b = np.array([bound for constraint in constraints for bound in constraint.bounds])
    cones = [constraint.cone for constraint in constraints]
    solver = clarabel.DefaultSolver(sparse.csc_matrix(np.triu(P)), q, A, b, cones, settings)
    solution = solver.solve()
    if "Solved" not in str(solution.status):
        raise SingularModelError(
            f"no physically consistent robot fits the recordings: the solver clarabel stops with {solution.status}"
        )
    return np.array(solution.x)
