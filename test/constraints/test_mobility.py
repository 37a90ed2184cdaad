"""Mobility of robots with loops: independent joints, refused motors, singular positions and assembly modes."""

from dataclasses import replace

import numpy as np
import pytest
from peers.five_bar import random_five_bar
from peers.four_bar import random_four_bar
from peers.loop_states import mobility
from peers.random_loops import random_loops

from robot_dynamics import DescriptionError, Dynamics, InvalidInputError, SingularModelError, load_robot
from robot_dynamics.constraints.closure_search import find_widest_loop
from robot_dynamics.constraints.loop_equations import equations_per_loop
from robot_dynamics.model.joint import Mimic, Spring
from robot_dynamics.model.loop import Loop, LoopEnd
from robot_dynamics.model.placement import placement


def with_joint(robot, name, **changes):
    joints = [replace(joint, **changes) if joint.name == name else joint for joint in robot.joints]
    return replace(robot, joints=tuple(joints))


@pytest.mark.parametrize("seed", range(40))
def test_independent_joints_are_as_many_as_the_mobility(seed):
    looped = random_loops(seed)
    dynamics = Dynamics(looped.robot, compiled=False)
    assert len(dynamics.joint_names) == mobility(looped.robot, looped.q)
    assert sorted(dynamics.dependent_joint_names) == sorted(looped.robot.joints[k].name for k in looped.dependents)


def test_one_motor_too_many_is_refused():
    robot = with_joint(load_robot("four_bar"), "coupler", actuated=True)
    with pytest.raises(DescriptionError, match=r"mobility 1 and 2 motors: 'crank', 'coupler' cannot move independent"):
        Dynamics(robot)


def test_one_motor_too_few_is_refused_with_the_mobility():
    robot = with_joint(load_robot("five_bar"), "right_crank", actuated=False)
    with pytest.raises(
        DescriptionError, match=r"mobility 2 and 1 motors: with 'left_crank' locked, passive joints can"
    ):
        Dynamics(robot)


def test_loops_without_motor_are_refused():
    robot = with_joint(load_robot("four_bar"), "crank", actuated=False)
    with pytest.raises(DescriptionError, match=r"mobility 1 and 0 motors: with no joint locked"):
        Dynamics(robot)


def test_motors_that_depend_on_each_other_are_refused():
    """Every pair of joints of a five-bar may be actuated; of the squeezer's joints only one."""
    robot = load_robot("five_bar")
    tree = Dynamics(replace(robot, loops=()), compiled=False)
    assert len(tree.joint_names) == 5
    for pair in (("left_rod", "apex"), ("left_crank", "left_rod"), ("right_rod", "apex")):
        actuated_pair = replace(
            robot, joints=tuple(replace(joint, actuated=joint.name in pair) for joint in robot.joints)
        )
        assert set(Dynamics(actuated_pair).joint_names) == set(pair)
    squeezer = load_robot("andrews_squeezer")
    with pytest.raises(DescriptionError, match="mobility 1 and 2 motors"):
        Dynamics(with_joint(squeezer, "omega", actuated=True))


def test_elastic_joint_is_independent_where_motors_are_too_few():
    robot = with_joint(load_robot("five_bar"), "right_crank", actuated=False, spring=Spring(100.0, rest=np.pi))
    dynamics = Dynamics(robot)
    assert dynamics.joint_names == ("left_crank", "right_crank")
    assert dynamics.unactuated_joint_names == ("right_crank",)


def test_elastic_joints_in_excess_of_the_mobility_are_dependent():
    robot = with_joint(load_robot("five_bar"), "right_crank", actuated=False, spring=Spring(100.0, rest=np.pi))
    robot = with_joint(robot, "right_rod", spring=Spring(100.0))
    dynamics = Dynamics(robot)
    assert len(dynamics.joint_names) == 2 and len(dynamics.unactuated_joint_names) == 1
    assert set(dynamics.dependent_joint_names) > {"left_rod", "apex"}


@pytest.mark.parametrize("make", [random_four_bar, random_five_bar])
def test_elastic_joints_that_motors_determine_are_dependent(make):
    linkage = make(2, springs=True)
    robot = linkage.robot(linkage.independent)
    names = tuple(robot.joints[number].name for number in linkage.independent)
    assert Dynamics(robot).joint_names == names


def test_loop_that_cannot_close_is_refused_with_its_gap():
    robot = load_robot("four_bar")
    loop = robot.loops[0]
    far_end = LoopEnd(loop.closed_on.link, placement(translation=(50.0, 0.0, 0.0)))
    with pytest.raises(DescriptionError, match=rf"the ends of loop '{loop.name}' stay [0-9.]+ m and [0-9.]+ rad apart"):
        Dynamics(replace(robot, loops=(replace(loop, closed_on=far_end),)))


def test_nearly_parallel_axes_are_named_in_the_error():
    """A URDF's 1.5708 for pi/2: the ends of a planar loop stay micrometres apart."""
    robot = load_robot("four_bar")
    joint = robot.joints[robot.joint_numbers["rocker"]]
    tilt = np.eye(4)
    tilt[1:3, 1:3] = [[np.cos(4e-6), -np.sin(4e-6)], [np.sin(4e-6), np.cos(4e-6)]]
    with pytest.raises(DescriptionError, match="parallel must be so to the last digit"):
        Dynamics(with_joint(robot, "rocker", placement=joint.placement @ tilt))


def test_widest_loop_has_its_gap_in_metres_and_radians():
    robot = load_robot("irb460")
    rows, unit = equations_per_loop(robot), robot.characteristic_length
    assert len(rows) > 2 and unit != 1
    for number, loop in enumerate(robot.loops):
        residual = np.full(sum(rows), 1e-3)
        start = sum(rows[:number])
        residual[start : start + rows[number]] = np.array([0.03, 0, 0.04, 0, 0, 2 * np.tan(0.35)])[: rows[number]]
        name, distance, angle = find_widest_loop(robot, residual)
        assert name == loop.name and distance == pytest.approx(0.05 * unit, rel=1e-12)
        assert loop.is_spherical or angle == pytest.approx(0.7, rel=1e-12)


@pytest.mark.parametrize("angle", [1e-2, 1e-3, 1e-4])
def test_rates_of_a_parallelogram_near_its_dead_centre(angle):
    """Its coupler does not rotate: exact rates and accelerations, at condition numbers of the loop of 1e3 to 1e5."""
    linkage = replace(random_four_bar(1), crank=0.3, coupler=0.8, rocker=0.3, ground=0.8)
    dynamics = Dynamics(linkage.robot((1.0,)))
    q = dynamics.expand_positions([angle])
    rounding = 1e-15 / angle**2
    np.testing.assert_allclose(q[:3], [angle, -angle, angle], rtol=0, atol=rounding * angle)
    np.testing.assert_allclose(dynamics.expand_velocities([2.0], q), [2, -2, 2, 2], atol=10 * rounding)
    np.testing.assert_allclose(dynamics.expand_accelerations([3.0], q, [2.0]), [3, -3, 3, 3], atol=500 * rounding)


def test_positions_out_of_reach_are_refused_with_loop_and_condition():
    robot = load_robot("four_bar")
    lengths = {joint.name: joint for joint in robot.joints}
    short = placement(translation=(0.5 * np.linalg.norm(lengths["coupler"].placement[:3, 3]), 0, 0))
    shorter = replace(robot, loops=tuple(replace(loop, closed_on=LoopEnd(loop.closed_on.link,
        loop.closed_on.placement @ short)) for loop in robot.loops))  # fmt: skip
    dynamics = Dynamics(shorter)
    message = None
    for angle in np.linspace(-np.pi, np.pi, 40):
        try:
            dynamics.expand_positions([angle])
        except SingularModelError as error:
            message = str(error)
    if message is not None:
        assert f"loop {robot.loops[0].name!r}" in message and "condition number" in message


def test_dead_centre_of_a_parallelogram_is_refused_with_its_condition():
    """All four links on one line: the positions do not determine whether the parallelogram crosses."""
    linkage = replace(random_four_bar(1), crank=0.3, coupler=0.8, rocker=0.3, ground=0.8)
    dynamics = Dynamics(linkage.robot((1.0,)))
    with pytest.raises(SingularModelError, match=r"loop '[a-z_]+' is singular.*condition number [0-9.e+]+"):
        dynamics.inverse([0.0, 0.0, 0.0, 0.0], [1.0], [0.0])


def test_mimic_joint_in_a_loop_moves_with_its_leader():
    robot = load_robot("five_bar")
    first = robot.joints[0]
    gear = with_joint(robot, "right_crank", mimic=Mimic(first.name, -1.0, np.pi))
    dynamics = Dynamics(gear)
    assert dynamics.joint_names == ("left_crank",)
    q = dynamics.expand_positions([0.2])
    assert q[dynamics.all_joint_names.index("right_crank")] == pytest.approx(np.pi - 0.2, abs=1e-12)


def test_loops_with_repeated_names_or_invalid_ends_are_refused():
    robot = load_robot("four_bar")
    loop = robot.loops[0]
    with pytest.raises(DescriptionError, match="more than once"):
        replace(robot, loops=(loop, loop))
    with pytest.raises(DescriptionError, match="on link 5, of 0 to 4"):
        replace(robot, loops=(Loop("other", LoopEnd(5, np.eye(4)), LoopEnd(0, np.eye(4))),))
    with pytest.raises(DescriptionError, match="closes nothing"):
        replace(robot, loops=(Loop("other", LoopEnd(1, np.eye(4)), LoopEnd(1, np.eye(4))),))


# two motors at the base, one of them through a parallelogram: the forearm stays opposite to the second one
ARM = """\
robot: arm
parameters: {l: 0.5, c: 0.15}
joints:
  - {joint: m1, link: upper, mdh: {alpha: pi/2}, mass: 2, first_moments: [l, 0, 0]}
  - {joint: elbow, link: fore, mdh: {d: l}, role: passive, initial_position: -pi/2, mass: 1}
  - {joint: m2, link: crank, antecedent: base_link, mdh: {alpha: pi/2}, mass: 1}
  - {joint: pin, link: rod, mdh: {d: c}, role: passive, initial_position: -pi/2, mass: 1}
loops:
  - joint: rear
    moved: {antecedent: rod, xyz: [l, 0, 0]}
    closed_on: {antecedent: fore, xyz: [-c, 0, 0]}
"""


def mode_deviation(q):
    """(...) distance of the forearm of ARM from the direction opposite to the second motor [0 to 2]."""
    return np.abs(np.exp(1j * (q[..., 0] + q[..., 1])) + np.exp(1j * q[..., 2]))


@pytest.mark.slow
def test_positions_beyond_a_singular_position_keep_the_mode_or_are_refused():
    """A parallelogram may cross where all links are on one line: positions beyond keep its mode, or are refused."""
    dynamics = Dynamics(load_robot(ARM), compiled=False)
    refusals = 0
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (100, 2)):
        try:
            assert mode_deviation(dynamics.expand_positions(q)) < 1e-9
        except SingularModelError as error:
            assert "another assembly mode" in str(error) or "is singular" in str(error)
            refusals += 1
    assert 33 < refusals < 67  # samples beyond the singular position


@pytest.mark.parametrize("samples", [20, 50, 200, 201, 1000])
@pytest.mark.parametrize("to", [(0.7, -1.0), (2.7, -2.5), (2.0, 1.0)])
def test_trajectories_keep_the_branch_through_singular_positions(samples, to):
    path = Dynamics(load_robot(ARM), compiled=False).expand_trajectory(np.linspace([0.7, 2.5], to, samples))
    assert mode_deviation(path).max() < 1e-8


def test_positions_next_to_a_singular_one_are_refused():
    """Positions there are closed to the last digit, but rounding decides the direction of rates."""
    dynamics = Dynamics(load_robot(ARM), compiled=False)
    with pytest.raises(SingularModelError, match="sample 19: it closes"):
        dynamics.expand_trajectory(np.linspace([0.7, 2.5], [0.7, 0.7], 20))
    crank = Dynamics(load_robot(SLIDER), compiled=False)
    with pytest.raises(SingularModelError, match="does not determine crank, pin, end"):
        crank.inverse([0.4], [0.0], [0.0])


@pytest.mark.parametrize("robot", [ARM, "four_bar", "irb460", "bricard"])
def test_positions_next_to_the_initial_ones_are_solved(robot):
    dynamics = Dynamics(load_robot(robot), compiled=False)
    columns = [dynamics.all_joint_names.index(name) for name in dynamics.joint_names]
    q = dynamics._closure_solver.closed_positions[columns]
    for shift in (0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3):
        np.testing.assert_allclose(dynamics.expand_positions(q + shift)[columns], q + shift, atol=1e-15)


@pytest.mark.parametrize("short", 10.0 ** -np.arange(1, 9))
def test_positions_up_to_a_dead_centre_are_solved(short):
    position = 0.4 - short
    (force,) = Dynamics(load_robot(SLIDER), compiled=False).inverse([position], [0.0], [0.0])
    angle = 2 * np.arcsin(np.sqrt((0.3**2 - (position - 0.1) ** 2) / (4 * 0.1 * position)))  # the half-angle formula
    slope = -0.1 * np.sin(angle) * (1 + 0.1 * np.cos(angle) / np.sqrt(0.3**2 - (0.1 * np.sin(angle)) ** 2))
    assert abs(force) == pytest.approx(abs(9.81 * 0.05 * np.cos(angle) / slope), rel=1e-6)


SLIDER = """\
robot: slider
joints:
  - {joint: crank, link: crank, mdh: {alpha: pi/2}, role: passive, mass: 1, first_moments: [0.05, 0, 0]}
  - {joint: pin, link: rod, mdh: {d: 0.1}, role: passive}
  - {joint: slide, type: prismatic, link: piston, antecedent: base_link, mdh: {gamma: pi/2, alpha: pi/2},
     initial_position: 0.3, mass: 2}
loops:
  - {joint: end, moved: {antecedent: rod, xyz: [0.3, 0, 0]}, closed_on: {antecedent: piston, rpy: [0, -pi/2, 0]}}
"""


@pytest.mark.parametrize(
    ("rpy", "message"),
    [
        ("", r"and 1\.57 rad apart; the axis of the joint at which a loop is cut is z of both its frames"),
        (", rpy: [0, pi/2, 0]", r"and 3\.14 rad apart; the axis of the joint at which a loop is cut is z of both"),
    ],
)
def test_misaligned_axes_of_a_cut_joint_are_named_in_the_error(rpy, message, recwarn):
    with pytest.raises(DescriptionError, match=message):
        Dynamics(load_robot(SLIDER.replace(", rpy: [0, -pi/2, 0]", rpy)))
    assert not recwarn.list


def test_immobile_loops_are_refused_with_a_hint_at_their_axes():
    lengthwise = SLIDER.replace("xyz: [0.3, 0, 0]", "xyz: [0.3, 0, 0], rpy: [0, pi/2, 0]").replace("-pi/2, 0]", "0, 0]")
    with pytest.raises(DescriptionError, match=r"mobility 0 and 1 motors.*a joint is missing, or an axis is wrong"):
        Dynamics(load_robot(lengthwise))


def test_wrong_number_of_positions_is_refused_with_both_valid_numbers():
    with pytest.raises(
        InvalidInputError, match=r"shape \(4,\): \(\.\.\., 2\) is needed.*or \(\.\.\., 5\), one for each of"
    ):
        Dynamics(load_robot(ARM)).expand_positions([0.7, -1.3, 2.5, -1.8])
