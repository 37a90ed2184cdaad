"""URDF that is wrong is refused by the project's own error, which says what, where, and what would be right."""

import os
import subprocess
import sys
import time

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from peers.real_robots import real_urdf

from robot_dynamics import DescriptionError, RobotDynamicsError, load_robot
from robot_dynamics.model.formats.decoding import MAX_DESCRIPTION_LENGTH
from robot_dynamics.model.formats.urdf.reader import read_urdf

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
JOINT = '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>'
GOOD = f'<robot name="r">\n<link name="a"/>\n<link name="b">{INERTIAL}</link>\n{JOINT}\n</robot>'


def changed(old, new):
    assert old in GOOD
    return GOOD.replace(old, new)


def with_xacro(old, new):
    """Return GOOD with the namespace of xacro and a replacement."""
    return changed(old, new).replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')


def test_valid_description_is_read():
    assert [joint.name for joint in read_urdf(GOOD).joints] == ["j"]


BAD = {
    "malformed": (GOOD[:-5], "not well-formed"),
    "crossed tags": (changed("</link>", "</lnik>"), "not well-formed"),
    "empty": ("", "empty"),
    "blank": (" \n\t ", "empty"),
    "not a robot": ("<sdf/>", "root element is <sdf>"),
    "doctype": ("<!DOCTYPE robot>" + GOOD, "line 1: a DOCTYPE"),
    "doctype in lower case": ("<?xml version='1.0'?>\n<!doctype robot>" + GOOD, "line 2: a DOCTYPE"),
    "entity bomb": ('<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>' + changed("r", "&b;"), "DOCTYPE"),
    "external entity": ('<!DOCTYPE r [<!ENTITY f SYSTEM "file:///etc/passwd">]>' + GOOD, "DOCTYPE"),
    "external include": (
        changed("</robot>", '<i:include xmlns:i="http://www.w3.org/2001/XInclude" href="/etc/passwd"/></robot>'),
        "line 5: an XInclude",
    ),
    "external include in what is drawn": (
        changed("</link>", '<visual xmlns:i="http://www.w3.org/2001/XInclude">\n<i:fallback/></visual></link>'),
        "line 4: an XInclude",
    ),
    "external include by default namespace": (
        changed("</robot>", '<include xmlns="http://www.w3.org/2001/XInclude" href="/etc/passwd"/></robot>'),
        "line 5: an XInclude",
    ),
    "external include by a prefix that is not declared": (
        changed("</robot>", '<gazebo><xi:include href="/etc/passwd"/></gazebo></robot>'),
        "line 5: an XInclude",
    ),
    "undeclared entity": (changed('name="a"', 'name="&a;"'), "not well-formed"),
    "xacro": (
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n<xacro:property name="x" value="1"/></robot>',
        "line 2: <xacro:property> is xacro",
    ),
    "xacro in what is drawn": (with_xacro("</link>", "<visual><xacro:if/></visual></link>"), "line 3: .* is xacro"),
    "call of a macro alone": ('<robot name="r" xmlns:xacro="http://ros.org/xacro"><xacro:arm/></robot>', "is xacro"),
    "call of a macro in a link": (
        with_xacro(INERTIAL, '<xacro:inertial mass="1"/>'),
        "line 3: <xacro:inertial> is in a <link>, and is xacro. Expand it first",
    ),
    "call of a macro in an inertial": (with_xacro("<mass", "<xacro:centre/><mass"), "is in a <inertial>"),
    "call of a macro in a joint": (with_xacro("<axis", "<xacro:limits/><axis"), "line 4: .* is in a <joint>"),
    "call of a macro around a link": (
        with_xacro(JOINT, JOINT + '<xacro:arm><link name="c"/></xacro:arm>'),
        "line 4: <xacro:arm> has a link or joint",
    ),
    "joint with a prefix that is not declared": (
        changed(JOINT, JOINT + JOINT.replace("<joint", "<my:joint").replace("</joint", "</my:joint")),
        "line 4: <my:joint> has a link or joint, and its prefix is not declared",
    ),
    "inertia with a prefix that is not declared": (changed("<inertia ", "<my:inertia "), "is in a <inertial>"),
    "prefix that is not declared and a crossed tag": (changed(JOINT, JOINT + "<a:b></a:c>"), "not well-formed"),
    "root with a prefix that is not declared": ("<my:sdf>" + GOOD + "</my:sdf>", "root element is <my:sdf>"),
    "root of a long name": (f"<{'s' * 5000}/>", "root element is <sss.*…s*>"),
    "long instruction": (f"<?{'x' * 5000}", "not well-formed XML: .*…x*.*line 1, column"),
    "no link": ('<robot name="r"/>', "no <link>"),
    "link without name": (changed('<link name="a"/>', "<link/>"), "line 2: this <link> has no name"),
    "two links of a name": (changed('<link name="b">', '<link name="a">'), "'a' is already defined at line 2"),
    "two joints of a name": (changed(JOINT, JOINT + JOINT), "joint 'j' is already defined"),
    "unknown joint type": (changed("revolute", "revolut"), "line 4: joint 'j' has type 'revolut': known are"),
    "planar joint": (changed("revolute", "planar"), "'planar': known are"),
    "no joint type": (changed(' type="revolute"', ""), "type None"),
    "floating inside": (
        changed(
            JOINT, JOINT + '<link name="c"/><joint name="k" type="floating"><parent link="b"/><child link="c"/></joint>'
        ),
        "'k' is floating inside",
    ),
    "no parent": (changed('<parent link="a"/>', ""), "no <parent"),
    "unknown parent": (changed('parent link="a"', 'parent link="aa"'), "unknown link 'aa': known are a, b"),
    "unknown child": (changed('child link="b"', 'child link="x"'), "unknown link 'x'"),
    "self-parent": (changed('child link="b"', 'child link="a"'), "roots|cycle"),
    "cycle": (
        changed(JOINT, JOINT + '<joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint>'),
        "cycle",
    ),
    "cycle beside a tree": (
        changed(
            JOINT,
            JOINT + '<link name="c"/><link name="d"/>'
            '<joint name="k" type="fixed"><parent link="c"/><child link="d"/></joint>'
            '<joint name="l" type="fixed"><parent link="d"/><child link="c"/></joint>',
        ),
        "'c', 'd' form a cycle",
    ),
    "two roots": (changed(JOINT, ""), "'a' and 'b' are all roots"),
    "two parents": (
        changed(JOINT, JOINT + '<link name="c"/>' + JOINT.replace('"j"', '"k"').replace('"a"', '"c"')),
        "child of joint 'j' and of joint 'k'",
    ),
    "missing inertia": (changed('<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>', ""), "'b' .*<inertia>"),
    "missing moment": (changed('iyy="1" ', ""), "link 'b': <inertia> lacks iyy"),
    "missing mass": (changed('<mass value="1"/>', ""), "link 'b' has an <inertial> without <mass>"),
    "mass without value": (changed('<mass value="1"/>', "<mass/>"), "link 'b': <mass> lacks value"),
    "two inertials": (changed(INERTIAL, INERTIAL * 2), "link 'b' has a second <inertial>"),
    "negative mass": (changed('mass value="1"', 'mass value="-1"'), "link 'b': mass -1 kg is negative"),
    "mass is NaN": (changed('mass value="1"', 'mass value="nan"'), "link 'b': <mass> has value='nan'"),
    "moment is infinite": (changed('ixx="1"', 'ixx="inf"'), "link 'b': <inertia> has ixx='inf'"),
    "word for a number": (changed('ixx="1"', 'ixx="one"'), "ixx='one', a number is needed"),
    "underscored number": (changed('ixx="1"', 'ixx="1_0"'), "ixx='1_0'"),
    "axis of two numbers": (changed('xyz="0 0 1"', 'xyz="0 1"'), "line 4: joint 'j': <axis> has xyz='0 1', 3 numbers"),
    "axis without direction": (changed('xyz="0 0 1"', 'xyz="0 0 0"'), "joint 'j': axis '0 0 0' has no direction"),
    "axis is NaN": (changed('xyz="0 0 1"', 'xyz="0 nan 1"'), "joint 'j': <axis>"),
    "origin of a joint": (changed("<axis", '<origin rpy="0 0"/><axis'), "joint 'j': <origin> has rpy='0 0'"),
    "negative damping": (changed("<axis", '<dynamics damping="-1"/><axis'), "damping -1 is negative"),
    "limit is NaN": (changed("<axis", '<limit lower="nan"/><axis'), "<limit> has lower='nan'"),
    "mimic without joint": (changed("<axis", "<mimic/><axis"), "<mimic> lacks joint"),
    "axis too long": (changed('xyz="0 0 1"', 'xyz="0 1e200 0"'), "far from a unit vector"),
    "digits of another script": (changed('mass value="1"', 'mass value="٣"'), "value='٣', a number is needed"),
    "second origin": (changed("<axis", "<origin/><origin/><axis"), "joint 'j' has a second <origin>"),
    "second axis": (changed("<axis", "<axis/><axis"), "joint 'j' has a second <axis>"),
    "second mass": (changed("<mass", '<mass value="2"/><mass'), "link 'b' has a second <mass>"),
    "namespace": (changed("<robot", '<robot xmlns="http://example.org"'), "Remove its attribute xmlns"),
    "root element of xacro": (
        changed("<robot", '<xacro:robot xmlns:xacro="http://wiki.ros.org/xacro"').replace("</robot", "</xacro:robot"),
        "the root element <xacro:robot> is xacro. Expand it first",
    ),
    "xacro in the name of a joint": (changed('name="j"', 'name="${prefix}j"'), r"name='\$\{prefix\}j', which is xacro"),
    "xacro in the name of a robot": (changed('robot name="', 'robot name="$(arg name)'), "which is xacro. Expand"),
    "xacro as a mass": (changed('mass value="1"', 'mass value="${m}"'), r"<mass> has value='\$\{m\}', which is xacro"),
    "xacro as angles": (
        changed("<axis", '<origin rpy="0 ${pi/2} 0"/><axis'),
        r"<origin> has rpy='0 \$\{pi/2\} 0', which",
    ),
    "mimic of a fixed joint": (
        changed(
            JOINT,
            JOINT.replace("<axis", '<mimic joint="k"/><axis')
            + '<link name="c"/><joint name="k" type="fixed"><parent link="b"/><child link="c"/></joint>',
        ),
        "'j' mimics joint 'k', which is fixed",
    ),
    "too many joints": (
        '<robot name="r"><link name="0"/>'
        + "".join(
            f'<link name="{k}"/><joint name="{k}" type="continuous"><parent link="{k - 1}"/><child link="{k}"/></joint>'
            for k in range(1, 2002)
        )
        + "</robot>",
        "2001 moving joints",
    ),
    "deep": ("<robot name='r'>" + "<a>" * 5000 + "</a>" * 5000 + "</robot>", "not well-formed"),
    "null character": (changed('name="a"', 'name="\0"'), "not well-formed"),
}


@pytest.mark.parametrize("case", BAD)
def test_malformed_urdf_is_refused_with_a_reason(case):
    text, reason = BAD[case]
    with pytest.raises(DescriptionError, match=reason) as refusal:
        read_urdf(text)
    assert len(str(refusal.value)) < 500


LEFT_OVER = {
    "namespace of XInclude, unused": (changed("<robot", '<robot xmlns:xi="http://www.w3.org/2001/XInclude"'), ()),
    "call of a macro of sensors": (
        with_xacro(JOINT, f'<xacro:imu rate="5"/>\n{JOINT}\n<xacro:imu/>\n<xacro:camera><x/></xacro:camera>'),
        ("line 4 and 1 more: <xacro:imu> is ignored", "line 7: <xacro:camera> is ignored"),
    ),
    "call of a macro of colours": (
        with_xacro("</link>", "\n<visual><xacro:grey/></visual></link>"),
        ("line 4: <xacro:grey> is ignored",),
    ),
    "prefix that is not declared": (
        changed(JOINT, JOINT + '\n<gazebo reference="b">\n<sensor:camera name="rgb" a:b="1"/></gazebo>'),
        ("line 6: <sensor:camera> is ignored",),
    ),
    "joint of a plugin with a prefix that is not declared": (
        changed("</robot>", "\n<gazebo><c:plugin><joint>j</joint></c:plugin></gazebo></robot>"),
        ("line 6: <c:plugin> is ignored",),
    ),
    "attribute whose prefix is not declared": (changed('<link name="b"', '<link my:colour="red" name="b"'), ()),
    "prefixes of simulators": (
        changed("</robot>", '<c:p xmlns:c="http://example.org/#controller"><joint/></c:p></robot>'),
        (),
    ),
}


@pytest.mark.parametrize("case", LEFT_OVER)
def test_unexpanded_elements_are_ignored_with_a_warning(case):
    text, warnings = LEFT_OVER[case]
    robot, expected = read_urdf(text, source="left.urdf"), read_urdf(GOOD)
    for sentence, warning in zip(robot.reader_warnings, warnings, strict=True):
        assert sentence.startswith(warning)
    assert [link.name for link in robot.links] == [link.name for link in expected.links]
    assert [joint.name for joint in robot.joints] == ["j"] and robot.links[1].inertia.mass == 1


@pytest.mark.slow
def test_show_command_lists_ignored_elements(tmp_path):
    path = tmp_path / "left.urdf"
    path.write_text(LEFT_OVER["call of a macro of sensors"][0])
    process = subprocess.run(
        [sys.executable, "-m", "robot_dynamics.cli.main", "show", path], capture_output=True, text=True, timeout=60
    )
    assert process.returncode == 0 and "WARNING" not in process.stderr
    assert process.stdout.count("\nwarning: ") == 2 and "warning: line 7: <xacro:camera>" in process.stdout


def test_description_of_100_megabytes_is_refused_before_it_is_parsed(tmp_path):
    text = GOOD + " " * 100_000_000
    path = tmp_path / "large.urdf"
    path.write_text(text)
    started = time.perf_counter()
    for description in (text, text.encode(), path, str(path)):
        with pytest.raises(DescriptionError, match=str(MAX_DESCRIPTION_LENGTH)):
            load_robot(description)
    assert time.perf_counter() - started < 5  # a parser would take far longer: this is no measure of speed


@pytest.mark.parametrize(
    ("description", "reason"),
    [
        ("/no/such/file.urdf", "cannot be read as a file"),
        ("", "empty"),
        ("nobody", "no robot of that name ships"),
        (b"", "is empty: the text of a URDF, a xacro, an SDF, an MJCF"),
        (b"\xff\xfe\x00", "cannot be decoded|not well-formed"),
        (b'<?xml version="1.0" encoding="klingon"?>' + GOOD.encode(), "klingon"),
        (b'<?xml version="1.0" encoding="undefined"?>' + GOOD.encode(), "cannot be decoded"),
        (b'<?xml version="1.0" encoding="punycode"?>' + GOOD.encode(), "punycode is no character set"),
        ("/dev/zero", "is not a file"),
        ("/", "is not a file"),
        ("a\0b", "cannot be read"),
        (None, "None"),
        (42, "42"),
    ],
)
def test_unreadable_file_is_refused(description, reason):
    with pytest.raises(DescriptionError, match=reason):
        load_robot(description)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1"])
def test_encodings_that_a_file_declares_are_read(encoding, tmp_path):
    declared = {"utf-16": "utf-16", "iso-8859-1": "iso-8859-1"}.get(encoding, "utf-8")
    path = tmp_path / "robot.urdf"
    path.write_bytes((f'<?xml version="1.0" encoding="{declared}"?>' + changed('"b"', '"bä"')).encode(encoding))
    assert load_robot(path).links[1].name == "bä"


def test_doctype_in_another_encoding_is_refused(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_bytes(('<!DOCTYPE r [<!ENTITY f SYSTEM "file:///etc/passwd">]>' + GOOD).encode("utf-16"))
    with pytest.raises(DescriptionError, match="DOCTYPE"):
        load_robot(path)


def test_pipe_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")  # reading it would wait for ever
    with pytest.raises(DescriptionError, match="is not a file"):
        load_robot(tmp_path / "pipe")


def test_unused_elements_are_not_interpreted():
    drawn = (
        '<visual><geometry><mesh filename="package://nowhere/none.stl" scale="x"/></geometry></visual>'
        '<collision><geometry><sphere radius="many"/></geometry></collision></link>'
    )
    unused = '<safety_controller k_velocity="fast"/><calibration rising="x"/><axis'
    assert len(read_urdf(changed("</link>", drawn)).joints) == 1
    assert len(read_urdf(changed("<axis", unused)).joints) == 1


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_mutated_urdf_raises_only_description_errors(data):
    """Real descriptions with pieces cut out, doubled, swapped or replaced."""
    text = data.draw(st.sampled_from([GOOD, real_urdf("ur5")[:6000] + "</robot>", real_urdf("kinova")]))
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        end = min(len(text), start + data.draw(st.integers(0, 30)))
        piece = data.draw(
            st.sampled_from(
                ["", "nan", "-1", "1e999", "<", "/>", '"', "&amp;", "\0", "0 0", "fixed", text[start:end] * 2]
            )
            | st.text(max_size=5)
        )
        text = text[:start] + piece + text[end:]
    try:
        read_urdf(text)
    except RobotDynamicsError:
        pass
