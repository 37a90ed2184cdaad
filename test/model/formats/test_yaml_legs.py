"""Legs and platforms in MDH tables: what a short one means, that all of it is written, and how mistakes are told."""

import math
from dataclasses import replace

import numpy as np
import pytest

from robot_dynamics import DescriptionError, Dynamics
from robot_dynamics.model.formats.mdh_yaml.reader import read_mdh_yaml
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.formats.par.writer import find_losses as par_losses
from robot_dynamics.model.formats.urdf.writer import find_losses as urdf_losses
from robot_dynamics.model.joint import Limits
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.model.minimal_frames import minimal_frames, snap_angles
from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw
from robot_dynamics.model.platform import COORDINATES, Platform

PLANAR = """\
robot: planar
parameters: {l: 0.5, w: 2}
base: {link: ground}
joints:
  - {joint: lift, link: rail, type: prismatic, mass: 1}
legs:
  - joints:
      - {link: foot, type: fixed, named: false}
      - {joint: hip, link: thigh, mdh: {theta: pi/2}, mass: 1, initial_position: w/10}
      - {joint: knee, link: shin, mdh: {d: l}, role: passive, mass: w, initial_position: -0.3}
      - {link: toe, type: fixed, mdh: {d: l}}
      - {joint: geared, link: gear, antecedent: foot, mimic: {joint: hip, multiplier: -1}, mass: 1}
    end: {joint: ankle, moved: {antecedent: toe}, viscous_friction: 0.1}
    copies:
      - {base: {xyz: [0.5, 0, 0]}, platform: {xyz: [0.2, 0, 0]}}
      - suffix: _left
        base: {xyz: [-0.5, 0, 0]}
        platform: {mdh: {gamma: pi, d: 0.2}}
        parameters: {w: 3}
  - joints:
      - {joint: slide, link: rod, type: prismatic, mdh: {alpha: -pi/2}, role: passive, initial_position: 0.9, mass: 1}
    ends:
      - {joint: pin, type: spherical}
      - joint: peg
        type: revolute
        link: pegged
        moved: {xyz: [0, 0, 0.1], rpy: [pi/2, 0, 0]}
        closed_on: {xyz: [0, 0.1, 0]}
    copies:
      - {suffix: _a, base: {antecedent: rail}}
platform:
  link: plate
  mass: 2
  centre_of_mass: [0.01, 0, 0]
  central_inertia: {zz: 0.1, xx: 0.05, yy: 0.05}
  free: [x, y, yaw]
  initial: {xyz: [0.1, 0.9, 0], rpy: [0, 0, 0.2]}
  limits: {x: {lower: -0.1, upper: l}}
frames:
  - {frame: tool, link: plate, xyz: [0, 0, 0.3]}
  - {frame: tip, link: shin_left, xyz: [l, 0, 0]}
"""


def test_each_copy_of_a_leg_is_a_branch_with_a_suffix():
    robot = read_mdh_yaml(PLANAR)
    coordinates = [f"plate_{name}" for name in COORDINATES]
    right, left = ([f"{name}{suffix}" for name in ("hip", "knee", "geared")] for suffix in ("_1", "_left"))
    names = [joint.name for joint in robot.joints]
    assert names == [*coordinates, "lift", *right, *left, "slide_a", "ankle_1", "ankle_left", "peg_a"]
    links = [link.name for link in robot.links]
    bodies = ["rail", "thigh_1", "shin_1", "gear_1", "thigh_left", "shin_left", "gear_left", "rod_a"]
    assert links[1:] == [*coordinates[:5], "plate", *bodies, "ankle_1_link", "ankle_left_link", "pegged_a"]
    carriers = {joint.name: links[joint.antecedent] for joint in robot.joints}
    assert (carriers["hip_left"], carriers["knee_left"], carriers["geared_left"]) == ("ground", "thigh_left", "ground")
    assert carriers["slide_a"] == "rail" and carriers["ankle_left"] == "shin_left" and carriers["peg_a"] == "rod_a"
    assert robot.joints[robot.joint_numbers["geared_left"]].mimic.joint == "hip_left"
    assert [loop.name for loop in robot.loops] == ["ankle_1", "ankle_left", "pin_a", "peg_a"]
    assert [loop.is_spherical for loop in robot.loops] == [False, False, True, False]
    assert {"toe_1", "toe_left", "tool", "tip"} <= robot.frames_by_name.keys() and "foot_1" not in robot.frames_by_name


def test_base_and_platform_of_a_copy_place_its_ends():
    robot = read_mdh_yaml(PLANAR)
    hip = robot.joints[robot.joint_numbers["hip_left"]]
    np.testing.assert_allclose(
        hip.placement, placement_from_mdh(MDHParameters(theta=math.pi / 2)) + _moved(-0.5), atol=1e-15
    )
    plate = robot.frame("plate").placement
    ankle, peg = (next(loop for loop in robot.loops if loop.name == name) for name in ("ankle_left", "peg_a"))
    np.testing.assert_allclose(
        ankle.closed_on.placement, plate @ placement_from_mdh(MDHParameters(gamma=math.pi, d=0.2)), atol=1e-15
    )
    np.testing.assert_allclose(peg.closed_on.placement, plate @ placement(translation=[0, 0.1, 0]), atol=1e-15)
    knee, cut = (robot.joints[robot.joint_numbers[name]] for name in ("ankle_left", "peg_a"))
    np.testing.assert_allclose(knee.placement, placement(translation=[0.5, 0, 0]), atol=1e-15)
    turned = placement(rotation_from_roll_pitch_yaw(math.pi / 2, 0, 0), [0, 0, 0.1])
    np.testing.assert_allclose(cut.placement, turned, atol=1e-15)
    assert knee.viscous_friction == 0.1


def _moved(x):
    matrix = np.zeros((4, 4))
    matrix[0, 3] = x
    return matrix


def test_parameters_of_a_copy_apply_to_it_alone():
    robot = read_mdh_yaml(PLANAR)
    masses = [robot.links[robot.frame(name).link].inertia.mass for name in ("shin_1", "shin_left")]
    starts = [robot.joints[robot.joint_numbers[name]].initial_position for name in ("hip_1", "hip_left")]
    assert masses == [2, 3] and starts == [0.2, 0.3]
    assert [link.inertia.mass for link in read_mdh_yaml(PLANAR, values={"w": 7}).links if "shin" in link.name] == [7, 3]


def test_platform_is_described_in_its_own_frame():
    robot = read_mdh_yaml(PLANAR)
    assert robot.platform == Platform(6, (0, 1, 2, 3, 4, 5), ("x", "y", "yaw"))
    assert [joint.initial_position for joint in robot.joints[:6]] == pytest.approx([0.1, 0.9, 0, 0.2, 0, 0])
    assert robot.joints[0].limits == Limits(-0.1, 0.5) and robot.joints[1].limits == Limits()
    own = np.linalg.inv(robot.frame("plate").placement)
    body = robot.links[6].inertia.transformed_by(own)
    np.testing.assert_allclose([body.mass, *body.first_moments], [2, 0.02, 0, 0], atol=1e-15)
    np.testing.assert_allclose(np.diagonal(body.second_moments), [0.05, 0.0502, 0.1002], atol=1e-15)
    tool = own @ robot.frame("tool").placement
    np.testing.assert_allclose(tool, placement(translation=[0, 0, 0.3]), atol=1e-15)


@pytest.mark.parametrize("change", [lambda robot: robot, minimal_frames, lambda robot: snap_angles(robot, 1e-3)])
def test_robot_is_the_same_when_written_and_read(change):
    robot = change(read_mdh_yaml(PLANAR))
    again = read_mdh_yaml(write_mdh_yaml(robot))
    assert again.platform == robot.platform
    assert [joint.name for joint in again.joints] == [joint.name for joint in robot.joints]
    assert [joint.limits for joint in again.joints] == [joint.limits for joint in robot.joints]
    assert again.frames_by_name.keys() == robot.frames_by_name.keys()
    for frame in robot.frames:
        np.testing.assert_allclose(again.frame(frame.name).placement, frame.placement, rtol=0, atol=1e-15)
    for loop, same in zip(robot.loops, again.loops, strict=True):
        assert [end.link for end in loop.ends] == [
            end.link for end in same.ends
        ] and loop.is_spherical == same.is_spherical
        for end, same_end in zip(loop.ends, same.ends, strict=True):
            np.testing.assert_allclose(same_end.placement, end.placement, rtol=0, atol=1e-15)


def test_coordinates_place_the_named_frame_of_the_platform_in_any_link_frames():
    robot = read_mdh_yaml(PLANAR)
    alone = replace(robot, loops=())
    rng = np.random.default_rng(0)
    for variant in (
        alone,
        minimal_frames(alone),
        replace(read_mdh_yaml(write_mdh_yaml(minimal_frames(robot))), loops=()),
    ):
        dynamics = Dynamics(variant, compiled=False)
        q = rng.uniform(-1, 1, (10, len(dynamics.joint_names)))
        poses = q[:, [dynamics.joint_names.index(f"plate_{name}") for name in COORDINATES]]
        for pose, (x, y, z, yaw, pitch, roll) in zip(dynamics.link_pose("plate", q), poses, strict=True):
            expected = placement(rotation_from_roll_pitch_yaw(roll, pitch, yaw), [x, y, z])
            np.testing.assert_allclose(pose, expected, rtol=0, atol=1e-14)


def test_platform_is_listed_as_lost_in_other_formats():
    robot = read_mdh_yaml(PLANAR)
    assert any("'plate' is the platform, free to move in x, y, yaw" in loss for loss in par_losses(robot))
    assert any("'plate' is the platform, free to move in x, y, yaw" in loss for loss in urdf_losses(robot))


@pytest.mark.parametrize(("kept", "message"), [(0, "no leg holds it"), (1, "only one leg holds it")])
def test_platform_on_fewer_than_two_legs_causes_a_warning(kept, message):
    robot = read_mdh_yaml(PLANAR)
    loose = replace(robot, loops=robot.loops[:kept])
    assert any(message in warning for warning in loose.warnings)
    assert not any("holds it" in warning for warning in robot.warnings)


def test_joints_list_may_be_absent_beside_legs():
    text = PLANAR[: PLANAR.index("joints:")] + PLANAR[PLANAR.index("legs:") :].replace("antecedent: rail", "")
    assert [joint.name for joint in read_mdh_yaml(text).joints][6] == "hip_1"


MISTAKES = {
    "no platform": (PLANAR[PLANAR.index("platform:\n") : PLANAR.index("frames:")], "", 7, 3, "platform missing: the"),
    "platform without inertia": (
        PLANAR[PLANAR.index("  mass: 2\n  centre") : PLANAR.index("  free:")],
        "",
        32,
        3,
        "platform 'plate' has no inertia: mass missing",
    ),
    "unknown base": ("antecedent: rail", "antecedent: rial", 30, 41, "unknown link 'rial': did you mean 'rail'"),
    "base that is a joint": ("antecedent: rail", "antecedent: lift", 30, 41, "'lift' is a joint: it moves 'rail'"),
    "unknown link in a leg": ("antecedent: foot", "antecedent: feet", 12, 49, "unknown link 'feet'"),
    "neither end nor ends": (
        "    end: {joint: ankle, moved: {antecedent: toe}, viscous_friction: 0.1}\n",
        "",
        7,
        5,
        "either end is needed, or ends",
    ),
    "copies of one name": ("suffix: _left", "suffix: _1", 16, 17, "suffix '_1' is already used"),
    "name of the platform taken": ("link: plate\n", "link: rail\n", 5, 25, "link or frame 'rail' is already defined"),
    "unknown parameter": ("parameters: {w: 3}", "parameters: {v: 3}", 19, 25, "unknown parameter 'v'"),
    "unknown coordinate": ("free: [x, y, yaw]", "free: [x, y, phi]", 36, 16, "is none of x, y, z, yaw, pitch, roll"),
    "coordinate twice": ("free: [x, y, yaw]", "free: [x, y, x]", 36, 9, "a list of the coordinates"),
    "nothing free": ("free: [x, y, yaw]", "free: []", 36, 9, "a list of the coordinates"),
    "motor at the end": (
        "joint: ankle,",
        "joint: ankle, role: actuated,",
        13,
        31,
        "joint 'ankle_1' cannot be actuated",
    ),
    "friction of a ball": (
        "joint: pin, type: spherical",
        "joint: pin, type: spherical, limits: {}",
        23,
        47,
        "no joint vari",
    ),
    "frame of the platform": ("frame: tool", "frame: plate", 40, 13, "link or frame 'plate' is already defined"),
    "two ways to say a place": (
        "gamma: pi, d: 0.2}}",
        "d: 1}, xyz: [0, 0, 0]}",
        18,
        38,
        "mdh and xyz exclude each other",
    ),
    "degrees": ("rpy: [0, 0, 0.2]", "rpy: [0, 0, 20]", 37, 45, "radians(20)"),
    "leader": ("mimic: {joint: hip,", "mimic: {joint: hop,", 12, 70, "unknown joint 'hop': known are"),
    "limits": ("{lower: -0.1, upper", "{lower: inf, upper", 38, 23, "unknown name 'inf'"),
    "strange key": ("    copies:\n      - {suffix", "    placed:\n      - {suffix", 29, 5, "unknown key 'placed'"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_malformed_table_is_refused_with_line_column_and_remedy(mistake):
    wrong, right, line, column, reason = MISTAKES[mistake]
    text = PLANAR.replace(wrong, right, 1)
    assert text != PLANAR
    with pytest.raises(DescriptionError) as refusal:
        read_mdh_yaml(text, source="legs.yaml")
    message = str(refusal.value)
    assert reason in message and message.startswith(f"legs.yaml, line {line}, column {column}: "), message


WRITTEN = {
    "unknown joint": ("coordinates: [plate_x", "coordinates: [plate_w", "unknown joint 'plate_w'"),
    "another order": (
        "coordinates: [plate_x, plate_y",
        "coordinates: [plate_y, plate_x",
        "in their order, must connect",
    ),
    "too few": ("coordinates: [plate_x, ", "coordinates: [", "5 entries: a list of 6 joints"),
    "body told twice": ("\n  coordinates:", "\n  mass: 1\n  coordinates:", "coordinate joints: omit it here"),
    "unknown link": ("platform:\n  link: plate", "platform:\n  link: palte", "unknown link 'palte'"),
    "another link": ("platform:\n  link: plate", "platform:\n  link: rail", "the six joints of its coordinates"),
    "motor": ("role: passive\n    limits: {lower: -0.1, upper: 0.5}", "limits: {}", "have neither motors nor springs"),
    "axes": ("link: plate_y\n    antecedent: plate_x\n    type: prismatic\n    mdh: {gamma: pi/2", "", ""),
}


@pytest.mark.parametrize("mistake", WRITTEN)
def test_malformed_coordinate_rows_are_refused_with_a_reason(mistake):
    wrong, right, reason = WRITTEN[mistake]
    text = write_mdh_yaml(read_mdh_yaml(PLANAR))
    if mistake == "axes":
        wrong = text[text.index("joint: plate_yaw") : text.index("joint: plate_pitch")]
        right, reason = (
            wrong.replace("mdh: {", "mdh: {b: 0.1, "),
            "must slide along x, y and z of the base and then turn",
        )
    assert text.replace(wrong, right, 1) != text
    with pytest.raises(DescriptionError, match=reason):
        read_mdh_yaml(text.replace(wrong, right, 1))
