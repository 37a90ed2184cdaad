"""The robots that ship have the figures of their sources, checked against numbers printed elsewhere."""

import numpy as np
import pytest
from peers.reachable import reachable

from robot_dynamics import DescriptionError, Dynamics, load_robot, shipped_robots


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_robots())
def test_robot_loads_and_both_models_agree(name):
    robot = load_robot(name)
    dynamics = Dynamics(robot)
    if robot.moving_base:
        return
    rng, count = np.random.default_rng(0), len(dynamics.joint_names)
    q, qd, qdd = rng.uniform(-1, 1, (3, 20, count))
    if robot.loops:
        q = reachable(dynamics, 20, rng)
    qdd[:, [dynamics.joint_names.index(name) for name in dynamics.unactuated_joint_names]] = np.nan
    result = dynamics.solve(q, qd, qdd=qdd)
    np.testing.assert_allclose(dynamics.direct(q, qd, result.efforts), result.accelerations, rtol=1e-7, atol=1e-7)


def test_puma_has_its_measured_gravity_constants():
    """g1..g5 [N m] of Armstrong, Khatib and Burdick 1986, Table A: gravity of joint 2 is g1 cos θ2 + g3 sin θ2
    + g2 sin θ23 + g4 cos θ23 + ..., measured with the motors off; -37.2, -8.44, 1.02, 0.249, -0.0282."""
    dynamics = Dynamics(load_robot("puma560"))

    def gravity(theta2, theta23, theta5=0.0):
        return dynamics.gravity([0, theta2, theta23 - theta2, 0, theta5, 0])

    right = np.pi / 2
    g4 = gravity(0, 0)[2]
    g2 = gravity(0, right)[2]
    g1 = gravity(0, 0)[1] - g4
    g3 = gravity(right, 0)[1] - g4
    g5 = gravity(0, 0, right)[4]
    np.testing.assert_allclose([g1, g2, g3, g4], [-37.2, -8.44, 1.02, 0.249], rtol=0.02)
    assert abs(abs(g5) - 0.0282) < 5e-4


def test_rx90_is_balanced_by_its_spring():
    """The balancing spring of joint 2 bears about 176 N m with the arm level and the forearm upright (the law and the
    figures of the spring in the same source): gravity of joint 2 is within 3 % of it."""
    stretched = np.hypot(0.06, 0.45)
    spring = 0.06 * 0.45 * (20295.0 - 6257.75 / stretched)
    gravity = Dynamics(load_robot("rx90")).gravity(np.zeros(6))[1]
    assert abs(gravity / spring - 1) < 0.03


def test_manutec_has_the_composite_inertia_of_the_dfvlr_model():
    """Links 3 to 5 about joint 3, wrist straight: xx, yy, zz 7.870, 0.437, 8.108 kg m² and 60.3 kg in the model R3M2SI
    of DFVLR, which has another origin than the figures here; its axes are x along joint 3's, z along the forearm."""
    robot = load_robot("manutec_r3")
    poses = [Dynamics(robot).link_pose(f"link_{k}", np.zeros(9)) for k in (3, 4, 5)]
    link_3 = np.linalg.inv(poses[0])
    bodies = [
        robot.links[number].inertia.transformed_by(link_3 @ pose) for number, pose in zip((6, 7, 8), poses, strict=True)
    ]
    whole = bodies[0] + bodies[1] + bodies[2]
    assert whole.mass == pytest.approx(60.3)
    moments = sorted(np.diagonal(whole.second_moments))
    np.testing.assert_allclose(moments, [0.437, 7.870, 8.108], rtol=0.02)


def test_gears_of_the_manutec_deflect_under_its_weight():
    """With a horizontal arm each gear deflects by its load divided by its stiffness, less than 1.5 mrad."""
    dynamics = Dynamics(load_robot("manutec_r3"))
    q = np.zeros(9)
    q[2] = np.pi / 2
    equilibrium = dynamics.equilibrium(q)
    for motor, spring, stiffness in ((0, 1, 43 * 105**2), (2, 3, 8 * 210**2), (4, 5, 58 * 60**2)):
        assert equilibrium.positions[spring] * stiffness == pytest.approx(-equilibrium.efforts[motor], abs=1e-6)
    assert equilibrium.stable and 1e-3 < np.abs(equilibrium.positions[[1, 3, 5]]).max() < 5e-3


@pytest.mark.parametrize(
    ("path", "hint"),
    [
        ("panda.urdf", "The robot that ships is named 'panda', without a folder or a suffix"),
        ("config/panda.yaml", "The robot that ships is named 'panda', without"),
        ("PUMA560.par", "The robot that ships is named 'puma560', without"),
        ("pandas.urdf", "did you mean 'panda'?"),
        ("/nowhere/ur5.urdf", "Did you mean the robot 'ur5e' that ships?"),
    ],
)
def test_misspelt_path_leads_to_the_shipped_robot(path, hint):
    with pytest.raises(DescriptionError, match="cannot be read as a file") as refused:
        load_robot(path)
    assert hint in str(refused.value)


def test_existing_file_and_unlike_names_cause_no_hint(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "panda.urdf").write_text("")
    for path in ("panda.urdf", "/nowhere/something_else.urdf"):
        with pytest.raises(DescriptionError) as refused:
            load_robot(path)
        assert "ship" not in str(refused.value)
