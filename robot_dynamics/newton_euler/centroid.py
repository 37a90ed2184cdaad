"""Centre of mass, momentum and kinetic energy of a tree, over generic scalars.

The momentum of all bodies is the wrench that would start them from rest in unit time, [P; L] at the origin of frame 0:
the rows of the base in the inertia matrix times the rates. Angular momentum about the centre of mass C is L - OC × P
(Orin, Goswami, Lee, Centroidal dynamics of a humanoid robot, 2013). Rotors have no part in it: the models count them at
their joints alone. A base that is fixed does not count as a body.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.model.vector_product import skew
from robot_dynamics.newton_euler.composite import inertia_matrix
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.joint_placement import joint_placement
from robot_dynamics.newton_euler.kinematics import run_forward_pass
from robot_dynamics.newton_euler.screw import apply, cross, dot, screw

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.robot import Robot

ZERO_SCREW = np.zeros(6, dtype=int)


def moving_mass(robot: Robot) -> float:
    """Mass of all bodies that can move [kg]: of a fixed base the mass does not count."""
    return sum((link.inertia.mass for link in robot.links[_first_link(robot) :]), 0.0)


def first_moments(robot: Robot, q: ScalarArray) -> ScalarArray:
    """First moments (..., 3) of all bodies that can move [kg m], in frame 0 about its origin.

    q: positions (..., joints). From the tips to the base, as composite bodies.
    """
    masses: list[float | ScalarArray] = [link.inertia.mass for link in robot.links]
    first = [link.inertia.first_moments for link in robot.links]
    if _first_link(robot):
        masses[0] = 0
        first[0] = np.zeros(3, dtype=int)
    for j in range(len(robot.joints), 0, -1):
        joint = robot.joints[j - 1]
        R, P = joint_placement(joint, q[..., j - 1 : j])
        i = joint.antecedent
        first[i] = first[i] + apply(R, first[j]) + masses[j] * P
        masses[i] = masses[i] + masses[j]
    return first[0]


def centre_of_mass(robot: Robot, q: ScalarArray) -> ScalarArray:
    """Centre of mass (..., 3) of all bodies that can move [m], in frame 0."""
    centre: ScalarArray = first_moments(robot, q) / moving_mass(robot)
    return centre


def centroidal_momentum_matrix(robot: Robot, q: ScalarArray) -> ScalarArray:
    """Matrix (..., 6, m) that gives the momentum from rates: [P; angular momentum about the centre of mass].

    In the axes of frame 0; m = joints, or 6 + joints with a moving base, whose twist in frame 0 comes first.
    """
    columns = slice(None if robot.moving_base else 6, None)
    momenta = inertia_matrix(robot, q, with_base=True)[..., :6, columns]
    linear = momenta[..., :3, :]
    angular = momenta[..., 3:, :] - skew(centre_of_mass(robot, q)) @ linear
    return np.concatenate(np.broadcast_arrays(linear, angular), axis=-2)


def centroidal_momentum_bias(
    robot: Robot, q: ScalarArray, qd: ScalarArray, base_twist: ScalarArray, accelerations: ScalarArray
) -> ScalarArray:
    """Derivative (..., 6) of the momentum by time, without acceleration of the base: the wrench about C in frame 0.

    Parameters
    ----------
    robot : Robot
    q, qd, accelerations : ndarray, shape (..., joints)
        The motion of all joints.
    base_twist : ndarray, shape (..., 6)
        0V0.
    """
    forward_pass = run_forward_pass(robot, q, qd, base_twist, {})
    wrench = inverse_dynamics(robot, forward_pass, accelerations, ZERO_SCREW)[1][..., 0, :]
    force = wrench[..., :3]
    return screw(force, wrench[..., 3:] - cross(centre_of_mass(robot, q), force))


def kinetic_energy(robot: Robot, q: ScalarArray, qd: ScalarArray, base_twist: ScalarArray) -> ScalarArray:
    """Kinetic energy (..., 1) of bodies and rotors [J] at positions and rates (..., joints), base_twist (..., 6)."""
    velocities = run_forward_pass(robot, q, qd, base_twist, {}).velocities
    doubled: ScalarArray = np.zeros(1, dtype=int)
    for link, V in zip(robot.links, velocities, strict=True):
        doubled = doubled + dot(V, apply(link.inertia.spatial, V))
    for number, joint in enumerate(robot.joints):
        rate = qd[..., number : number + 1]
        doubled = doubled + joint.rotor_inertia * rate * rate
    return 0.5 * doubled


def _first_link(robot: Robot) -> int:
    """Number of the first link that can move."""
    return 0 if robot.moving_base else 1
