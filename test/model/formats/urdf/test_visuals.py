"""Visuals of URDFs: equal to Pinocchio's for real robots, and never an obstacle to the dynamics."""

import pickle
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from peers.pinocchio_visuals import PinocchioVisuals, pinocchio_visuals
from peers.real_robots import REAL_ROBOTS, ROBOTS, real_urdf

from robot_dynamics import DescriptionError, Inertia, load_robot
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.formats.par.writer import find_losses as find_par_losses
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.formats.urdf.visuals import MAX_VISUALS
from robot_dynamics.model.formats.urdf.writer import find_losses as find_urdf_losses
from robot_dynamics.model.formats.urdf.writer import write_urdf
from robot_dynamics.model.minimal_frames import minimal_frames, snap_angles
from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw
from robot_dynamics.model.visual import BoxShape, CylinderShape, MeshShape, SphereShape, Visual
from robot_dynamics.simulation.varied_inertias import compare_inertias
from robot_dynamics.viewing.link_poses import visual_poses

ROBOT = '<robot name="r">{materials}<link name="a">{visual}</link></robot>'
BOX = '<geometry><box size="1 2 3"/></geometry>'
RED = '<color rgba="1 0 0 1"/>'
EVERY_ROBOT = pytest.mark.parametrize("name", REAL_ROBOTS)


def read_visual(content, materials=""):
    return read_urdf(ROBOT.format(visual=f"<visual>{content}</visual>", materials=materials))


def load_real(name):
    return load_robot(ROBOTS / REAL_ROBOTS[name])


def order_of_pinocchio(robot, peer):
    """Return Pinocchio's index of each visual of a robot."""
    indices = {frame.name: iter(peer.on_frame(frame.name)) for frame in robot.frames}
    return [next(indices[visual.frame]) for visual in robot.visuals]


def check_poses(robot, peer, seed):
    """The visuals stand where Pinocchio has them, at random joint positions."""
    q = np.random.default_rng(seed).uniform(-2, 2, (3, len(robot.joints)))
    poses = visual_poses(robot, q)
    order = order_of_pinocchio(robot, peer)
    assert poses.shape == (3, len(robot.visuals), 4, 4)
    for positions, actual in zip(q, poses, strict=True):
        expected = peer.world_poses(dict(zip([joint.name for joint in robot.joints], positions, strict=True)))
        np.testing.assert_allclose(actual, expected[order], rtol=0, atol=1e-12)


def has_shape(visual, geometry):
    """Return whether a visual has the shape of an object of Pinocchio."""
    shape = visual.shape
    match shape:
        case BoxShape():
            return np.array_equal(shape.size, 2 * geometry.geometry.halfSide)
        case SphereShape():
            return shape.radius == geometry.geometry.radius
        case CylinderShape():
            return (shape.radius, shape.length) == (geometry.geometry.radius, 2 * geometry.geometry.halfLength)
        case MeshShape():
            is_file = geometry.meshPath.endswith(shape.file.split("://")[-1].strip("/").partition("/")[2])
            return is_file and np.array_equal(shape.scale, geometry.meshScale.ravel())


def same(first, second):
    """Return whether two visuals are equal."""

    def values(visual):
        shape = {
            key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in vars(visual.shape).items()
        }
        shape.pop("folder", None)
        return (visual.frame, type(visual.shape), shape, visual.colour, visual.name)

    return values(first) == values(second) and np.abs(first.placement - second.placement).max() < 1e-14


@EVERY_ROBOT
def test_visuals_of_a_real_robot_are_those_of_pinocchio(name):
    robot, peer = load_real(name), pinocchio_visuals(name)
    counts = Counter(visual.frame for visual in robot.visuals)
    assert counts.total() == len(peer.geometry.geometryObjects) > 0
    assert all(len(peer.on_frame(frame)) == count for frame, count in counts.items())
    for visual, index in zip(robot.visuals, order_of_pinocchio(robot, peer), strict=True):
        geometry = peer.geometry.geometryObjects[index]
        assert has_shape(visual, geometry), visual
        assert (visual.colour is not None) <= geometry.overrideMaterial
        if visual.colour is not None:
            np.testing.assert_allclose(visual.colour, geometry.meshColor, rtol=0, atol=1e-6)  # urdfdom has floats


@EVERY_ROBOT
def test_poses_of_all_visuals_are_those_of_pinocchio(name):
    check_poses(load_real(name), pinocchio_visuals(name), seed=1)


CHANGES = {
    "moved": placement(translation=[1e-11, 0, 0]),
    "turned": placement(rotation_from_roll_pitch_yaw(0, 0, 1e-11)),
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("number", range(7))
def test_wrong_pose_is_noticed(number, change):
    robot, peer = load_real("ur5"), pinocchio_visuals("ur5")
    visuals = list(robot.visuals)
    visuals[number] = replace(visuals[number], placement=visuals[number].placement @ CHANGES[change])
    with pytest.raises(AssertionError, match="Mismatched elements"):
        check_poses(replace(robot, visuals=tuple(visuals)), peer, seed=1)


@pytest.mark.parametrize("change", [minimal_frames, lambda robot: robot.with_payload("wrist_3_link", Inertia(1.0))])
def test_visuals_remain_with_their_frames(change):
    check_poses(change(load_real("ur5")), pinocchio_visuals("ur5"), seed=2)


def test_visuals_remain_in_a_snapped_and_in_a_pickled_robot():
    robot = load_real("panda")
    assert snap_angles(robot, 1e-3).visuals == robot.visuals
    copied = pickle.loads(pickle.dumps(robot))
    assert all(same(*pair) for pair in zip(copied.visuals, robot.visuals, strict=True))


def test_robots_that_differ_in_visuals_are_simulated_together():
    robot = load_real("panda")
    others = [load_real("panda"), replace(robot, visuals=()), robot.with_payload("panda_link8", Inertia(1.0))]
    assert len(compare_inertias([robot, *others]).links) == 1


def test_visuals_remain_in_a_urdf_that_a_yaml_completes(tmp_path):
    (tmp_path / "urdf").mkdir()
    (tmp_path / "urdf" / "panda.urdf").write_text(real_urdf("panda"))
    (tmp_path / "panda.yaml").write_text("urdf: urdf/panda.urdf\nroles: {panda_joint3: passive}\n")
    robot = load_robot(tmp_path / "panda.yaml")
    assert len(robot.visuals) == 11
    assert {visual.shape.folder for visual in robot.visuals} == {tmp_path / "urdf"}


@pytest.mark.parametrize("moving_base", [False, True])
@pytest.mark.parametrize("change", [lambda robot: robot, minimal_frames])
@pytest.mark.parametrize("name", ["panda", "ur5", "talos", "tiago", "pr2", "z1", "solo12"])
def test_written_urdf_has_the_same_visuals(name, change, moving_base, tmp_path):
    robot = load_robot(ROBOTS / REAL_ROBOTS[name], moving_base=moving_base)
    text = write_urdf(change(robot), lossy=True)
    written = read_urdf(text, moving_base=moving_base)
    for frame in robot.frames:
        originals = [visual for visual in robot.visuals if visual.frame == frame.name]
        copies = [visual for visual in written.visuals if visual.frame == frame.name]
        assert all(same(*pair) for pair in zip(originals, copies, strict=True)), frame.name
    missing = [{link.name for link in model.links if link.lacks_inertial} for model in (robot, written)]
    assert missing[0] == missing[1]
    if not moving_base:
        (tmp_path / "written.urdf").write_text(text)
        peer = PinocchioVisuals(tmp_path / "written.urdf")
        check_poses(robot, peer, seed=3)
        index = order_of_pinocchio(robot, peer)
        colours = [peer.geometry.geometryObjects[number].meshColor for number in index]
        expected = [colours[k] if visual.colour is None else visual.colour for k, visual in enumerate(robot.visuals)]
        np.testing.assert_allclose(colours, expected, rtol=0, atol=1e-6)


def test_colours_of_one_link_have_names_of_their_own():
    """RViz 2 (robot_link.cpp, getVisualWithMaterial) takes the first visual of the link with the name of a material."""
    link = "".join(
        f'<visual>{BOX}<material name=""><color rgba="{rgba}"/></material></visual>'
        for rgba in ("1 0 0 1", "0 1 0 1", "1 0 0 1")
    )
    root = etree.fromstring(write_urdf(read_urdf(ROBOT.format(visual=link, materials=""))).encode())
    visuals = root.findall("link/visual")
    first = {}
    for visual in visuals:
        first.setdefault(visual.find("material").get("name"), visual.find("material/color").get("rgba"))
    shown = [first[visual.find("material").get("name")] for visual in visuals]
    assert shown == ["1 0 0 1", "0 1 0 1", "1 0 0 1"] and "" not in first


def test_visuals_are_no_loss():
    robot = load_real("panda")
    assert find_urdf_losses(robot) == []
    assert find_par_losses(robot) == find_par_losses(replace(robot, visuals=()))
    assert write_mdh_yaml(robot) == write_mdh_yaml(replace(robot, visuals=()))


def test_names_that_xml_lacks_are_refused():
    robot = read_visual(BOX)
    bad = replace(robot.visuals[0], name="\x00")
    with pytest.raises(DescriptionError, match="XML has no character"):
        write_urdf(replace(robot, visuals=(bad,)))
    bad = replace(robot.visuals[0], shape=SphereShape(np.nan))
    with pytest.raises(DescriptionError, match="visual of link 'a' has"):
        write_urdf(replace(robot, visuals=(bad,)))


def test_visual_on_an_unknown_frame_is_refused():
    with pytest.raises(DescriptionError, match="a visual is on frame 'nowhere'"):
        replace(read_visual(BOX), visuals=(Visual("nowhere", np.eye(4), SphereShape(1.0)),))


def test_link_above_a_moving_base_is_not_drawn():
    text = (
        f'<robot name="r"><link name="world"><visual>{BOX}</visual></link><link name="b"><visual>{BOX}</visual></link>'
        '<joint name="j" type="floating"><parent link="world"/><child link="b"/></joint></robot>'
    )
    assert [visual.frame for visual in read_urdf(text).visuals] == ["b"]
    assert [visual.frame for visual in read_urdf(text, moving_base=False).visuals] == ["world", "b"]


MATERIALS = {
    "inline": ("", f'<material name="">{RED}</material>', (1, 0, 0, 1)),
    "by name": (f'<material name="m">{RED}</material>', '<material name="m"/>', (1, 0, 0, 1)),
    "the name counts more": (
        f'<material name="m">{RED}</material>',
        '<material name="m"><color rgba="0 1 0 1"/></material>',
        (1, 0, 0, 1),
    ),
    "unknown name": ("", '<material name="m"/>', None),
    "no material": ("", "", None),
    "texture": ("", '<material name="m"><texture filename="file:///etc/passwd"/></material>', None),
    "texture of the robot": (
        '<material name="m"><texture filename="t.png"/></material>',
        f'<material name="m">{RED}</material>',
        None,
    ),
    "0 to 255": ("", '<material name=""><color rgba="255 -1 0.5 1"/></material>', (1, 0, 0.5, 1)),
}


@pytest.mark.parametrize("case", MATERIALS)
def test_colour(case):
    materials, material, colour = MATERIALS[case]
    robot = read_visual(BOX + material, materials)
    assert robot.visuals[0].colour == colour and not robot.reader_warnings


def test_colour_of_an_earlier_link_is_found_by_name():
    text = (
        f'<robot name="r"><link name="a"><visual>{BOX}<material name="m">{RED}</material></visual>'
        f'<visual name="second">{BOX}<material name="m"/></visual></link></robot>'
    )
    first, second = read_urdf(text).visuals
    assert first.colour == second.colour == (1, 0, 0, 1)
    assert (first.name, second.name) == (None, "second")


MESH = '<geometry><mesh filename="{}" {}/></geometry>'
UNREADABLE = {
    "word": ('<geometry><box size="1 x 3"/></geometry>', "<box> has size='1 x 3', 3 numbers are needed"),
    "two numbers": ('<geometry><box size="1 2"/></geometry>', "3 numbers are needed"),
    "not a number": ('<geometry><sphere radius="nan"/></geometry>', "a number is needed"),
    "infinite": ('<geometry><sphere radius="1e999"/></geometry>', "must be finite"),
    "negative": ('<geometry><cylinder radius="1" length="-1"/></geometry>', "<cylinder> has a negative length"),
    "no radius": ('<geometry><cylinder length="1"/></geometry>', "<cylinder> has no radius"),
    "no file": ("<geometry><mesh/></geometry>", "<mesh> has no filename"),
    "one scale": (MESH.format("a.stl", 'scale="0.001"'), "<mesh> has scale='0.001', 3 numbers are needed"),
    "xacro": (MESH.format("a.stl", 'scale="1 ${s} 1"'), "3 numbers are needed"),
    "empty geometry": ("<geometry/>", "<geometry> has no shape"),
    "comment": ("<geometry><!-- box --></geometry>", "<geometry> has no shape"),
    "unknown shape": ("<geometry><capsule/></geometry>", "<capsule> is not a shape of URDF"),
    "prefix": ('<geometry><x:box size="1 1 1"/></geometry>', "is not a shape of URDF"),
    "origin": (f'<origin rpy="0 0 east"/>{BOX}', "<origin> has rpy='0 0 east', 3 numbers are needed"),
    "digits": (f'<origin xyz="1 2 \u0663"/>{BOX}', "3 numbers are needed"),
}


@pytest.mark.parametrize("case", UNREADABLE)
def test_unreadable_visual_is_left_out_with_a_warning(case, caplog):
    content, message = UNREADABLE[case]
    text = ROBOT.format(visual=f"\n<visual>{content}</visual><visual>{BOX}</visual>", materials="")
    robot = load_robot(text)
    assert len(robot.visuals) == 1 and isinstance(robot.visuals[0].shape, BoxShape)
    warning = robot.reader_warnings[-1]
    assert warning.startswith("line 2: link 'a': ") and message in warning and "is not drawn" in warning
    assert warning in caplog.text
    with pytest.raises(DescriptionError, match="is not drawn"):
        load_robot(text, strict=True)


def test_unreadable_colour_is_ignored_with_a_warning():
    robot = read_visual(f'{BOX}<material name="m"><color rgba="1 0 0"/></material>')
    assert robot.visuals[0].colour is None
    assert "link 'a': <color> has rgba='1 0 0', 4 numbers are needed; the colour is ignored" in robot.reader_warnings[0]


def test_visual_without_geometry_is_ignored():
    assert read_visual('<origin xyz="x"/>').visuals == () == read_visual("").reader_warnings


def test_number_of_visuals_is_limited():
    count = MAX_VISUALS + 70_000
    text = ROBOT.format(visual=f"<visual>{BOX}</visual>" * count, materials="")
    robot = read_urdf(text)
    assert len(robot.visuals) == MAX_VISUALS
    assert robot.reader_warnings == (
        f"line 1 and 69999 more: more than {MAX_VISUALS} visuals: the others are not drawn",
    )


def test_many_unreadable_visuals_are_one_warning():
    visuals = "".join(
        f'<visual><geometry><s{number} radius="{number}x"/></geometry></visual>' for number in range(9000)
    )
    (warning,) = read_urdf(ROBOT.format(visual=visuals, materials="")).reader_warnings
    assert warning.startswith("line 1 and 8999 more: ") and len(warning) < 300


def test_folder_is_that_of_the_file(tmp_path, monkeypatch):
    text = ROBOT.format(visual=f"<visual>{MESH.format('a.stl', '')}</visual>", materials="")
    (tmp_path / "r.urdf").write_text(text)
    monkeypatch.chdir(tmp_path)
    assert load_robot(Path("r.urdf")).visuals[0].shape.folder == tmp_path
    assert load_robot("r.urdf").visuals[0].shape.folder == tmp_path
    assert load_robot(text).visuals[0].shape.folder is None
