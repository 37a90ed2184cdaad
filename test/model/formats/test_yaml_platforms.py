"""Parallel modules in series in MDH tables: what is read of them, that all of it is written, and how mistakes are
told."""

import numpy as np
import pytest
from peers.planar_stack import planar_stack

from robot_dynamics import DescriptionError
from robot_dynamics.model.formats.mdh_yaml.reader import read_mdh_yaml
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.formats.par.writer import find_losses as par_losses
from robot_dynamics.model.minimal_frames import minimal_frames
from robot_dynamics.model.platform import COORDINATES

STACK = planar_stack("gears")


def test_each_platform_and_its_legs_start_on_its_base():
    """The upper platform is the first in the list, before the fixed row of the turntable on which it stands."""
    robot = read_mdh_yaml(STACK)
    assert robot.platform_links == ("upper", "lower")
    upper, lower = robot.platforms
    assert (upper.base, lower.base) == ("bench", None) and upper.free == ("x", "y", "yaw")
    names, links = [joint.name for joint in robot.joints], [link.name for link in robot.links]
    of_lower, of_upper = ([f"{link}_{name}" for name in COORDINATES] for link in ("lower", "upper"))
    assert names[:14] == [*of_lower, "turn", *of_upper, "point"]
    assert [names[number] for number in upper.joints] == of_upper and links[upper.link] == "upper"
    bench, first = robot.frame("bench"), robot.joints[robot.joint_numbers["upper_x"]]
    assert links[first.antecedent] == links[bench.link] == "turntable"
    np.testing.assert_allclose(first.placement[:3, 2], bench.placement[:3, 0], atol=1e-15)  # slides along x of it
    np.testing.assert_allclose(first.placement[:3, 3], bench.placement[:3, 3], atol=1e-15)
    for number in (1, 2, 3):
        joint = robot.joints[robot.joint_numbers[f"crank_upper_{number}"]]
        assert links[joint.antecedent] == "turntable" and joint.placement[2, 3] == bench.placement[2, 3]
        assert robot.joints[robot.joint_numbers[f"crank_lower_{number}"]].antecedent == 0
    ends = {loop.name: links[loop.closed_on.link] for loop in robot.loops}
    assert ends["wrist_upper_2"] == "upper" and ends["wrist_lower_2"] == "lower" and len(ends) == 6


@pytest.mark.parametrize("change", [lambda robot: robot, minimal_frames])
def test_robot_is_the_same_when_written_and_read(change):
    robot = change(read_mdh_yaml(STACK))
    again = read_mdh_yaml(write_mdh_yaml(robot))
    assert again.platforms == robot.platforms
    assert [joint.name for joint in again.joints] == [joint.name for joint in robot.joints]
    for joint, same in zip(robot.joints, again.joints, strict=True):
        assert (joint.limits, joint.spring, joint.role) == (same.limits, same.spring, same.role)
        np.testing.assert_allclose(same.placement, joint.placement, rtol=0, atol=1e-15)
    for frame in robot.frames:
        np.testing.assert_allclose(again.frame(frame.name).placement, frame.placement, rtol=0, atol=1e-15)
    assert sum("is the platform" in loss for loss in par_losses(robot)) == 2


FIRST_COPY = "        platform: {antecedent: lower, mdh: {gamma: toward, d: s*0.1, theta: -toward}}\n"
MISTAKES = {
    "unknown base": ("base: bench", "base: bunch", "unknown link 'bunch': did you mean 'bench'"),
    "base that is a joint": ("base: bench", "base: turn", "'turn' is a joint: it moves 'turntable'"),
    "base on itself": ("base: bench", "base: upper", "unknown link 'upper'"),
    "which one a leg meets": (
        FIRST_COPY,
        "",
        "there are several platforms (upper, lower): name one of them, platform: {ante",
    ),
    "leg to another link": (
        "antecedent: lower, mdh: {gamma",
        "antecedent: bench, mdh: {gamma",
        "unknown platform 'bench'",
    ),
    "one and many": (
        "platforms:\n",
        "platform: {link: third, mass: 1}\nplatforms:\n",
        "platform and platforms exclude each other",
    ),
    "none": (STACK[STACK.index("platforms:") : STACK.index("legs:")], "platforms: []\n", "a list of platforms"),
    "twice": ("link: upper, base: bench", "link: lower, base: bench", "'lower_x' is already defined"),
    "no inertia": ("free: [x, y, yaw], mass: 4,", "free: [x, y, yaw], mass: 0,", "platform 'lower' has no inertia"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_malformed_platform_is_refused_with_line_and_remedy(mistake):
    wrong, right, reason = MISTAKES[mistake]
    text = STACK.replace(wrong, right, 1)
    assert text != STACK
    with pytest.raises(DescriptionError) as refusal:
        read_mdh_yaml(text, source="stack.yaml")
    assert reason in str(refusal.value) and str(refusal.value).startswith("stack.yaml, line "), refusal.value


def test_coordinate_rows_must_start_at_the_base():
    text = write_mdh_yaml(read_mdh_yaml(STACK))
    assert text.count("base: bench") == 1
    for right, reason in (
        (
            "",
            "in their order, must connect the platform to its base, not 'upper_x', ",
        ),
        ("base: turntable", "must coincide with that of the base where they are zero"),
        ("base: banch", "the base of a platform: unknown link 'banch': did you mean 'bench'"),
    ):
        with pytest.raises(DescriptionError, match=reason):
            read_mdh_yaml(text.replace("    base: bench\n", right and f"    {right}\n"))
