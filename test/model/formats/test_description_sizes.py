"""Work of the readers: it grows with the size of a text and no faster, and short texts do not describe large robots."""

import sys

import pytest
from peers.hostile_descriptions import (
    beams,
    chain,
    fixed_rows,
    frames,
    leg_copies,
    par,
    parameters,
    platforms,
    urdf,
)

from robot_dynamics import DescriptionError, load_robot, shipped_robots
from robot_dynamics.model.formats import expression
from robot_dynamics.model.loading import read_robot

BEAM_ROW = "{joint: j{k}, link: l{k}, beams: [" + "{to: [1, 0, 0], section: b, material: s}, " * 20 + "]}"
SHORT = {
    "rows": (
        leg_copies("{link: l{k}, type: fixed}", 400, 400),
        "have 160800 rows, beams and loops: the maximum is 5000",
    ),
    "joints": (leg_copies("{link: l{k}, joint: j{k}}", 80, 40), "more than 2000 moving joints"),
    "beams": (leg_copies(BEAM_ROW, 20, 400), "rows, beams and loops: the maximum is 5000"),
    "ends": (leg_copies("{link: l{k}, joint: j{k}}", 1, 2000, f"ends: [{'{joint: e}, ' * 10}]"), "the maximum is 5000"),
    "parameters": (parameters(400, 400), "expressions up to here are too many"),
}


def count_calls(text):
    """Number of functions that are called while a text is read: a measure of work that no other process changes."""
    count = 0

    def profile(_frame, _event, _argument):
        nonlocal count
        count += 1

    read_robot(text, source="text")  # caches are full
    sys.setprofile(profile)
    try:
        read_robot(text, source="text")
    finally:
        sys.setprofile(None)
    return count


@pytest.mark.parametrize(
    ("make", "size"),
    [(beams, 25), (chain, 40), (fixed_rows, 40), (frames, 60), (platforms, 8), (urdf, 40), (par, 60)],
)
def test_work_of_readers_is_proportional_to_the_length(make, size):
    """400 beams (24 KB) took 30 s: their number entered with its third power."""
    assert count_calls(make(4 * size)) < 5 * count_calls(make(size))


@pytest.mark.parametrize("case", SHORT)
def test_short_text_of_a_large_robot_is_refused(case):
    text, reason = SHORT[case]
    assert len(text) < 50_000
    with pytest.raises(DescriptionError, match=reason) as refusal:
        read_robot(text, source="text")
    assert str(refusal.value).startswith("text, line")


def test_robots_that_ship_are_far_below_the_limit_of_expressions(monkeypatch):
    monkeypatch.setattr(expression, "MAX_EVALUATED_LENGTH", expression.MAX_EVALUATED_LENGTH // 20)
    for name in shipped_robots():
        load_robot(name)
