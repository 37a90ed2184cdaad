"""Descriptions of robots: URDF, SDF, MDH tables, .par, and tables that contain a URDF.

Each text is refused with a DescriptionError, or read. Where an independent reader reads it too, the dynamics of both
robots agree at random positions.
"""

from __future__ import annotations

import random
import re
from zlib import crc32

import numpy as np
from fuzzing.campaign import Outcome
from fuzzing.mutations import mutate_text

from robot_dynamics import Dynamics, RobotDynamicsError
from robot_dynamics.model.formats.sdf.document import is_sdf
from robot_dynamics.model.loading import is_urdf, read_robot
from robot_dynamics.model.robot import Robot

try:
    from fuzzing import tree_peer
except ImportError:  # without Pinocchio nothing is compared
    tree_peer = None

LONGEST_MESSAGE = 2000
LARGEST_VALUE = 1e6  # of numbers of robots that are compared: rounding errors of others are large
TOLERANCE = 1e-6  # relative to the largest term of the efforts
STATES = 2


class DescriptionTarget:
    """Texts for `read_robot`."""

    name = "descriptions"

    def prepare(self) -> None:
        """Nothing to load."""

    def mutate(self, data: bytes, rng: random.Random, corpus: list[bytes]) -> bytes:
        """Return a mutated text."""
        return mutate_text(data, rng, corpus)

    def run(self, data: bytes) -> Outcome:
        """Read a text; as bytes, like a file, where it is not UTF-8 and for each fourth text."""
        text: str | bytes
        try:
            text = data.decode("utf-8") if crc32(data) % 4 else data
        except UnicodeDecodeError:
            text = data
        try:
            robot = read_robot(text, source="text")
        except RobotDynamicsError as error:
            message = str(error)
            assert message.startswith("text"), message[:300]
            assert len(message) < LONGEST_MESSAGE, message[:300]
            return Outcome("refused", re.sub(r"'[^']*'|\"[^\"]*\"|[\d.]+", "", message)[:80])
        if tree_peer is None or not isinstance(text, str):
            return Outcome("accepted")
        return compare(robot, text)


def compare(robot: Robot, text: str) -> Outcome:
    """Compare the dynamics of a robot with those of an independent reader of its text."""
    if robot.loops or robot.platforms or robot.moving_base or not robot.joints:
        return Outcome("accepted", "not covered")
    if is_sdf(text):
        return Outcome("accepted", "not covered: SDF")
    try:
        if is_urdf(text):
            tree = tree_peer.read_urdf_tree(text)
        elif re.match(r"\s*(\(\*|\w+\s*=)", text):
            tree = tree_peer.read_par_tree(text)
        else:
            tree = tree_peer.read_table_tree(text)
    except tree_peer.NotCovered as reason:
        return Outcome("accepted", "not covered: " + re.sub(r"'[^']*'|[\d.]+", "", str(reason))[:40])
    dynamics = Dynamics(robot, compiled=False)
    names = list(dynamics.joint_names)
    is_par = re.match(r"\s*(\(\*|\w+\s*=)", text) is not None
    assert len(names) == len(tree.rows), f"joints {names}, the independent reader has {list(tree.rows)}"
    rows = list(tree.rows.values()) if is_par else [tree.rows[name] for name in names]
    numbers = [float(number) for number in re.findall(r"\d+\.?\d*(?:[eE][-+]?\d+)?", text)]
    if max(numbers, default=0.0) > LARGEST_VALUE:
        return Outcome("accepted", "large numbers")
    rng = np.random.default_rng(crc32(text.encode("utf-8", "replace")))
    for _ in range(STATES):
        q, qd, qdd = rng.uniform(-1, 1, (3, len(names)))
        try:
            parts = [
                dynamics.inertia_matrix(q) @ qdd,
                dynamics.coriolis(q, qd),
                dynamics.gravity(q),
            ]
        except RobotDynamicsError as error:
            return Outcome("accepted", f"no model: {re.sub(r'[^a-z ]', '', str(error))[:40]}")
        full = np.zeros((3, tree.model.nv))
        full[:, rows] = q, qd, qdd
        position = full[0]
        if tree.model.nq != tree.model.nv:  # continuous joints have a cosine and a sine
            position = np.zeros(tree.model.nq)
            for joint in list(tree.model.joints)[1:]:
                angle = full[0][joint.idx_v]
                position[joint.idx_q : joint.idx_q + joint.nq] = (
                    angle if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
                )
        expected = tree.efforts(position, full[1], full[2])[rows]
        if not np.isfinite(expected).all():
            return Outcome("accepted", "not finite")
        scale = np.abs(parts).max() + np.abs(dynamics.inertia_matrix(q)).max() + 1e-9
        error = np.abs(sum(parts) - expected).max()
        assert error <= TOLERANCE * scale, (
            f"differs from the independent reader by {error:.3g}: {sum(parts)}, {expected}"
        )
    return Outcome("compared", "", STATES)
