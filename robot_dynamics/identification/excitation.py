"""Trajectories that show the parameters of a robot: Fourier series of joint positions, within limits, after which the
columns of its efforts are as independent as can be (Swevers et al., "Optimal robot excitation and identification",
1997). They begin and end at rest, without acceleration.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import minimize

from robot_dynamics.errors import QuestionError
from robot_dynamics.identification.motions import position_bounds

OVERSAMPLED = 20  # points of the grid for each harmonic, on which limits are kept
SAMPLES_PER_HARMONIC = 12  # of the columns whose condition number is asked for
STEPS = (0.03, 0.01, 0.03)  # of finite differences: Coulomb friction steps as samples pass zero velocity
BEGINNINGS = 40  # random trajectories, of which the best is improved


@dataclass(frozen=True, eq=False)
class JointBounds:
    """lower, upper (n,) positions, velocity, acceleration (n,) in absolute value, infinite where none is known."""

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


@dataclass(frozen=True, eq=False)
class FourierTrajectory:
    """q_j(t) = middle_j + Σ_k cosines_jk cos(k ω t) + sines_jk sin(k ω t), ω = 2π / duration: one period.

    middle (n,); cosines, sines (n, harmonics) [rad or m].
    """

    duration: float
    middle: np.ndarray
    cosines: np.ndarray
    sines: np.ndarray

    def __call__(self, times):
        """Positions, velocities and accelerations (N, n) at times (N,) [s]."""
        rates = 2 * np.pi / self.duration * np.arange(1, self.cosines.shape[1] + 1)
        angles = np.multiply.outer(times, rates)
        c, s, a, b = np.cos(angles), np.sin(angles), self.cosines.T, self.sines.T
        return (
            self.middle + c @ a + s @ b,
            (c * rates) @ b - (s * rates) @ a,
            -(c * rates**2) @ a - (s * rates**2) @ b,
        )


def joint_bounds(dynamics, acceleration=np.inf, margin=0.05):
    """The JointBounds that the description of the robot of a Dynamics tells, less a margin of each range.

    acceleration: [rad/s² or m/s²] of every joint, of which descriptions tell nothing. A joint without limits may go
    half a turn or 1 m to either side. Raises QuestionError.
    """
    if not 0 <= margin < 0.5:
        raise QuestionError(f"margin {margin:g}: a part of the range of a joint, 0 to 0.5, is needed")
    joints = [dynamics.robot.joints[dynamics.robot.joint_numbers[name]] for name in dynamics.joint_names]
    lower, upper = np.array([position_bounds(joint) for joint in joints]).T
    rates = np.array([joint.limits.velocity for joint in joints])
    rates = np.where(np.isfinite(rates) & (rates > 0), rates, np.inf)
    room = margin * (upper - lower)
    return JointBounds(lower + room, upper - room, (1 - margin) * rates, np.full(len(joints), float(acceleration)))


def condition(columns, trajectory, samples):
    """The condition number of EffortColumns at samples of a trajectory, each column of length 1."""
    X = columns.rows_at(*trajectory(np.arange(samples) * trajectory.duration / samples))
    X = X.reshape(-1, X.shape[-1])
    lengths = np.linalg.norm(X, axis=0)
    X = X / np.where(lengths > 0, lengths, 1)
    least, *_, most = np.linalg.eigvalsh(X.T @ X)
    return float(np.sqrt(most / max(least, 1e-14 * most)))


class TrajectoryFamily:
    """Trajectories within JointBounds, by numbers without bounds: (n, 2 harmonics) of any size, flattened.

    Of each joint the first number says where in the room that is left its middle is, the second how large the motion is
    of what is allowed, the others its shape, among those that begin and end at rest.
    """

    def __init__(self, bounds, duration, harmonics):
        if harmonics < 2 or not duration > 0:
            raise QuestionError(f"{harmonics} harmonics in {duration:g} s: at least 2, and more than 0 s, are needed")
        self.bounds, self.duration, self.harmonics = bounds, duration, harmonics
        numbers = np.arange(1, harmonics + 1)
        self._cosines, self._sines = null_space(numbers[None] ** 2.0), null_space(numbers[None] * 1.0)
        points = OVERSAMPLED * harmonics
        self._grid = np.arange(points) * duration / points
        # what a trigonometric polynomial of this degree can be more between the points of the grid (Ehlich and Zeller)
        self._beyond = 1 / np.cos(np.pi * harmonics / points)
        self.size = len(bounds.lower) * (2 + 2 * (harmonics - 1))

    def random(self, chance):
        """Numbers of a random trajectory, as large as bounds allow."""
        numbers = chance.normal(size=(len(self.bounds.lower), self.size // len(self.bounds.lower)))
        numbers[:, 1] = 2.0
        return numbers.ravel()

    def __call__(self, numbers):
        """The FourierTrajectory of numbers."""
        bounds, n = self.bounds, len(self.bounds.lower)
        place, largeness, *shape = numbers.reshape(n, -1).T
        shape = np.array(shape).T
        cosines = shape[:, : self.harmonics - 1] @ self._cosines.T
        sines = shape[:, self.harmonics - 1 :] @ self._sines.T
        q, qd, qdd = FourierTrajectory(self.duration, np.zeros(n), cosines, sines)(self._grid)
        centre = (q.max(axis=0) + q.min(axis=0)) / 2
        q = q - centre
        peaks = [self._beyond * np.abs(each).max(axis=0) + 1e-300 for each in (q, qd, qdd)]
        half = (bounds.upper - bounds.lower) / 2
        allowed = np.min([half / peaks[0], bounds.velocity / peaks[1], bounds.acceleration / peaks[2]], axis=0)
        scale = allowed / (1 + np.exp(-largeness))
        room = half - scale * peaks[0]
        middle = (bounds.lower + bounds.upper) / 2 + room * np.tanh(place) - scale * centre
        return FourierTrajectory(self.duration, middle, scale[:, None] * cosines, scale[:, None] * sines)


def exciting_trajectory(columns, bounds, *, duration=20.0, harmonics=5, iterations=25, seed=0, told=None):
    """(FourierTrajectory, its condition number): the best that is found for EffortColumns within JointBounds.

    told: called with (iterations done, condition number) after each. The same for a seed. Raises QuestionError.
    """
    robot, undriven = columns.dynamics.robot, columns.dynamics.undriven_joint_names
    if robot.loops or robot.moving_base:
        raise QuestionError(f"{robot.name!r}: trajectories are designed for a fixed base without loops")
    if undriven:
        raise QuestionError(f"{robot.name!r}: no motor drives {', '.join(undriven)}: trajectories are designed for "
                            "robots all joints of which have motors")  # fmt: skip
    family, samples = TrajectoryFamily(bounds, duration, harmonics), SAMPLES_PER_HARMONIC * harmonics
    chance = np.random.default_rng(seed)
    best = {"condition": np.inf, "numbers": None}

    def asked(numbers):
        found = condition(columns, family(numbers), samples)
        if found < best["condition"]:
            best.update(condition=found, numbers=numbers.copy())
        return np.log(found)

    for _ in range(BEGINNINGS):
        asked(family.random(chance))
    done = 0

    def after(_):
        nonlocal done
        done += 1
        if told is not None:
            told(done, best["condition"])

    for step in STEPS:  # a search ends where noise hides the slope, which is elsewhere for another step
        if done < iterations:
            options = {"maxiter": iterations - done, "eps": step}
            minimize(asked, best["numbers"], method="BFGS", callback=after, options=options)
    return family(best["numbers"]), best["condition"]
