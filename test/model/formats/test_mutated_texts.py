"""Readers raise only DescriptionError for mutated texts, and in short time: thousands of mutations here, a hundred
thousand of each format in `make soak`."""

import os
import random
import re
import time

import pytest

from robot_dynamics import RobotDynamicsError, load_robot
from robot_dynamics.model.loading import read_robot

pytestmark = pytest.mark.slow

MUTATIONS = int(os.environ.get("MUTATIONS", "1500"))  # of each format
LONGEST = 10  # seconds for one text

URDF = """\
<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.1 0 0" rpy="0 0 1.5708"/><mass value="2"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.3" rpy="0 0 0"/><limit lower="-1" upper="1" effort="10" velocity="3"/>
    <dynamics damping="0.1" friction="0.2"/></joint>
  <link name="tool"/>
  <joint name="flange" type="fixed"><parent link="upper"/><child link="tool"/></joint>
  <link name="finger"><inertial><mass value="0.1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
  <joint name="slide" type="prismatic"><parent link="tool"/><child link="finger"/><mimic joint="shoulder"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""
MDH = """\
robot: arm
parameters: {l: 0.5, m: 2*l}
gravity: [0, 0, -9.81]
base: {link: ground, moving: false, mass: 3}
joints:
  - joint: swing
    link: rod
    mdh: {alpha: pi/2, d: 0, theta: -pi/2, r: l}
    mass: m
    first_moments: [m*l/2, 0, 0]
    inertia: {yy: m*l^2/3, zz: m*l^2/3}
    limits: {lower: -1, upper: radians(90)}
  - joint: slide
    link: slider
    antecedent: rod
    type: prismatic
    role: elastic
    spring: {stiffness: 300, rest: 0.01}
    mass: 0.1
  - {link: tip, type: fixed, mdh: {d: 0.1}}
frames:
  - {frame: tool, link: slider, xyz: [l, 0, 0], rpy: [0, 0, pi/2]}
"""
LOOPS = """\
robot: bars
parameters: {l: 0.5}
joints:
  - {joint: crank, link: input, mdh: {alpha: pi/2}, mass: 1, initial_position: pi/3}
  - {joint: coupling, link: coupler, mdh: {d: 0.2}, role: passive, mass: 1}
  - {joint: rocker, link: output, antecedent: base_link, mdh: {alpha: pi/2, d: l}, role: passive}
loops:
  - joint: knee
    link: cut
    moved: {antecedent: coupler, mdh: {alpha: 0.3, d: l}}
    closed_on: {antecedent: output, xyz: [0.2, 0, 0], rpy: [0.3, 0, 0]}
    role: elastic
    spring: {stiffness: 3, rest: 0.1}
    coulomb_friction: 0.4
    limits: {lower: -1, upper: 1}
    initial_position: -pi/3
  - joint: slide
    type: prismatic
    moved: {antecedent: cut}
    closed_on: {antecedent: base_link}
  - joint: ball
    type: spherical
    moved: {antecedent: coupler, mdh: {d: l}}
    closed_on: {antecedent: output}
"""
PAR = """\
(* Robotname = 'arm' *)
NL = 3
NJ = 3
NF = 3
Type = 0
is_floating = 0
(* Geometric parameters *)
ant = {0,1,2}
sigma = {0,1,2}
b = {0,0,0}
d = {0,0.4,
 0.1}
r = {0.3,r2 + 0.1,0}
gamma = {0,0,0}
alpha = {0,-pi/2,atan2(1,2)}
mu = {1,0,0}
theta = {th1 - pi/2,0,0}
XX = {0.1,0.2,0}
ZZ = {0.1,0.2,0}
MX = {1e-2,0,0}
M = {1,2,0.5}
FV = {0.1,0,0}
eta = {0,1,0}
k = {0,300,0}
G = {0,0,-9.81}
(* Frames = 'tool' 3 *)
"""
PAR_LOOPS = """\
NL = 4
NJ = 6
NF = 8
ant = {0,1,0,3,4,2,2,3}
sigma = {0,0,0,0,0,2,2,2}
b = {0,0,0,0,0,0,0,0}
d = {0,0.5,0,0.5,0.5,0,0.5,0.3}
r = {0,0,0,0,0,0,0,0}
gamma = {0,0,0,0,0,0,0,0}
alpha = {0,0,0,0,0,pi/3,0,0}
mu = {1,0,1,0,0,0,0,0}
theta = {th1,th2,th3,th4,th5,0,0,0}
M = {1,2,3,4}
eta = {0,0,0,0,1,0}
k = {0,0,0,0,30,0}
(* Loops = 'knee', 'weld' *)
"""
WITH_URDF = """\
roles: {slide: elastic}
springs: {slide: {stiffness: 3}}
initial_positions: {shoulder: 0.5}
loops:
  - {joint: ball, type: spherical, moved: {antecedent: tool}, closed_on: {antecedent: base, xyz: [1, 0, 0]}}
urdf: |
""" + "".join(f"    {line}\n" for line in URDF.replace('<mimic joint="shoulder"/>', "").splitlines())
LEGS = """\
robot: legs
parameters: {l: 0.5}
legs:
  - joints:
      - {joint: hip, link: thigh, mdh: {theta: pi/2}, mass: 1, initial_position: l/10}
      - {joint: knee, link: shin, mdh: {d: l}, role: passive, mass: 1}
    loops: [{joint: stop, type: spherical, moved: {antecedent: shin}, closed_on: {antecedent: base_link}}]
    end: {joint: ankle, moved: {mdh: {d: l}}}
    copies:
      - {base: {xyz: [0.5, 0, 0]}, platform: {xyz: [0.2, 0, 0]}}
      - {suffix: _b, base: {antecedent: base_link}, platform: {mdh: {gamma: pi, d: 0.2}}, parameters: {l: 3}}
platform: {link: plate, mass: 2, free: [x, y, yaw], initial: {rpy: [0, 0, 0.2]}, limits: {x: {lower: -0.1, upper: l}}}
"""
TEXTS = {
    "URDF": URDF,
    "MDH table": MDH,
    "par": PAR,
    "loops": LOOPS,
    "URDF with loops": WITH_URDF,
    "par with loops": PAR_LOOPS,
    "legs": LEGS,
}
WORDS = """
{ } [ ] ( ) : , ' " - # &a *a !!int --- ... < > </ &amp; &#0; <!DOCTYPE_x> <!-- ]]> = (* *) | ? % @ ~ null nan inf -inf
1e400 1e-400 1e200 0 -1 -0.0 3 99999999999999999999 pi/2 1/0 x \x00 \ufeff é 日 true no (((((((( 9^9^9^9 mimic joint
link mass rpy= xyz loops: cut spherical role: passive sigma NL NJ ant th1 1.0.0 0x10 1_000 + {} []
"""
TOKENS = [*WORDS.split(), "\n", "\t", " ", "\u2028", "\ud7ff"]
NUMBERS = ["0", "1", "-1", "2", "1e-9", "1e9", "1e200", "-1e-320", "pi", "1.5708", "0.30000000000000004", "1e400", "7"]


def change(text, rng):
    """Return the text with one mutation."""
    start = rng.randrange(len(text) + 1)
    end = min(len(text), start + rng.choice([0, 1, 1, 2, 5, 20, 100]))
    before, middle, after = text[:start], text[start:end], text[end:]
    lines = text.split("\n")
    mutation = rng.randrange(12)
    if mutation <= 3:
        number = rng.choice(list(re.finditer(r"\d+(\.\d+)?", text)) or [None])
        return text if number is None else text[: number.start()] + rng.choice(NUMBERS) + text[number.end() :]
    return [
        before + after,
        before + rng.choice(TOKENS) + middle + after,
        before + rng.choice(TOKENS) + after,
        before + middle * rng.choice([2, 3, 50]) + after,
        before + chr(rng.randrange(1, 0x300)) + after,
        "\n".join(lines[:k] + lines[k + 1 :] + lines[k : k + 1]) if (k := rng.randrange(len(lines))) else before,
        "\n".join(lines[:k] + lines[k + 1 :]) if (k := rng.randrange(len(lines))) else text * 2,
        text.replace(rng.choice(text.split() or ["x"]), rng.choice(TOKENS + text.split())),
    ][mutation - 4]


def mutate(text, rng):
    """Return the text with one to four mutations, sometimes as bytes, in an encoding or with a changed byte."""
    for _ in range(rng.choice([1, 1, 1, 2, 2, 3, 4])):
        text = change(text, rng)
    kind = rng.random()
    if kind < 0.9:
        return text
    content = text.encode(rng.choice(["utf-8", "utf-16", "utf-16-le", "utf-8-sig", "latin-1"]), "replace")
    if kind < 0.95 or not content:
        return content
    at = rng.randrange(len(content))
    return content[:at] + bytes([rng.randrange(256)]) + content[at + 1 :]


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", TEXTS)
def test_mutated_text_is_read_or_refused_with_a_reason(name):
    rng = random.Random(f"{name} {MUTATIONS}")
    assert load_robot(TEXTS[name]).joints
    read, slowest = 0, 0.0
    for number in range(MUTATIONS):
        text = mutate(TEXTS[name], rng)
        start = time.monotonic()
        try:
            read_robot(text, source="text")
            read += 1
        except RobotDynamicsError as error:
            message = str(error)
            assert message.startswith("text") and len(message) < 2000, (number, message)
        except Exception as error:
            raise AssertionError(f"mutation {number} made the reader raise {error!r}:\n{text!r}") from error
        slowest = max(slowest, time.monotonic() - start)
    print(f"{name}: {MUTATIONS} mutations, {read} read, the others refused, slowest {slowest:.2f} s")
    assert slowest < LONGEST
    assert 0.1 * MUTATIONS < read < 0.9 * MUTATIONS  # or the mutations try nothing
