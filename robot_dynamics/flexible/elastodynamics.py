"""How a robot vibrates about a pose at which its motors and brakes hold it: `Dynamics.elastodynamics`."""

import time
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_dynamics.codegen.jit.threads import run_in_threads
from robot_dynamics.errors import CompilationError, InvalidInputError
from robot_dynamics.flexible import eigenmodes
from robot_dynamics.flexible.jacobians import compute_node_kinematics
from robot_dynamics.flexible.matrices import Matrices, constrained_matrices, constrained_matrices_by_qr
from robot_dynamics.flexible.matrices_program import MatricesProgram
from robot_dynamics.flexible.structure import build_structure
from robot_dynamics.newton_euler.kinematics import link_placements

BATCH_SIZE = 20  # samples whose matrices are computed at once: as many as a cache has place for


@dataclass(frozen=True, eq=False)
class NaturalFrequencies:
    """How a robot vibrates.

    frequencies: (..., m) [Hz], ascending; zero of motions that nothing resists, inf of those that move no mass.
    mode_shapes: (..., m, g) of the generalized coordinates, of unit generalized mass; zero where the frequency is inf.
    coordinates: names of these g, `joint` [rad or m] or `link.element.component` [m or rad], how the end of an element
    has moved against its beginning, in its axes; or `body.component`, how a free body has moved, in its axes.
    """

    frequencies: np.ndarray
    mode_shapes: np.ndarray
    coordinates: tuple


class Elastodynamics:
    """Mass and stiffness of a Dynamics whose links bend; `Dynamics.elastodynamics` gives it.

    held: names of the joints that do not move, with those that follow them; left out: all that have a motor or a brake.
    planar: count only motion in the plane, of a robot whose joints all turn about parallel axes.

    coordinates: names of the generalized coordinates, as NaturalFrequencies has them. Poses are told by q, as Dynamics
    takes it, or where there is a platform by its pose (..., 4, 4). Raises QuestionError where something does not fit,
    SingularModelError where loops do not close.

    Small displacements from rest; gravity does not strain the beams. Source: Briot and Khalil.
    """

    def __init__(self, dynamics, held=None, planar=False):
        self._dynamics, self._robot = dynamics, dynamics.robot
        self.structure = build_structure(self._robot, held, planar)
        self.coordinates = self.structure.coordinates
        self._program = MatricesProgram(self.structure, self._robot)

    @property
    def operations(self):
        """The Operations of a call of the program of M and K. Raises QuestionError where there is none."""
        return self._program.program.operations

    def compile(self):
        """Compile the program of the matrices now; else it is done beside when they have been asked for some time.

        Raises CompilationError, and QuestionError where the loops leave no program.
        """
        self._program.compile()

    def compile_if_possible(self):
        """As `compile`, but where there is no program, or no compiler, things stay as they are."""
        try:
            self._program.compile()
        except (CompilationError, InvalidInputError):
            pass

    def positions(self, q=None, pose=None):
        """(..., all joints) positions of all joints at a q or at a pose of the platform."""
        if (q is None) == (pose is None):
            raise InvalidInputError("give q or the pose of the platform, one of the two")
        return self._dynamics.expand_positions(q) if pose is None else self._dynamics.platform.joint_positions(pose)

    def matrices(self, q=None, *, pose=None):
        """The Matrices at a pose: mass and stiffness (..., n, n) of independent coordinates, (expansion @ x) those of
        all. A batch has the same ones throughout, but where they are chosen by numbers: then it is refused."""
        q = self.positions(q, pose)
        found = self._closed(q)
        if found is None and q.ndim > 1:
            raise InvalidInputError("independent coordinates differ from pose to pose: ask for one at a time")
        return constrained_matrices_by_qr(self.structure, self._robot, q) if found is None else found

    def frequencies(self, q=None, *, pose=None, count=None, threads=1):
        """Natural frequencies (..., m) [Hz] alone, the first `count` or all; threads: how many share a batch."""
        _check_count(count)
        return self._each(self.positions(q, pose), eigenmodes.natural_frequencies, threads)[..., :count]

    def natural_frequencies(self, q=None, *, pose=None, count=None):
        """The NaturalFrequencies at a pose, the first `count` or all."""
        _check_count(count)
        q = self.positions(q, pose)
        samples = [self._modes(one, count) for one in q.reshape(-1, q.shape[-1])]
        found, shapes = (
            np.array(told).reshape(*q.shape[:-1], *np.shape(told[0])) for told in zip(*samples, strict=True)
        )
        return NaturalFrequencies(found, shapes, self.coordinates)

    def _modes(self, q, count):
        M, K, _, J = self.matrices(q)
        found, shapes = eigenmodes.modes(M, K)
        return found[:count], (shapes @ J.T)[:count]

    def node_positions(self, q, shape=None):
        """(nodes, 3) [m] where the nodes of the structure are, in frame 0, and (nodes, 3) [m], where a mode shape (g,)
        takes them from there. q: (all joints,)."""
        placements = link_placements(self._robot, q)
        motion, structure = compute_node_kinematics(self.structure, q), self.structure
        rests, moves = [], []
        for node, jacobian in zip(structure.nodes, motion.end_jacobians, strict=True):
            R, P = placements[node.link]
            rests.append(P + R @ node.placement_in_link[:3, 3])
            twist = (
                shape[list(jacobian.numbers)] @ jacobian.rows[:, :3] if shape is not None and jacobian.numbers else 0
            )
            moves.append(R @ node.placement_in_link[:3, :3] @ (twist + np.zeros(3)))
        return np.array(rests), np.array(moves)

    @cached_property
    def segments(self):
        """(node, node) pairs between which the robot is drawn: elements and rigid arms, but none through the ground."""
        ends = ((node.parent, number) for number, node in enumerate(self.structure.nodes) if node.parent is not None)
        return tuple((begin, end) for begin, end in ends if self.structure.nodes[begin].link > 0)

    def _closed(self, q):
        """The Matrices, by the program where it is ready; None where the loops leave no element to each."""
        if self._program.compiled_matrices is not None:
            M, K, J, independent = self._program.compiled_matrices(q)
            return Matrices(M, K, independent, J)
        started = time.perf_counter()
        found = constrained_matrices(self.structure, self._robot, q)
        self._program.record_duration(time.perf_counter() - started)
        return found

    def _each(self, q, solve, threads):
        """(..., m) of a function of (mass, stiffness) of each sample."""
        samples = q.reshape(-1, q.shape[-1])
        found, following = [None] * len(samples), iter(range(0, len(samples), BATCH_SIZE))

        def work():
            for first in following:
                for number, matrices in enumerate(self._systems(samples[first : first + BATCH_SIZE]), start=first):
                    found[number] = solve(*matrices)

        run_in_threads(work, min(threads, -(-len(samples) // BATCH_SIZE)))
        return np.array(found).reshape(*q.shape[:-1], -1)

    def _systems(self, samples):
        """(mass, stiffness) of each of some samples (N, all joints)."""
        together = self._closed(samples)
        if together is None:
            return [constrained_matrices_by_qr(self.structure, self._robot, one)[:2] for one in samples]
        return zip(together.mass, together.stiffness, strict=True)


def _check_count(count):
    if count is not None and (not isinstance(count, int | np.integer) or count < 1):
        raise InvalidInputError(f"count is {count!r}: a number of modes, 1 or more, is needed")
