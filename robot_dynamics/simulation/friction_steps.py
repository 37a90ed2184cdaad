"""Friction of one step: predicted for its end, it acts throughout the step; the rest acts as impulses at the end."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.constrained_motion import LoopCoordinates
    from robot_dynamics.simulation.friction_impulses import ImpulsiveFriction
    from robot_dynamics.simulation.plant import Plant
    from robot_dynamics.simulation.rate_constraints import RateConstraints
    from robot_dynamics.simulation.simulation_state import SimulationState
    from robot_dynamics.simulation.step_inputs import StepInputs
    from robot_dynamics.simulation.step_integrator import StepIntegrator

NOTHING = np.zeros(0)


class AppliedFriction(NamedTuple):
    """Impulses (k,) of friction among the efforts of a step, and lowest and highest impulse (k,) of dry friction."""

    impulses: Array
    limits: tuple[Array, Array]


class FrictionSteps:
    """Friction of the joints of a Plant that acts as impulses.

    Parameters
    ----------
    plant : Plant
    constraints : RateConstraints
    friction : ImpulsiveFriction
    integrator : StepIntegrator
    step : float
        Length of a step [s].
    """

    def __init__(
        self,
        plant: Plant,
        constraints: RateConstraints,
        friction: ImpulsiveFriction,
        integrator: StepIntegrator,
        step: float,
    ) -> None:
        self._plant = plant
        self._constraints = constraints
        self._friction = friction
        self._integrator = integrator
        self._step = step

    def begin(
        self, state: SimulationState, q: Array, rates: Array, coordinates: LoopCoordinates | None, inputs: StepInputs
    ) -> tuple[StepInputs, AppliedFriction]:
        """Inputs with friction among the efforts, so that sticking joints do not move.

        q: positions as the programs take them; rates: (6 + n,) that the step begins with.
        """
        joints = self._friction.joints
        if not len(joints) or inputs.motion is not None:
            return inputs, AppliedFriction(NOTHING, (NOTHING, NOTHING))
        joint_shares = self._joint_shares(q)
        joint_efforts = inputs.efforts[joints] if self._plant.loops is not None else joint_shares.T @ inputs.efforts
        limits = self._friction.limits(joint_shares.T @ rates[6:], joint_efforts)
        accelerations = self._integrator.accelerations(state, q, rates, coordinates, inputs)
        no_friction = AppliedFriction(np.zeros(len(joints)), limits)
        impulses, _ = self._apply(q, rates + self._step * accelerations, joint_shares, inputs, no_friction)
        efforts = inputs.efforts.copy()
        if self._plant.loops is not None:
            efforts[joints] += impulses / self._step
        else:
            efforts += joint_shares @ impulses / self._step
        return inputs._replace(efforts=efforts), AppliedFriction(impulses, limits)

    def end(self, q: Array, rates: Array, inputs: StepInputs, applied: AppliedFriction) -> Array:
        """The rates (6 + n,) after the friction that they do not contain yet, at the end of a step."""
        if not len(applied.impulses):
            return rates
        return rates + self._apply(q, rates, self._joint_shares(q), inputs, applied)[1]

    def _joint_shares(self, q: Array) -> Array:
        """Rates (n, k) of the joints with friction by the rates of the coordinates, transposed."""
        shares: Array = self._plant.velocity_matrix(q)[self._friction.joints].T
        return shares

    def _apply(
        self, q: Array, rates: Array, joint_shares: Array, inputs: StepInputs, applied: AppliedFriction
    ) -> tuple[Array, Array]:
        """Impulses (k,) of friction, and the change of the rates (6 + n,) by those that they do not contain yet."""
        response = self._constraints.impulse_response(q, rates, joint_shares, inputs.drive is not None)
        impulses, change = self._friction.apply(
            response, joint_shares, joint_shares.T @ rates[6:], applied.impulses, applied.limits
        )
        return impulses, change
