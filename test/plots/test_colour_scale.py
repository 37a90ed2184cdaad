"""Colour scales of maps: round numbers that contain the values, and the same ones for maps that are alike."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_dynamics.plots.colour_scale import CONDITION_SCALE, ColourScale, fit_scale

ROUND = {1, 2, 3, 5, 10}


def leading(value):
    """Return the digits of a number before its power of ten."""
    return value / 10 ** np.floor(np.log10(value) + 1e-9)


@given(st.lists(st.floats(1e-6, 1e9), min_size=1, max_size=20))
def test_scale_contains_the_values_and_its_marks_are_round(values):
    scale = fit_scale(np.array([*values, np.nan]))
    assert scale.lower <= min(values) * (1 + 1e-8) and max(values) * (1 - 1e-8) <= scale.upper
    levels = scale.levels
    assert 1 <= len(levels) < 70 and np.all(np.diff(levels) > 0)
    assert levels[0] >= scale.lower * (1 - 1e-8) and levels[-1] <= scale.upper * (1 + 1e-8)
    marks = levels if scale.is_logarithmic else np.diff(levels)[:1]
    assert all(min(abs(leading(mark) - number) for number in ROUND) < 1e-4 for mark in marks)


def test_maps_that_are_alike_have_the_same_scale():
    assert fit_scale(np.array([36.9, 55.1])) == fit_scale(np.array([36.2, 55.9])) == ColourScale(36, 56)
    assert fit_scale(np.array([3.2, 170.0])) == fit_scale(np.array([3.9, 155.0])) == ColourScale(3, 200)


@pytest.mark.parametrize("values", [[], [np.nan], [0.0, 0.0], [np.inf]])
def test_scale_of_nothing(values):
    assert fit_scale(np.array(values)) == ColourScale(0, 1)


def test_levels_of_the_condition_number():
    assert CONDITION_SCALE.levels.tolist() == [1, 2, 3, 5, 10, 20, 30, 50, 100]
    assert ColourScale(0, 60).levels.tolist() == list(range(0, 61, 5))
