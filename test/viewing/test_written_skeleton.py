"""Skeletons in URDFs: other readers have their shapes where this package has them, and rods end at the joints."""

import io
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
import yourdfpy
from lxml import etree
from peers.cut_urdf import CutUrdf
from peers.pinocchio_visuals import PinocchioVisuals

from robot_dynamics import Dynamics, RobotDynamicsError, add_skeleton, load_robot, shipped_robots, write_urdf
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.hull_primitives import primitive_visuals, rods_between
from robot_dynamics.model.visual import CylinderShape, HullShape, SphereShape, Visual
from robot_dynamics.viewing.link_poses import visual_poses


@pytest.fixture(scope="module", params=sorted(shipped_robots()))
def drawn(request):
    return DrawnRobot(request.param)


class DrawnRobot:
    """A robot with its skeleton, the URDF that is written of it, and a random closed position."""

    def __init__(self, name):
        self.robot = add_skeleton(replace(load_robot(name), moving_base=False))
        self.primitives = replace(self.robot, visuals=primitive_visuals(self.robot.visuals))
        self.text = write_urdf(self.robot, lossy=True)
        dynamics = Dynamics(self.robot, compiled=False)
        start = dynamics.initial_joint_positions
        numbers = [self.robot.joint_numbers[joint] for joint in dynamics.joint_names]
        motion = np.random.default_rng(1).uniform(-0.05, 0.05, len(numbers))
        self.q = dynamics.expand_positions(start[numbers] + motion, previous=start)
        self.positions = dict(zip(dynamics.all_joint_names, self.q, strict=True))


def test_written_urdf_has_the_skeleton(drawn):
    written = read_urdf(drawn.text)
    assert len(written.visuals) == len(drawn.primitives.visuals) > 0
    for frame in drawn.robot.frames:
        originals = [visual for visual in drawn.primitives.visuals if visual.frame == frame.name]
        copies = [visual for visual in written.visuals if visual.frame == frame.name]
        for original, copy in zip(originals, copies, strict=True):
            assert (original.colour, original.name) == (copy.colour, copy.name)
            np.testing.assert_allclose(copy.placement, original.placement, rtol=0, atol=1e-14)
            assert type(original.shape) is type(copy.shape)
            for size, copied in zip(vars(original.shape).values(), vars(copy.shape).values(), strict=True):
                np.testing.assert_array_equal(size, copied)


def test_dynamics_of_the_written_urdf_do_not_change(drawn):
    """For Pinocchio, and for this package, which gives the same warnings."""
    bare = write_urdf(replace(drawn.robot, visuals=()), lossy=True)
    models = [pinocchio.buildModelFromXML(text) for text in (bare, drawn.text)]
    assert list(models[0].names) == list(models[1].names)
    for number in range(models[0].njoints):
        first, second = (model.inertias[number].toDynamicParameters() for model in models)
        np.testing.assert_array_equal(first, second)
        first, second = (model.jointPlacements[number].homogeneous for model in models)
        np.testing.assert_array_equal(first, second)
    first, second = map(read_urdf, (bare, drawn.text))
    assert first.reader_warnings == second.reader_warnings
    for one, other in zip(first.links, second.links, strict=True):
        assert one.inertia.mass == other.inertia.mass
        np.testing.assert_array_equal(one.inertia.second_moments, other.inertia.second_moments)
        assert one.lacks_inertial == other.lacks_inertial


def test_shapes_stand_where_pinocchio_has_them(drawn, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(drawn.text)
    peer = PinocchioVisuals(path)
    indices = {frame.name: iter(peer.on_frame(frame.name)) for frame in drawn.robot.frames}
    order = [next(indices[visual.frame]) for visual in drawn.primitives.visuals]
    assert len(order) == len(peer.geometry.geometryObjects)
    expected = peer.world_poses(drawn.positions)[order]
    np.testing.assert_allclose(visual_poses(drawn.primitives, drawn.q), expected, rtol=0, atol=1e-12)


def test_shapes_stand_where_yourdfpy_has_them(drawn):
    peer = yourdfpy.URDF.load(io.BytesIO(drawn.text.encode()), build_scene_graph=True, load_meshes=False)
    peer.update_cfg({name: drawn.positions[name] for name in peer.actuated_joint_names})
    shapes = {name: iter(link.visuals) for name, link in peer.link_map.items()}
    for visual, pose in zip(drawn.primitives.visuals, visual_poses(drawn.primitives, drawn.q), strict=True):
        read = next(shapes[visual.frame])
        origin = np.eye(4) if read.origin is None else read.origin
        expected = peer.get_transform(visual.frame, drawn.robot.base_link) @ origin
        np.testing.assert_allclose(pose, expected, rtol=0, atol=1e-12)
        assert (read.geometry.cylinder is not None) == isinstance(visual.shape, CylinderShape)
    assert all(next(rest, None) is None for rest in shapes.values())


def test_rods_end_at_joints_and_every_joint_is_at_an_end(drawn):
    """At the origins of joints, and the cut joints of loops, as Pinocchio computes them at the closed position."""
    urdf = CutUrdf(drawn.robot, drawn.text)
    urdf.move(drawn.positions)
    hulls = [isinstance(visual.shape, HullShape) for visual in drawn.robot.visuals]
    assert any(hulls)
    rods, balls = ends_of_rods(drawn)
    joints = points_of_joints(drawn, urdf)
    for link, ends in rods.items():
        allowed = joints.get(link, []) + tips(drawn, urdf, link)
        for end in ends:
            assert min(np.linalg.norm(end - point) for point in allowed) < 1e-9, link
    for link, points in joints.items():
        if link in rods:
            for point in points:
                assert min(np.linalg.norm(end - point) for end in rods[link]) < 1e-9, link
                assert min(np.linalg.norm(ball - point) for ball in balls[link]) < 1e-9, link


def ends_of_rods(drawn):
    """({link: ends (3,) of its rods}, {link: centres (3,) of their balls}) in the base, by this package.

    Rods and balls of bones have the name of no joint.
    """
    rods, balls = {}, {}
    for visual, pose in zip(drawn.primitives.visuals, visual_poses(drawn.primitives, drawn.q), strict=True):
        if visual.name is None and isinstance(visual.shape, CylinderShape):
            along = pose[:3, 2] * visual.shape.length / 2
            rods.setdefault(visual.frame, []).extend([pose[:3, 3] - along, pose[:3, 3] + along])
        elif visual.name is None:
            balls.setdefault(visual.frame, []).append(pose[:3, 3])
    return rods, balls


def points_of_joints(drawn, urdf):
    """{link: points (3,) where it is joined to others}, by Pinocchio; joints of platforms have no hardware."""
    robot, model, data = drawn.robot, urdf.model, urdf.data
    coordinates = {index for platform in robot.platforms for index in platform.joints}
    points = {}
    for index, joint in enumerate(robot.joints):
        if index in coordinates:
            continue
        number = model.getJointId(joint.name)
        parent = data.oMi[model.parents[number]]
        start = (parent * model.jointPlacements[number]).translation
        points.setdefault(robot.links[joint.antecedent].name, []).append(start)
        points.setdefault(robot.links[index + 1].name, []).append(data.oMi[number].translation)
    for loop in robot.loops:
        for end in loop.ends:
            points.setdefault(robot.links[end.link].name, []).append(urdf.end_pose(end)[:3, 3])
    return points


def tips(drawn, urdf, link):
    """Points (3,) at which a last link may end, by Pinocchio: frames that are fixed to it, and its centre of mass."""
    number = drawn.robot.frame(link).link
    frames = [frame.name for frame in drawn.robot.frames if frame.link == number]
    return [urdf.pose(frame)[:3, 3] for frame in frames] + [urdf.centre_of_mass(link)[0]]


@pytest.mark.parametrize("seed", range(20))
def test_rods_hang_together(seed):
    """As the shortest tree through all points is among them, which SciPy computes; in a plane and in space."""
    from scipy.sparse.csgraph import minimum_spanning_tree
    from scipy.spatial.distance import cdist

    random = np.random.default_rng(seed)
    points = random.normal(size=(random.integers(2, 12), 3)) * [1, 1, seed % 2]
    tree = minimum_spanning_tree(cdist(points, points))
    assert {tuple(sorted(pair)) for pair in np.argwhere(tree.toarray())} <= set(rods_between(points))


def test_plates_are_rings_of_rods():
    """A hexagon has its sides and the diagonals through its centre; coincident points are one."""
    angles = np.arange(6) * np.pi / 3 + 0.1 * (-1) ** np.arange(6)
    points = np.stack([np.cos(angles), np.sin(angles), np.zeros(6)], axis=-1)
    sides = {(k, k + 1) for k in range(5)} | {(0, 5)}
    assert sides <= set(rods_between(points)) and len(rods_between(points)) <= 9
    hull = HullShape(np.vstack([points, points[:2]]), 0.1)
    shapes = [visual.shape for visual in primitive_visuals((Visual("a", np.eye(4), hull),))]
    assert sum(isinstance(shape, SphereShape) for shape in shapes) == 6
    (ball,) = primitive_visuals((Visual("a", np.eye(4), HullShape(np.ones((3, 3)), 0.1), name="b"),))
    assert ball.placement[:3, 3].tolist() == [1, 1, 1] and (ball.name, ball.shape.radius) == ("b", 0.1)


def test_many_joints_on_a_link_are_a_star():
    points = np.random.default_rng(1).normal(size=(1000, 3))
    assert rods_between(points) == [(0, number) for number in range(1, 1000)]


def test_robot_whose_loops_do_not_close_is_drawn():
    """As it is described: its description can be looked at, and corrected."""
    robot = load_robot("four_bar")
    longer = replace(robot.joints[1], placement=robot.joints[1].placement + 90 * np.eye(4, k=3))
    open_robot = replace(robot, joints=(robot.joints[0], longer, *robot.joints[2:]))
    with pytest.raises(RobotDynamicsError):
        _ = Dynamics(open_robot).initial_joint_positions
    assert len(add_skeleton(open_robot).visuals) == len(add_skeleton(robot).visuals)


def test_shapes_of_the_description_stay():
    visual = Visual("panda_link0", np.eye(4), SphereShape(0.1))
    robot = replace(load_robot("panda"), visuals=(visual,))
    assert add_skeleton(robot) is robot


def test_urdf_of_a_robot_without_shapes_has_none():
    root = etree.fromstring(write_urdf(load_robot("delta"), lossy=True).encode())
    assert not root.findall("link/visual")
