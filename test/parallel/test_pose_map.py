"""Maps over poses of a platform: each entry agrees with PlatformDynamics at its pose."""

from dataclasses import replace

import numpy as np
import pytest
from peers.gough_stewart import gough_stewart

from robot_dynamics import Dynamics, InvalidInputError, frequency_map
from robot_dynamics.parallel.platform_dynamics import pose_from_coordinates
from robot_dynamics.parallel.pose_map import pose_map

DYNAMICS = Dynamics(gough_stewart())


@pytest.mark.slow
def test_map_entries_agree_with_single_poses():
    fractions = []
    axes = {"x": np.linspace(-0.2, 0.2, 3), "yaw": np.linspace(-0.4, 0.4, 4)}
    actual = pose_map(DYNAMICS, axes, {"z": 0.85}, [0, 0, 1, 0, 0, 0], fractions.append)
    assert actual.within_limits.shape == actual.condition_number.shape == (3, 4) and actual.efforts.shape == (3, 4, 6)
    assert fractions[-1] == 1.0 and actual.within_limits.all()
    for row, x in enumerate(axes["x"]):
        for column, yaw in enumerate(axes["yaw"]):
            pose = pose_from_coordinates(np.array([x, 0, 0.85, yaw, 0, 0]))
            expected = DYNAMICS.platform.inverse(pose, None, [0, 0, 1, 0, 0, 0])
            np.testing.assert_allclose(actual.efforts[row, column], expected, rtol=1e-9)
            J = DYNAMICS.platform.jacobian(DYNAMICS.platform.joint_positions(pose))
            unit = DYNAMICS.robot.characteristic_length
            world = np.kron(np.eye(2), pose[:3, :3])  # at pitch and roll zero rates of coordinates are along these axes
            scaled = np.diag([1, 1, 1, unit, unit, unit]) @ world @ J
            assert actual.condition_number[row, column] == pytest.approx(np.linalg.cond(scaled), rel=1e-6)


def test_poses_out_of_reach_are_nan():
    robot = gough_stewart()
    limited = [
        replace(joint, limits=replace(joint.limits, lower=0.5, upper=1.0)) if joint.actuated else joint
        for joint in robot.joints
    ]
    actual = pose_map(Dynamics(replace(robot, joints=tuple(limited))), {"z": np.array([0.2, 0.8, 3.0])})
    assert actual.within_limits.tolist() == [False, True, False]
    assert np.isnan(actual.efforts[[0, 2]]).all() and np.isfinite(actual.efforts[1]).all()


def test_robot_in_place_of_its_dynamics_is_refused():
    for function in (pose_map, frequency_map):
        with pytest.raises(InvalidInputError, match=r"a map is of Dynamics\(robot\), not of Robot\("):
            function(DYNAMICS.robot, {"x": [0.0]})


def test_unknown_coordinate_is_refused():
    with pytest.raises(InvalidInputError, match="unknown coordinate of a platform 'q'"):
        pose_map(DYNAMICS, {"q": np.zeros(2)})
