"""Derivatives of the inverse and direct dynamic models, and the linear state space near one state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from robot_dynamics.codegen.program_calls import base_arguments, program_key, run_all_outputs, wrench_arguments
from robot_dynamics.inputs import base_state, common_batch_shape, link_wrenches
from robot_dynamics.joint_space.dynamics_terms import DynamicsTerms
from robot_dynamics.model.vector_product import skew
from robot_dynamics.newton_euler.screw import BASE_ROWS
from robot_dynamics.results import DirectDerivatives, InverseDerivatives, Linearization

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.codegen.jit.compiled_models import RunnableProgram
    from robot_dynamics.codegen.jit.program_key import ProgramKey
    from robot_dynamics.inputs import Base, ExternalWrenches


LAST_ARGUMENTS = {"inverse_derivatives": ("qdd", "accelerations"), "direct_derivatives": ("efforts", "efforts")}
"""Last argument of each model: its name as an option of `solve`, and in errors."""


class MotionDerivatives(DynamicsTerms):
    """Derivatives of the dynamic models in joint coordinates, by programs; base class of `Dynamics`."""

    def inverse_derivatives(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        *,
        base: Base | None = None,
        external_wrenches: ExternalWrenches | None = None,
    ) -> InverseDerivatives:
        """Derivatives of `inverse` by positions, velocities and accelerations.

        The first call compiles a program, or loads it from the cache: half a second for an arm, 3 s for 30 joints.

        Parameters
        ----------
        q, qd, qdd, base, external_wrenches
            As `inverse`. External wrenches are constant in their link frames.

        Returns
        -------
        InverseDerivatives

        Raises
        ------
        InvalidInputError, SingularModelError
            As `inverse`. Also SingularModelError where the pitch of a platform is ±90°.

        Notes
        -----
        Coulomb friction counts as constant: its derivative is zero at rest too. The derivative by the parameters of the
        robot is `regressor`.
        """
        return InverseDerivatives(*self._derivatives("inverse_derivatives", q, qd, qdd, base, external_wrenches))

    def direct_derivatives(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        efforts: ArrayLike,
        *,
        base: Base | None = None,
        external_wrenches: ExternalWrenches | None = None,
    ) -> DirectDerivatives:
        """Derivatives of `direct` by positions, velocities and efforts.

        Parameters
        ----------
        q, qd, efforts, base, external_wrenches
            As `direct`. External wrenches are constant in their link frames.

        Returns
        -------
        DirectDerivatives

        Raises
        ------
        InvalidInputError, SingularModelError
            As `direct`. Also SingularModelError where the pitch of a platform is ±90°.

        Notes
        -----
        As `inverse_derivatives`.
        """
        return DirectDerivatives(*self._derivatives("direct_derivatives", q, qd, efforts, base, external_wrenches))

    def linearize(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        efforts: ArrayLike,
        *,
        base: Base | None = None,
        external_wrenches: ExternalWrenches | None = None,
    ) -> Linearization:
        """Linear state space of the robot near one state: dẋ = A dx + B du.

        Parameters
        ----------
        q, qd, efforts, external_wrenches
            As `direct_derivatives`.
        base : Base, optional
            State of the base without acceleration, for a robot with a moving base only.

        Returns
        -------
        Linearization

        Raises
        ------
        InvalidInputError, SingularModelError
            As `direct_derivatives`.

        Notes
        -----
        The state need not be at rest. With a moving base, d ξ̇ = dV - [V, ξ] for its twist V, and the derivative of the
        components of its linear velocity is its acceleration less ω × v.
        """
        self._refuse_base_acceleration(base)
        direct = self.direct_derivatives(q, qd, efforts, base=base, external_wrenches=external_wrenches)
        m = direct.positions.shape[-1]
        inputs = [column for column in range(len(self.joint_names)) if column not in self._unactuated]
        A = np.zeros((*direct.positions.shape[:-2], 2 * m, 2 * m))
        A[..., :m, m:] = np.eye(m)
        A[..., m:, :m] = direct.positions
        A[..., m:, m:] = direct.velocities
        if self.robot.moving_base:
            _add_base_kinematics(A, base_state(self.robot, base).twist)
        B = np.zeros((*A.shape[:-1], len(inputs)))
        B[..., m:, :] = direct.efforts[..., inputs]
        names = (*BASE_ROWS[: m - len(self.joint_names)], *self.joint_names)
        state_names = tuple(f"{kind} of {name}" for kind in ("position", "velocity") for name in names)
        return Linearization(A, B, state_names, tuple(self.joint_names[column] for column in inputs))

    def _compile_derivatives(self, base: Base | None, links: Sequence[str]) -> None:
        """Compile now what derivatives need with external wrenches on links; it is safe in any thread.

        Raises SingularModelError where there are no derivatives in any state.
        """
        for model in LAST_ARGUMENTS:
            self._runnable_program(program_key(model, self.robot, base, dict.fromkeys(links, np.zeros(6))))

    def _derivatives(
        self,
        model: str,
        q: ArrayLike,
        qd: ArrayLike,
        last: ArrayLike,
        base: Base | None,
        external_wrenches: ExternalWrenches | None,
    ) -> list[Array]:
        """Return the derivatives of a model; `last`: accelerations of the inverse model, efforts of the direct one.

        Raises InvalidInputError and SingularModelError.
        """
        if base is None and external_wrenches is None:
            columns = self._attempt(model, q, qd, last)
            if columns is not None:
                m = len(columns)
                return [columns[:, :m], columns[:, m : 2 * m], columns[:, 2 * m :]]
        option, description = LAST_ARGUMENTS[model]
        arguments = [
            self._check_positions(q),
            self._check_joints("velocities", qd),
            self._check_actuated(description, last),
        ]
        results = self._run_derivatives(model, arguments, base, external_wrenches)
        if results is None:
            self._refuse_singular_state(q, qd, {option: last, "base": base, "external_wrenches": external_wrenches})
        return results

    def _run_derivatives(
        self,
        model: str,
        arguments: list[Array],
        base: Base | None,
        external_wrenches: ExternalWrenches | None,
    ) -> list[Array] | None:
        """Return the derivatives of a model, None where they are not finite or the state is singular."""
        link_wrenches(self.robot, external_wrenches)  # refuses what does not fit
        wrenches = dict(external_wrenches or {})
        options = {"base": base, "external_wrenches": wrenches}
        inputs = [
            *arguments,
            *base_arguments(model, self.robot, options, base),
            *wrench_arguments(self.robot, wrenches),
        ]
        batch = common_batch_shape(*inputs)
        if not (self.joint_names or self.robot.moving_base):
            return [np.zeros((*batch, 0, 0))] * 3
        program = self._runnable_program(program_key(model, self.robot, base, wrenches))
        if 0 in batch:
            return [np.zeros((*batch, *shape)) for name, shape in program.interface.outputs if name.startswith("by_")]
        return run_all_outputs(program, inputs, batch)

    def _runnable_program(self, key: ProgramKey) -> RunnableProgram:
        """Return the program of a model. `Dynamics` has it."""
        raise NotImplementedError

    def _refuse_singular_state(self, q: ArrayLike, qd: ArrayLike, options: dict[str, Any]) -> NoReturn:
        """Raise SingularModelError for a state without derivatives, of arguments of `solve`. `Dynamics` does it."""
        raise NotImplementedError


def _add_base_kinematics(A: Array, twist: Array) -> None:
    """Add to A (..., 2 m, 2 m) how the position and the twist (..., 6) of a moving base change in its own frame."""
    m = A.shape[-1] // 2
    v, omega = skew(twist[..., :3]), skew(twist[..., 3:])
    A[..., :3, :3] -= omega
    A[..., :3, 3:6] -= v
    A[..., 3:6, 3:6] -= omega
    A[..., m : m + 3, m : m + 3] -= omega
    A[..., m : m + 3, m + 3 : m + 6] += v
