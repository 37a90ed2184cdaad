"""Centre of mass, momentum and energy of all bodies of a robot together."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.array_checks import broadcast_result
from robot_dynamics.constraints.constrained_state import projection_matrix
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.inputs import base_state, common_batch_shape
from robot_dynamics.joint_space.frame_kinematics import concatenated_rates, products, screws_in_world
from robot_dynamics.newton_euler import centroid
from robot_dynamics.newton_euler.joint_springs import spring_energy
from robot_dynamics.newton_euler.screw import apply, dot

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.inputs import Base
    from robot_dynamics.joint_space.dynamics_terms import DynamicsTerms
    from robot_dynamics.model.robot import Robot


class WholeBody:
    """Centre of mass, momentum and energy of a robot. `Dynamics.whole_body` makes it.

    All bodies that can move count, platforms and legs too; a fixed base does not. Vectors are in the axes of the world,
    which is frame 0 where the base is fixed. Momenta are [linear; angular], angular about the centre of mass. Rotors
    have kinetic energy; the models give them no other momentum.

    Columns of matrices belong to the independent joints, `Dynamics.joint_names`; with a moving base the six columns of
    its twist, which is expressed in frame 0, come first:

        momentum = A [base twist; q̇],   derivative of the momentum = A [base acceleration; q̈] + bias

    Methods take one sample or a batch, and raise the errors of `Dynamics`. They change to compiled programs after some
    time of use, as those of `Dynamics` do.

    Attributes
    ----------
    mass : float
        Mass of all bodies that can move [kg].
    """

    def __init__(self, dynamics: DynamicsTerms) -> None:
        self._dynamics = dynamics
        self.mass = float(centroid.moving_mass(dynamics.robot))

    def __repr__(self) -> str:
        return f"WholeBody({self._dynamics!r})"

    def centre_of_mass(self, q: ArrayLike, *, base: Base | None = None) -> Array:
        """Centre of mass in the world.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].
        base : Base, optional
            State of the base, for a robot with a moving base only.

        Returns
        -------
        ndarray, shape (..., 3)
            [m]

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot, or no body that can move has a mass.
        SingularModelError
            The loops do not close or are singular.
        """
        self._require_mass()
        result = self._dynamics._attempt("centre_of_mass", q)
        if result is None:
            q = self._dynamics._check_positions(q)

            def recursion() -> Array:
                closed = self._dynamics._closure_solver.close_loops(q)
                with np.errstate(all="ignore"):
                    return broadcast_result(centroid.centre_of_mass(self._robot, closed), np.shape(q)[:-1])

            result = self._dynamics._evaluate("centre_of_mass", {"q": q}, recursion, {})
        if base is None and not self._robot.moving_base:
            return result
        pose = base_state(self._robot, base).pose
        batch = common_batch_shape(result, pose[..., 0, :])
        with np.errstate(all="ignore"):
            return broadcast_result(apply(pose[..., :3, :3], result) + pose[..., :3, 3], batch)

    def centre_of_mass_velocity(self, q: ArrayLike, qd: ArrayLike, *, base: Base | None = None) -> Array:
        """Velocity of the centre of mass.

        Parameters
        ----------
        q, qd, base
            As `centroidal_momentum`.

        Returns
        -------
        ndarray, shape (..., 3)
            [m/s]

        Raises
        ------
        InvalidInputError, SingularModelError
            As `centre_of_mass`.
        """
        return self._per_mass(self.centroidal_momentum(q, qd, base=base)[..., :3])

    def centre_of_mass_jacobian(self, q: ArrayLike, *, base: Base | None = None) -> Array:
        """Jacobian of the velocity of the centre of mass.

        Parameters
        ----------
        q, base
            As `centre_of_mass`.

        Returns
        -------
        ndarray, shape (..., 3, n)
            With a moving base (..., 3, 6 + n), the base first.

        Raises
        ------
        InvalidInputError, SingularModelError
            As `centre_of_mass`.
        """
        return self._per_mass(self.centroidal_momentum_matrix(q, base=base)[..., :3, :])

    def centroidal_momentum(self, q: ArrayLike, qd: ArrayLike, *, base: Base | None = None) -> Array:
        """Momentum of all bodies, angular about the centre of mass.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].
        qd : array_like, shape (..., n)
            Velocities [rad/s or m/s].
        base : Base, optional
            State of the base, for a robot with a moving base only.

        Returns
        -------
        ndarray, shape (..., 6)
            Linear [kg m/s], then angular momentum [kg m²/s].

        Raises
        ------
        InvalidInputError, SingularModelError
            As `centre_of_mass`.
        """
        rates = concatenated_rates(self._dynamics, qd, base)
        return products(self.centroidal_momentum_matrix(q, base=base), rates)

    def centroidal_momentum_matrix(self, q: ArrayLike, *, base: Base | None = None) -> Array:
        """Matrix that gives `centroidal_momentum` from the twist of the base and the joint velocities.

        Parameters
        ----------
        q, base
            As `centre_of_mass`.

        Returns
        -------
        ndarray, shape (..., 6, n)
            Rows: linear, then angular momentum. With a moving base (..., 6, 6 + n), the base first.

        Raises
        ------
        InvalidInputError, SingularModelError
            As `centre_of_mass`.

        Notes
        -----
        Source: Orin, Goswami and Lee, Centroidal dynamics of a humanoid robot (2013); in loops times G (Khalil,
        section 4).
        """
        self._require_mass()
        matrix = self._dynamics._attempt("centroidal_momentum_matrix", q)
        if matrix is None:
            q = self._dynamics._check_positions(q)

            def recursion() -> Array:
                state = self._dynamics._closure_solver.state_at(q)
                P = projection_matrix(state.G, self._dynamics._base_size())
                with np.errstate(all="ignore"):
                    matrix = centroid.centroidal_momentum_matrix(state.robot, state.chart_q) @ P
                    return broadcast_result(matrix, np.shape(q)[:-1], axes=2)

            matrix = self._dynamics._evaluate("centroidal_momentum_matrix", {"q": q}, recursion, {})
        return self._in_world(matrix, base)

    def centroidal_momentum_bias(self, q: ArrayLike, qd: ArrayLike, *, base: Base | None = None) -> Array:
        """Derivative of `centroidal_momentum` by time where neither joints nor base accelerate: Ȧ [base twist; q̇].

        Parameters
        ----------
        q, qd
            As `centroidal_momentum`.
        base : Base, optional
            State of the base without acceleration, for a robot with a moving base only.

        Returns
        -------
        ndarray, shape (..., 6)
            Force [N], then torque about the centre of mass [N m].

        Raises
        ------
        InvalidInputError, SingularModelError
            As `centre_of_mass`.
        """
        self._require_mass()
        dynamics = self._dynamics
        dynamics._refuse_base_acceleration(base)
        bias = dynamics._attempt("centroidal_momentum_bias", q, qd) if base is None else None
        if bias is None:
            q = dynamics._check_positions(q)

            def recursion() -> Array:
                state = dynamics._state(q, qd, base)
                with np.errstate(all="ignore"):
                    bias = centroid.centroidal_momentum_bias(
                        state.robot, state.chart_q, state.qd, state.base.twist, state.drift
                    )
                return broadcast_result(bias, state.batch)

            arguments = {"q": q, "qd": dynamics._check_joints("velocities", qd)}
            bias = dynamics._evaluate("centroidal_momentum_bias", arguments, recursion, {"base": base})
        return self._in_world(bias[..., None], base)[..., 0]

    def kinetic_energy(self, q: ArrayLike, qd: ArrayLike, *, base: Base | None = None) -> Array:
        """Kinetic energy of bodies and rotors.

        Parameters
        ----------
        q, qd, base
            As `centroidal_momentum`.

        Returns
        -------
        ndarray, shape (...)
            [J]

        Raises
        ------
        InvalidInputError, SingularModelError
            As `Dynamics.inertia_matrix`.
        """
        dynamics = self._dynamics
        energy = dynamics._attempt("kinetic_energy", q, qd) if base is None else None
        if energy is None:
            q = dynamics._check_positions(q)

            def recursion() -> Array:
                state = dynamics._state(q, qd, base)
                with np.errstate(all="ignore"):
                    energy = centroid.kinetic_energy(state.robot, state.chart_q, state.qd, state.base.twist)
                return broadcast_result(energy, state.batch)

            arguments = {"q": q, "qd": dynamics._check_joints("velocities", qd)}
            energy = dynamics._evaluate("kinetic_energy", arguments, recursion, {"base": base})
        return energy[..., 0]

    def gravitational_energy(self, q: ArrayLike, *, base: Base | None = None) -> Array:
        """Potential energy of the weights; zero where the centre of mass is at the origin of the world.

        Parameters
        ----------
        q, base
            As `centre_of_mass`.

        Returns
        -------
        ndarray, shape (...)
            [J]

        Raises
        ------
        InvalidInputError, SingularModelError
            As `Dynamics.inertia_matrix`.
        """
        if not self.mass:
            state = self._dynamics._state(q, np.zeros(len(self._dynamics.joint_names)), base)
            return np.zeros(state.batch)
        centre = self.centre_of_mass(q, base=base)
        with np.errstate(all="ignore"):
            return broadcast_result(-self.mass * dot(self._robot.gravity, centre)[..., 0], centre.shape[:-1], axes=0)

    def elastic_energy(self, q: ArrayLike) -> Array:
        """Potential energy of the springs at joints, dependent joints included: the sum of k (q - rest)² / 2.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].

        Returns
        -------
        ndarray, shape (...)
            [J]

        Raises
        ------
        InvalidInputError, SingularModelError
            As `Dynamics.inertia_matrix`.
        """
        with np.errstate(all="ignore"):
            energy = spring_energy(self._robot, self._dynamics.expand_positions(q))
        return broadcast_result(energy, energy.shape, axes=0)

    @property
    def _robot(self) -> Robot:
        return self._dynamics.robot

    def _per_mass(self, values: Array) -> Array:
        with np.errstate(all="ignore"):
            return broadcast_result(values / self.mass, values.shape, axes=0)

    def _require_mass(self) -> None:
        if not self.mass:
            raise InvalidInputError(
                f"{self._robot.name!r} has no mass that can move, and so no centre of mass: give its links masses"
            )

    def _in_world(self, rows: Array, base: Base | None) -> Array:
        """Momenta (..., 6, k), given in the axes of frame 0, in those of the world."""
        if base is None and not self._robot.moving_base:
            return rows
        return screws_in_world(rows, base_state(self._robot, base).pose)
