"""SYMORO+ .par: reading against Khalil's formulas, round trips, and errors."""

import logging
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_dynamics import DescriptionError, Dynamics
from robot_dynamics.model.formats.par.reader import read_par
from robot_dynamics.model.joint import Spring

SAMPLES = Path(__file__).parents[3].parent / "shared" / "data" / "par"

GOOD = """(* Robotname = 'arm' *)
NL = 4
NJ = 4
NF = 4
Type = 0
is_floating = 0
is_mobile = 0
(* Geometric parameters,
   in m and rad *)
Ant = {0,1,2,3}
Sigma = {0,0,1,2}
B = {0,0.1,0,b4}
d = {0,D2,0,0.2}
R = {0.5,0,r3 + 0.1,0}
gamma = {0,Pi/3,0,atan2(1,2)}
Alpha = {0,pi/2,
         -pi/2,0.7}
Mu = {1,0,1,0}
Theta = {th1,th2 - pi/2,0.3,gam4}
M = {1,2,3,m4}
MX = {0,0.1,0,0.05}
XX = {1,1,1,1}
YY = {1,1,1,1}
ZZ = {1,1,1,1}
IA = {0.1,0,0,0}
FV = {0,0.2,0,0}
FX = {0,0,0,FX4}
QP = {QP1,QP2,QP3,QP4}
G = {0,0,G3}
"""
VALUES = {"b4": -0.1, "D2": 0.4, "gam4": "pi/5", "m4": 0.5, "G3": -9.81}

PENDULUM = """NL = 2
NJ = 2
ant = {0,1}
sigma = {0,2}
b = {0,0}
d = {0,0.5}
r = {0,0}
gamma = {0,0}
alpha = {pi/2,0}
theta = {th1,0}
M = {0,2}
"""


def khalil(gamma, b, alpha, d, theta, r):
    """Return iTj, element by element (Khalil, section 2)."""
    cg, sg, ca, sa, ct, st_ = (f(x) for x in (gamma, alpha, theta) for f in (math.cos, math.sin))
    return np.array(
        [
            [cg * ct - sg * ca * st_, -cg * st_ - sg * ca * ct, sg * sa, d * cg + r * sg * sa],
            [sg * ct + cg * ca * st_, -sg * st_ + cg * ca * ct, -cg * sa, d * sg - r * cg * sa],
            [sa * st_, sa * ct, ca, r * ca + b],
            [0, 0, 0, 1],
        ]
    )


def changed(old, new, text=GOOD):
    assert old in text
    return text.replace(old, new)


def test_frames_match_the_mdh_formula():
    dynamics = Dynamics(read_par(GOOD, values=VALUES))
    q1, q2, q3 = q = np.array([0.3, -1.1, 0.25])
    expected = khalil(0, 0, 0, 0, q1, 0.5) @ khalil(math.pi / 3, 0.1, math.pi / 2, 0.4, q2 - math.pi / 2, 0)
    np.testing.assert_allclose(dynamics.link_pose("link_2", q), expected, atol=1e-14)
    expected = expected @ khalil(0, 0, -math.pi / 2, 0, 0.3, q3 + 0.1)
    np.testing.assert_allclose(dynamics.link_pose("link_3", q), expected, atol=1e-14)
    expected = expected @ khalil(math.atan2(1, 2), -0.1, 0.7, 0.2, math.pi / 5, 0)
    np.testing.assert_allclose(dynamics.link_pose("frame_4", q), expected, atol=1e-14)


def test_row_entries_are_joint_parameters():
    robot = read_par(GOOD.encode(), values=VALUES)
    assert robot.name == "arm"
    assert [joint.name for joint in robot.joints] == ["joint_1", "joint_2", "joint_3"]
    assert [joint.prismatic for joint in robot.joints] == [False, False, True]
    assert [joint.role for joint in robot.joints] == ["actuated", "passive", "actuated"]
    assert robot.joints[0].rotor_inertia == 0.1 and robot.joints[1].viscous_friction == 0.2
    assert robot.links[3].inertia.mass == 3.5 and not robot.moving_base
    assert robot.gravity.tolist() == [0, 0, -9.81]


def test_fixed_row_is_lumped_into_its_link():
    dynamics = Dynamics(read_par(PENDULUM + "XX = {0.3,0}\nZZ = {0.7,0}"))
    angle = 0.4
    np.testing.assert_allclose(dynamics.gravity(np.array([angle])), 2 * 9.81 * 0.5 * math.cos(angle))
    np.testing.assert_allclose(dynamics.inertia_matrix(np.array([angle])), 0.7 + 2 * 0.5**2)
    assert dynamics.robot.frames_by_name["frame_2"].link == 1


@pytest.mark.parametrize("before", [None, "theta"])
def test_joint_variable_with_a_value_is_a_constant(before):
    text = changed("{th1,0}", "{th1 + q,0}", PENDULUM)
    robot = read_par(text, values={"th1": "pi/2"} | ({"q": 0.25} if before else {}))
    angle = math.pi / 2 + (0.25 if before else 0)
    np.testing.assert_allclose(robot.joints[0].placement, khalil(0, 0, math.pi / 2, 0, angle, 0), atol=1e-15)


def test_gravity_argument_overrides_the_vector_of_the_par():
    assert read_par(PENDULUM).gravity.tolist() == [0, 0, -9.81]
    assert read_par(PENDULUM + "G = {1,2,3}").gravity.tolist() == [1, 2, 3]
    assert read_par(PENDULUM + "G = {0,0,G3}", gravity=(0, 1, 0)).gravity.tolist() == [0, 1, 0]


FLOATING = changed("M = {0,2}", "is_floating = 1\nM = {m0,0,2}\nZZ = {5,1,1}\nMX = {0.5,0,0}", PENDULUM)


def test_floating_base_has_the_first_entry_of_the_link_lists():
    robot = read_par(FLOATING, values={"m0": 7})
    assert robot.moving_base and robot.links[0].inertia.mass == 7 and robot.links[0].inertia.first_moments[0] == 0.5
    assert robot.links[1].inertia.mass == 2
    held = read_par(FLOATING, moving_base=False)  # m0 enters nothing
    assert not held.moving_base and held.links[1].inertia.mass == 2
    assert read_par(PENDULUM, moving_base=True).links[0].inertia.mass == 0


def test_elastic_joint_has_a_spring_and_no_motor():
    robot = read_par(PENDULUM + "mu = {1,0}\neta = {1,0}\nk = {k1,k2}", values={"k1": 30})
    assert robot.joints[0].role == "elastic" and robot.joints[0].spring == Spring(30)


def test_mu_of_zero_throughout_means_actuated_joints(caplog):
    with caplog.at_level(logging.WARNING):
        robot = read_par(PENDULUM + "mu = {0,0}")
    assert robot.joints[0].role == "actuated" and "mu is 0 throughout" in caplog.text


def test_state_data_of_a_par_is_ignored_with_a_warning(caplog):
    with caplog.at_level(logging.WARNING):
        read_par(PENDULUM + "Z = {1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1}\nQP = {0,a}\nFX = {0,b}\nIA = {0,c}")
        assert not caplog.records
        read_par(PENDULUM + "Z = {1,0,0,0,0,1,0,0,0,0,1,2,0,0,0,1}\nQP = {3,a}\nIA = {0,5}\nVP0 = {0,0,9.81}")
    assert "QP, VP0, IA are not part" in caplog.text and "Z is ignored" in caplog.text


def test_comments_of_a_par_contain_names():
    comments = (
        "(* Robotname = 'RX 90' *) (* Joints = 'shoulder, left' *)\n(* Links = 'base', 'arm' *) (* Frames = 'arm' 2 *)"
    )
    robot = read_par(comments + PENDULUM)
    assert (robot.name, robot.joints[0].name, robot.links[1].name) == ("RX 90", "shoulder, left", "arm")
    assert [frame.name for frame in robot.frames] == ["base", "arm"]
    np.testing.assert_allclose(robot.frames_by_name["arm"].placement[:3, 3], [0.5, 0, 0])
    assert read_par("(* Joints = six of them *)" + PENDULUM).joints[0].name == "joint_1"


BAD = {
    "empty": ("", "empty"),
    "no bytes": (5, "par is 5: the text"),
    "not decodable": (b"\xffNL", "cannot be decoded"),
    "too large": ("a" * (1024 * 1024 + 1), "more than 1048576"),
    "open comment": (GOOD + "\n(* end", "line 31: the comment .* never ends"),
    "stray end of comment": (changed("in m and rad *)", "(* in *) *)"), "line 9: '.*' has no meaning there"),
    "no statement": (changed("Type = 0", "what is this"), "line 5: 'what is this' has no meaning"),
    "two keys": (changed("Type = 0", "NL = 6"), "line 5: NL is already defined at line 2"),
    "two spellings": (changed("Mu =", "mu = {1,1,1,1}\nMu ="), "line 19: mu is already defined at line 18"),
    "unknown key": (changed("gamma", "gama"), "line 15: unknown key 'gama': did you mean 'gamma'"),
    "no list": (changed("M = {1,2,3,m4}", "M = 5"), "line 20: M = 5: M is a list in braces"),
    "no number": (changed("NL = 4", "NL = {4}"), "line 2: NL = .4.: NL is one number"),
    "nothing": (changed("NL = 4", "NL ="), "line 2: NL: .*end"),
    "open list": (changed("-pi/2,0.7}", "-pi/2,0.7"), "line 16: the list alpha = { never ends"),
    "brace in a list": (changed("{0,0,G3}", "{0,{0},G3}"), "line 29: the list G = { never ends"),
    "empty entry": (changed("{0,0,G3}", "{0,,G3}"), "line 29: entry 2 of G is empty"),
    "last comma": (changed("{0,0,G3}", "{0,0,G3,}"), "line 29: entry 4 of G is empty"),
    "open parenthesis": (changed("0.7}", "(0.7}"), "line 17: a parenthesis in alpha is opened"),
    "closed parenthesis": (changed("0.7}", "0.7)}"), "line 17: a parenthesis in alpha is closed"),
    "too short": (changed("{0,0,1,2}", "{0,0,1}"), "line 11: sigma has 3 entries: it needs NF = 4, one for each frame"),
    "too long": (changed("{1,2,3,m4}", "{0,1,2,3,4}"), "line 20: M has 5 entries: it needs NL = 4,.* is_floating = 0"),
    "floating": (changed("is_floating = 0", "is_floating = 1"), "line 20: M has 4 entries: it needs NL . 1 = 5, from"),
    "gravity": (changed("{0,0,G3}", "{G3}"), "line 29: G has 1 entry: it needs 3"),
    "no list of sigma": (changed("Sigma = {0,0,1,2}", ""), "par: sigma missing"),
    "no NL": (changed("NL = 4", ""), "par: NL missing"),
    "half a link": (changed("NL = 4", "NL = 4.5"), "line 2: NL = 4.5: a whole number"),
    "negative": (changed("NL = 4", "NL = -4"), "line 2: NL = -4: a whole number"),
    "word": (changed("NL = 4", "NL = four"), "line 2: NL: .*'four'"),
    "endless": (changed("NL = 4", "NL = 2e5").replace("NJ = 4", "NJ = 2e5"), "line 2: NL = 200000: the maximum"),
    "type": (changed("Type = 0", "Type = tree"), "line 5: Type: .*'tree'"),
    "frames": (changed("NF = 4", "NF = 5"), "line 4: NF = 5: NF = 2 NJ - NL = 4"),
    "joints too few": (changed("NJ = 4", "NJ = 3"), "line 3: NJ = 3 joints cannot move"),
    "wheels": (changed("is_mobile = 0", "is_mobile = 1"), "line 7: .*bases on wheels are not supported"),
    "truth": (changed("is_mobile = 0", "is_mobile = no"), "line 7: is_mobile = 'no': 0 or 1"),
    "antecedent": (changed("{0,1,2,3}", "{0,2,2,3}"), "line 10: ant of row 2 is '2': 0 to 1, .*before"),
    "antecedent of the first": (changed("{0,1,2,3}", "{1,1,2,3}"), "line 10: ant of row 1 is '1': 0, the base"),
    "half an antecedent": (changed("{0,1,2,3}", "{0,0.5,2,3}"), "line 10: ant of row 2 is '0.5'"),
    "sigma": (changed("{0,0,1,2}", "{0,0,3,2}"), "line 11: sigma of row 3 is '3': 0 .revolute.*is needed"),
    "named sigma": (changed("{0,0,1,2}", "{0,0,s3,2}"), "line 11: sigma of row 3 is 's3'"),
    "mu": (changed("{1,0,1,0}", "{1,2,1,0}"), "line 18: mu of row 2 is '2': 0 or 1"),
    "eta": (GOOD + "eta = {0,0,2,0}", "line 30: eta of row 3 is '2': 0 .rigid. or 1 .elastic."),
    "no stiffness": (GOOD + "eta = {0,0,1,0}", "line 30: row 3 is elastic, but the list k is missing"),
    "negative stiffness": (GOOD + "eta = {0,0,1,0}\nk = {0,0,-5,0}", "line 31: k of row 3 is -5"),
    "negative mass": (changed("{1,2,3,m4}", "{1,-2,3,m4}"), "line 20: mass M of link 2 is -2"),
    "negative rotor": (changed("{0.1,0,0,0}", "{-0.1,0,0,0}"), "line 25: IA of row 1 is -0.1"),
    "factor": (
        changed("th2 - pi/2", "2*th2"),
        "line 19: theta of row 2 is '2[*]th2' and does not increase by as much as th2",
    ),
    "other direction": (changed("th2 - pi/2", "pi/2 - th2"), "line 19: .*th2 plus or minus a constant"),
    "curve": (changed("th2 - pi/2", "th2*cos(th2)"), "line 19: .*th2 plus or minus a constant"),
    "not everywhere": (changed("th2 - pi/2", "asin(th2)"), "line 19: .*th2 plus or minus a constant"),
    "absolute": (changed("th2 - pi/2", "abs(th2)"), "line 19: .*th2 plus or minus a constant"),
    "hidden factor": (changed("r3 + 0.1", "1e200 + 5*r3"), "line 14: .*r3 plus or minus a constant"),
    "two variables": (changed("th2 - pi/2", "th2 + o2"), "line 19: .*th2, o2 have no value: give values"),
    "variable of two": (changed("th2 - pi/2", "th1 - pi/2"), "line 19: th1 is the joint variable of row 1 and of"),
    "variable elsewhere": (changed("atan2(1,2)", "th1"), "line 15: th1 is the joint variable of row 1"),
    "malformed entry": (changed("Pi/3", "Pi//3"), "line 15: expression 'Pi//3'"),
    "division": (changed("atan2(1,2)", "1/(2 - 2)"), "line 15: .*division by zero"),
    "unknown function": (changed("atan2", "atan3"), "line 15: .*unknown function 'atan3': did you mean 'atan'"),
    "long entry": (changed("0.7}", "+".join(["0.1"] * 300) + "}"), "line 17: an entry has 1199 characters"),
    "infinite": (changed("{0,D2,0,0.2}", "{0,D2,0,1e999}"), "line 13: .*inf"),
    "joints by name": (
        "(* Joints = 'a', 'b' *)" + GOOD,
        "line 1: the comment Joints = has 2 names: there are 3 joints",
    ),
    "links by name": ("(* Links = 'a' *)" + GOOD, "line 1: .* has 1 names: there are 4 links, the base first"),
    "names twice": ("(* Links = 'a' *)\n(* Links = 'a' *)" + GOOD, "line 2: a comment Links = is already present at"),
    "name without end": ("(* Links = 'a', b *)" + GOOD, "line 1: the comment Links = ends in ' b'"),
    "frame without row": ("(* Frames = 'a' *)" + GOOD, "line 1: .*'tool' 7"),
    "frame beyond": ("(* Frames = 'a' 5 *)" + GOOD, "line 1: frame 'a' is at row 5: there are rows 0 to 4"),
    "frame on another": ("(* Frames = 'link_1' 4 *)" + GOOD, "line 1: frame 'link_1' is at row 4, which is not fixed"),
    "frame twice": ("(* Frames = 'a' 4, 'a' 2 *)" + GOOD, "par: frame 'a' is defined more than once"),
}


@pytest.mark.parametrize("name", BAD)
def test_malformed_par_is_refused_with_line_and_remedy(name):
    text, message = BAD[name]
    values = {key: value for key, value in VALUES.items() if isinstance(text, str) and re.search(rf"\b{key}\b", text)}
    with pytest.raises(DescriptionError) as raised:
        read_par(text, values=values)
    assert re.search(message, str(raised.value), re.DOTALL), str(raised.value)
    assert str(raised.value).startswith("par")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {},
            "arm.par, line 12: no value for b4, D2, gam4, m4, G3: write a number .*or give values .*--set b4=0.5",
        ),
        ({**VALUES, "gam3": 1}, "arm.par: value given for unknown name 'gam3': did you mean 'gam4'"),
        ({**VALUES, "D2": "x"}, "arm.par: value given for 'D2': .*unknown name 'x'"),
        ({**VALUES, "D2": None}, "arm.par: value given for 'D2': None is no number"),
        ({**VALUES, "D2": math.nan}, "arm.par: value given for 'D2'"),
        ({**VALUES, "pi": 3}, "unknown name 'pi'"),
        ([1], r"values are \[1\]"),
    ],
)
def test_missing_values_are_listed_by_name(values, message):
    with pytest.raises(DescriptionError, match=message):
        read_par(GOOD, source="arm.par", values=values)


def test_infinite_lengths_are_refused():
    rows = {"ant": "{0,1}", "sigma": "{2,2}", "b": "{1e308,1e308}", **dict.fromkeys(("r", "gamma", "alpha"), "{0,0}")}
    text = "NL = 2\nNJ = 2\nd = {0,\n0}\ntheta = {0,0}\n" + "".join(f"{key} = {value}\n" for key, value in rows.items())
    with pytest.raises(DescriptionError, match="par, line 4: row 2 places its frame too far away"):
        read_par(text)


def test_invalid_gravity_and_base_are_refused():
    with pytest.raises(DescriptionError, match="par: gravity is 'down'"):
        read_par(PENDULUM, gravity="down")
    with pytest.raises(DescriptionError, match="par: moving_base is 'yes'"):
        read_par(PENDULUM, moving_base="yes")


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_mutated_par_raises_no_other_error(data):
    text = data.draw(st.sampled_from([GOOD, PENDULUM, FLOATING, "(* Frames = 'a' 2, 'b' 0 *)" + PENDULUM]))
    for _ in range(data.draw(st.integers(1, 4))):
        start, length = data.draw(st.integers(0, len(text))), data.draw(st.integers(0, 8))
        put = data.draw(st.sampled_from([*"{}()*,='/-+^0159\n\r eth", "(*", "*)", "1e308", "pi", "é", "\x00"]))
        text = text[:start] + put + text[start + length :]
    try:
        read_par(text, values=VALUES if all(re.search(rf"\b{key}\b", text) for key in VALUES) else None)
    except DescriptionError as error:
        assert str(error)


def sample(name):
    path = SAMPLES / f"{name}.par"
    if not path.exists():
        pytest.skip(f"the published descriptions are not beside this checkout: {path} is not there")
    return path.read_bytes()


def values_of(text, **given_values):
    """Return values for all dynamic parameters of a sample, and the additional ones."""
    names = re.findall(rb"\b(?:XX|XY|XZ|YY|YZ|ZZ|MX|MY|MZ|M|IA|FV|FS)\d+\b", text)
    return {name.decode(): 0.1 + 0.01 * k for k, name in enumerate(names)} | {"G3": -9.81} | given_values


def test_stanford_arm_matches_its_table(caplog):
    text = sample("Stanford")
    with caplog.at_level(logging.WARNING):
        robot = read_par(text, values=values_of(text, RL2=0.154))
    assert "mu is 0 throughout" in caplog.text and {joint.role for joint in robot.joints} == {"actuated"}
    q = np.array([0.1, -0.7, 0.4, 1.1, -0.3, 2.0])
    alphas = [0, -math.pi / 2, math.pi / 2, 0, -math.pi / 2, math.pi / 2]
    expected = np.eye(4)
    for k, alpha in enumerate(alphas):
        r = {1: 0.154, 2: q[2]}.get(k, 0)
        expected = expected @ khalil(0, 0, alpha, 0, 0 if k == 2 else q[k], r)
    np.testing.assert_allclose(Dynamics(robot).link_pose("link_6", q), expected, atol=1e-14)
    # the wrist's centre, on axis 3: r3 along z3, which RL2 sets beside axis 1
    c1, s1, c2, s2 = math.cos(q[0]), math.sin(q[0]), math.cos(q[1]), math.sin(q[1])
    centre = [q[2] * c1 * s2 - 0.154 * s1, q[2] * s1 * s2 + 0.154 * c1, q[2] * c2]
    np.testing.assert_allclose(Dynamics(robot).link_pose("link_6", q)[:3, 3], centre, atol=1e-14)


def test_rx90_matches_its_table():
    text = sample("RX90")
    robot = read_par(text, values=values_of(text, D3=0.45, RL4=0.45))
    assert robot.name == "RX90" and len(robot.joints) == 6
    upright = Dynamics(robot).link_pose("link_6", np.array([0, math.pi / 2, -math.pi / 2, 0, 0, 0]))
    np.testing.assert_allclose(upright[:3, 3], [0, 0, 0.9], atol=1e-14)  # upper arm and forearm, one above the other
    np.testing.assert_allclose(robot.links[3].inertia.first_moments[2], 0.1 + 0.01 * 50)  # MZ3


def test_large_constant_beside_a_joint_variable_does_not_hide_it():
    """r = r1 + 1e12: the entry increases by as much as the variable, in the remaining digits."""
    zeros = "".join(f"{key} = {{0}}\n" for key in ("ant", "b", "d", "gamma", "alpha", "theta"))
    text = f"NL = 1\nNJ = 1\nsigma = {{1}}\nr = {{r1 + 1e12}}\n{zeros}"
    assert read_par(text).joints[0].placement[2, 3] == 1e12
    with pytest.raises(DescriptionError, match="does not increase by as much as r1"):
        read_par(text.replace("r1 + 1e12", "2*r1 + 1e12"))
