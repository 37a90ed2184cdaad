"""The Delta and the Gough-Stewart platform beside MuJoCo, which closes their legs by equality constraints."""

import mujoco_loops
import numpy as np
import pytest
from peers.platform_states import random_states

from robot_dynamics import Dynamics, load_robot

COUNT = 100
# Its constraints give way by what the impedance lacks of 1, 1e-4 at least: by these parts of what they change in the
# accelerations, most where the two bars of an arm of the Delta hold the platform level.
COMPLIANCE = {"delta": 1e-2, "gough_stewart": 2e-4}
RIGID = {"delta": 1e-4, "gough_stewart": 1e-7}  # the same, extrapolated from two impedances to 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["delta", "gough_stewart"])
def test_both_models_agree_with_mujoco_within_its_constraint_compliance(name):
    dynamics = Dynamics(load_robot(name), compiled=False)
    states = random_states(dynamics, COUNT, np.random.default_rng(8))
    pose, twist, acceleration = (next(iter(part.values())) for part in states[:3])
    q, qd, qdd = dynamics.platform.joint_motion(pose, twist, acceleration)
    n = [dynamics.robot.joint_numbers[joint] for joint in dynamics.joint_names]
    efforts = dynamics.inverse(q, qd[:, n], qdd[:, n])
    peer = mujoco_loops.MujocoLoops(dynamics.robot, dynamics.initial_joint_positions)
    motor_rows = [peer.dof_indices[peer.kept_joints.index(number)] for number in n]
    passive = np.setdiff1d(np.arange(peer.model.nv), motor_rows)
    worst = []
    for k in range(COUNT):
        state, accelerations = (peer.to_mujoco_order(q[k]), peer.to_mujoco_order(qd[k])), peer.to_mujoco_order(qdd[k])
        # constraints bear the forces of its inverse at passive joints: the motors have no softness left
        forces, J = peer.inverse(*state, accelerations).copy(), peer.jacobian(state[0])
        multipliers = np.linalg.lstsq(J[:, passive].T, forces[passive], rcond=None)[0]
        actual = forces[motor_rows] - J[:, motor_rows].T @ multipliers
        np.testing.assert_allclose(actual, efforts[k], rtol=0, atol=1e-9 * np.abs(efforts[k]).max())
        arguments, soft = (*state, peer.to_mujoco_order(dynamics.embed_efforts(efforts[k]))), []
        for softness in (2e-4, 1e-4):
            peer.model.eq_solimp[:, :2] = 1 - softness
            soft.append(peer.direct(*arguments).copy())
        change = np.abs(accelerations - peer.free()).max()
        worst.append([np.abs(actual - accelerations).max() / change for actual in (soft[1], 2 * soft[1] - soft[0])])
    assert np.all(np.max(worst, axis=0) < [COMPLIANCE[name], RIGID[name]])
