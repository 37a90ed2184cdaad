"""MDH tables in YAML: reading, and errors with line, column and remedy."""

import json
import math
import re
import time

import jsonschema
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robot_dynamics import DescriptionError, Dynamics, load_robot
from robot_dynamics.model.formats.mdh_yaml.reader import SCHEMA, read_mdh_yaml

PENDULUM = """\
robot: pendulum
parameters:
  l: 0.5
  m: 2*l          # refers to a name above
gravity: [0, -9.81, 0]
base: {link: ground}
joints:
  - joint: swing
    link: rod
    mdh: {alpha: 0, d: 0, theta: 0, r: 0}
    mass: m
    first_moments: [m*l/2, 0, 0]
    inertia: {yy: m*l^2/3, zz: m*l^2/3}
  - joint: slide
    link: slider
    type: prismatic
    mdh: {gamma: pi/6, b: 0.1, alpha: pi/2, d: l, theta: pi, r: 0.2}
    mass: 0.1
    role: elastic
    spring: {stiffness: 300, rest: 0.01, damping: 2}
frames:
  - {frame: tip, link: rod, xyz: [l, 0, 0], rpy: [0, 0, pi/2]}
"""


def test_short_table_is_read_as_expected():
    robot = read_mdh_yaml(PENDULUM)
    assert [joint.role for joint in robot.joints] == ["actuated", "elastic"]
    rod = robot.links[1].inertia
    assert rod.mass == 1 and rod.first_moments.tolist() == [0.25, 0, 0] and rod.second_moments[2, 2] == 0.25 / 3
    turn = Rotation.from_euler("z", math.pi / 6) * Rotation.from_euler("x", math.pi / 2)
    placed = robot.joints[1].placement
    np.testing.assert_allclose(placed[:3, 2], turn.apply([0, 0, 1]), atol=1e-15)
    np.testing.assert_allclose(placed[:3, 3] - [0, 0, 0.1], turn.apply([0.5, 0, 0.2]), atol=1e-15)
    dynamics = Dynamics(robot)
    np.testing.assert_allclose(dynamics.link_pose("tip", [0.4, 0])[:2, 3], [0.5 * math.cos(0.4), 0.5 * math.sin(0.4)])


def test_row_without_antecedent_is_placed_in_the_row_before():
    explicit = PENDULUM.replace("    link: slider\n", "    link: slider\n    antecedent: rod\n")
    assert (
        explicit != PENDULUM
        and read_mdh_yaml(explicit).joints[1].antecedent == read_mdh_yaml(PENDULUM).joints[1].antecedent
    )


@pytest.mark.parametrize("angle", ["4*pi/3+pi", "radians(420)", "-3*pi"])
def test_angle_of_more_than_a_turn_is_accepted_with_pi_or_radians(angle):
    value = eval(angle, {"pi": math.pi, "radians": math.radians})
    placed = read_mdh_yaml(PENDULUM.replace("rpy: [0, 0, pi/2]", f"rpy: [0, 0, {angle}]")).frame("tip").placement
    np.testing.assert_allclose(placed[:3, :3], Rotation.from_euler("z", value).as_matrix(), atol=1e-12)
    turned = read_mdh_yaml(PENDULUM.replace("theta: pi,", f"theta: {angle},")).joints[1].placement
    plain = read_mdh_yaml(PENDULUM.replace("theta: pi,", f"theta: {math.remainder(value, 2 * math.pi)},"))
    np.testing.assert_allclose(turned, plain.joints[1].placement, atol=1e-12)


def test_values_replace_parameters():
    longer = read_mdh_yaml(PENDULUM, values={"l": "3/4"})
    assert longer.links[1].inertia.mass == 1.5
    with pytest.raises(DescriptionError, match="unknown parameter 'L': known are l, m"):
        read_mdh_yaml(PENDULUM, values={"L": 1})


def test_inertia_about_the_centre_of_mass_is_the_same_body():
    """A rod of mass m and length l: m l²/12 about its centre is m l²/3 about its end."""
    central = PENDULUM.replace("first_moments: [m*l/2, 0, 0]", "centre_of_mass: [l/2, 0, 0]")
    central = central.replace("inertia: {yy: m*l^2/3, zz: m*l^2/3}", "central_inertia: {yy: m*l^2/12, zz: m*l^2/12}")
    actual, expected = (read_mdh_yaml(text).links[1].inertia.spatial for text in (central, PENDULUM))
    np.testing.assert_allclose(actual, expected, atol=1e-15)


def test_fixed_rows_are_lumped_and_remain_frames():
    text = PENDULUM + "  - {frame: rod, link: rod, xyz: [0, 0, 1]}\n"
    weight = """\
  - link: weight
    antecedent: rod
    type: fixed
    mdh: {d: l}
    mass: 3
"""
    robot = read_mdh_yaml(text.replace("frames:\n", weight + "frames:\n"))
    assert robot.links[1].inertia.mass == 4 and robot.links[1].inertia.first_moments[0] == 0.25 + 1.5
    assert robot.frame("weight").placement[0, 3] == 0.5 and robot.frame("weight").link == 1
    assert robot.frame("rod").placement[2, 3] == 1  # where wrenches on the rod are meant


MISTAKES = {
    "misspelt key": ("    mass: m\n", "    mas: m\n", 11, 5, "unknown key 'mas': did you mean 'mass'"),
    "misspelt key in a mapping": ("alpha: 0,", "alfa: 0,", 10, 11, "unknown key 'alfa': known are gamma, b, alpha"),
    "list too short": ("[m*l/2, 0, 0]", "[m*l/2, 0]", 12, 20, "2 entries: a list of 3 numbers, x, y, z is needed"),
    "list instead of a mapping": ("{link: ground}", "[ground]", 6, 7, "a mapping that describes link 0 is needed"),
    "unbound name": ("mass: m\n", "mass: mm\n", 11, 11, "unknown name 'mm'"),
    "name bound below": ("l: 0.5", "l: m", 3, 6, "only to those above it, not to m"),
    "expression that ends": ("pi/6", "pi/", 17, 18, "expression 'pi/': the end is not expected there"),
    "type that is none": ("type: prismatic", "type: sliding", 16, 11, "none of revolute, prismatic, fixed"),
    "spring without role": ("    role: elastic\n", "", 19, 13, "role missing: elastic"),
    "elastic without spring": ("    spring: {stiffness: 300, rest: 0.01, damping: 2}\n", "", 19, 11, "needs a spring"),
    "passive with spring": ("role: elastic", "role: passive", 19, 11, "a passive joint with a spring is elastic"),
    "negative stiffness": ("stiffness: 300", "stiffness: -300", 14, 5, "'slide': stiffness -300 is negative"),
    "negative mass": ("mass: 0.1", "mass: -0.1", 18, 11, "mass -0.1 kg is negative"),
    "key twice": ("    mass: 0.1\n", "    mass: 0.1\n    mass: 0.2\n", 19, 5, "'mass' is already present"),
    "antecedent below": ("link: rod\n", "link: rod\n    antecedent: slider\n", 10, 17, "unknown link 'slider'"),
    "link twice": ("link: slider", "link: rod", 15, 11, "'rod' is already defined"),
    "frame of the base": ("frame: tip", "frame: ground", 22, 13, "'ground' is the base"),
    "joint missing": ("  - joint: slide\n    link", "  - link", 14, 5, "joint missing: the name of the joint, or type"),
    "joint twice": ("joint: slide\n", "joint: swing\n", 14, 12, "joint 'swing' is already defined"),
    "name that is a number": (
        "joint: slide\n",
        "joint: 1\n",
        14,
        12,
        "a name (in quotes where it looks like a number)",
    ),
    "two ways to say a body": ("mass: 0.1", "centre_of_mass: [0,0,0]\n    inertia: {}", 14, 5, "exclude each other"),
    "robot missing": ("robot: pendulum\n", "", 1, 1, "robot missing"),
    "degrees": ("gamma: pi/6", "gamma: 30", 17, 18, "30 rad is more than a turn. Angles are in radians: radians(30)"),
    "degrees in a frame": ("rpy: [0, 0, pi/2]", "rpy: [0, 0, 90]", 22, 57, "radians(90)"),
    "mass forgotten": ("    mass: 0.1\n", "    centre_of_mass: [0, 0, 1]\n", 14, 5, "mass missing: centre_of_mass"),
    "pi told anew": ("  l: 0.5", "  pi: 3", 3, 7, "pi is a constant"),
    "joint where a link belongs": ("link: slider\n", "link: slider\n    antecedent: swing\n", 16, 17, "it moves 'rod'"),
    "name of a classical table": ("d: 0, theta", "a: 0, theta", 10, 21, "the distance along x is d, that along z is r"),
    "another key for the name": ("robot: pendulum", "name: pendulum", 1, 1, "own kind: `robot: name`"),
    "dash out of its column": ("  - joint: slide", "   - joint: slide", 14, 4, "stand in one column"),
    "leader that is not there": (
        "role: elastic\n",
        "mimic: {joint: swin}\n",
        19,
        20,
        "unknown joint 'swin': did you mean",
    ),
    "tab": ("  l: 0.5", "\tl: 0.5", 3, 1, "Indent with spaces"),
    "bracket left open": ("[l, 0, 0]", "[l, 0, 0", 22, 61, "expected"),
    "alias": ("[m*l/2, 0, 0]", "*tip", 12, 20, "anchors and aliases are not supported"),
    "tag": ("robot: pendulum", "robot: !!python/object:os.system x", 1, 8, "tag"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_malformed_table_is_refused_with_line_column_and_remedy(mistake):
    wrong, right, line, column, reason = MISTAKES[mistake]
    text = PENDULUM.replace(wrong, right, 1)
    assert text != PENDULUM
    with pytest.raises(DescriptionError) as refusal:
        read_mdh_yaml(text, source="arm.yaml")
    message = str(refusal.value)
    assert reason in message and message.startswith(f"arm.yaml, line {line}, column {column}: "), message
    assert len(message) < 400


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "is empty"),
        ("# nothing\n", "is empty"),
        ("- 1\n- 2\n", "a mapping with the keys robot and joints is needed"),
        ("robot: a\njoints: []\n---\nrobot: b\n", "expected a single document"),
        (b"robot: \xff\xfe\n", "cannot be decoded"),
        ("robot: " + "[" * 100_000, "nested more than 40 deep"),
        ("robot: a\njoints: []\nparameters: {a: " + "(" * 100_000 + "}", "100000 characters: the maximum is 1000"),
        ("robot: " + "a" * 10_000_000, "10000007 characters: more than 1048576"),
        ("robot: \x00", "is no YAML"),
        ("a: &a [1]\nb: [*a, *a]", "anchors and aliases are not supported"),
    ],
    ids=range(10),
)
def test_text_that_is_not_a_table_is_refused_quickly(text, reason):
    start = time.monotonic()
    with pytest.raises(DescriptionError) as refusal:
        read_mdh_yaml(text)
    assert reason in str(refusal.value) and len(str(refusal.value)) < 400
    assert time.monotonic() - start < 10


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_bytes_are_decoded_by_their_mark(encoding):
    text = PENDULUM.replace("swing", "Schwung-größe")
    assert read_mdh_yaml(text.encode(encoding)).joints[0].name == "Schwung-größe"
    assert load_robot(text.encode(encoding)).joints[0].name == "Schwung-größe"


def test_words_that_yaml_1_1_takes_for_booleans_and_octals_are_names_and_decimals():
    text = PENDULUM.replace("link: rod", "link: no").replace("mass: 0.1", "mass: 010")
    robot = read_mdh_yaml(text)
    assert robot.links[1].name == "no" and robot.links[2].inertia.mass == 10


def test_schema_is_valid_and_describes_each_number():
    schema = json.loads(SCHEMA.read_text())
    jsonschema.Draft7Validator.check_schema(schema)
    row = schema["definitions"]["row"]["properties"]
    assert {"mdh", "mass", "first_moments", "inertia", "rotor_inertia", "spring", "mimic", "limits"} <= set(row)
    assert re.search("Rot\\(z, gamma\\) Trans\\(z, b\\)", schema["definitions"]["mdh"]["$comment"])
