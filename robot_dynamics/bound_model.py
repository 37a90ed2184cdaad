"""Models of Dynamics that are bound to a base and to external wrenches that do not change."""

from __future__ import annotations

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
        wrenches = {name: np.array(wrench, dtype=float) for name, wrench in (external_wrenches or {}).items()}
        self.model = model
        self._method = getattr(dynamics, model)
        self._options: dict[str, Any] = {}
        if base is not None:
            self._options["base"] = base
        if wrenches:
            if model not in ("inverse", "direct"):
                raise InvalidInputError(f"external wrenches have no part in {model}: leave them out")
            self._options["external_wrenches"] = wrenches
        for name in wrenches:
            robot.frame(name)
        takes_base = {"base": base} if model != "inertia_matrix" else {}
        constants = [*base_arguments(model, robot, takes_base, base), *wrench_arguments(robot, wrenches)]
        if any(constant.ndim != 1 for constant in constants):
            raise InvalidInputError("the base and the wrenches of a bound model are those of one sample")
        self._constants = [np.array(constant, dtype=float) for constant in constants]
        self._attempts = checked_models.compile(program_key(model, robot, base, wrenches))

    def __repr__(self) -> str:
        return f"BoundModel({self.model!r})"

    def __call__(self, *joint_arguments: ArrayLike) -> Array:
        """The result of the model. Raises the errors of the method of Dynamics."""
        for attempt in self._attempts:
            result = attempt(*joint_arguments, *self._constants)
            if result is not None:
                return result
        computed: Array = self._method(*joint_arguments, **self._options)
        return computed
