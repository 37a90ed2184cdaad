"""URDF that its parser would repair, default or ignore without a message: refused, or read with a warning.

The parser is yourdfpy, which is imported only where a URDF is read.
"""

import json
import re
import subprocess
import sys

import numpy as np
import pinocchio
import pytest
from peers.real_robots import REAL_ROBOTS, real_urdf

from robot_dynamics import DescriptionError, Dynamics, Inertia, load_robot
from robot_dynamics.model.formats.urdf.reader import read_urdf

ORIGIN = '<origin xyz="0.1 0 0" rpy="0 0 0.3"/>'
MASS = '<mass value="2"/>'
INERTIA = '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.25"/>'
INERTIAL = f"<inertial>{ORIGIN}{MASS}{INERTIA}</inertial>"
PLACE = '<origin xyz="0 0 0.3" rpy="0 0 0"/>'
AXIS = '<axis xyz="0 0 1"/>'
LIMIT = '<limit lower="-1" upper="1" effort="10" velocity="3"/>'
DYNAMICS = '<dynamics damping="0.5" friction="0.2"/>'
BRANCH = """<link name="c">
<inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="k" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="3"/></joint>"""
URDF = f"""<robot name="r">
<link name="a"/>
<link name="b">
{INERTIAL}
</link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/>
{PLACE}
{AXIS}
{LIMIT}
{DYNAMICS}
</joint>
{BRANCH}
</robot>"""


def changed(*replacements):
    """Return URDF with texts replaced at their first place: old, new, old, new, ..."""
    text = URDF
    for old, new in zip(replacements[::2], replacements[1::2], strict=True):
        assert old in text
        text = text.replace(old, new, 1)
    return text


def moved(content, before):
    """Return URDF where `content` stands before the text `before` instead of at its own place."""
    return changed(content, "").replace(before, content + before, 1)


def renamed(content, old, new):
    """Return URDF where an element has another name."""
    return changed(content, content.replace(old, new))


def added(content):
    """Return URDF with more content at the end of <robot>."""
    return changed("</robot>", f"{content}</robot>")


MIMIC = '<mimic joint="j" multipler="2"/>'
DRAKE = 'xmlns:drake="http://drake.mit.edu"'
REFUSED = {
    # elements of other spelling
    "<Inertial>": (renamed(INERTIAL, "inertial>", "Inertial>"), "line 4: link 'b': <Inertial> .* name is <inertial>"),
    "<inertal>": (renamed(INERTIAL, "inertial>", "inertal>"), "the name is <inertial>"),
    "<Origin> in inertial": (renamed(ORIGIN, "origin", "Origin"), "the name is <origin>"),
    "<pose> in inertial": (changed(ORIGIN, "<pose>0.1 0 0 0 0 0.3</pose>"), "<pose> is not .*<inertial>: .*<origin>"),
    "<com> in inertial": (changed(ORIGIN, '<com xyz="0.1 0 0"/>'), "the name is <origin>"),
    "<pose> in joint": (changed(PLACE, "<pose>0 0 0.3 0 0 0</pose>"), "line 7: joint 'j': <pose> is not"),
    "<orgin> in joint": (renamed(PLACE, "origin", "orgin"), "the name is <origin>"),
    "<orgin> in fixed joint": (renamed(PLACE, "origin", "orgin").replace("revolute", "fixed"), "name is <origin>"),
    "<Axis>": (renamed(AXIS, "axis", "Axis"), "line 8: joint 'j': <Axis> .* the name is <axis>"),
    "<axes>": (renamed(AXIS, "axis", "axes"), "the name is <axis>"),
    "<limits>": (renamed(LIMIT, "limit", "limits"), "the name is <limit>"),
    "<dynamic>": (renamed(DYNAMICS, "dynamics", "dynamic"), "line 10: joint 'j': <dynamic> .* name is <dynamics>"),
    "<Dynamics>": (renamed(DYNAMICS, "dynamics", "Dynamics"), "the name is <dynamics>"),
    "<mimick>": (changed(AXIS, AXIS + '<mimick joint="k"/>'), "the name is <mimic>"),
    "branch of <Link> and <Joint>": (
        renamed(BRANCH, "link>", "Link>")
        .replace('<link name="c"', '<Link name="c"')
        .replace("joint>\n</robot", "Joint>\n</robot")
        .replace('<joint name="k"', '<Joint name="k"'),
        "line 12: <Link> is not an element of <robot>: the name is <link>",
    ),
    # attributes of other spelling or meaning
    "damping as Damping": (renamed(DYNAMICS, "damping", "Damping"), "Damping='0.5', .* the attribute is damping"),
    "friction as frction": (renamed(DYNAMICS, "friction", "frction"), "line 10: joint 'j': .* attribute is friction"),
    "multiplier as multipler": (changed(AXIS, AXIS + MIMIC.replace('"j"', '"k"')), "the attribute is multiplier"),
    "rpy as RPY": (renamed(ORIGIN, "rpy", "RPY"), "line 4: link 'b': <origin> has RPY='0 0 0.3'"),
    "xyz as position": (renamed(PLACE, "xyz", "position"), "position='0 0 0.3', .* xyz is missing"),
    "lower as Lower": (renamed(LIMIT, "lower", "Lower"), "the attribute is lower"),
    "quaternion": (renamed(PLACE, 'rpy="0 0 0"', 'quat_xyzw="0 0 1 0"'), "quat_xyzw='0 0 1 0', .* write .* rpy="),
    "quaternion and angles": (renamed(PLACE, "rpy", 'quat_xyzw="0 0 1 0" rpy'), "write the rotation as rpy"),
    "millimetres": (renamed(PLACE, "xyz", 'unit="mm" xyz'), "unit='mm', .* m, rad, kg, N and s"),
    "prefix of damping": (
        renamed(DYNAMICS, "damping", 'xmlns:s="http://e.org" s:damping'),
        "damping='0.5', .* the attribute is damping",
    ),
    "mass as an attribute of a link": (
        changed(INERTIAL, "", '<link name="b"', '<link name="b" mass="2"'),
        "line 3: link 'b': <link> has mass='2', .* element <mass> inside",
    ),
    "damping as an attribute of a joint": (
        changed(DYNAMICS, "", 'name="j"', 'name="j" damping="0.5"'),
        "<joint> has damping='0.5', .* element <dynamics> inside",
    ),
    # elements at another level
    "<mass> beside <inertial>": (
        changed(INERTIAL, INERTIAL + '<mass value="9"/>'),
        "<mass> is in <link> .* belongs in <inertial>",
    ),
    "<mass> and <inertia> in link": (changed(INERTIAL, MASS + INERTIA), "belongs in <inertial>"),
    "<inertial> in visual": (changed(INERTIAL, f"<visual>{INERTIAL}</visual>"), "<inertial> is inside <visual>"),
    "<inertial> in joint": (moved(INERTIAL, AXIS), "<inertial> is in <joint> .* belongs in <link>"),
    "<dynamics> in link": (moved(DYNAMICS, INERTIAL), "<dynamics> is in <link> .* belongs in <joint>"),
    "<dynamics> in robot": (moved(DYNAMICS, "</robot>"), "<dynamics> is in <robot>"),
    "<origin> in child": (
        changed(PLACE, "", '<child link="b"/>', f'<child link="b">{PLACE}</child>'),
        "<origin> inside <child>",
    ),
    "<origin> in mass": (changed(ORIGIN, "", MASS, f'<mass value="2">{ORIGIN}</mass>'), "<origin> inside <mass>"),
    "<damping> in dynamics": (
        changed(DYNAMICS, "<dynamics><damping>0.5</damping></dynamics>"),
        "write <dynamics damping='...' friction='...'/>",
    ),
    "<damping> in joint": (changed(DYNAMICS, '<damping value="0.5"/>'), "it is an attribute, <dynamics damping='...'>"),
    "text in origin": (changed(PLACE, "<origin>0 0 0.3</origin>"), "line 7: joint 'j': <origin> contains text"),
    "branch in <group>": (
        changed(BRANCH, f"<group>{BRANCH}</group>"),
        "line 13: link 'c': <inertial> is inside <group>",
    ),
    "branch in <robot>": (changed(BRANCH, f"<robot>{BRANCH}</robot>"), "is inside <robot>"),
    "link in link": (
        changed('<link name="c">', '<link name="d"><link name="c">', "</inertial></link>", "</inertial></link></link>"),
        "<link> is in <link>",
    ),
    # namespaces
    "default namespace": (
        renamed(DYNAMICS, "<dynamics", '<dynamics xmlns="http://e.org"'),
        "<dynamics> has a namespace",
    ),
    "declared prefix": (renamed(ORIGIN, "<origin", '<s:origin xmlns:s="http://e.org"'), "<origin> has a namespace"),
    "joint of Drake": (
        changed('<joint name="k"', f'<drake:joint {DRAKE} name="k"').replace(
            "</joint>\n</robot>", "</drake:joint>\n</robot>"
        ),
        "<joint> has a namespace",
    ),
    # numbers
    "negative effort": (renamed(LIMIT, '"10"', '"-10"'), "line 9: joint 'j': effort limit -10 is negative"),
    "negative velocity": (renamed(LIMIT, '"3"', '"-3"'), "velocity limit -3 is negative"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_content_that_would_be_lost_is_refused(case):
    text, reason = REFUSED[case]
    with pytest.raises(DescriptionError, match=reason) as error:
        read_urdf(text, source="arm.urdf")
    assert str(error.value).startswith("arm.urdf, line ")


def drive(inertia):
    """Return a <transmission> with the element of a rotor inertia."""
    return f'\n<transmission name="t" {DRAKE}><joint name="j"/><actuator name="m">{inertia}</actuator></transmission>'


WARNED = {
    "axis of length 2": (renamed(AXIS, '1"', '2"'), "line 8: joint 'j': axis '0 0 2' is not a unit vector"),
    "angles in degrees": (
        renamed(PLACE, '0"/>', '90"/>'),
        "line 7: joint 'j': rpy='0 0 90' has an angle over one turn",
    ),
    "angles of inertia in degrees": (renamed(ORIGIN, "0.3", "45"), "line 4: link 'b': rpy='0 0 45' has an angle"),
    "no position limits": (
        renamed(LIMIT, 'lower="-1" upper="1" ', ""),
        "line 9: joint 'j': <limit> lacks lower and upper",
    ),
    "no upper limit in two joints": (
        URDF.replace(' upper="1"', ""),
        "line 9 and 1 more: joint 'j': <limit> lacks upper",
    ),
    "unknown attribute of dynamics": (
        renamed(DYNAMICS, "damping", "viscous"),
        "line 10: <dynamics> has viscous, ignored",
    ),
    "unknown attribute of inertia": (renamed(INERTIA, "ixy", 'iyx="0.1" ixy'), "line 4: <inertia> has iyx, ignored"),
    "effort as force": (
        renamed(LIMIT, "effort", "force"),
        "line 9: <limit> has force, ignored: its attributes are lower",
    ),
    "unknown element of a joint": (changed(AXIS, AXIS + "<spring/>"), "line 8: <spring> in <joint> is ignored"),
    "unknown element of an inertial": (
        changed(MASS, MASS + "<density/>"),
        "line 4: <density> in <inertial> is ignored",
    ),
    "<limits> beside <limit>": (changed(LIMIT, LIMIT + "<limits/>"), "line 9: <limits> in <joint> is ignored"),
    "origin of a link": (
        changed(INERTIAL, INERTIAL + '<origin xyz="1 0 0"/>'),
        "line 4: <origin> in <link> is ignored",
    ),
    "rotor inertia of Drake": (
        added(drive('<drake:rotor_inertia value="1e-4"/>')),
        "line 17: the <rotor_inertia> in <tra",
    ),
    "rotor inertia of a motor": (
        added(drive("<motorInertia>1e-4</motorInertia>")),
        "line 17: the <motorInertia> in <tra",
    ),
    "spring of Gazebo": (
        added('<gazebo reference="j"><springStiffness>9</springStiffness></gazebo>'),
        "line 16: the <springStiffness> in <gazebo> is ignored: a YAML",
    ),
    "closed loop of Gazebo": (
        added('<gazebo><joint name="l" type="revolute"><parent>c</parent><child>a</child></joint></gazebo>'),
        "line 16: joint 'l' in <gazebo> from 'c' to 'a' is ignored",
    ),
}


@pytest.mark.parametrize("case", WARNED)
def test_content_of_doubtful_meaning_is_read_with_a_warning(case, caplog):
    text, warning = WARNED[case]
    robot = load_robot(text)
    assert [joint.name for joint in robot.joints] == ["j", "k"]
    [record] = caplog.records
    assert record.levelname == "WARNING" and record.getMessage().startswith(f"description: {warning}")
    [sentence] = robot.warnings
    assert sentence.startswith(warning)
    with pytest.raises(DescriptionError, match=re.escape(warning)):
        load_robot(text, strict=True)


SILENT = {
    "complete": URDF,
    "no axis: x": changed(AXIS, ""),
    "no origin of a joint": changed(PLACE, ""),
    "no angles": renamed(ORIGIN, ' rpy="0 0 0.3"', ""),
    "no origin of an inertia": changed(ORIGIN, ""),
    "no dynamics": changed(DYNAMICS, ""),
    "fixed joint with all": URDF.replace("revolute", "fixed").replace("<dynamics ", "<dynamic "),
    "continuous joint without position limits": renamed(LIMIT, 'lower="-1" upper="1" ', "").replace(
        "revolute", "continuous"
    ),
    "zero origin of a link": changed(INERTIAL, INERTIAL + '<origin xyz="0 0 0" rpy="0 -0 0"/>'),
    "extension of limit": renamed(LIMIT, "effort", 'gear_velocity="3" effort'),
    "extensions of tools": added(
        f'<gazebo reference="j"><springStiffness>0</springStiffness><implicitSpringDamper>1</implicitSpringDamper>'
        f"<inertial><mass>3</mass></inertial></gazebo><sensor><parent link='b'/><origin xyz='1 1 1'/></sensor>"
        f"<joints><joint>j</joint></joints>"
        f'<ros2_control><joint name="j"><limit/></joint></ros2_control><drake:note {DRAKE}/>'
        + drive("<mechanicalReduction>50</mechanicalReduction>")
    ),
    "extensions of links and joints": changed(
        INERTIAL,
        INERTIAL + "<contact><damping value='1'/></contact><gravity>1</gravity><kinematic>0</kinematic>",
        DYNAMICS,
        DYNAMICS + "<safety_controller k_velocity='1'/><calibration rising='1'/>",
        'name="j"',
        'name="j" dont_collapse="true"',
    ),
}


@pytest.mark.parametrize("case", SILENT)
def test_defaults_of_urdf_are_taken_as_pinocchio_takes_them(case, caplog):
    robot = load_robot(SILENT[case])
    assert not caplog.records
    peer = pinocchio.buildModelFromXML(SILENT[case])
    positions = np.linspace(0.3, 0.7, len(robot.joints))
    configuration = pinocchio.integrate(peer, pinocchio.neutral(peer), positions)
    data = peer.createData()
    pinocchio.crba(peer, data, configuration)
    mass_matrix = np.triu(data.M) + np.triu(data.M, 1).T
    np.testing.assert_allclose(Dynamics(robot).inertia_matrix(positions), mass_matrix, atol=1e-12)
    gravity = pinocchio.computeGeneralizedGravity(peer, data, configuration)
    np.testing.assert_allclose(Dynamics(robot).gravity(positions), gravity, rtol=1e-3, atol=1e-9)  # g: 9.80665 or 9.81
    assert [joint.viscous_friction for joint in robot.joints] == list(peer.damping)
    assert [joint.coulomb_friction for joint in robot.joints] == list(peer.friction)


EXTENSIONS = {"panda": "line 48 and 6 more: <dynamics> has D, K, mu_coulomb, mu_viscous, ignored"}
"""Warnings that real robots cause: an old URDF of the Panda has friction in attributes that no reader knows."""


@pytest.mark.parametrize("name", REAL_ROBOTS)
def test_real_robots_cause_no_warnings_but_right_ones(name):
    robot = read_urdf(real_urdf(name))
    assert len(robot.reader_warnings) == (name in EXTENSIONS)
    assert all(warning.startswith(EXTENSIONS[name]) for warning in robot.reader_warnings)
    assert not any("no <inertial>" in warning for warning in robot.warnings)


SHAPE = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
MISSING = {
    "shape": (SHAPE, "", ["link 'b' has a shape and moves, but has no <inertial>: its mass is taken as 0"]),
    "collision shape": (SHAPE.replace("visual", "collision"), "", ["link 'b' has a shape and moves"]),
    "shape of a link that is fixed to it": ("", SHAPE, ["link 'b' has a shape and moves"]),
    "virtual link": ("", "", []),
    "explicit zero": (SHAPE + INERTIAL.replace('"2"', '"0"').replace("0.1", "0").replace("0.2", "0"), "", []),
    "mass of a link that is fixed to it": (SHAPE, INERTIAL, []),
}


@pytest.mark.parametrize("case", MISSING)
def test_moving_link_with_a_shape_needs_an_inertial(case):
    content, fixed_content, warnings = MISSING[case]
    joint = '<joint name="f" type="fixed"><parent link="b"/><child link="d"/></joint>'
    text = added(f'<link name="d">{fixed_content}</link>{joint}').replace(INERTIAL, content, 1)
    robot = load_robot(text)
    sentences = [sentence for sentence in robot.warnings if "no <inertial>" in sentence]
    assert len(sentences) == len(warnings) and all(map(str.startswith, sentences, warnings))
    if warnings:
        with pytest.raises(DescriptionError, match="no <inertial>"):
            load_robot(text, strict=True)
        body = Inertia.about_centre_of_mass(1.0, np.eye(3), [0.1, 0, 0])
        assert robot.with_payload("b", body).warnings == ()


def test_base_without_inertial_is_named_only_where_it_moves():
    text = URDF.replace('<link name="a"/>', f'<link name="a">{SHAPE}</link>')
    assert load_robot(text).warnings == ()
    assert "link 'a' has a shape and moves" in " ".join(load_robot(text, moving_base=True).warnings)


def modules_after(program):
    """Return the names of the modules that a Python program imports in a new interpreter."""
    program += "\nimport json, sys\nprint(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    return set(json.loads(done.stdout.splitlines()[-1]))


PAR = "NL=1\nNJ=1\nNF=1\nant={0}\nsigma={0}\nb={0}\ngamma={0}\nalpha={0}\nd={0}\ntheta={th1}\nr={0}\nM={2}\nMX={1}"


def test_parser_of_urdf_is_not_imported_for_other_formats():
    program = f"""
import robot_dynamics as rd
for text in ("rx90", {PAR!r}):
    dynamics = rd.Dynamics(rd.load_robot(text))
    zeros = [0.0] * len(dynamics.robot.joints)
    dynamics.inverse(zeros, zeros, zeros), dynamics.inertia_matrix(zeros)
"""
    assert not {"yourdfpy", "trimesh", "networkx"} & modules_after(program)
    assert not {"yourdfpy", "lxml", "numpy", "scipy"} & modules_after("import robot_dynamics")


@pytest.mark.slow
def test_urdf_imports_no_more_of_trimesh_than_its_parser():
    def of_trimesh(program):
        return {name for name in modules_after(program) if name.partition(".")[0] == "trimesh"}

    needed = of_trimesh("import yourdfpy")
    assert needed and of_trimesh("import robot_dynamics as rd; rd.load_robot('ur5e')") == needed
