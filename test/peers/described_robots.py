"""Arbitrary valid robots, drawn by hypothesis."""

import numpy as np
from hypothesis import strategies as st

from robot_dynamics import Spring
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint, Limits, Mimic
from robot_dynamics.model.loop import Loop, LoopEnd
from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw
from robot_dynamics.model.robot import Frame, Link, Robot

reals = st.floats(-3, 3) | st.sampled_from([0.0, 1e-300, -0.0, 1 / 3, np.pi / 2])
positive = st.floats(0, 1e6)
fractions = st.floats(-1, 1) | st.just(0.0)
NAMES = st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1, max_size=8) | st.sampled_from(
    ["no", "1", "1.5", "null", "true", "~", "a: b", "# x", "'", '"', "\t", "\n", "- x", "é", "日本", " "]
)


@st.composite
def robots(draw, names=NAMES):
    """Draw any valid robot: trees, loops, every kind of joint, unusual names and numbers.

    The last joints may be cut joints: they end branches, and most of them satisfy all conditions of `cut_joints`.
    names: a strategy.
    """
    count, cuts = draw(st.integers(0, 5)), draw(st.integers(0, 3))
    tree, count = count, count + cuts
    texts = draw(st.lists(names, min_size=3 * count + 4, max_size=3 * count + 4, unique=True))
    joint_names, link_names, frame_names = texts[:count], texts[count : 2 * count + 1], texts[2 * count + 1 :]
    odd = [k >= tree and draw(st.integers(0, 9)) == 0 for k in range(count)]

    def random_pose():
        return placement(
            rotation_from_roll_pitch_yaw(*(draw(reals) for _ in range(3))), [draw(reals) for _ in range(3)]
        )

    def body():
        entries = [draw(reals) for _ in range(6)]
        moments = np.array([entries[:3], [entries[1], *entries[3:5]], [entries[2], *entries[4:]]])
        return Inertia(draw(positive), [draw(reals) for _ in range(3)], moments)

    joints = []
    for k in range(count):
        cut = k >= tree and not odd[k]
        leads = k == 0 or cut or draw(st.booleans())
        bounds = [draw(reals | st.just(np.inf)) for _ in range(4)]
        joints.append(
            Joint(
                name=joint_names[k],
                antecedent=draw(st.integers(0, k if odd[k] else min(k, tree))),
                prismatic=draw(st.booleans()),
                placement=random_pose(),
                rotor_inertia=0.0 if cut else draw(positive),
                viscous_friction=(viscous := draw(positive)),
                coulomb_friction=(coulomb := draw(positive)),
                viscous_asymmetry=viscous * draw(fractions),
                coulomb_asymmetry=coulomb * draw(fractions),
                stribeck_friction=draw(st.sampled_from([0.0, 0.25])),
                stribeck_velocity=draw(st.floats(1e-6, 1e3)),
                limits=Limits(-bounds[0] if bounds[0] == np.inf else bounds[0], *bounds[1:]),
                mimic=None if leads else Mimic(joint_names[k - 1], draw(reals), draw(reals)),
                actuated=not leads or (not cut and draw(st.booleans())),
                spring=draw(st.none() | st.builds(Spring, positive, reals, positive)),
                initial_position=draw(reals),
            )
        )
    frames = [
        Frame(name, k, random_pose() if k and draw(st.booleans()) else np.eye(4)) for k, name in enumerate(link_names)
    ]
    frames += [Frame(name, draw(st.integers(0, count)), random_pose()) for name in frame_names]
    return Robot(
        name=draw(names),
        links=tuple(
            Link(name, body() if k <= tree or draw(st.integers(0, 9)) == 0 else Inertia())
            for k, name in enumerate(link_names)
        ),
        joints=tuple(joints),
        frames=tuple(frames),
        moving_base=draw(st.booleans()),
        gravity=[draw(reals) for _ in range(3)],
        loops=draw_loops(draw, joint_names, tree, frame_names, random_pose) if count else (),
    )


def draw_loops(draw, joint_names, tree, frame_names, random_pose):
    """Draw the loops of a robot: one at each joint after those of the tree, and welds and ball joints in between."""
    count, loops = len(joint_names), []
    any_link = st.integers(0, count) if draw(st.integers(0, 3)) == 0 or tree == 0 else st.integers(0, tree)
    for number in range(tree + 1, count + 1):
        closed_on = draw(any_link)
        if draw(st.integers(0, 9)) and closed_on != number:
            loops.append(Loop(joint_names[number - 1], LoopEnd(number, np.eye(4)), LoopEnd(closed_on, random_pose())))
    free = sorted({*frame_names, *joint_names} - {loop.name for loop in loops})
    for name in draw(st.lists(st.sampled_from(free), max_size=2, unique=True)):
        moved, closed_on = draw(st.lists(any_link, min_size=2, max_size=2, unique=True))
        loop = Loop(
            name, LoopEnd(moved, random_pose()), LoopEnd(closed_on, random_pose()), is_spherical=draw(st.booleans())
        )
        loops.insert(draw(st.integers(0, len(loops))), loop)
    return tuple(loops)
