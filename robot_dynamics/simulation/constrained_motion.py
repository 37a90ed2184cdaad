"""Independent coordinates of closed loops during a simulation, and motion at singular positions of the loops.

The positions of all joints are integrated together, and after each step the dependent ones are put back on the
constraints (Newton's method, from where the integration has led them): so a mechanism stays on its branch where two
assembly modes meet. The independent coordinates are chosen by pivoting, and chosen anew where the loops no longer
determine the others well: so a mechanism passes a dead point of its motor. Source: Wehage and Haug, Generalized
coordinate partitioning for dimension reduction in analysis of constrained dynamic systems, Journal of Mechanical
Design 104 (1982).

Where branches cross, as in a flat parallelogram, the constraint Jacobian loses rank whatever the coordinates. On its
own branch the motion is smooth there all the same. What a model gives at such a point is interpolated between points of
the branch on both sides of it.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics.constraints import attitude_angles, attitude_charts
from robot_dynamics.constraints.branch_tracker import BranchTracker
from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.constraints.mobility import find_widest_loop
from robot_dynamics.constraints.newton_iteration import NEWTON_TOLERANCE
from robot_dynamics.constraints.state import charted_state_at
from robot_dynamics.constraints.topology import build_topology
from robot_dynamics.errors import SingularModelError
from robot_dynamics.simulation.rotation import rotation_vector_rate

NEAR_SINGULAR_QUALITY = 1e-2
"""Quality of loops below which each stage of a step is put on the constraints."""
SINGULAR_QUALITY = 1e-6
"""Quality of loops below which values are interpolated."""
UNDETERMINED_QUALITY = 1e-9
"""Quality of loops below which rounding leaves no direction of the tangent."""
DEGRADATION_RATIO = 0.1
"""Part of its best quality since it was chosen below which a set of coordinates is compared with others."""
IMPROVEMENT_RATIO = 2.0
"""Factor by which the quality of another set must be better to be chosen."""
OFFSETS, WEIGHTS = (1, 2, 3), (15 / 20, -6 / 20, 1 / 20)
"""Interpolation at 0 between equidistant points on both sides, exact for polynomials of degree 5."""
NEIGHBOUR_DISTANCES = tuple(0.004 * 1.5**k for k in range(9))
"""Distances of neighbours that are tried, the shortest first [rad or characteristic lengths]."""
LATERAL_TOLERANCE = 0.1
"""Part of the distance by which a neighbour may lie beside the end that was predicted."""
MAX_TRAVEL_NEAR_SINGULAR = 0.02
"""Longest travel of a joint in a sub-step near a singular position [rad or characteristic lengths]."""
MAX_TRAVEL = 0.1
"""Longest travel of a joint of loops in a part of a step elsewhere."""
TIGHT_CLOSURE_TOLERANCE = 3e-16
"""Residual [characteristic lengths, rad] wanted near a singular position: the tangent there is as good as the residual
divided by the square of the distance."""
MAX_CORRECTION = 5e-3
"""Distance by which positions may have to be corrected after a part of a step [rad or characteristic lengths]."""
REST_VELOCITY = 1e-12
"""Velocity [rad/s or characteristic lengths/s] below which no direction of motion is known."""


class LoopCoordinates(NamedTuple):
    """Which joints of closed loops are the independent coordinates.

    Attributes
    ----------
    independent : tuple of int
        Numbers of the joints whose velocities are integrated.
    best : float
        Best quality since they were chosen.
    quality : float
        How well the loops determine the other joints at the present positions: the least squared sine between a column
        of the constraint Jacobian and those before it, 0 where the other joints are not determined.
    """

    independent: tuple[int, ...]
    best_quality: float
    quality: float


class LocalAttitudeChart(NamedTuple):
    """The attitude of a platform as a rotation from where a part of a step begins: near pitch ±90° its angles are no
    coordinates.

    Attributes
    ----------
    joints : list of int
        Numbers of the joints of yaw, pitch and roll, in the place of which the rotation vector [rad] is integrated.
    angles : ndarray, shape (3,)
        Yaw, pitch and roll [rad] where the part begins.
    """

    joints: list[int]
    angles: np.ndarray


class ConstrainedMotion:
    """Positions and velocities of all joints of a robot with loops, from those of changing independent coordinates.

    Parameters
    ----------
    dynamics : Dynamics
        Of the robot, which must have loops.
    """

    def __init__(self, dynamics):
        self._dynamics, self._coupling = dynamics, build_topology(dynamics.robot)
        self._partitions = {}  # Coupling and program of the closure by independent joints
        self.default_independent = tuple(self._coupling.independent)
        self.joint_units = self._coupling.joint_units
        self._looped = sorted(dynamics.robot.joints_in_loops)

    def default_coordinates(self, q):
        """LoopCoordinates of Dynamics.joint_names at positions q (all joints,) that close the loops."""
        quality = self._quality(self.default_independent, q)
        return LoopCoordinates(self.default_independent, quality, quality)

    def choose_coordinates(self, coordinates, q):
        """The LoopCoordinates for positions q (all joints,), other ones where the present ones have become worse."""
        independent, best_quality, quality = coordinates
        if quality >= DEGRADATION_RATIO * best_quality:
            return LoopCoordinates(independent, max(best_quality, quality), quality)
        pivoted = self._coupling.select_independent(q)
        reached = self._quality(pivoted, q)
        if reached > IMPROVEMENT_RATIO * quality:
            return LoopCoordinates(pivoted, reached, reached)
        return LoopCoordinates(independent, quality, quality)

    def close_loops(self, coordinates, q, tolerance=NEWTON_TOLERANCE):
        """Put positions on the constraints; the independent joints stay where they are.

        Parameters
        ----------
        coordinates : LoopCoordinates
        q : ndarray, shape (all joints,)
            Positions predicted by the integration.
        tolerance : float
            Residual at which Newton's method ends.

        Returns
        -------
        q : ndarray, shape (all joints,)
        quality : float

        Raises
        ------
        SingularModelError
            The loops do not close near q.
        """
        partition, step = self._partition(coordinates.independent)
        found = BranchTracker(partition, step).project_onto_constraints(self._free(q)[None], tolerance)
        if not found.is_closed[0]:
            self._refuse(q, "do not close near the positions that the integration leads to")
        return self._all(found.t[0]), float(found.quality[0])

    def close_on_branch(self, coordinates, q, velocities):
        """(positions on the constraints next to q, quality) after a part of a step, on the branch that led there.

        Parameters
        ----------
        coordinates : LoopCoordinates
            With the quality before the part of the step.
        q : ndarray, shape (all joints,)
            Positions predicted by the integration.
        velocities : ndarray, shape (all joints,)
            Direction of motion.

        Raises
        ------
        SingularModelError
            The loops do not close near q, or only on another branch.
        """
        if coordinates.quality < NEAR_SINGULAR_QUALITY and self.quality(coordinates, q) < SINGULAR_QUALITY:
            neighbours = self.neighbours(coordinates, q, velocities)
            closed = interpolate(lambda q: [q], neighbours)[0]
            return closed, self.quality(coordinates, closed)
        closed, quality = self.close_loops(
            coordinates, q, TIGHT_CLOSURE_TOLERANCE if coordinates.quality < NEAR_SINGULAR_QUALITY else NEWTON_TOLERANCE
        )
        if np.abs(self._between(q, closed) / self.joint_units[self._coupling.non_mimic_joints]).max() > MAX_CORRECTION:
            self._refuse(q, "close only beside the branch that the integration leads along")
        return closed, quality

    def limit_substep(self, part, shortest, coordinates, q, velocities):
        """A part of a step [s], halved until no joint of the loops travels too far in it, down to `shortest` [s]."""
        travel = MAX_TRAVEL_NEAR_SINGULAR if coordinates.quality < NEAR_SINGULAR_QUALITY else MAX_TRAVEL
        rates = attitude_charts.chart_rates(q, velocities, *self._charts)
        speed = np.abs(rates / self.joint_units)[self._looped].max()
        while part * speed > travel and part > shortest:
            part /= 2
        return part

    def quality(self, coordinates, q):
        """Quality of the coordinates at positions q (all joints,) near the constraints."""
        _, step = self._partition(coordinates.independent)
        _, _, pivots, lengths, _ = step(self._free(q))
        return float((pivots / lengths).min())

    def neighbours(self, coordinates, q, velocities):
        """Positions on the branch on both sides of a singular position, and their weights in the interpolation.

        Parameters
        ----------
        coordinates : LoopCoordinates
        q : ndarray, shape (all joints,)
            Positions near the constraints.
        velocities : ndarray, shape (all joints,)
            Velocities of all joints near q: the direction of the branch.

        Returns
        -------
        list of (float, ndarray)

        Raises
        ------
        SingularModelError
            The mechanism is at rest, so that nothing determines its branch; or the branch turns or ends here.
        """
        rates = self._direction(coordinates, q, velocities)
        speed = np.abs(rates / self.joint_units)[self._looped].max()
        for distance in NEIGHBOUR_DISTANCES:
            sides = [self._side(coordinates, q, sign * distance / speed * rates) for sign in (1, -1)]
            if None not in sides:
                return [(weight, side[k]) for k, weight in enumerate(WEIGHTS) for side in sides]
        self._refuse(q, "are singular all along the direction of motion, or on a branch that turns sharply")

    def _direction(self, coordinates, q, velocities):
        """Rates (all joints,) along the branch at q (all joints,), in the charts of platforms: those of velocities (all
        joints,); at rest those of the tangent, where it is determined."""
        rates = attitude_charts.chart_rates(q, velocities, *self._charts)
        if np.abs(rates / self.joint_units)[self._looped].max() > REST_VELOCITY:
            return rates
        if self.quality(coordinates, q) < UNDETERMINED_QUALITY:
            self._refuse(q, "can move on in more than one way from here, and they are at rest: no direction of motion "
                            "determines the branch")  # fmt: skip
        return self.constrained_state(coordinates, q).expand_rates(np.ones(len(coordinates.independent)))

    def _side(self, coordinates, q, stride):
        """Positions on the branch at OFFSETS times the stride (all joints,) from q, None where they are not regular."""
        placed, way = [q], self._free(stride)
        for _ in OFFSETS:
            predicted = self._all(self._moved(self._free(placed[-1]), way))
            try:
                closed, quality = self.close_loops(coordinates, predicted, TIGHT_CLOSURE_TOLERANCE)
            except SingularModelError:
                return None
            beside = self._between(predicted, closed)
            if quality < SINGULAR_QUALITY or np.abs(beside).max() > LATERAL_TOLERANCE * np.abs(stride).max():
                return None
            way = self._between(placed[-1], closed)
            placed.append(closed)
        return placed[1:]

    def _moved(self, t, way):
        return attitude_charts.displace(t, way, self._coupling.attitudes)

    def _between(self, begin, end):
        """The way (m,) of the joints that follow no other one between positions (all joints,)."""
        return attitude_charts.displacement(self._free(begin), self._free(end), self._coupling.attitudes)

    def _partition(self, independent):
        """(Coupling, function that gives Newton's steps) of independent joints."""
        if independent not in self._partitions:
            partition = self._coupling.with_independent(independent)
            program = self._dynamics.compile("closure", independent=independent)
            self._partitions[independent] = partition, program.evaluate
        return self._partitions[independent]

    def constrained_state(self, coordinates, q):
        """The Configuration at positions q (all joints,), its independent joints those of the coordinates."""
        return charted_state_at(self._partition(coordinates.independent)[0], q)

    def joint_velocities(self, q, rates):
        """Velocities (all joints,) of the joints, from rates (all joints,) in the charts of platforms at q."""
        return attitude_charts.joint_velocities(q, rates, *self._charts)

    def local_charts(self, q):
        """SteepAttitudes of the platforms whose pitch is steep at positions q (all joints,)."""
        return [
            LocalAttitudeChart(list(one.joints), self._angles(q, one.joints))
            for one in self._coupling.attitudes
            if abs(attitude_charts.pitch_sine_cosine(q, one, self._coupling.offset)[1])
            < attitude_charts.STEEP_PITCH_COSINE
        ]

    def integration_variables(self, q, local_charts):
        """What is integrated in the place of positions q (all joints,) where a part of a step begins."""
        if not local_charts:
            return q
        q = q.copy()
        for one in local_charts:
            q[one.joints] = 0.0
        return q

    def positions(self, x, local_charts):
        """Positions (all joints,) from what is integrated."""
        if not local_charts:
            return x
        q = x.copy()
        for joints, angles in local_charts:
            R = attitude_angles.rotation_from_angles(angles) @ Rotation.from_rotvec(x[joints]).as_matrix()
            q[joints] = attitude_angles.nearest_angles(R, angles) + self._coupling.offset[joints]
        return q

    def derivative(self, x, q, rates, local_charts):
        """dx/dt of what is integrated, at positions q and rates (all joints,) in the charts of platforms."""
        if not self._coupling.attitudes:
            return rates
        found = self.joint_velocities(q, rates)
        for joints, _ in local_charts:
            roll = self._angles(q, joints)[2]
            omega = attitude_angles.axis_rotation(0, roll).T @ rates[joints][::-1]  # in the axes of the platform
            found[joints] = rotation_vector_rate(x[joints], omega)
        return found

    def _angles(self, q, joints):
        return q[[*joints]] - self._coupling.offset[[*joints]]

    @property
    def _charts(self):
        return self._coupling.attitudes, self._coupling.offset

    def _quality(self, independent, q):
        return self.quality(LoopCoordinates(independent, 1.0, 1.0), q)

    def _free(self, q):
        """Positions of the joints that follow no other one."""
        return np.ascontiguousarray(q[self._coupling.non_mimic_joints])

    def _all(self, t):
        return self._coupling.S @ t + self._coupling.offset

    def _refuse(self, q, what):
        robot = self._dynamics.robot
        loop, _, _ = find_widest_loop(robot, loop_equations(robot, q).residual)
        names = self._dynamics.all_joint_names
        positions = ", ".join(f"{name} {value:.6g}" for name, value in zip(names, q, strict=True))
        raise SingularModelError(f"loop {loop!r} is singular: the loops {what} (at {positions})")


def interpolate(evaluate, neighbours):
    """Weighted sum of the arrays that evaluate(q) gives at neighbours, as `ConstrainedMotion.neighbours` gives them."""
    sums = None
    for weight, q in neighbours:
        terms = [weight * value for value in evaluate(q)]
        sums = terms if sums is None else [total + term for total, term in zip(sums, terms, strict=True)]
    return sums
