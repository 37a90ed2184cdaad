"""What the description tells of the parameters before anything is measured, and how far it may be wrong.

Each parameter is expected at the value of the description, with a standard deviation of 100 % of the scale of its link:
the mass of the link, this mass times a length, or times its square. Where the description has a larger inertia, as some
tables have to fill a gap, its own size is the scale: it may be as wrong as it is large. For frictions, rotor inertias
and offsets the standard deviation is what explains all the measured effort of a joint at 1 rad/s or m/s, and at 10
rad/s² or m/s². A fit takes from the data what the data show better than this.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.identification.friction_terms import SHIFT_PARAMETER
from robot_dynamics.newton_euler.friction import further_friction_parameters
from robot_dynamics.newton_euler.regressor import JOINT_PARAMETERS

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.identification.identification_model import IdentificationModel
    from robot_dynamics.model.inertia import Inertia
    from robot_dynamics.model.robot import Robot

MIN_MASS = 0.05  # [kg] scale of links without mass in the description
CHARACTERISTIC_LENGTH = 0.2  # [m] scale of the dimensions of links
WEIGHT_PER_EFFORT = 1 / (9.81 * 0.5)  # [kg/(N m)] mass that makes an effort at 0.5 m, where no link has a mass
TYPICAL_RATE = 1.0  # [rad/s or m/s]
TYPICAL_ACCELERATION = 10.0  # [rad/s² or m/s²]
ROUNDING = 1e-12  # of the deviation of a parameter, below which its value is zero
MIN_EFFORT = 1e-6  # of the largest effort: scale of joints without measured effort


@dataclass(frozen=True, eq=False)
class DescriptionPrior:
    """Expected values of P parameters of an identification.

    Attributes
    ----------
    values : (P,) array
        Values of the description; zero for offsets and losses of coupled motors.
    root : (P, P) array
        Root R of the covariance R Rᵀ of the errors of these values.
    """

    values: Array
    root: Array

    @property
    def deviations(self) -> Array:
        """(P,) standard deviations of the errors of the values."""
        deviations: Array = np.sqrt(np.square(self.root).sum(axis=1))
        return deviations


def build_description_prior(model: IdentificationModel, efforts: Array) -> DescriptionPrior:
    """Build the prior of the parameters of a model; efforts: (n,) RMS of the measured efforts."""
    levels = np.maximum(efforts, MIN_EFFORT * max(float(efforts.max(initial=0)), MIN_EFFORT))
    scales = np.concatenate([parameter_scales(model.dynamics.robot), np.ones(len(model.terms))])
    if model.dynamics.robot.is_massless:
        scales *= max(1.0, WEIGHT_PER_EFFORT * float(levels.max()) / MIN_MASS)
    level_of = dict(zip(model.dynamics.joint_names, levels, strict=True))
    divisors = dict(zip(JOINT_PARAMETERS, (TYPICAL_ACCELERATION, TYPICAL_RATE, 1.0), strict=True))
    divisors |= {"Fva": TYPICAL_RATE, "Fsa": 1.0, "Fst": 1.0, SHIFT_PARAMETER: 1.0}
    for index, name in enumerate(model.robot_names):
        kind, _, joint = name.partition(".")
        if kind in divisors:
            scales[index] = level_of.get(joint, levels.max()) / divisors[kind]
    b = model.robot_count
    grouping = model.robot_grouping_matrix
    values = np.concatenate([grouping @ model.robot_parameters, np.zeros(len(model.names) - b)])
    offsets = np.resize(levels, len(model.names) - b)  # losses of coupled motors follow the offsets of the joints
    covariance = np.zeros((len(values), len(values)))
    covariance[:b, :b] = (grouping * scales**2) @ grouping.T
    covariance[b:, b:] = np.diag(offsets**2)
    deviations = np.sqrt(np.diagonal(covariance))
    values[np.abs(values) < ROUNDING * deviations] = 0.0
    eigenvalues, vectors = np.linalg.eigh(covariance / deviations / deviations[:, None])
    return DescriptionPrior(values, deviations[:, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0)))


def _largest_central_moment(inertia: Inertia) -> float:
    """Largest moment of inertia about an axis of the frame through the centre of mass [kg m²]."""
    moments = np.diagonal(inertia.second_moments)
    if inertia.mass > 0:
        S = inertia.first_moments
        moments = moments - (S @ S - S**2) / inertia.mass
    return float(np.abs(moments).max())


def parameter_scales(robot: Robot) -> Array:
    """Return the scale (p,) of each parameter of Dynamics.parameter_names; 1 for those of joints."""
    scales: list[float] = []
    for index, link in enumerate(robot.links):
        mass = max(abs(link.inertia.mass), MIN_MASS)
        if index > 0 or robot.moving_base:
            inertia = max(mass * CHARACTERISTIC_LENGTH**2, _largest_central_moment(link.inertia))
            scales += [inertia] * 6 + [mass * CHARACTERISTIC_LENGTH] * 3 + [mass]
        if index > 0:
            scales += [1.0] * len(JOINT_PARAMETERS)
    scales += [1.0] * len(further_friction_parameters(robot))
    return np.array(scales)
