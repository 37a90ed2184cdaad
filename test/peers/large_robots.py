"""Robots that ship whose models take most of the time of a test of all robots."""

import os

import pytest

LARGE_ROBOTS = ("delta_wrist", "hexapod_stack", "navaro", "orthoglide")


def each_robot(names, large=LARGE_ROBOTS):
    """Return names of robots as parameters of a test; large ones are tested by `make soak`, which sets EVERY_ROBOT."""
    skip = pytest.mark.skipif("EVERY_ROBOT" not in os.environ, reason="takes long: a part of `make soak`")
    return [pytest.param(name, marks=skip) if name in large else name for name in names]
