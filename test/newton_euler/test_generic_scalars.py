"""The recursions run over any scalar: over dual numbers, a + b ε with ε² = 0, they differentiate themselves exactly."""

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
    """value + slope ε, with the operations that the recursions may use and no other."""

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
    made = np.empty(np.shape(values), dtype=object)
    for index in np.ndindex(made.shape):
        made[index] = Dual(values[index], slopes[index])
    return made


def part(array, name):
    return np.vectorize(lambda number: getattr(dual(number), name), otypes=[float])(array)


@pytest.mark.parametrize("seed", range(5))
def test_models_over_dual_numbers_are_the_models_with_their_derivatives(seed):
    robot = read_urdf(random_urdf(seed, joints=5), moving_base=True)
    rng = np.random.default_rng(seed)
    q, qd, qdd, way, speed = rng.uniform(-1, 1, (5, 5))
    twist, push = rng.uniform(-1, 1, 6), rng.uniform(-1, 1, (5, 6))
    columns = [None] * 5

    def models(q, qd):
        """Efforts by two sweeps; accelerations of joints and of a free base, and wrenches, by three."""
        sweep = run_forward_pass(robot, q, qd, twist, {j: push[j - 1] for j in (2, 5)})
        forces, wrenches = inverse_dynamics(robot, sweep, qdd, twist)
        given = list(qdd[:, None])
        found = articulated_body.solve(robot, sweep, columns, given)
        mixed = articulated_body.solve(
            robot, sweep, [given[0], None, given[2], None, None], [None, given[1], None, *given[3:]], twist
        )
        return np.concatenate(
            [
                forces,
                wrenches.ravel(),
                found.accelerations,
                found.base_acceleration,
                found.wrenches.ravel(),
                mixed.accelerations,
                mixed.forces,
                inertia_matrix(robot, q).ravel(),
            ]
        )

    found = models(duals(q, way), duals(qd, speed))
    expected = models(q, qd)
    np.testing.assert_allclose(part(found, "value"), expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())
    step = 1e-4
    ahead = [models(q + k * step * way, qd + k * step * speed) for k in (-2, -1, 1, 2)]
    slope = (ahead[0] - 8 * ahead[1] + 8 * ahead[2] - ahead[3]) / (12 * step)
    np.testing.assert_allclose(part(found, "slope"), slope, rtol=1e-6, atol=1e-7 * np.abs(slope).max())
