"""Kinetic and potential energy of a chain of joints and flexible beams, and Lagrange's equations from them by
differences alone: no inertia matrix, no velocity terms, no derivative written by hand.

4x4 matrices give the placement of each point of the chain; their derivative by a complex step gives its velocity.
"""

import numpy as np

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(8)
STEP = 1e-3
STENCIL = ((1, 672), (-1, -672), (2, -168), (-2, 168), (3, 32), (-3, -32), (4, -3), (-4, 3))  # over 840, order 8


def matrix(R, p):
    T = np.zeros((4, 4), dtype=complex)
    T[:3, :3], T[:3, 3], T[3, 3] = R, p, 1
    return T


def rotation(vector):
    """Rodrigues' formula, of complex numbers too."""
    x, y, z = vector
    angle = np.sqrt(x * x + y * y + z * z + 1e-300)
    hat = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) / angle * hat + (1 - np.cos(angle)) / angle**2 * hat @ hat


def section(L, e, s):
    """(4, 4) of the section at a fraction s of an element: linear along and about it, Hermite's cubics across."""

    def across(end, slope, at):
        return end * (3 * at**2 - 2 * at**3) + L * slope * (at**3 - at**2)

    def slope(end, turn, at):
        return end * (6 * at - 6 * at**2) / L + turn * (3 * at**2 - 2 * at)

    at = s * (1 + POINTS) / 2
    shortening = s * L / 4 * WEIGHTS @ (slope(e[1], e[5], at) ** 2 + slope(e[2], -e[4], at) ** 2)
    p = [s * L + s * e[0] - shortening, across(e[1], e[5], s), across(e[2], -e[4], s)]
    return matrix(rotation([s * e[3], -slope(e[2], -e[4], s), slope(e[1], e[5], s)]), p)


class BendingChain:
    """links: [(placement (4, 4) in the end of the link before, [(element length, section as of peers.frame)],
    tip mass [kg])]. Coordinates: each joint, then the elastic ones of all elements, in their order."""

    def __init__(self, links, gravity):
        self.links, self.gravity = links, np.asarray(gravity)
        self.size = len(links) + 6 * sum(len(elements) for _, elements, _ in links)

    def bodies(self, x):
        """Return [(mass, moments of inertia about its own axes (3,), placement (4, 4))]."""
        frame = np.eye(4)
        number = len(self.links)
        bodies = []
        for joint, (placement, elements, tip) in enumerate(self.links):
            frame = frame @ placement @ matrix(rotation([0, 0, x[joint]]), np.zeros(3))
            for L, (A, I_y, I_z, _, I_p, _, _, rho) in elements:
                e = x[number : number + 6]
                for point, weight in zip(POINTS, WEIGHTS, strict=True):
                    share = rho * weight * L / 2
                    moments = share * np.array([I_p, I_y, I_z])
                    bodies.append((share * A, moments, frame @ section(L, e, (1 + point) / 2)))
                frame, number = frame @ section(L, e, 1.0), number + 6
            bodies.append((tip, np.zeros(3), frame))
        return bodies

    def kinetic(self, x, rates):
        total = 0.0
        for mass, moments, T in self.bodies(x + 1e-30j * rates):
            spin = T[:3, :3].real.T @ (T[:3, :3].imag / 1e-30)  # of its own axes
            omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
            total += mass / 2 * np.sum((T[:3, 3].imag / 1e-30) ** 2) + moments @ omega**2 / 2
        return total

    def potential(self, x):
        total = -sum(mass * self.gravity @ T[:3, 3].real for mass, _, T in self.bodies(x))
        number = len(self.links)
        for _, elements, _ in self.links:
            for L, cross_section in elements:
                total += self._strain(L, cross_section, x[number : number + 6])
                number += 6
        return total

    def _strain(self, L, cross_section, e):
        """½ ∫ E A u'² + G I_0 φ'² + E I_z v''² + E I_y w''²."""
        A, I_y, I_z, I_0, _, E, G, _ = cross_section
        total = L / 2 * (E * A * (e[0] / L) ** 2 + G * I_0 * (e[3] / L) ** 2)
        s = (1 + POINTS) / 2
        for second, end, turn in ((I_z, e[1], e[5]), (I_y, e[2], -e[4])):
            curved = end * (6 - 12 * s) / L**2 + turn * (6 * s - 2) / L
            total += L / 4 * E * second * WEIGHTS @ curved**2
        return total

    def efforts(self, x, rates, accelerations, only=None):
        """d/dt ∂T/∂ẋ - ∂T/∂x + ∂V/∂x, of some coordinates or all."""
        efforts = []
        for number in range(self.size) if only is None else only:
            unit = np.eye(self.size)[number]
            total = 0.0
            for steps, weight in STENCIL:
                at = steps * STEP
                # ẋ(t) = ẋ + ẍ t along x(t) = x + ẋ t + ẍ t²/2: T is quadratic in rates, differences are exact
                there, going = x + at * rates + at**2 / 2 * accelerations, rates + at * accelerations
                momentum = (self.kinetic(there, going + unit) - self.kinetic(there, going - unit)) / 2
                moved = x + at * unit
                total += weight * (momentum - self.kinetic(moved, rates) + self.potential(moved))
            efforts.append(total / (840 * STEP))
        return np.array(efforts)
