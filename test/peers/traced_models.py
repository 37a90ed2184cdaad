"""Shipped robots and the programs of their models: loaded and traced once in a process."""

from functools import cache

from robot_dynamics import load_robot
from robot_dynamics.codegen.jit.compiled_models import MODELS


@cache
def shipped_robot(name):
    return load_robot(name)


@cache
def shipped_program(name, model, **options):
    """The Program of a model of a shipped robot, with options of its function in MODELS."""
    return MODELS[model](shipped_robot(name), **options)
