"""Robots that differ in inertias of links alone, and models that take these inertias as arguments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robot_dynamics.codegen.jit.compiled_models import MODELS
from robot_dynamics.codegen.jit.compiled_program import compile_program, load_program
from robot_dynamics.codegen.procedure.kernels import Kernel
from robot_dynamics.codegen.trace.fingerprint import fingerprint
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.inertia import Inertia, symmetric_entries, symmetric_matrix

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
    from robot_dynamics.model.robot import Robot

VARIED_MODELS = ("direct", "state_derivative", "inertia_matrix")
"""Models of a step that depend on inertias."""

ENTRIES = 10
"""Entries of an inertia: M, MX, MY, MZ, XX, XY, XZ, YY, YZ, ZZ."""

FIELDS_WITHOUT_EFFECT = ("name", "reader_warnings", "payload_warnings", "visuals")
"""Fields of a Robot without effect on its motion."""


class VariedInertias(NamedTuple):
    """What differs between N robots.

    Attributes
    ----------
    links : tuple of int
        Numbers of the links whose inertias differ.
    values : ndarray, shape (N, 10 k)
        The inertias of these k links of each robot.
    """

    links: tuple[int, ...]
    values: Array


class VariedKernel(Kernel):
    """A model with inertias as last arguments, which is called without them.

    Attributes
    ----------
    inertias : sequence
        One array (10,) for each varied link, of numbers or symbols. Set while a procedure is staged.
    """

    inertias: Sequence[Any] = ()

    def __call__(self, *arguments: Any) -> Any:
        return super().__call__(*arguments, *self.inertias)


def compare_inertias(robots: Sequence[Robot]) -> VariedInertias:
    """The inertias that differ between robots.

    Raises
    ------
    InvalidInputError
        There is no robot, or they differ in more than inertias of links.
    """
    if not robots:
        raise InvalidInputError("there is no robot: pass one, or one for each simulation")
    first = robots[0]
    for number, robot in enumerate(robots):
        if not _differ_in_inertias_alone(first, robot):
            raise InvalidInputError(
                f"robot {number} differs from robot 0 in more than the inertias of its links: simulate it in a call of "
                "its own"
            )
    values = np.array([[_entries(link.inertia) for link in robot.links] for robot in robots])
    links = np.flatnonzero((values != values[0]).any(axis=(0, 2)))
    return VariedInertias(tuple(links.tolist()), values[:, links].reshape(len(robots), -1))


def with_inertias(robot: Robot, varied: VariedInertias, sample: int) -> Robot:
    """A robot with the inertias of one of N robots."""
    links = list(robot.links)
    for number, entries in zip(varied.links, varied.values[sample].reshape(-1, ENTRIES), strict=True):
        inertia = Inertia(entries[0], entries[1:4], symmetric_matrix(*entries[4:]))
        links[number] = replace(links[number], inertia=inertia)
    return replace(robot, links=tuple(links))


def make_kernel(robot: Robot, model: str, links: tuple[int, ...], independent: tuple[int, ...] | None) -> VariedKernel:
    """The Kernel of one of VARIED_MODELS with the inertias of some links as arguments. Raises CompilationError."""
    options: dict[str, object] = {"varied_links": links}
    if independent is not None:
        options["independent"] = independent
    trace = cache(partial(MODELS[model], robot, **options))
    key = fingerprint(robot, model, options)
    program: CompiledProgram | None = load_program(key, trace) if key else None
    return VariedKernel(model, program or compile_program(trace(), key=key))


def with_inertia_input(function: Callable[..., Any], kernels: Sequence[Kernel]) -> Callable[..., Any]:
    """A procedure with a further input, the inertias (10 k,) that VariedKernels among its kernels take."""

    def call(*arguments: Any) -> Any:
        *others, inertias = arguments
        parts = [inertias[start : start + ENTRIES] for start in range(0, len(inertias), ENTRIES)]
        for kernel in kernels:
            if isinstance(kernel, VariedKernel):
                kernel.inertias = parts
        return function(*others)

    return call


def _entries(inertia: Inertia) -> list[float]:
    return [inertia.mass, *inertia.first_moments, *symmetric_entries(inertia.second_moments)]


def _differ_in_inertias_alone(first: Robot, second: Robot) -> bool:
    if first is second:
        return True
    shared = [field.name for field in fields(first) if field.name not in (*FIELDS_WITHOUT_EFFECT, "links")]
    if len(first.links) == len(second.links) and all(
        _is_same(getattr(first, name), getattr(second, name)) for name in shared
    ):
        pairs = zip(first.links, second.links, strict=True)
        if all(a.flexibility is b.flexibility for a, b in pairs):
            return True
    keys = [fingerprint(_without_inertias(robot)) for robot in (first, second)]
    return keys[0] is not None and keys[0] == keys[1]


def _is_same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b)
    return a is b


def _without_inertias(robot: Robot) -> list[object]:
    """All of a robot that has an effect on its motion, but for inertias."""
    values: list[object] = [
        getattr(robot, field.name) for field in fields(robot) if field.name not in (*FIELDS_WITHOUT_EFFECT, "links")
    ]
    return [*values, [replace(link, name="", inertia=Inertia()) for link in robot.links]]
