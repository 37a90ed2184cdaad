"""Lagrange's equations of planar linkages in closed form, and the parts of which their Robots are made.

A linkage tells, for independent angles q and for complex arguments too, the angles of all its joints and of its links,
their rates for unit rates of q, and the rest follows here: T = ½ q̇ᵀ M(q) q̇ and V(q), with derivatives by complex steps,
∂f/∂q = Im f(q + ih)/h, which subtract nothing and so are exact to the last digits.
Source: Lagrange, second kind; Squire and Trapp, SIAM Review 40 (1998) 110.
"""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint, Spring

STEP = 1e-40


def unit(angle):
    """(2,): the unit vector at an angle to the x axis; may be complex."""
    return np.array([np.cos(angle), np.sin(angle)])


def normal(angle):
    """(2,): `unit` turned by a quarter, its derivative."""
    return np.array([-np.sin(angle), np.cos(angle)])


def angle_of(vector):
    """atan2 of a vector (2,), with the first-order imaginary part that complex steps carry through it."""
    x, y = vector
    real = np.arctan2(np.real(y), np.real(x))
    return real + 1j * (np.real(x) * np.imag(y) - np.real(y) * np.imag(x)) / np.real(x * x + y * y)


def wrapped(angle):
    """The same angle with its real part in [−π, π)."""
    return angle - 2 * np.pi * np.floor((np.real(angle) + np.pi) / (2 * np.pi))


def intersection(a, radius_a, b, radius_b, mode):
    """Where circles about a and b (2,) meet, left of the way from a to b for mode 1, right of it for mode −1.

    The law of cosines: x = (r_a² − r_b² + D²) / 2D along the way, and √(r_a² − x²) beside it.
    """
    direction = b - a
    distance = np.sqrt(direction @ direction)
    along = (radius_a**2 - radius_b**2 + distance**2) / (2 * distance)
    square = radius_a**2 - along**2
    if np.real(square) <= 0:
        raise ValueError(f"the linkage cannot close: circles of {radius_a} and {radius_b} are {distance} apart")
    ahead = direction / distance
    return a + along * ahead + mode * np.sqrt(square) * np.array([-ahead[1], ahead[0]])


@dataclass(frozen=True)
class PlanarBody:
    """A link in its frame: mass [kg], centre of mass (3,) [m], inertia about the centre of mass (3, 3) [kg m²]."""

    mass: float
    centre: np.ndarray
    inertia: np.ndarray

    def about_origin(self):
        return Inertia.about_centre_of_mass(self.mass, self.inertia, translation(*self.centre))


@dataclass(frozen=True)
class JointProperties:
    """Ia, Fv, Fs and a spring at a joint, as in Joint."""

    rotor_inertia: float = 0.0
    viscous_friction: float = 0.0
    coulomb_friction: float = 0.0
    spring: Spring | None = None


def random_body(rng, length):
    mass = rng.uniform(0.5, 5)
    centre = np.array([rng.uniform(0.2, 0.8) * length, *rng.uniform(-0.2, 0.2, 2)])
    spread = mass * rng.uniform(0.02, 0.3, 3) ** 2
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return PlanarBody(mass, centre, axes @ np.diag(spread.sum() - spread) @ axes.T)


def random_joint(rng, friction=True, spring=False):
    losses = rng.uniform(0.1, 2, 2) if friction else (0.0, 0.0)
    joint_spring = Spring(rng.uniform(1, 50), rng.uniform(-1, 1), rng.uniform(0, 1)) if spring else None
    return JointProperties(rng.uniform(0.01, 0.5), *losses, joint_spring)


def random_plane(rng):
    """(4, 4): random pose of a linkage in the frame of the base."""
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    plane = np.eye(4)
    plane[:3, :3], plane[:3, 3] = axes * np.linalg.det(axes), rng.uniform(-1, 1, 3)
    return plane


def translation(x, y=0.0, z=0.0):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def made_joint(name, antecedent, placement, properties, actuated, position):
    return Joint(
        name,
        antecedent,
        False,
        placement,
        rotor_inertia=properties.rotor_inertia,
        viscous_friction=properties.viscous_friction,
        coulomb_friction=properties.coulomb_friction,
        spring=properties.spring,
        actuated=actuated,
        initial_position=float(position),
    )


class PlanarLagrange:
    """Equations of motion of a planar linkage; a subclass has the geometry.

    joint_angles(q): (n,) of all joints, the cut one last. joint_rates(q): (n, independent) ∂(joint angles)/∂q.
    bodies_at(q): a list of (PlanarBody, joint position (2,), link angle, (2, independent) ∂(position)/∂q,
    (independent,) ∂(angle)/∂q). independent: numbers of the joints whose angles q are.

    plane: (4, 4) pose of the linkage in the world, gravity: (3,) [m/s²] in the world; joints: JointProperties (n,).
    """

    plane: np.ndarray
    gravity: np.ndarray
    joints: tuple
    independent: tuple

    def mass_matrix(self, q):
        """M(q) (independent, independent) [kg m²]: every body's m |ċ|² + I ω², and rotors, at unit rates."""
        size = len(self.independent)
        M = np.zeros((size, size), dtype=complex)
        for body, _, angle, origin_rate, angle_rate in self.bodies_at(q):
            x, y, _ = body.centre
            centre_rate = origin_rate + np.outer(x * normal(angle) - y * unit(angle), angle_rate)
            M += body.mass * centre_rate.T @ centre_rate
            M += body.inertia[2, 2] * np.outer(angle_rate, angle_rate)
        rates = self.joint_rates(q)
        return M + rates.T @ np.diag([joint.rotor_inertia for joint in self.joints]) @ rates

    def gravity_potential(self, q):
        """−Σ m g·c [J]; zero at the origin of the world."""
        total = 0.0
        for body, origin, angle, _, _ in self.bodies_at(q):
            x, y, z = body.centre
            planar = origin + x * unit(angle) + y * normal(angle)
            total -= body.mass * self.gravity @ (self.plane[:3, :3] @ np.array([*planar, z]) + self.plane[:3, 3])
        return total

    def spring_energy(self, q):
        """½ Σ k (θ − θ₀)² [J]."""
        angles = self.joint_angles(q)
        joint_spring = [(joint.spring, angle) for joint, angle in zip(self.joints, angles, strict=True) if joint.spring]
        return sum((spring.stiffness * (angle - spring.rest) ** 2 / 2 for spring, angle in joint_spring), 0.0)

    def derivatives(self, function, q):
        """∂f/∂q with a last axis for the entries of q (independent,), by complex steps."""
        steps = 1j * STEP * np.eye(len(q))
        return np.stack([np.imag(function(q + step)) / STEP for step in steps], axis=-1)

    def losses(self, q, qd):
        """(independent,): friction and dampers of all joints, through the rates of the joints."""
        rates = self.joint_rates(q).real
        speeds = rates @ qd
        forces = [
            joint.viscous_friction * speed
            + joint.coulomb_friction * np.sign(speed)
            + (joint.spring.damping * speed if joint.spring else 0.0)
            for joint, speed in zip(self.joints, speeds, strict=True)
        ]
        return rates.T @ np.array(forces)

    def bias(self, q, qd):
        """H (independent,) [N m] of M q̈ + H = Γ: Ṁ q̇ − ½ ∂(q̇ᵀ M q̇)/∂q + ∂V/∂q + losses."""
        q, qd = np.asarray(q, dtype=float), np.asarray(qd, dtype=float)
        slope = self.derivatives(self.mass_matrix, q)  # ∂M_ij/∂q_k
        inertial = np.einsum("ijk,j,k->i", slope, qd, qd) - np.einsum("ijk,i,j->k", slope, qd, qd) / 2
        potential = self.derivatives(lambda q: self.gravity_potential(q) + self.spring_energy(q), q)
        return inertial + potential + self.losses(q, qd)

    def inverse(self, q, qd, qdd):
        """Γ (independent,) [N m] of independent angles, rates and accelerations."""
        return self.mass_matrix(np.asarray(q, dtype=float)).real @ qdd + self.bias(q, qd)

    def direct(self, q, qd, efforts):
        """q̈ (independent,) [rad/s²]."""
        return np.linalg.solve(self.mass_matrix(np.asarray(q, dtype=float)).real, efforts - self.bias(q, qd))

    def positions(self, q):
        """(n,) angles of all joints [rad], closed."""
        return np.real(self.joint_angles(np.asarray(q, dtype=float)))

    def velocities(self, q, qd):
        """(n,) rates of all joints [rad/s]."""
        return self.joint_rates(np.asarray(q, dtype=float)).real @ qd

    def accelerations(self, q, qd, qdd):
        """(n,) of all joints [rad/s²]: K q̈ + (∂K/∂q · q̇) q̇ with K = ∂θ/∂q."""
        q = np.asarray(q, dtype=float)
        slope = self.derivatives(self.joint_rates, q)
        return self.joint_rates(q).real @ qdd + np.einsum("ijk,j,k->i", slope, qd, qd)
