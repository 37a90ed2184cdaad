"""Planned motions and models for tests of motions."""

from dataclasses import replace

import numpy as np

from robot_dynamics import Dynamics
from robot_dynamics.motions.actuator_limits import find_actuator_limits
from robot_dynamics.motions.effort_model import EffortModel
from robot_dynamics.motions.sampled_motion import SampledMotion, trapezoid_weights
from robot_dynamics.recordings.drives import direct_drives


def joint_mass(velocity, friction=""):
    """A mass of 2 kg on a slide along z, without gravity, with a force of at most 10 N."""
    return f"""
robot: mass
gravity: [0, 0, 0]
joints:
  - {{joint: j, link: l, type: prismatic, mass: 2,
     limits: {{lower: -5, upper: 5, velocity: {velocity}, effort: 10}}{friction}}}
"""


def model_of(robot, drives=None, **limits):
    """(EffortModel, ActuatorLimits) of a robot; limits: of all of its joints instead of those of the description."""
    joints = tuple(replace(joint, limits=replace(joint.limits, **limits)) for joint in robot.joints)
    dynamics = Dynamics(replace(robot, joints=joints))
    drives = drives or direct_drives(dynamics.joint_names)
    return EffortModel(dynamics, drives), find_actuator_limits(dynamics.robot, drives)


def quintic(duration, begin, end, count=201):
    """A motion from rest to rest along a line, by a polynomial of degree 5."""
    times = np.linspace(0, duration, count)
    part = times / duration
    way = np.array(end) - np.array(begin)
    q = np.array(begin) + np.outer(10 * part**3 - 15 * part**4 + 6 * part**5, way)
    qd = np.outer((30 * part**2 - 60 * part**3 + 30 * part**4) / duration, way)
    qdd = np.outer((60 * part - 180 * part**2 + 120 * part**3) / duration**2, way)
    return SampledMotion(times, q, qd, qdd, trapezoid_weights(times))
