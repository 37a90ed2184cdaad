"""MJCF: inverse dynamics as those of MuJoCo, and refusals by name."""

import numpy as np
import pytest

from robot_dynamics import DescriptionError, Dynamics, load_robot, write_mdh_yaml
from robot_dynamics.model.formats.mjcf import mjcf_process, reader
from robot_dynamics.model.formats.mjcf.document import is_mjcf

mujoco = pytest.importorskip("mujoco")

from foreign_models import inverse_difference  # noqa: E402  needs mujoco

pytestmark = pytest.mark.reference

BODY = '<inertial pos=".1 .02 .03" mass="{mass}" fullinertia=".02 .03 .04 .001 .002 -.003"/>'
ROD = BODY.format(mass=1.5)
TREE = f"""<!-- a comment with <urdf> --><mujoco model="tree">
  <compiler angle="radian"/>
  <option gravity="1 2 -9"/>
  <default><joint armature=".1" damping=".3"/></default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="stand" pos="0 0 1" euler=".1 .2 .3">
      <geom size=".1"/>
      <body name="torso" pos=".1 .2 .3" quat="1 .5 -.2 .1">
        {ROD}
        <joint name="slide" type="slide" axis="1 2 3" pos=".1 0 0" ref=".2"/>
        <joint name="first" axis="1 1 0" pos=".1 .2 .3" ref=".4" range="-1 2" limited="true"/>
        <joint name="second" axis="0 -1 0" stiffness="7" springref=".3" frictionloss=".6"/>
        <body name="tool" pos=".3 0 0"><geom type="box" size=".1 .2 .3" pos=".1 0 0" mass=".4"/></body>
        <body pos="-.3 0 0">{ROD}<joint axis="1 0 0" name="side"/></body>
      </body>
    </body>
    <body name="other">{ROD}<joint name="other" axis="0 0 1" ref=".1"/></body>
  </worldbody>
  <equality><joint joint1="side" joint2="other" polycoef=".2 -1.5 0 0 0"/></equality>
  <actuator>
    <motor joint="first" gear="20" ctrlrange="-2 3" ctrllimited="true"/>
    <position joint="second" kp="100" forcerange="-9 9" forcelimited="true"/>
    <motor joint="other"/>
  </actuator>
</mujoco>
"""
FREE = f"""<mujoco><worldbody><light pos="0 0 1"/><body name="trunk" pos="0 0 1"><freejoint name="root"/>{ROD}
  <body name="leg" pos=".1 0 0">{ROD}<joint name="hip" axis="0 1 0"/>
    <body name="foot" pos="0 0 -.4">{ROD}<joint name="knee" axis="0 1 .1" pos="0 0 .1"/></body></body>
  <body name="arm" pos="0 .3 0">{ROD}<joint name="shoulder" axis="1 0 0"/></body>
</body></worldbody></mujoco>"""
FOUR_BAR = f"""<mujoco><worldbody>
  <body name="crank">{ROD}<joint name="crank" axis="0 1 0"/>
    <body name="coupler" pos="0 0 .3">{ROD}<joint name="coupler" axis="0 1 0"/></body></body>
  <body name="rocker" pos=".5 0 0">{ROD}<joint name="rocker" axis="0 1 0"/></body>
</worldbody>
<equality>{{constraint}}</equality><actuator><motor joint="crank"/></actuator></mujoco>"""
# one cause each of the closed loops in public models: the legs of Cassie and the hand of the xArm
LEG = f"""<mujoco><worldbody><body name="hip"><freejoint name="root"/>{ROD}
  <body name="rod" pos=".1 .05 0">{ROD}
    <joint name="rod y" axis="0 1 0" damping=".01"/><joint name="rod z" axis="0 0 1" damping=".01"/></body>
  <body name="knee" pos="0 0 -.1">{ROD}<joint name="knee" axis="0 1 0" armature=".05" ref=".2"/>
    <body name="shin" pos=".05 0 -.2">{ROD}<joint name="shin" axis="0 1 .02" stiffness="1500" damping=".1"/>
      <body name="tarsus" pos=".3 0 0">{ROD}<joint name="tarsus" axis=".01 1 0" ref="-.3"/>
        <body name="heel" pos=".05 0 .02">{ROD}<joint name="heel" axis="0 1 0" stiffness="1250"/></body>
      </body></body></body>
</body></worldbody>
<equality><connect body1="rod" body2="heel" anchor=".3 .01 -.2"/></equality>
<actuator><motor joint="knee" gear="16" ctrlrange="-12 12"/></actuator></mujoco>"""
FINGER = """<body name="{0} driver" pos="{1}.03 0 0">{2}<joint name="{0} driver" axis="0 {1}1 0"/>
    <body name="{0} tip" pos="{1}.03 0 .04">{2}<joint name="{0} tip" axis="0 {1}1 0"/></body></body>
  <body name="{0} bar" pos="{1}.01 0 .02">{2}<joint name="{0} bar" axis="0 {1}1 0"/></body>"""
HAND = f"""<mujoco><worldbody><body name="palm">
  {FINGER.format("left", "", ROD)}{FINGER.format("right", "-", ROD)}</body></worldbody><equality>
  <connect body1="left tip" body2="left bar" anchor="-.02 0 .03"/>
  <connect body1="right tip" body2="right bar" anchor=".02 0 .03"/>
  <joint joint1="right driver" joint2="left driver"/>
</equality><actuator><general joint="left driver"/></actuator></mujoco>"""
MODELS = {
    "tree": TREE,
    "free base": FREE,
    "connect": FOUR_BAR.format(constraint='<connect body1="coupler" body2="rocker" anchor=".5 0 .1"/>'),
    "leg with springs and a rod": LEG,
    "hand whose fingers mimic": HAND,
    "weld": FREE.replace("<freejoint", '<joint axis="0 0 1"').replace(
        "</mujoco>",
        "<equality><weld body1='foot' body2='arm'/></equality><actuator><motor joint='root'/></actuator></mujoco>",
    ),
}


@pytest.mark.parametrize("name", MODELS)
def test_inverse_dynamics_are_those_of_mujoco(name):
    model = mujoco.MjModel.from_xml_string(MODELS[name])
    robot = load_robot(MODELS[name])
    differences = [inverse_difference(model, robot, seed) for seed in range(3)]
    assert max(differences) < (1e-9 if robot.loops else 1e-12), differences


def test_reads_what_the_model_says():
    robot = load_robot(TREE)
    assert robot.name == "tree" and not robot.moving_base
    np.testing.assert_array_equal(robot.gravity, [1, 2, -9])
    assert [joint.name for joint in robot.joints] == ["slide", "first", "second", "side", "other"]
    slide, first, second, side, _ = robot.joints
    assert slide.prismatic and slide.role == "passive" and slide.rotor_inertia == 0.1
    assert (first.limits.lower, first.limits.upper, first.limits.effort) == (-1, 2, 40)
    assert second.spring.stiffness == 7 and second.spring.rest == 0.3 and second.limits.effort == 9
    assert second.coulomb_friction == 0.6 and second.viscous_friction == 0.3
    assert side.mimic.joint == "other" and side.mimic.multiplier == -1.5
    assert side.mimic.offset == pytest.approx(0.2 + 1.5 * 0.1)
    assert robot.frame("tool").link == robot.frame("torso").link == 3 and robot.frame("stand").link == 0


def test_poses_are_those_of_mujoco():
    """A known configuration, in which joint variables are those of MuJoCo: also where `ref` is not zero."""
    model = mujoco.MjModel.from_xml_string(TREE)
    data = mujoco.MjData(model)
    data.qpos[:] = [0.3, -0.5, 0.7, 0.2 - 1.5 * (0.4 - 0.1), 0.4]
    mujoco.mj_kinematics(model, data)
    dynamics = Dynamics(load_robot(TREE), compiled=False)
    q = dict(zip(["slide", "first", "second", "side", "other"], data.qpos, strict=True))
    independent = [q[name] for name in dynamics.joint_names]
    for body in ("stand", "torso", "tool", "other"):
        pose = dynamics.link_pose(body, independent)
        np.testing.assert_allclose(pose[:3, 3], data.body(body).xpos, atol=1e-14)
        np.testing.assert_allclose(pose[:3, :3].ravel(), data.body(body).xmat, atol=1e-14)


def test_weld_places_both_frames_as_mujoco_does():
    model = mujoco.MjModel.from_xml_string(MODELS["weld"])
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    (loop,) = load_robot(MODELS["weld"]).loops
    assert not loop.is_spherical and np.abs(data.efc_pos[: data.ne]).max() < 1e-12
    robot, worlds = load_robot(MODELS["weld"]), []
    for name, end in zip(("foot", "arm"), loop.ends, strict=True):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = data.body(name).xmat.reshape(3, 3), data.body(name).xpos
        worlds.append(matrix @ np.linalg.inv(robot.frame(name).placement) @ end.placement)
    np.testing.assert_allclose(worlds[0], worlds[1], atol=1e-12)


def test_base_can_be_held():
    robot = load_robot(FREE, moving_base=False, gravity=[0, 0, -1])
    assert not robot.moving_base and robot.base_link == "trunk" and robot.gravity[2] == -1


def test_file_has_includes_and_meshes_of_its_folder_only(tmp_path):
    folder = tmp_path / "robot"
    (folder / "parts").mkdir(parents=True)
    (folder / "parts" / "arm.xml").write_text(f'<mujocoinclude><body name="arm">{ROD}<joint/></body></mujocoinclude>')
    shape = '<asset><mesh name="m" file="gone.stl"/></asset>'
    text = f'<mujoco>{shape}<worldbody><include file="{{}}"/><geom type="mesh" mesh="m"/></worldbody></mujoco>'
    file = folder / "robot.xml"
    file.write_text(text.format("parts/arm.xml"))
    assert load_robot(file).links[1].inertia.mass == 1.5  # the mesh of the world has no inertia: it is not read
    (tmp_path / "outside.xml").write_text("<mujoco/>")
    file.write_text(text.format("../outside.xml"))
    with pytest.raises(DescriptionError, match=r"'../outside.xml' is not read: it is outside the folder"):
        load_robot(file)
    with pytest.raises(DescriptionError, match=r"names the file 'a.xml', but this text has no file"):
        load_robot(text.format("a.xml"))


def changed(old, new, model=TREE):
    assert old in model
    return model.replace(old, new)


TENDON = '<tendon><fixed name="t" stiffness="1"><joint joint="side" coef="1"/></fixed></tendon>'
LOOSE = f'<body name="ball">{ROD}<freejoint/></body>'
REFUSED = {
    "ball": (changed('name="hip" axis', 'name="hip" type="ball" axis', FREE), "joint 'hip' is a ball joint"),
    "fluid": (changed("<option", '<option density="1.2"'), "has a fluid"),
    "gravity compensation": (changed('name="tool"', 'name="tool" gravcomp="1"'), "body 'tool' has gravcomp"),
    "equality that is not linear": (changed("-1.5 0 0 0", "-1.5 1 0 0"), "of joint 'side' is not linear"),
    "joint that is held": (changed(' joint2="other"', ""), "holds joint 'side'"),
    "tendon": (changed("</mujoco>", TENDON + "</mujoco>"), "tendon 't' has stiffness"),
    "loose body": (changed("</worldbody>", LOOSE + "</worldbody>", FREE), "'trunk', 'ball' move independently"),
    "damped base": (changed("<freejoint", '<joint type="free" damping="1"', FREE), "'root' is free and has damping"),
    "unknown element": (changed('<joint name="other"', '<hinge name="other"'), "MuJoCo cannot compile it: .*hinge"),
    "entity": ("<!DOCTYPE a [<!ENTITY b 'c'>]><mujoco/>", "a DOCTYPE is refused"),
    "soft body": (
        changed("<light", '<flexcomp name="f" type="mesh" file="/etc/passwd"/><light', FREE),
        "'f' is a soft",
    ),
    "other file": (changed("<light", '<site file="/etc/passwd"/><light', FREE), "<site> names a file"),
    "submodel": (changed("<option", '<asset><model file="a.xml"/></asset><option'), "<model> is not read"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_has_no_equal_is_refused_by_name(case, monkeypatch):
    """The compiler runs in this process, which takes less time than one for each case."""
    text, message = REFUSED[case]
    monkeypatch.setattr(reader, "call_isolated", lambda _, request, *__, **___: mjcf_process.run(request))
    with pytest.raises(DescriptionError, match=f"(?s){message}"):
        load_robot(text)


def test_shapes_are_those_of_the_viewer():
    """Visible groups are drawn, hidden ones where a body has no other; sizes are halves in MJCF."""
    geoms = (
        '<geom type="box" size=".1 .2 .3" pos="1 2 3" rgba="1 0 0 .5"/><geom type="sphere" size=".4" group="3"/>',
        '<geom type="capsule" size=".1" fromto="0 0 0 0 0 .6" group="3"/>',
        '<geom type="cylinder" size=".1 .2"/>',
    )
    bodies = "".join(f'<body name="{n}">{ROD}<joint/>{shape}</body>' for n, shape in enumerate(geoms))
    text = f'<mujoco><worldbody><geom type="box" size="1 1 1"/>{bodies}</worldbody></mujoco>'
    box, capsule, cylinder = load_robot(text).visuals
    assert (box.frame, capsule.frame, cylinder.frame) == ("0", "1", "2")
    assert box.shape.size.tolist() == [0.2, 0.4, 0.6] and box.colour == pytest.approx((1, 0, 0, 0.5))
    assert box.placement[:3, 3].tolist() == [1, 2, 3] and capsule.colour is None
    ends = (capsule.placement @ np.column_stack([capsule.shape.points, np.ones(2)]).T)[:3].T
    np.testing.assert_allclose(sorted(ends.tolist()), [[0, 0, 0], [0, 0, 0.6]], atol=1e-12)
    assert (cylinder.shape.radius, cylinder.shape.length) == (0.1, 0.4)


def test_values_are_refused():
    with pytest.raises(DescriptionError, match="values of a are given"):
        load_robot(FREE, values={"a": 1})


def test_table_of_an_mjcf_is_the_same_robot():
    robot = load_robot(TREE)
    table = load_robot(write_mdh_yaml(robot))
    q, v, a = np.random.default_rng(0).normal(size=(3, 4))
    a[0] = 0.0  # slide has no motor
    expected, efforts = (Dynamics(model, compiled=False).inverse(q, v, a) for model in (robot, table))
    np.testing.assert_allclose(efforts, expected, atol=1e-12)


def test_root_element_decides():
    assert is_mjcf("\ufeff<?xml version='1.0'?>\n<!-- a --> <!-- b -->\n<mujoco/>") and is_mjcf(b"<mujoco model='a'>")
    for text in ("<robot><mujoco/></robot>", "<!-- <mujoco> -->", "<!-- a", "<mujocos/>", "<!---->" * 5000):
        assert not is_mjcf(text)
