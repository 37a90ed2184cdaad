"""Inertias that bodies can have, nearest to what was measured; and the robot that has them.

A body can exist where its pseudo-inertia [[½ tr(J) 1 - J, MS], [MSᵀ, M]] is positive semidefinite (Wensing, Kim and
Slotine, "Linear matrix inequalities for physically consistent inertial parameter identification", 2018): this keeps the
triangle inequality, and puts the mass within the body. Frictions and rotor inertias are zero or more. Of what the
motion does not show, the description's own values are kept as far as they can be. The problem is convex.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from robot_dynamics.errors import SingularModelError
from robot_dynamics.model.inertia import Inertia, symmetric_matrix
from robot_dynamics.model.robot import Robot
from robot_dynamics.newton_euler.regressor import JOINT_PARAMETERS, LINK_PARAMETERS
from robot_dynamics.optional_packages import import_optional
from robot_dynamics.recordings.drives import DRIVE_PARAMETERS, Drives

MIN_MASS = 0.05  # [kg] scale of links of which the description tells no mass
CHARACTERISTIC_LENGTH = 0.2  # [m] scale of what is told about links
PRIOR_WEIGHT = 1.0  # weight of the description beside residuals in units of their deviation
MIN_EIGENVALUE = 1e-7  # least eigenvalue of a pseudo-inertia, in units of the scale of its link
# entries of the upper triangle of a pseudo-inertia, column by column, as sums of BODY
PSEUDO_INERTIA_ENTRIES = (
    {"XX": -0.5, "YY": 0.5, "ZZ": 0.5}, {"XY": -1.0}, {"XX": 0.5, "YY": -0.5, "ZZ": 0.5},
    {"XZ": -1.0}, {"YZ": -1.0}, {"XX": 0.5, "YY": 0.5, "ZZ": -0.5}, {"MX": 1.0}, {"MY": 1.0}, {"MZ": 1.0}, {"M": 1.0},
)  # fmt: skip
DIAGONAL_ENTRIES = (0, 2, 5, 9)


@dataclass(frozen=True, eq=False)
class ConsistentRobot:
    """A robot and its drives with what was identified; values: (P,) of the columns of the Fit that they come to."""

    robot: Robot
    drives: Drives
    values: np.ndarray


def import_convex_solver():
    """The package clarabel. Raises MissingPackageError."""
    return import_optional("clarabel", "finding inertias that bodies can have")


def fit_consistent_robot(fit):
    """The Identified robot nearest to a Fit, in the squares of residuals that it minimises.

    Raises SingularModelError where none is found, MissingPackageError where the solver is not installed.
    """
    columns = fit.model
    robot, names = columns.dynamics.robot, columns.base_parameters.names
    p, others = len(names), len(columns.names) - len(columns.parameter_indices)
    A, b = fit.factors.weighted_system(fit.weights)
    whole = np.zeros((len(columns.names), p + others))
    whole[: len(columns.parameter_indices), :p] = columns.grouping_matrix
    whole[len(columns.parameter_indices) :, p:] = np.eye(others)
    prior = np.concatenate([columns.dynamics.parameters, np.zeros(others)])
    scale = np.concatenate([_scales(robot), np.ones(others)])
    free = np.concatenate([np.full(p, PRIOR_WEIGHT), np.full(others, 1e-6)])
    H = A @ whole * scale
    cones, rows, least = _cones(robot, columns, p + others, scale)
    x = _minimised(H.T @ H + np.diag(free), -(H.T @ b + free * prior / scale), rows, least, cones) * scale
    values = whole @ x
    return ConsistentRobot(_robot_with(robot, names, x[:p]), _drives_with(columns, values), values)


def _scales(robot):
    """(p,) the size that a parameter may have."""
    scales = []
    for number, link in enumerate(robot.links):
        mass = max(abs(link.inertia.mass), MIN_MASS)
        if number > 0 or robot.moving_base:
            scales += [mass * CHARACTERISTIC_LENGTH**2] * 6 + [mass * CHARACTERISTIC_LENGTH] * 3 + [mass]
        if number > 0:
            scales += [1.0] * len(JOINT_PARAMETERS)
    return np.array(scales)


def _cones(robot, columns, size, scale):
    """(cones, A, b): what x in units of scale must be so that b - A x is in the cones of clarabel."""
    clarabel, names = import_convex_solver(), list(columns.base_parameters.names)
    cones, rows, least = [], [], []
    drive = [column for column, name in enumerate(names) if name.partition(".")[0] in JOINT_PARAMETERS]
    motors = [column for column in drive if not (names[column].startswith("Ia.") and not _has_rotors(columns))]
    still = sorted(set(drive) - set(motors))
    if still:
        cones.append(clarabel.ZeroConeT(len(still)))
        rows += [_unit(column, size, -1.0) for column in still]
        least += [-columns.dynamics.parameters[column] / scale[column] for column in still]
    cones.append(clarabel.NonnegativeConeT(len(motors)))
    rows += [_unit(column, size, -1.0) for column in motors]
    least += [0.0] * len(motors)
    for link in robot.links[0 if robot.moving_base else 1 :]:
        first = names.index(f"XX.{link.name}")
        mass, places = scale[first + 9], dict(zip(LINK_PARAMETERS, range(first, first + 10), strict=True))
        units = (
            CHARACTERISTIC_LENGTH,
            CHARACTERISTIC_LENGTH,
            CHARACTERISTIC_LENGTH,
            1.0,
        )  # of rows and columns of the pseudo-inertia, times the mass
        pairs = [(row, column) for column in range(4) for row in range(column + 1)]
        for number, ((row, column), entries) in enumerate(zip(pairs, PSEUDO_INERTIA_ENTRIES, strict=True)):
            line, unit = np.zeros(size), mass * units[row] * units[column]
            for key, factor in entries.items():
                line[places[key]] = -factor * scale[places[key]] / unit
            rows.append(line if number in DIAGONAL_ENTRIES else line * np.sqrt(2))
            least.append(-MIN_EIGENVALUE if number in DIAGONAL_ENTRIES else 0.0)
        cones.append(clarabel.PSDTriangleConeT(4))
    return cones, np.array(rows), np.array(least)


def _has_rotors(columns):
    """Whether rotors were asked for: with them each has a column, or is seen together with a link."""
    return all(number in columns.parameter_indices for number in columns.base_parameters.independent)


def _unit(column, size, value):
    line = np.zeros(size)
    line[column] = value
    return line


def _minimised(P, q, A, b, cones):
    clarabel = import_convex_solver()
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solver = clarabel.DefaultSolver(sparse.csc_matrix(np.triu(P)), q, sparse.csc_matrix(A), b, cones, settings)
    found = solver.solve()
    if "Solved" not in str(found.status):
        raise SingularModelError(f"no inertias that bodies can have fit: the solver ends with {found.status}")
    return np.array(found.x)


def _robot_with(robot, names, parameters):
    """The Robot with other parameters (p,) of names."""
    told = dict(zip(names, parameters.tolist(), strict=True))
    links, joints = list(robot.links), list(robot.joints)
    for number, link in enumerate(links):
        if number == 0 and not robot.moving_base:
            continue
        value = {key: told[f"{key}.{link.name}"] for key in LINK_PARAMETERS}
        first = np.array([value["MX"], value["MY"], value["MZ"]])
        links[number] = replace(
            link, inertia=Inertia(value["M"], first, symmetric_matrix(*(value[key] for key in LINK_PARAMETERS[:6])))
        )
    for number, joint in enumerate(joints):
        losses = (max(0.0, told[f"{key}.{joint.name}"]) for key in JOINT_PARAMETERS)
        joints[number] = replace(joint, **dict(zip(DRIVE_PARAMETERS, losses, strict=True)))
    return replace(robot, links=tuple(links), joints=tuple(joints))


def _drives_with(columns, values):
    """The Drives with the offsets and coupled losses among values (P,) of columns."""
    b, n = len(columns.parameter_indices), len(columns.dynamics.joint_names)
    losses = values[b + n :].reshape(-1, len(DRIVE_PARAMETERS)).tolist()
    coupling_parameters = {
        motor: tuple(told) for motor, told in zip(columns.drives.coupling_ratios, losses, strict=True)
    }
    return replace(columns.drives, effort_offsets=values[b : b + n].copy(), coupling_parameters=coupling_parameters)
