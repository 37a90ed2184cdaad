"""Models of Dynamics that are bound to a base and to external wrenches that do not change."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.codegen.program_calls import base_arguments, program_key, wrench_arguments
from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.codegen.procedure.checked_models import CheckedModels
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.inputs import Base, ExternalWrenches


class BoundModel:
    """A model of a robot at one state of the base and with constant external wrenches. `Dynamics.bind` makes it.

    Called with the joint arguments of the method of Dynamics of that name, it returns the same result. One sample takes
    less than a microsecond for most arms; batches take the way of Dynamics.

    Attributes
    ----------
    model : str
        Name of the model.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        model: str,
        checked_models: CheckedModels,
        base: Base | None,
        external_wrenches: ExternalWrenches | None,
    ) -> None:
        robot = dynamics.robot
        if not (dynamics.joint_names or robot.moving_base):
            raise InvalidInputError(f"{robot.name!r} has no joints: there is nothing to bind")
        if not isinstance(external_wrenches, Mapping | None):
            raise InvalidInputError(
                f"external_wrenches must be a mapping from link names, not {external_wrenches!r:.60}"
            )
        if base is not None and model == "inertia_matrix":
            raise InvalidInputError("the state of the base has no part in inertia_matrix: leave it out")
        if base is not None and base.acceleration is not None and model in ("gravity", "coriolis"):
            raise InvalidInputError("the acceleration of the base has no part in this term: leave it out of Base")
        base = copy.deepcopy(base)
        names = tuple(external_wrenches or ())
        for name in names:
            robot.frame(name)
        constant_wrenches = wrench_arguments(robot, external_wrenches or {})
        wrenches = {name: np.array(wrench) for name, wrench in zip(names, constant_wrenches, strict=True)}
        self.model = model
        self._dynamics = dynamics
        self._method = getattr(dynamics, model)
        self._options: dict[str, Any] = {}
        if base is not None:
            self._options["base"] = base
        if wrenches:
            if model not in ("inverse", "direct"):
                raise InvalidInputError(f"external wrenches have no part in {model}: leave them out")
            self._options["external_wrenches"] = wrenches
        takes_base = {"base": base} if model != "inertia_matrix" else {}
        constants = [*base_arguments(model, robot, takes_base, base), *wrenches.values()]
        if any(constant.ndim != 1 for constant in constants):
            raise InvalidInputError("the base and the wrenches of a bound model are those of one sample")
        self._constants = [np.array(constant, dtype=float) for constant in constants]
        self._attempts = checked_models.compile(program_key(model, robot, base, wrenches))

    def __repr__(self) -> str:
        return f"BoundModel({self.model!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle without the machine code, which belongs to this process: the copy is compiled again."""
        return partial(type(self._dynamics).bind, **self._options), (self._dynamics, self.model)

    def __call__(self, *joint_arguments: ArrayLike) -> Array:
        """The result of the model. Raises the errors of the method of Dynamics."""
        for attempt in self._attempts:
            result = attempt(*joint_arguments, *self._constants)
            if result is not None:
                return result
        computed: Array = self._method(*joint_arguments, **self._options)
        return computed
