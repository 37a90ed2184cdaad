"""Natural frequencies and modes of a robot about a pose at which its motors and brakes hold it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from robot_dynamics.codegen.jit.threads import run_in_threads
from robot_dynamics.errors import CompilationError, InvalidInputError
from robot_dynamics.flexible import eigenmodes
from robot_dynamics.flexible.jacobians import compute_node_kinematics
from robot_dynamics.flexible.matrices import Matrices, constrained_matrices, constrained_matrices_by_qr
from robot_dynamics.flexible.matrices_program import MatricesProgram
from robot_dynamics.flexible.structure_builder import build_structure
from robot_dynamics.newton_euler.kinematics import link_placements
from robot_dynamics.notebook_display import notebook_html

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.codegen.trace.program import OperationCount
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.parallel.platform_dynamics import PlatformDynamics

BATCH_SIZE = 20  # samples whose matrices are computed at once: as many as fit the processor cache


@dataclass(frozen=True, eq=False)
class NaturalFrequencies:
    """Natural frequencies and mode shapes of a robot.

    Attributes
    ----------
    frequencies : (..., m)
        [Hz], ascending; zero for motions without stiffness, inf for motions without mass.
    mode_shapes : (..., m, g)
        Shapes in the g generalized coordinates, of unit generalized mass; zero where the frequency is inf.
    coordinates : tuple of str
        Names of the g coordinates: `joint` [rad or m]; `link.element.component` [m or rad], displacement of the end of
        an element relative to its start, in its axes; `body.component`, displacement of a free body, in its axes.
    """

    _repr_html_ = notebook_html

    frequencies: Array
    mode_shapes: Array
    coordinates: tuple[str, ...]


class RobotGeometry(Protocol):
    """What `Elastodynamics` takes of a `Dynamics`: the robot, and the positions of all its joints."""

    robot: Robot

    def expand_positions(self, q: ArrayLike) -> Array:
        """Positions of all joints from those of the independent ones."""

    @property
    def platform(self) -> PlatformDynamics:
        """The models in coordinates of the platform."""


class Elastodynamics:
    """Mass and stiffness matrices, natural frequencies and modes of a robot; `Dynamics.elastodynamics` constructs it.

    Parameters
    ----------
    dynamics : Dynamics
        Of a robot with flexible links or elastic joints.
    held : iterable of str, optional
        Names of the joints that do not move, with the joints that follow them. Default: joints with a motor or a brake.
    planar : bool, default False
        Count only motion in the plane, for a robot whose joints all turn about parallel axes.

    Attributes
    ----------
    robot : Robot
        The robot.
    coordinates : tuple of str
        Names of the g generalized coordinates, as in `NaturalFrequencies`.
    structure : Structure
        The virtual tree of elements (internal).

    Raises
    ------
    InvalidInputError
        A joint is unknown, or the robot does not move in the plane.

    Notes
    -----
    Methods take a pose either as `q`, positions as for Dynamics, or as `pose`, the pose (..., 4, 4) of the platform.
    They raise InvalidInputError for an argument that does not fit, and SingularModelError where loops do not close.

    Displacements are small, from rest; gravity does not strain the beams. Source: Briot and Khalil.
    """

    def __init__(self, dynamics: RobotGeometry, held: Iterable[str] | None = None, planar: bool = False) -> None:
        self._dynamics = dynamics
        self.robot = dynamics.robot
        self.structure = build_structure(self.robot, held, planar)
        self.coordinates: tuple[str, ...] = self.structure.coordinates
        self._program = MatricesProgram(self.structure, self.robot)

    @property
    def operations(self) -> OperationCount:
        """Operation count of the program of M and K. Raises InvalidInputError where there is none."""
        return self._program.program.operations

    def compile(self) -> None:
        """Compile the program of the matrices now instead of in the background after some time of use.

        Raises
        ------
        CompilationError
            No compiler is available.
        InvalidInputError
            The loops leave no program.
        """
        self._program.compile()

    def compile_if_possible(self) -> None:
        """Compile as `compile`; do nothing where there is no program or no compiler."""
        try:
            self._program.compile()
        except (CompilationError, InvalidInputError):
            pass

    def positions(self, q: ArrayLike | None = None, pose: ArrayLike | None = None) -> Array:
        """Return positions of all joints at a pose.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].
        pose : array_like, shape (..., 4, 4)
            Pose of the platform: exactly one of the two.

        Returns
        -------
        ndarray, shape (..., all joints)

        Raises
        ------
        InvalidInputError, SingularModelError
            As `Dynamics.expand_positions`.
        """
        if q is not None and pose is None:
            return self._dynamics.expand_positions(q)
        if q is None and pose is not None:
            return self._dynamics.platform.joint_positions(pose)
        raise InvalidInputError("give q or the pose of the platform, one of the two")

    def matrices(self, q: ArrayLike | None = None, *, pose: ArrayLike | None = None) -> Matrices:
        """Return mass and stiffness matrices of independent coordinates.

        Parameters
        ----------
        q, pose
            As `positions`.

        Returns
        -------
        Matrices
            `mass`, `stiffness` (..., n, n); `independent`, numbers of the n coordinates; `expansion` (..., g, n), to
            all coordinates.

        Raises
        ------
        InvalidInputError
            The independent coordinates of a batch differ from pose to pose.
        """
        positions = self.positions(q, pose)
        matrices = self._matrices_by_elimination(positions)
        if matrices is not None:
            return matrices
        if positions.ndim > 1:
            raise InvalidInputError("independent coordinates differ from pose to pose: give one pose at a time")
        return constrained_matrices_by_qr(self.structure, self.robot, positions)

    def frequencies(
        self,
        q: ArrayLike | None = None,
        *,
        pose: ArrayLike | None = None,
        count: int | None = None,
        threads: int = 1,
    ) -> Array:
        """Return natural frequencies without mode shapes.

        Parameters
        ----------
        q, pose
            As `positions`.
        count : int, optional
            Number of frequencies. Default: all.
        threads : int
            Number of threads that share a batch.

        Returns
        -------
        ndarray, shape (..., m)
            [Hz], as in `NaturalFrequencies`.

        Raises
        ------
        SingularModelError
            Loops do not close, or some motion has neither mass nor stiffness.
        """
        _check_count(count)
        positions = self.positions(q, pose)
        return self._map_samples(positions, eigenmodes.natural_frequencies, threads)[..., :count]

    def natural_frequencies(
        self, q: ArrayLike | None = None, *, pose: ArrayLike | None = None, count: int | None = None
    ) -> NaturalFrequencies:
        """Return natural frequencies and mode shapes.

        Parameters
        ----------
        q, pose, count
            As `frequencies`.

        Returns
        -------
        NaturalFrequencies

        Raises
        ------
        SingularModelError
            As `frequencies`.
        """
        _check_count(count)
        positions = self.positions(q, pose)
        batch = positions.shape[:-1]
        samples = [self._modes(sample, count) for sample in positions.reshape(-1, positions.shape[-1])]
        frequencies, shapes = (
            np.array(values).reshape(*batch, *np.shape(values[0])) for values in zip(*samples, strict=True)
        )
        return NaturalFrequencies(frequencies, shapes, self.coordinates)

    def _modes(self, q: Array, count: int | None) -> tuple[Array, Array]:
        """Return frequencies (m,) and shapes (m, g) at positions q (all joints,)."""
        matrices = self.matrices(q)
        frequencies, shapes = eigenmodes.modes(matrices.mass, matrices.stiffness)
        return frequencies[:count], (shapes @ matrices.expansion.T)[:count]

    def node_positions(self, q: Array, mode_shape: Array | None = None) -> tuple[Array, Array]:
        """Return positions of the nodes of the structure, and their displacements in a mode.

        Parameters
        ----------
        q : ndarray, shape (all joints,)
            Positions as `positions` returns them [rad or m].
        mode_shape : ndarray, shape (g,), optional
            A row of `NaturalFrequencies.mode_shapes`. Default: zero.

        Returns
        -------
        positions, displacements : ndarray, shape (nodes, 3)
            [m], in frame 0.
        """
        placements = link_placements(self.robot, q)
        kinematics = compute_node_kinematics(self.structure, q)
        positions = []
        displacements = []
        for node, jacobian in zip(self.structure.nodes, kinematics.end_jacobians, strict=True):
            R, P = placements[node.link]
            displacement = np.zeros(3)
            if mode_shape is not None and jacobian.numbers:
                displacement = displacement + mode_shape[list(jacobian.numbers)] @ jacobian.rows[:, :3]
            positions.append(P + R @ node.placement_in_link[:3, 3])
            displacements.append(R @ node.placement_in_link[:3, :3] @ displacement)
        return np.array(positions), np.array(displacements)

    @cached_property
    def segments(self) -> tuple[tuple[int, int], ...]:
        """Pairs of nodes to connect in a picture: elements and rigid arms, without segments through the ground."""
        ends = ((node.parent, number) for number, node in enumerate(self.structure.nodes))
        return tuple((start, end) for start, end in ends if start is not None and self.structure.nodes[start].link > 0)

    def _matrices_by_elimination(self, q: Array) -> Matrices | None:
        """Return the Matrices, by the program where it is ready; None where no elements can be eliminated."""
        if self._program.compiled_matrices is not None:
            M, K, J, independent = self._program.compiled_matrices(q)
            return Matrices(M, K, independent, J)
        start = time.perf_counter()
        matrices = constrained_matrices(self.structure, self.robot, q)
        self._program.record_duration(time.perf_counter() - start)
        return matrices

    def _map_samples(self, q: Array, function: Callable[[Array, Array], Array], threads: int) -> Array:
        """Return (..., m): a function of mass and stiffness at each sample of q (..., all joints)."""
        samples = q.reshape(-1, q.shape[-1])
        results: list[Array | None] = [None] * len(samples)
        batches = iter(range(0, len(samples), BATCH_SIZE))

        def work() -> None:
            for first in batches:
                systems = self._systems(samples[first : first + BATCH_SIZE])
                for number, (mass, stiffness) in enumerate(systems, start=first):
                    results[number] = function(mass, stiffness)

        run_in_threads(work, min(threads, -(-len(samples) // BATCH_SIZE)))
        return np.array(results).reshape(*q.shape[:-1], -1)

    def _systems(self, samples: Array) -> Iterable[tuple[Array, Array]]:
        """Return mass and stiffness of each of some samples (N, all joints)."""
        matrices = self._matrices_by_elimination(samples)
        if matrices is not None:
            return zip(matrices.mass, matrices.stiffness, strict=True)
        by_qr = [constrained_matrices_by_qr(self.structure, self.robot, sample) for sample in samples]
        return [(matrices.mass, matrices.stiffness) for matrices in by_qr]


def _check_count(count: int | None) -> None:
    if count is not None and (not isinstance(count, int | np.integer) or count < 1):
        raise InvalidInputError(f"count is {count!r}: a number of modes, 1 or more, is needed")
