"""Random robots with loops that close: trees, and chains between two links.

The joints are placed at random positions, and frame k+B at the resulting pose of frame k. Kinds of loops:

planar: four to six joints, all axes parallel or across (sliding), so that three of six equations are redundant;
spatial: as many joints in any direction as give one degree of freedom or two, or none more where it ties two links;
ball: cut at a ball joint, so that three joints depend on the others.
A loop is cut at a joint that moves a link without inertia, or at a link, of which both halves are welded.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import qr

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint, Mimic, Spring
from robot_dynamics.model.loop import Loop, LoopEnd
from robot_dynamics.model.robot import EARTH_GRAVITY, Frame, Link, Robot

from .link_motion import joint_displacement
from .loop_states import closed_positions, condition_of, coupling, loop_gaps, loop_jacobian, rank_of

KINDS = ("planar", "spatial", "ball")
WORST_CONDITION = 1e3


class LoopedRobot(NamedTuple):
    """robot; q: (n,) closed positions of all joints, also the initial ones; dependents: numbers of the joints that
    depend on the others by the loops, all passive; independents: numbers of the others without mimic joints, actuated
    or elastic, as many as the mobility.
    """

    robot: Robot
    q: np.ndarray
    dependents: tuple
    independents: tuple


def random_loops(seed, loops=None, kinds=KINDS, moving_base=None, elastic=True, mimics=True):
    """Return a LoopedRobot with one to three loops of some `kinds`, which may share links, in a tree.

    loops: how many, None: any; moving_base: None: either; elastic: whether some of the independent joints are elastic,
    and some actuated ones have springs; mimics: whether joints outside of the loops may mimic actuated ones.
    """
    for attempt in range(200):
        rng = np.random.default_rng([seed, attempt, 6])
        base_moves = bool(rng.random() < 0.3) if moving_base is None else moving_base
        builder = _Builder(rng, base_moves)
        for _ in range(rng.integers(0, 4)):
            builder.add_joint(builder.any_link())
        for _ in range(int(rng.integers(1, 4)) if loops is None else loops):
            builder.add_loop(str(rng.choice(kinds)))
        for _ in range(rng.integers(0, 3)):
            builder.add_joint(builder.any_link())
        robot, q = builder.robot(f"loops_{seed}"), np.array(builder.q)
        dependents = _dependents(robot, q, builder.cut_joints, rng)
        if dependents is None or not _is_regular(robot, q, dependents, rng):
            continue
        return _assign_roles(robot, q, dependents, rng, elastic, mimics)
    raise ValueError(f"no robot with loops of {kinds} in good condition was found from seed {seed}")


class _Builder:
    """A robot under construction: links, joints, loops, and positions q at which poses (4, 4) of the links are kept."""

    def __init__(self, rng, moving_base):
        self.rng, self.moving_base = rng, moving_base
        self.links, self.joints, self.loops = [Link("base", random_inertia(rng))], [], []
        self.q, self.poses, self.cut_joints = [], [np.eye(4)], []

    def any_link(self):
        """Return the number of a link that has inertia."""
        return int(self.rng.choice([n for n, link in enumerate(self.links) if link.inertia.mass > 0]))

    def add_joint(self, antecedent, placement=None, prismatic=None, body=True):
        """Add a joint, and return the number of the link that it moves."""
        rng, number = self.rng, len(self.links)
        prismatic = bool(rng.random() < 0.2) if prismatic is None else prismatic
        placement = random_placement(rng) if placement is None else placement
        q = rng.uniform(-0.3, 0.3) if prismatic else rng.uniform(-3, 3)
        losses = rng.uniform(0, 2, 2) * (rng.random(2) < 0.7)
        joint = Joint(
            f"joint_{number}",
            antecedent,
            prismatic,
            placement,
            rotor_inertia=rng.uniform(0, 0.5) * (rng.random() < 0.5),
            viscous_friction=losses[0],
            coulomb_friction=losses[1],
            initial_position=q,
        )
        self.joints.append(joint)
        self.links.append(Link(f"link_{number}", random_inertia(rng) if body else Inertia()))
        self.q.append(q)
        self.poses.append(self.poses[antecedent] @ placement @ joint_displacement(joint, q))
        return number

    def add_loop(self, kind):
        """Add a loop: two chains that meet."""
        rng = self.rng
        cut_at_joint = kind != "ball" and rng.random() < 0.7
        start = end = self.any_link()
        if kind != "planar" and rng.random() < 0.4:
            end = self.any_link()
        count = rng.integers(4, 7) if kind == "planar" else {"spatial": 7, "ball": 4}[kind] + rng.integers(0, 2)
        if start != end:
            count -= rng.integers(0, 2)
        count = int(count) - cut_at_joint
        first = int(rng.integers((count + 1) // 2, count + 1))
        if kind == "planar":
            chain = _Planar(self, start)
            tip, second_tip = chain.grow(first), chain.grow(count - first)
            reach, turn = chain.next_placement(tip), False if rng.random() < 0.7 else None
        else:
            tip, second_tip = self._spatial(start, first), self._spatial(end, count - first)
            reach, turn = random_placement(rng), None
        if cut_at_joint:
            if kind == "planar":
                reach, sliding = chain.joint_placement(tip, turn)
            else:
                sliding = turn
            tip = self.add_joint(tip, reach, sliding, body=False)
            self.cut_joints.append(tip - 1)
            reach = np.eye(4)
        closed_on = np.linalg.inv(self.poses[second_tip]) @ self.poses[tip] @ reach
        closed_on[3] = 0, 0, 0, 1
        moved, target = LoopEnd(tip, reach), LoopEnd(second_tip, closed_on)
        self.loops.append(Loop(f"loop_{len(self.loops) + 1}", moved, target, kind == "ball"))

    def _spatial(self, link, count):
        """Add a chain of `count` joints, sometimes with a link without inertia, and return its last link."""
        massless_index = int(self.rng.integers(0, count)) if count > 2 and self.rng.random() < 0.3 else -1
        for index in range(count):
            link = self.add_joint(link, body=index != massless_index or index == count - 1)
        return link

    def robot(self, name):
        frames = tuple(Frame(link.name, number, np.eye(4)) for number, link in enumerate(self.links))
        gravity = EARTH_GRAVITY if self.rng.random() < 0.5 else self.rng.normal(size=3) * 6
        parts = tuple(self.links), tuple(self.joints), frames
        return Robot(name, *parts, self.moving_base, gravity, tuple(self.loops))


class _Planar:
    """Chains of joints with parallel axes, and across them those that slide, from one link on."""

    ACROSS = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # z into the plane

    def __init__(self, builder, start):
        self.builder, self.start = builder, start
        self.plane = {start: random_placement(builder.rng)}  # where the plane lies in the frames of links

    def next_placement(self, link):
        """Return a random placement in the plane, in the frame of a link."""
        rng = self.builder.rng
        angle = rng.uniform(-3, 3)
        moved = np.eye(4)
        moved[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        moved[:3, 3] = *rng.uniform(-0.8, 0.8, 2), rng.uniform(-0.1, 0.1)
        return self.plane.get(link, np.eye(4)) @ moved

    def joint_placement(self, link, sliding=None):
        """Return (placement of a joint in the frame of a link, whether it slides)."""
        placement = self.next_placement(link)
        sliding = bool(self.builder.rng.random() < 0.25) if sliding is None else sliding
        return (placement @ self.ACROSS if sliding else placement), sliding

    def grow(self, count):
        link = self.start
        for _ in range(count):
            placement, sliding = self.joint_placement(link)
            link = self.builder.add_joint(link, placement, sliding)
            self.plane[link] = self.ACROSS.T if sliding else np.eye(4)
        return link


def random_placement(rng):
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = axes * np.linalg.det(axes), rng.uniform(-0.6, 0.6, 3)
    return placed


def random_inertia(rng):
    """Return the inertia of a physical body of 0.1 to 10 kg."""
    mass = 10 ** rng.uniform(-1, 1)
    spread = mass * rng.uniform(0.05, 0.3, 3) ** 2
    frame = random_placement(rng)
    frame[:3, 3] *= 0.4
    return Inertia.about_centre_of_mass(mass, np.diag(spread.sum() - spread), frame)


def _dependents(robot, q, cut_joints, rng):
    """Return the numbers of dependent joints, including the cut joints; None where the condition is bad.

    Pivoted QR selects columns of the loops' Jacobian that span it.
    """
    J = loop_jacobian(robot, q)
    rank, gap = rank_of(J)
    if gap > 1e-13 or rank == J.shape[1]:
        return None
    weights = rng.uniform(0.3, 1, J.shape[1])
    weights[cut_joints] = 100
    order = qr(J * weights, mode="r", pivoting=True)[1]
    dependents = tuple(sorted(int(number) for number in order[:rank]))
    if not set(cut_joints) <= set(dependents) or condition_of(robot, q, dependents) > WORST_CONDITION:
        return None
    return dependents


def _is_regular(robot, q, dependents, rng):
    """Return whether q is regular: nearby the loops close too, and as many joints are dependent."""
    near = q + rng.uniform(-0.05, 0.05, len(q))
    near[list(dependents)] = q[list(dependents)]
    try:
        near = closed_positions(robot, near, dependents)
    except ValueError:
        return False
    return np.abs(loop_gaps(robot, q)).max() < 1e-13 and rank_of(loop_jacobian(robot, near))[0] == len(dependents)


def _assign_roles(robot, q, dependents, rng, elastic, mimics):
    """Return a LoopedRobot: dependent joints passive, the others actuated or elastic, with mimics of actuated ones."""
    independents = [number for number in range(len(q)) if number not in dependents]
    actuated = {int(rng.choice(independents))}
    joints = [replace(joint, actuated=number not in dependents) for number, joint in enumerate(robot.joints)]
    for number in independents:
        spring = Spring(10 ** rng.uniform(0, 3), q[number] + rng.uniform(-0.5, 0.5), rng.uniform(0, 2))
        if elastic and number not in actuated and rng.random() < 0.25:
            joints[number] = replace(joints[number], actuated=False, spring=spring)
        else:
            actuated.add(number)
            if elastic and rng.random() < 0.2:
                joints[number] = replace(joints[number], spring=spring)
    links, frames = list(robot.links), list(robot.frames)
    for _ in range(int(rng.integers(0, 3)) if mimics else 0):
        leader = joints[int(rng.choice(sorted(actuated)))].name
        carrier = int(rng.choice([number for number, link in enumerate(robot.links) if link.inertia.mass > 0]))
        number = len(links)
        joints.append(
            Joint(
                f"joint_{number}",
                carrier,
                bool(rng.random() < 0.3),
                random_placement(rng),
                rotor_inertia=rng.uniform(0, 0.2),
                viscous_friction=rng.uniform(0, 1),
                mimic=Mimic(leader, rng.uniform(-1.5, 1.5), rng.uniform(-0.5, 0.5)),
            )
        )
        links.append(Link(f"link_{number}", random_inertia(rng)))
        frames.append(Frame(links[-1].name, number, np.eye(4)))
    robot = replace(robot, joints=tuple(joints), links=tuple(links), frames=tuple(frames))
    S, offset = coupling(robot)
    q = S @ q + offset
    joints = [replace(joint, initial_position=float(value)) for joint, value in zip(joints, q, strict=True)]
    return LoopedRobot(replace(robot, joints=tuple(joints)), q, dependents, tuple(independents))
