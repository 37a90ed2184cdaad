"""The observer of a robot with the parameters of the node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.monitoring.collision_thresholds import default_thresholds, load_thresholds
from robot_dynamics.monitoring.contact_observer import ContactObserver
from robot_dynamics.monitoring.frame_wrench import WrenchEstimator
from robot_dynamics.monitoring.momentum_balance import MomentumBalance
from robot_dynamics.nodes.codecs.base_odometry import BaseOdometryReader
from robot_dynamics.nodes.codecs.joint_states import JointStateReader
from robot_dynamics.recordings.drives import load_drives

if TYPE_CHECKING:
    from sensor_msgs.msg import JointState

    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.parameters import ParameterValues

DEFAULT_BANDWIDTH = 50.0
"""[1/s] where neither a parameter nor the thresholds give one."""


@dataclass(frozen=True, eq=False)
class Monitoring:
    """The observer of one robot, and what reads messages into it.

    Attributes
    ----------
    observer : ContactObserver
    wrench : WrenchEstimator or None
    joint_states : JointStateReader
    base : BaseOdometryReader
    has_learnt_thresholds : bool
    """

    observer: ContactObserver
    wrench: WrenchEstimator | None
    joint_states: JointStateReader
    base: BaseOdometryReader
    has_learnt_thresholds: bool

    def read_efforts(self, message: JointState) -> None:
        """Copy the efforts of a message. Raises InvalidInputError if it has none."""
        mapping = self.joint_states.find_mapping(message)
        if mapping.rejection_reason:
            raise InvalidInputError(mapping.rejection_reason)
        if len(message.effort) != len(message.name):
            raise InvalidInputError(
                f"{len(message.effort)} efforts for {len(message.name)} names: publish efforts, or set effort_topic"
            )
        efforts = self.observer.balance.effort
        efforts[mapping.joint_indices] = np.frombuffer(message.effort)[mapping.message_indices]


def build_monitoring(dynamics: Dynamics, values: ParameterValues, namespace: str) -> Monitoring:
    """Make the observer of a robot; compiles its programs. Raises RobotDynamicsError where parameters do not fit."""
    names = dynamics.joint_names
    drives = load_drives(values["drives"], names) if values["drives"] else None
    if drives is not None and drives.names != names:
        raise InvalidInputError(
            f"drives {values['drives']!r}: joint_states have joints, and the file has motors "
            f"{', '.join(map(repr, drives.names))}. Leave `motors` out"
        )
    bandwidth = values["bandwidth"]
    if values["thresholds"]:
        thresholds = load_thresholds(values["thresholds"], names)
        if bandwidth not in (0.0, thresholds.bandwidth):
            raise InvalidInputError(
                f"parameter bandwidth is {bandwidth:g}, and the thresholds hold for {thresholds.bandwidth:g}: set it "
                "to 0, or learn the thresholds with this bandwidth"
            )
    else:
        thresholds = default_thresholds(dynamics, values["effort_share"], bandwidth or DEFAULT_BANDWIDTH)
    wrench = None
    if values["frame"]:
        wrench = WrenchEstimator(dynamics, values["frame"], values["wrench"], thresholds.moving)
    balance = MomentumBalance(dynamics, drives)
    observer = ContactObserver(balance, thresholds, values["max_gap"])
    observer.detector.release_ratio = values["release_ratio"]
    observer.detector.release_time = values["release_time"]
    reader = JointStateReader(
        dynamics, names, namespace, balance.position, balance.velocity, balance.dependent_positions
    )
    base = BaseOdometryReader(dynamics.robot, namespace, balance.twist, balance.gravity)
    return Monitoring(observer, wrench, reader, base, bool(values["thresholds"]))
