"""The recursions take any scalar: over dual numbers, a + b ε with ε² = 0, their results have exact derivatives."""

from dataclasses import dataclass

import numpy as np
import pytest
from peers.random_robots import random_urdf

from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.newton_euler import articulated_body
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.kinematics import run_forward_pass
from robot_dynamics.newton_euler.walker_orin import inertia_matrix


@dataclass
class Dual:
    """value + slope ε, with only the operations that the recursions may use."""

    value: float
    slope: float = 0.0

    def __add__(self, other):
        other = dual(other)
        return Dual(self.value + other.value, self.slope + other.slope)

    def __mul__(self, other):
        other = dual(other)
        return Dual(self.value * other.value, self.slope * other.value + self.value * other.slope)

    def __truediv__(self, other):
        other = dual(other)
        quotient = self.value / other.value
        return Dual(quotient, (self.slope - quotient * other.slope) / other.value)

    def __neg__(self):
        return Dual(-self.value, -self.slope)

    def __sub__(self, other):
        return self + -dual(other)

    def __rsub__(self, other):
        return dual(other) + -self

    def __rtruediv__(self, other):
        return dual(other) / self

    __radd__, __rmul__ = __add__, __mul__

    def sin(self):
        return Dual(np.sin(self.value), np.cos(self.value) * self.slope)

    def cos(self):
        return Dual(np.cos(self.value), -np.sin(self.value) * self.slope)


def dual(number):
    return number if isinstance(number, Dual) else Dual(float(number))


def duals(values, slopes):
    array_of_duals = np.empty(np.shape(values), dtype=object)
    for index in np.ndindex(array_of_duals.shape):
        array_of_duals[index] = Dual(values[index], slopes[index])
    return array_of_duals


def part(array, name):
    return np.vectorize(lambda number: getattr(dual(number), name), otypes=[float])(array)


@pytest.mark.parametrize("seed", range(5))
def test_recursions_over_dual_numbers_give_derivatives(seed):
    robot = read_urdf(random_urdf(seed, joints=5), moving_base=True)
    rng = np.random.default_rng(seed)
    q, qd, qdd, q_slope, qd_slope = rng.uniform(-1, 1, (5, 5))
    twist, wrenches_on_links = rng.uniform(-1, 1, 6), rng.uniform(-1, 1, (5, 6))
    columns = [None] * 5

    def models(q, qd):
        """Efforts by two passes; accelerations of joints and of a free base, and wrenches, by three."""
        forward_pass = run_forward_pass(robot, q, qd, twist, {j: wrenches_on_links[j - 1] for j in (2, 5)})
        forces, wrenches = inverse_dynamics(robot, forward_pass, qdd, twist)
        prescribed = list(qdd[:, None])
        solution = articulated_body.solve(robot, forward_pass, columns, prescribed)
        mixed = articulated_body.solve(
            robot,
            forward_pass,
            [prescribed[0], None, prescribed[2], None, None],
            [None, prescribed[1], None, *prescribed[3:]],
            twist,
        )
        return np.concatenate(
            [
                forces,
                wrenches.ravel(),
                solution.accelerations,
                solution.base_acceleration,
                solution.wrenches.ravel(),
                mixed.accelerations,
                mixed.forces,
                inertia_matrix(robot, q).ravel(),
            ]
        )

    solution = models(duals(q, q_slope), duals(qd, qd_slope))
    expected = models(q, qd)
    np.testing.assert_allclose(part(solution, "value"), expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())
    step = 1e-4
    samples = [models(q + k * step * q_slope, qd + k * step * qd_slope) for k in (-2, -1, 1, 2)]
    slope = (samples[0] - 8 * samples[1] + 8 * samples[2] - samples[3]) / (12 * step)
    np.testing.assert_allclose(part(solution, "slope"), slope, rtol=1e-6, atol=1e-7 * np.abs(slope).max())
