"""SDF: inverse dynamics as those of MuJoCo and Drake, and refusals by name."""

import numpy as np
import pytest

from robot_dynamics import DescriptionError, Dynamics, load_robot, write_mdh_yaml
from robot_dynamics.model.formats.sdf.document import is_sdf

INERTIA = "<ixx>.02</ixx><iyy>.03</iyy><izz>.04</izz><ixy>.001</ixy><ixz>.002</ixz><iyz>-.003</iyz>"
ROD = f"<inertial><pose>.1 .02 .03 0 0 0</pose><mass>1.5</mass><inertia>{INERTIA}</inertia></inertial>"
MJCF_ROD = '<inertial pos=".1 .02 .03" mass="1.5" fullinertia=".02 .03 .04 .001 .002 -.003"/>'


def link(name, pose="0 0 0", relative_to="", content=ROD):
    """An element <link>; pose: three or six numbers."""
    pose = " ".join([*pose.split(), "0", "0", "0"][:6])
    relative = f' relative_to="{relative_to}"' if relative_to else ""
    return f'<link name="{name}"><pose{relative}>{pose}</pose>{content}</link>'


def joint(name, kind, parent, child, axis="0 0 1", content="", pose="", expressed_in=""):
    """An element <joint>; content: of its <axis>."""
    frame = f' expressed_in="{expressed_in}"' if expressed_in else ""
    axis = f"<axis><xyz{frame}>{axis}</xyz>{content}</axis>" if axis else ""
    pose = f"<pose>{pose}</pose>" if pose else ""
    return f'<joint name="{name}" type="{kind}"><parent>{parent}</parent><child>{child}</child>{pose}{axis}</joint>'


def sdf(*elements, version="1.9", name="robot", attributes=""):
    return f'<sdf version="{version}"><model name="{name}"{attributes}>{"".join(elements)}</model></sdf>'


PASSIVE = "<limit><effort>0</effort></limit>"
TREE = (
    sdf(
        "<!-- a comment -- that XML forbids --><pose>0 0 1 .1 .2 .3</pose>",
        link("stand"),
        link("torso", ".1 .2 .3 .3 -.2 .5", "stand"),
        link("tool", ".3 0 0 0 .4 0", "torso"),
        link("side", "-.3 0 0", "torso"),
        '<frame name="diagonal" attached_to="torso"><pose degrees="true">1 2 3 0 90 0</pose></frame>',
        joint("held", "fixed", "world", "stand", ""),
        joint("slide", "prismatic", "stand", "torso", "1 2 3", "<dynamics><damping>.3</damping></dynamics>"),
        joint(
            "turn",
            "revolute",
            "torso",
            "tool",
            "0 2 1",
            "<limit><lower>-1</lower><upper>2</upper><effort>40</effort><velocity>-1</velocity></limit>"
            "<dynamics><friction>.6</friction><spring_stiffness>7</spring_stiffness>"
            "<spring_reference>.3</spring_reference></dynamics>",
            ".1 .2 .3 0 0 0",
        ),
        joint("side", "continuous", "torso", "side", expressed_in="diagonal"),
    ),
    f"""<mujoco><compiler angle="radian" eulerseq="XYZ"/><worldbody>
  <body name="stand" pos="0 0 1" euler=".1 .2 .3">{MJCF_ROD}
    <body name="torso" pos=".1 .2 .3" euler=".3 -.2 .5">{MJCF_ROD}
      <joint name="slide" type="slide" axis="1 2 3" damping=".3"/>
      <body name="tool" pos=".3 0 0" euler="0 .4 0">{MJCF_ROD}
        <joint name="turn" axis="0 2 1" pos=".1 .2 .3" stiffness="7" springref=".3"/></body>
      <body name="side" pos="-.3 0 0">{MJCF_ROD}<joint name="side" axis="1 0 0"/></body>
    </body></body></worldbody></mujoco>""",
)
FREE = (
    sdf(
        link("trunk", "0 0 1"),
        link("leg", ".1 0 0", "trunk"),
        link("foot", "0 0 -.4", "leg"),
        link("arm", "0 .3 0", "trunk"),
        joint("hip", "revolute", "trunk", "leg", "0 1 0"),
        joint("knee", "revolute", "leg", "foot", "0 1 .1", pose="0 0 .1 0 0 0"),
        joint("shoulder", "revolute", "trunk", "arm", "1 0 0"),
    ),
    f"""<mujoco><worldbody><body name="trunk" pos="0 0 1"><freejoint name="root"/>{MJCF_ROD}
  <body name="leg" pos=".1 0 0">{MJCF_ROD}<joint name="hip" axis="0 1 0"/>
    <body name="foot" pos="0 0 -.4">{MJCF_ROD}<joint name="knee" axis="0 1 .1" pos="0 0 .1"/></body></body>
  <body name="arm" pos="0 .3 0">{MJCF_ROD}<joint name="shoulder" axis="1 0 0"/></body>
</body></worldbody></mujoco>""",
)
FOUR_BAR = sdf(
    link("crank"),
    link("coupler", "0 0 .3"),
    link("rocker", ".5 0 0"),
    joint("crank", "revolute", "world", "crank", "0 1 0"),
    joint("coupler", "revolute", "crank", "coupler", "0 1 0", PASSIVE),
    joint("rocker", "revolute", "world", "rocker", "0 1 0", PASSIVE),
    joint("pin", "ball", "coupler", "rocker", "", pose="0 0 .4 0 0 0"),
)
MJCF_FOUR_BAR = f"""<mujoco><worldbody>
  <body name="crank">{MJCF_ROD}<joint name="crank" axis="0 1 0"/>
    <body name="coupler" pos="0 0 .3">{MJCF_ROD}<joint name="coupler" axis="0 1 0"/></body></body>
  <body name="rocker" pos=".5 0 0">{MJCF_ROD}<joint name="rocker" axis="0 1 0"/></body></worldbody>
<equality><connect body1="coupler" body2="rocker" anchor=".5 0 .1"/></equality>
<actuator><motor joint="crank"/></actuator></mujoco>"""
SCREW = (
    sdf(
        link("nut"),
        link("cross", "0 0 .3"),
        joint("screw", "screw", "world", "nut", "0 0 1").replace(
            "<axis>", "<screw_thread_pitch>.5</screw_thread_pitch><axis>"
        ),
        joint("cross", "universal", "nut", "cross", "1 0 0").replace(
            "</joint>", "<axis2><xyz>0 1 0</xyz><dynamics><damping>.2</damping></dynamics></axis2></joint>"
        ),
    ),
    f"""<mujoco><worldbody><body name="nut">{MJCF_ROD}<joint name="screw" axis="0 0 1"/>
  <joint name="travel" type="slide" axis="0 0 1"/>
  <body name="cross" pos="0 0 .3">{MJCF_ROD}<joint name="cross" axis="1 0 0"/>
    <joint name="axis2" axis="0 1 0" damping=".2"/></body></body></worldbody>
<equality><joint joint1="travel" joint2="screw" polycoef="0 {0.25 / np.pi} 0 0 0"/></equality></mujoco>""",
)
MIMIC = (
    sdf(
        link("first"),
        link("second", ".2 0 0"),
        joint("leader", "revolute", "world", "first", "0 1 0"),
        joint(
            "follower",
            "prismatic",
            "first",
            "second",
            "1 0 0",
            '<mimic joint="leader"><multiplier>-1.5</multiplier><offset>.2</offset><reference>.1</reference></mimic>',
        ),
    ),
    f"""<mujoco><worldbody><body name="first">{MJCF_ROD}<joint name="leader" axis="0 1 0"/>
  <body name="second" pos=".2 0 0">{MJCF_ROD}<joint name="follower" type="slide" axis="1 0 0"/></body></body>
</worldbody><equality><joint joint1="follower" joint2="leader" polycoef=".35 -1.5 0 0 0"/></equality></mujoco>""",
)
GEARBOX = (
    sdf(
        link("pelvis"),
        link("rotor"),
        link("thigh", ".1 0 0"),
        joint("hip", "revolute", "world", "pelvis", "0 0 1"),
        joint("motor", "revolute", "pelvis", "rotor", "0 -1 0"),
        joint("knee", "revolute", "pelvis", "thigh", "0 1 0"),
        joint("gears", "gearbox", "rotor", "thigh", "0 1 0").replace(
            "</joint>",
            "<axis2><xyz>0 1 0</xyz></axis2><gearbox_ratio>.04</gearbox_ratio>"
            "<gearbox_reference_body>pelvis</gearbox_reference_body></joint>",
        ),
    ),
    f"""<mujoco><worldbody><body name="pelvis">{MJCF_ROD}<joint name="hip" axis="0 0 1"/>
  <body name="rotor">{MJCF_ROD}<joint name="motor" axis="0 -1 0"/></body>
  <body name="thigh" pos=".1 0 0">{MJCF_ROD}<joint name="knee" axis="0 1 0"/></body></body></worldbody>
<equality><joint joint1="motor" joint2="knee" polycoef="0 25 0 0 0"/></equality></mujoco>""",
)
CASTER = (
    sdf(
        link("cart"),
        link("ball", ".1 .2 .3 .1 0 0"),
        joint("wheel", "revolute", "world", "cart", "0 1 0"),
        joint("caster", "ball", "cart", "ball", "", pose="0 .1 0 0 0 0"),
    ),
    f"""<mujoco><compiler angle="radian" eulerseq="XYZ"/><worldbody>
<body name="cart">{MJCF_ROD}<joint name="wheel" axis="0 1 0"/>
  <body name="ball" pos=".1 .2 .3" euler=".1 0 0">{MJCF_ROD}<joint axis="1 0 0" pos="0 .1 0"/>
    <joint axis="0 1 0" pos="0 .1 0"/><joint axis="0 0 1" pos="0 .1 0"/></body></body></worldbody></mujoco>""",
)
PAIRS = {
    "tree": TREE,
    "free base": FREE,
    "four-bar": (FOUR_BAR, MJCF_FOUR_BAR),
    "screw": SCREW,
    "mimic": MIMIC,
    "gearbox": GEARBOX,
    "caster": CASTER,
}


@pytest.mark.reference
@pytest.mark.parametrize("name", PAIRS)
def test_inverse_dynamics_are_those_of_mujoco(name):
    """The same robot is written as an SDF and as an MJCF."""
    mujoco = pytest.importorskip("mujoco")
    from foreign_models import inverse_difference  # needs mujoco

    text, mjcf = PAIRS[name]
    robot = load_robot(text)
    model = mujoco.MjModel.from_xml_string(mjcf)
    model.opt.gravity[:] = robot.gravity
    differences = [inverse_difference(model, robot, seed) for seed in range(3)]
    assert max(differences) < (1e-9 if robot.loops else 1e-12), differences


DRAKE_EFFORTS = [1.2475037591374765, 0.9716962553245705]
"""Of FRAMES [N m]: CalcInverseDynamics of Drake 1.51.1 with gravity 9.81 m/s², in the state of the test."""

FRAMES = sdf(
    link("base"),
    '<frame name="mount" attached_to="base"><pose relative_to="tilted">.1 0 .2 .3 0 0</pose></frame>',
    '<frame name="tilted" attached_to="base"><pose degrees="true">0 .1 0 10 20 30</pose></frame>',
    '<model name="arm" placement_frame="flange" canonical_link="upper">',
    '<pose relative_to="mount">.1 .2 .3 0 .5 0</pose>',
    link("upper", ".1 0 0 .2 0 0"),
    link("fore", "0 0 .5", "elbow_frame"),
    '<frame name="elbow_frame" attached_to="upper"><pose relative_to="upper">0 0 .4 .1 .2 .3</pose></frame>',
    '<frame name="flange" attached_to="upper"><pose>0 .1 0 .4 0 0</pose></frame>',
    joint("elbow", "revolute", "elbow_frame", "fore", "0 1 0", pose=".1 0 0 0 0 .2").replace(
        "<pose>", '<pose relative_to="elbow_frame">'
    ),
    "</model>",
    joint("shoulder", "revolute", "mount", "arm", "1 0 1", expressed_in="mount"),
    joint("ground", "fixed", "world", "base", ""),
)


def test_frames_are_those_of_drake():
    """Nested models, frames, a placement frame, and an axis and poses in other frames."""
    dynamics = Dynamics(load_robot(FRAMES), compiled=False)
    assert dynamics.joint_names == ("shoulder", "arm::elbow")
    efforts = dynamics.inverse([0.3, -0.7], [0.5, 1.1], [-0.4, 0.9])
    np.testing.assert_allclose(efforts, DRAKE_EFFORTS, atol=1e-12)


def test_reads_what_the_model_says():
    robot = load_robot(TREE[0])
    assert robot.name == "robot" and not robot.moving_base and robot.base_link == "world"
    assert [joint.role for joint in load_robot(CASTER[0]).joints] == ["actuated", *3 * ["passive"]]
    slide, turn, _ = robot.joints
    assert slide.prismatic and slide.viscous_friction == 0.3 and slide.role == "actuated"
    assert (turn.limits.lower, turn.limits.upper, turn.limits.effort, turn.limits.velocity) == (-1, 2, 40, np.inf)
    assert turn.spring.stiffness == 7 and turn.spring.rest == 0.3 and turn.coulomb_friction == 0.6
    assert robot.frame("stand").link == 0 and robot.frame("diagonal").link == robot.frame("torso").link == 1
    assert not robot.warnings


def test_revolute_joint_closes_a_planar_loop_as_a_ball_joint_does():
    pin = '<joint name="pin" type="ball">'
    assert pin in FOUR_BAR
    revolute = FOUR_BAR.replace(pin, '<joint name="pin" type="revolute">').replace(
        "0 0 .4 0 0 0</pose>", f"0 0 .4 0 0 0</pose><axis><xyz>0 1 0</xyz>{PASSIVE}</axis>"
    )
    robots = load_robot(FOUR_BAR), load_robot(revolute)
    assert [loop.name for robot in robots for loop in robot.loops] == ["pin", "pin"]
    expected, efforts = (Dynamics(robot, compiled=False).inverse([0.2], [1.1], [0.7]) for robot in robots)
    np.testing.assert_allclose(efforts, expected, atol=1e-10)


def test_joint_towards_its_parent_turns_in_its_sense():
    """The rod is the child of both: the second joint leads from it to its parent, with sign and zero of the joint."""
    pair = sdf(
        link("a"),
        link("rod", "0 0 .3"),
        link("b", ".1 .2 .3"),
        joint("ground", "revolute", "world", "a", "0 0 1"),
        joint("first", "revolute", "a", "rod", "0 1 0"),
        joint("second", "revolute", "{}", "{}", "1 0 0", pose="{}"),
    )
    forwards = Dynamics(load_robot(pair.format("rod", "b", "0 0 0 0 0 0")), compiled=False)
    backwards = Dynamics(load_robot(pair.format("b", "rod", ".1 .2 0 0 0 0")), compiled=False)
    q, v, a = np.random.default_rng(1).normal(size=(3, 3))
    sign = np.array([1, 1, -1])
    expected = sign * forwards.inverse(sign * q, sign * v, sign * a)
    np.testing.assert_allclose(backwards.inverse(q, v, a), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("version", "content", "expected"),
    [
        ("1.4", "", [1, 0, 0]),
        ("1.6", "", [0, 1, 0]),
        ("1.6", "<use_parent_model_frame>true</use_parent_model_frame>", [1, 0, 0]),
        ("1.12", "", [0, 1, 0]),
    ],
)
def test_old_versions_give_an_axis_in_the_model(version, content, expected):
    text = sdf(
        link("a", f"0 0 0 0 0 {np.pi / 2}"), joint("j", "revolute", "world", "a", "1 0 0", content), version=version
    )
    assert load_robot(text).joints[0].placement[:3, 2].tolist() == expected


def test_gravity_is_that_of_the_world():
    model = sdf(link("a"), joint("j", "revolute", "world", "a")).split(">", 1)[1].removesuffix("</sdf>")
    static = '<model name="ground"><static>true</static><link name="l"/></model>'
    loose = '<model name="ball"><link name="l"/></model>'
    world = f'<sdf version="1.9"><world name="w">{{}}{static}{loose}{model}</world></sdf>'
    assert load_robot(world.format("<gravity>0 1 -2</gravity>")).gravity.tolist() == [0, 1, -2]
    robot = load_robot(world.format(""))
    assert robot.gravity.tolist() == [0, 0, -9.8] and "model 'ball' has no joints and is left out" in robot.warnings[0]
    weightless = sdf(link("a", content=ROD + "<gravity>false</gravity>"), joint("j", "revolute", "world", "a"))
    assert load_robot(weightless).gravity.tolist() == [0, 0, 0]


def test_missing_inertia_is_that_of_sdf():
    robot = load_robot(sdf(link("a", content=""), joint("j", "revolute", "world", "a")))
    assert robot.links[1].inertia.mass == 1 and "SDF defines 1 kg" in robot.warnings[0]


def test_base_can_be_held_or_freed():
    held = load_robot(FREE[0], moving_base=False)
    assert not held.moving_base and held.base_link == "world"
    np.testing.assert_array_equal(held.frame("trunk").placement[:3, 3], [0, 0, 1])
    assert load_robot(TREE[0], moving_base=True).moving_base


def test_rotor_inertia_of_drake():
    extension = "<drake:rotor_inertia>1e-4</drake:rotor_inertia><drake:gear_ratio>100</drake:gear_ratio></joint>"
    text = sdf(link("a"), joint("j", "revolute", "world", "a").replace("</joint>", extension))
    assert load_robot(text).joints[0].rotor_inertia == pytest.approx(1.0)


def test_visuals_are_shapes_of_their_link(tmp_path):
    shapes = (
        "<box><size>1 2 3</size></box>",
        "<cylinder><radius>.1</radius><length>2</length></cylinder>",
        "<capsule><radius>.1</radius><length>2</length></capsule>",
        "<mesh><uri>model://arm/hand.stl</uri><scale>2 2 2</scale></mesh>",
        "<plane/>",
        "<sphere><radius>wide</radius></sphere>",
    )
    material = "<material><diffuse>1 .5 0 1</diffuse></material><transparency>.5</transparency>"
    visuals = "".join(
        f'<visual name="v{n}"><pose>0 0 {n} 0 0 0</pose><geometry>{shape}</geometry>{material}</visual>'
        for n, shape in enumerate(shapes)
    )
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "hand.stl").write_text("")
    file = tmp_path / "arm" / "model.sdf"
    file.write_text(sdf(link("a", content=ROD + visuals), joint("j", "revolute", "world", "a")))
    robot = load_robot(file)
    box, cylinder, capsule, mesh = robot.visuals
    assert box.shape.size.tolist() == [1, 2, 3] and box.colour == (1, 0.5, 0, 0.5) and box.frame == "a"
    assert (cylinder.shape.radius, cylinder.shape.length, cylinder.placement[2, 3]) == (0.1, 2, 1)
    assert capsule.shape.points.tolist() == [[0, 0, -1], [0, 0, 1]] and capsule.shape.radius == 0.1
    assert mesh.shape.file == f"file://{tmp_path}/arm/hand.stl" and mesh.shape.scale.tolist() == [2, 2, 2]
    assert "<radius> is 'wide', a number is needed; the <visual> is not drawn" in robot.warnings[0]


@pytest.fixture
def models(tmp_path):
    """A folder of models: an arm that includes a hand, in two versions."""
    (tmp_path / "hand").mkdir()
    (tmp_path / "arm").mkdir()
    hand = sdf(link("palm"), link("finger", ".1 0 0"), joint("grip", "revolute", "palm", "finger"), name="hand")
    (tmp_path / "hand" / "hand.sdf").write_text(hand)
    (tmp_path / "hand" / "model.config").write_text('<model><sdf version="1.9">hand.sdf</sdf></model>')
    include = "<include{}><uri>model://hand</uri><name>tool</name><pose>0 0 .5 0 0 0</pose></include>"
    arm = sdf(link("a"), include, joint("j", "revolute", "world", "a"), joint("k", "fixed", "a", "{}palm", ""))
    return tmp_path, arm


def test_included_models_are_nested_or_merged(models):
    folder, arm = models
    file = folder / "arm" / "model.sdf"
    efforts = []
    for merge, prefix in (("", "tool::"), (' merge="true"', "")):
        file.write_text(arm.format(merge, prefix))
        robot = load_robot(file)
        assert [joint.name for joint in robot.joints] == ["j", f"{prefix}grip"]
        np.testing.assert_array_equal(robot.frame(f"{prefix}palm").placement[:3, 3], [0, 0, 0.5])
        efforts.append(Dynamics(robot, compiled=False).inverse([0.1, 0.2], [1, 2], [3, 4]))
    np.testing.assert_array_equal(*efforts)
    with pytest.raises(DescriptionError, match=r"line 1: 'model://hand' is not read: this text has no file"):
        load_robot(file.read_text())


def test_errors_of_included_files_name_them(models):
    folder, arm = models
    file = folder / "arm" / "model.sdf"
    file.write_text(arm.format("", "tool::"))
    hand = folder / "hand" / "hand.sdf"
    hand.write_text(hand.read_text().replace("<mass>1.5", "\n<mass>heavy"))
    with pytest.raises(DescriptionError, match=r"hand.sdf < .*model.sdf, line 2: <mass> is 'heavy', a number is"):
        load_robot(file)
    hand.write_text(sdf("<include><uri>model://hand</uri></include>"))
    with pytest.raises(DescriptionError, match="files include each other"):
        load_robot(file)
    for uri in ("../hand/hand.sdf", "/etc/passwd", "file:///etc/passwd", "model://../hand", "https://host/hand"):
        file.write_text(arm.format("", "").replace("model://hand", uri))
        with pytest.raises(DescriptionError, match="is not found"):
            load_robot(file)


def test_folders_of_gazebo_are_searched(models, tmp_path_factory, monkeypatch):
    folder, arm = models
    text = arm.format("", "tool::")
    file = tmp_path_factory.mktemp("elsewhere") / "arm.world"
    model = text.split(">", 1)[1].removesuffix("</sdf>")
    file.write_text(f'<sdf version="1.9"><world name="w">{model}</world></sdf>')
    with pytest.raises(DescriptionError, match="'model://hand' is not found"):
        load_robot(file)
    monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", str(folder))
    assert len(load_robot(file).joints) == 2


def changed(old, new, text=TREE[0]):
    assert old in text
    return text.replace(old, new)


REFUSED = {
    "gearbox": (changed('"continuous"', '"gearbox"'), "gearbox 'side': it needs <gearbox_reference_body>"),
    "unknown type": (changed('"continuous"', '"hinge"'), "joint 'side': unknown type 'hinge'"),
    "automatic inertia": (changed("<inertial>", '<inertial auto="true">'), "link 'stand' has an inertia from its"),
    "added mass": (
        changed("<inertial>", "<inertial><fluid_added_mass><xx>1</xx></fluid_added_mass>"),
        "link 'stand' has <fluid_added_mass>",
    ),
    "partial gravity": (
        changed('<link name="tool">', '<link name="tool"><gravity>0</gravity>'),
        "link 'tool': gravity does not act on it, but on other links",
    ),
    "kinematic": (changed('<link name="tool">', '<link name="tool"><kinematic>1</kinematic>'), "it is kinematic"),
    "static": (changed("<pose>0 0 1 .1", "<static>1</static><pose>0 0 1 .1"), "model 'robot' is static"),
    "loose link": (changed("</model>", link("loose") + "</model>"), "link 'loose': no joints connect it to 'world'"),
    "two robots": (
        f'<sdf version="1.9"><world name="w">{2 * sdf(link("a"), joint("j", "fixed", "world", "a"))[19:-6]}'
        "</world></sdf>",
        "models 'robot', 'robot' move: one robot is read",
    ),
    "cycle of frames": (changed('degrees="true">1 2 3', 'relative_to="diagonal">1 2 3'), "through a cycle of frames"),
    "unknown frame": (changed('relative_to="torso"', 'relative_to="torsO"'), "unknown link or frame 'torsO'.*'torso'"),
    "unknown link": (changed("<child>side", "<child>sied"), "unknown link or frame 'sied': did you mean 'side'"),
    "misspelled element": (changed("<mass>", "<mas>").replace("</mass>", "</mas>"), "<mas> is not an element of <iner"),
    "attribute as in URDF": (changed("<mass>1.5</mass>", '<mass value="1.5"/>'), "<mass> is '', a number is needed"),
    "short pose": (changed(".1 .02 .03 0 0 0", ".1 .02 .03"), "<pose> is '.1 .02 .03', 6 numbers are needed"),
    "negative damping": (changed("<damping>.3", "<damping>-.3"), "damping -0.3 is negative"),
    "no axis": (changed("<xyz>1 2 3", "<xyz>0 0 0"), "joint 'slide': axis .* has no direction"),
    "second mass": (changed("<mass>", "<mass>2</mass><mass>"), "<inertial> has a second <mass>"),
    "two links of one name": (changed('<link name="tool">', '<link name="side">'), "link 'side' is already defined"),
    "version": (changed('version="1.9"', 'version="2.0"'), "the version of SDF is '2.0': 1.2 to 1.12 are read"),
    "entity": ("<!DOCTYPE a [<!ENTITY b 'c'>]><sdf/>", "a DOCTYPE is refused"),
    "no model": ('<sdf version="1.9"><world name="w"/></sdf>', "<world> has no <model>"),
    "spring that follows": (
        changed("<mimic", "<dynamics><spring_stiffness>1</spring_stiffness></dynamics><mimic", MIMIC[0]),
        "joint 'follower' has a spring and follows joint 'leader'",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_has_no_equal_is_refused_by_name(case):
    text, message = REFUSED[case]
    with pytest.raises(DescriptionError, match=rf"(?s)description, line 1: .*{message}"):
        load_robot(text)


def test_table_of_an_sdf_is_the_same_robot():
    for text in (TREE[0], FOUR_BAR):
        robot = load_robot(text)
        table = load_robot(write_mdh_yaml(robot))
        q, v, a = np.full((3, len(Dynamics(robot, compiled=False).joint_names)), 0.2)
        expected, efforts = (Dynamics(model, compiled=False).inverse(q, v, a) for model in (robot, table))
        np.testing.assert_allclose(efforts, expected, atol=1e-10)


def test_root_element_decides():
    assert is_sdf("\ufeff<?xml version='1.0'?>\n<!-- a --> <sdf version='1.9'/>") and is_sdf(b"<gazebo version='1.3'>")
    for text in ("<robot><sdf/></robot>", "<!-- <sdf> -->", "<sdfs/>"):
        assert not is_sdf(text)
