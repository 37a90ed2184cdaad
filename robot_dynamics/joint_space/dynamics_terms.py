"""Terms of the dynamic model of a robot: inertia matrix, gravity, Coriolis, friction, springs, regressor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.array_checks import broadcast_result
from robot_dynamics.constraints.attitude_charts import virtual_links
from robot_dynamics.constraints.charted_regressor import independent_regressor
from robot_dynamics.constraints.constrained_state import projection_matrix
from robot_dynamics.constraints.mixed_dynamics import RobotState
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.inputs import base_state, common_batch_shape, link_wrenches
from robot_dynamics.joint_space.joint_coordinates import JointCoordinates
from robot_dynamics.newton_euler.friction import friction, has_load_friction, load_friction
from robot_dynamics.newton_euler.joint_springs import spring_force
from robot_dynamics.newton_euler.regressor import parameter_names, parameters
from robot_dynamics.newton_euler.screw import apply_transposed
from robot_dynamics.newton_euler.walker_orin import bias, inertia_matrix

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.inputs import Base, BaseState, ExternalWrenches


@dataclass(frozen=True, eq=False)
class ModelState(RobotState):
    """A RobotState with all of the state of the base."""

    base: BaseState


class DynamicsTerms(JointCoordinates):
    """Terms of the dynamic model in joint coordinates, by the recursions; base class of `Dynamics`."""

    def inertia_matrix(self, q: ArrayLike) -> Array:
        """Mass matrix A(q) of the robot, rotors included.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].

        Returns
        -------
        ndarray, shape (..., n, n)
            [kg m², kg m or kg]; with a moving base (..., 6 + n, 6 + n), the base first.

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot.
        SingularModelError
            The loops do not close or are singular.

        Notes
        -----
        Source: Khalil, sections 3.3.1 and 7.1.
        """
        result = self._attempt("inertia_matrix", q)
        if result is not None:
            return result
        q = self._check_positions(q)
        return self._evaluate("inertia_matrix", {"q": q}, lambda: self._inertia_matrix(q), {})

    def _inertia_matrix(self, q: Array) -> Array:
        state = self._closure_solver.state_at(q)
        P = projection_matrix(state.G, self._base_size())
        with np.errstate(all="ignore"):
            A = inertia_matrix(state.robot, state.chart_q)
            return broadcast_result(np.swapaxes(P, -1, -2) @ A @ P, q.shape[:-1], axes=2)

    def gravity(self, q: ArrayLike, *, base: Base | None = None) -> Array:
        """Gravity term g(q) alone: the efforts that hold the robot at rest.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].
        base : Base, optional
            State of the base without acceleration, for a robot with a moving base only; its twist has no effect.

        Returns
        -------
        ndarray, shape (..., n)
            [N m or N]; with a moving base (..., 6 + n), the base first.

        Raises
        ------
        InvalidInputError, SingularModelError
            As `inertia_matrix`.
        """
        self._refuse_base_acceleration(base)
        result = None if base is not None else self._attempt("gravity", q)
        if result is not None:
            return result
        q = self._check_positions(q)

        def recursion() -> Array:
            state = self._state(q, np.zeros(len(self.joint_names)), base)
            return self._bias(state, base, np.zeros(6), state.base.rest_acceleration)

        return self._evaluate("gravity", {"q": q}, recursion, {"base": base})

    def coriolis(self, q: ArrayLike, qd: ArrayLike, *, base: Base | None = None) -> Array:
        """Coriolis and centrifugal term C(q, q̇)q̇ alone, without gravity and friction.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].
        qd : array_like, shape (..., n)
            Velocities [rad/s or m/s].
        base : Base, optional
            State of the base without acceleration, for a robot with a moving base only.

        Returns
        -------
        ndarray, shape (..., n)
            [N m or N]; with a moving base (..., 6 + n), the base first.

        Raises
        ------
        InvalidInputError, SingularModelError
            As `inertia_matrix`.
        """
        self._refuse_base_acceleration(base)
        result = None if base is not None else self._attempt("coriolis", q, qd)
        if result is not None:
            return result
        q = self._check_positions(q)

        def recursion() -> Array:
            state = self._state(q, qd, base)
            return self._bias(state, base, state.base.twist, np.zeros(6))

        arguments = {"q": q, "qd": self._check_joints("velocities", qd)}
        return self._evaluate("coriolis", arguments, recursion, {"base": base})

    def regressor(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, base: Base | None = None) -> Array:
        """Regressor Y of the inverse dynamic model: efforts without springs are ``Y @ parameters``.

        The column of a load friction is the magnitude of the load of the robot's own parameters times sign(q̇).

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].
        qd, qdd : array_like, shape (..., n)
            Velocities [rad/s or m/s] and accelerations [rad/s² or m/s²].
        base : Base, optional
            State of the base with its acceleration, for a robot with a moving base only.

        Returns
        -------
        ndarray, shape (..., n, p)
            Columns as `parameter_names`; with a moving base (..., 6 + n, p), the base first.

        Raises
        ------
        InvalidInputError, SingularModelError
            As `inertia_matrix`.

        Notes
        -----
        The links between yaw, pitch and roll of a platform have no body. Their columns, and those of these three
        joints, are the effect that a body would have. They grow with 1/cos² of pitch and are zero where the cosine of
        pitch is below 1e-12 in size.

        Source: Khalil, section 4, for loops: G^T times the regressor of the tree.
        """
        q = self._check_positions(q)
        qdd = self._check_joints("accelerations", qdd)
        if self.robot.moving_base and (base is None or base.acceleration is None):
            raise InvalidInputError("the regressor needs the acceleration of the moving base: give it in Base")

        def recursion() -> Array:
            state = self._state(q, qd, base, acting=qdd)
            with np.errstate(all="ignore"):
                Y = independent_regressor(
                    state.constrained_state,
                    state.qd,
                    state.expand_accelerations(qdd),
                    state.base.twist,
                    state.base.prescribed_acceleration,
                )
                return broadcast_result(Y, state.batch, axes=2)

        arguments = {"q": q, "qd": self._check_joints("velocities", qd), "qdd": qdd}
        return self._evaluate("regressor", arguments, recursion, {"base": base})

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the columns of `regressor`: XX.link, ... M.link, Ia.joint, Fv.joint, Fs.joint, link by link.

        Fva.joint, Fsa.joint, Fst.joint and mu.joint follow, of the joints for which the description has this friction.
        """
        return parameter_names(self.robot)

    @property
    def parameters(self) -> Array:
        """(p,) values of `parameter_names` for this robot."""
        return parameters(self.robot)

    def friction(self, qd: ArrayLike, q: ArrayLike | None = None, *, base: Base | None = None) -> Array:
        """Friction alone, that of dependent joints included; zero at rest.

        Load-dependent friction is that at zero acceleration: the load of a joint is then its Coriolis and gravity term.

        Parameters
        ----------
        qd : array_like, shape (..., n)
            Velocities [rad/s or m/s].
        q : array_like, shape (..., n) or (..., all joints), optional
            Positions [rad or m]; required where the robot has loops or load-dependent friction.
        base : Base, optional
            State of the base without acceleration, for a robot with a moving base only; required where the robot has
            load-dependent friction.

        Returns
        -------
        ndarray, shape (..., n)
            [N m or N]

        Raises
        ------
        InvalidInputError, SingularModelError
            As `inertia_matrix`.
        """
        qd = self._check_joints("velocities", qd)
        if has_load_friction(self.robot):
            return self._friction_under_load(qd, q, base)
        if base is not None:
            base_state(self.robot, base)  # refuses what does not fit
        state = self._constrained_state_or_any(q)
        with np.errstate(all="ignore"):
            efforts = state.projected(friction(self.robot, state.expand_rates(qd)))
        return broadcast_result(efforts, common_batch_shape(qd, None if q is None else state.q))

    def _friction_under_load(self, qd: Array, q: ArrayLike | None, base: Base | None) -> Array:
        """Return `friction` of a robot with load-dependent friction."""
        if q is None:
            raise InvalidInputError(f"friction of {self.robot.name!r} depends on loads, and these on positions: give q")
        state = self._state(q, qd, base)
        self._refuse_base_acceleration(base)
        with np.errstate(all="ignore"):
            acceleration = state.base.rest_acceleration
            H = bias(state.robot, state.chart_q, state.qd, state.base.twist, acceleration, drift=state.drift)
            loads = H[..., -len(self.robot.joints) :]
            efforts = friction(self.robot, state.qd) + load_friction(self.robot.joints, state.qd, loads)
            return broadcast_result(state.constrained_state.projected(efforts), state.batch)

    def elasticity(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """Efforts of springs and dampers alone: k (q - q₀) + damping · q̇.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].
        qd : array_like, shape (..., n)
            Velocities [rad/s or m/s].

        Returns
        -------
        ndarray, shape (..., n)
            [N m or N]

        Raises
        ------
        InvalidInputError, SingularModelError
            As `inertia_matrix`.
        """
        qd = self._check_joints("velocities", qd)
        state = self._closure_solver.state_at(q)
        with np.errstate(all="ignore"):
            efforts = state.projected(spring_force(self.robot, state.q, state.expand_rates(qd)))
        return broadcast_result(efforts, common_batch_shape(state.q, qd))

    def _attempt(self, model: str, *arguments: ArrayLike) -> Array | None:
        """Return the result of a model in machine code, None where it is not ready, does not fit, or is not valid.

        The arguments are not checked before: what does not fit takes the other way, which says what is wrong.
        """
        for attempt in self._attempts.get(model, ()):
            result: Array | None = attempt(*arguments)
            if result is not None:
                return result
        return None

    def _evaluate(
        self, model: str, arguments: Mapping[str, Array], recursion: Callable[[], Array], options: Mapping[str, object]
    ) -> Array:
        """Return the result of a model: here that of the recursion.

        arguments: checked arrays by name; options: `base` and `external_wrenches`, where the model takes them.
        """
        return recursion()

    def _state(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        base: Base | None,
        external_wrenches: ExternalWrenches | None = None,
        acting: Array | None = None,
        use_charts: bool = True,
    ) -> ModelState:
        """Return the ModelState of checked arguments.

        acting: accelerations or efforts (..., n) of its batch; use_charts: whether platforms may move in the charts of
        their attitudes.
        """
        state_of_base = base_state(self.robot, base)
        wrenches = link_wrenches(self.robot, external_wrenches)
        use_charts = use_charts and not virtual_links(self.robot) & {*wrenches}
        state = self._closure_solver.state_at(q, use_charts=use_charts)
        qd = self._check_joints("velocities", qd)
        batch = common_batch_shape(
            state.q,
            qd,
            acting,
            state_of_base.gravity,
            state_of_base.twist,
            state_of_base.acceleration,
            *wrenches.values(),
        )
        return ModelState(state, state.expand_rates(qd), state_of_base, wrenches, batch, self.joint_names)

    def _base_size(self) -> int:
        """Return the number of rows of the base in matrices of this robot."""
        return 6 if self.robot.moving_base else 0

    @staticmethod
    def _refuse_base_acceleration(base: Base | None) -> None:
        """Raise InvalidInputError where the state of the base has an acceleration."""
        if base is not None and base.acceleration is not None:
            raise InvalidInputError("the acceleration of the base has no part in this term: leave it out of Base")

    def _bias(self, state: ModelState, base: Base | None, twist: Array, acceleration: Array) -> Array:
        """Return bias efforts (..., n), or (..., 6 + n) with a moving base, of a twist and acceleration of the base."""
        self._refuse_base_acceleration(base)
        with np.errstate(all="ignore"):
            H = bias(state.robot, state.chart_q, state.qd, twist, acceleration, drift=state.drift)
            P = projection_matrix(state.constrained_state.G, self._base_size())
            return broadcast_result(apply_transposed(P, H), state.batch)
