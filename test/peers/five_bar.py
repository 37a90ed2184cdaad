"""A planar five-bar linkage, two cranks actuated: as a Robot with a loop, and as Lagrange's equations M(q) q̈ + H = Γ.

In the plane, the left crank turns about the origin, the right one about (ground, 0); each carries a rod at its end, and
the ends of the rods are hinged to each other. Angles of links are to the x axis; those of the rods' joints are between
crank and rod, that of the cut joint from the left rod to the right one.
"""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.loop import Loop, LoopEnd
from robot_dynamics.model.robot import EARTH_GRAVITY, Frame, Link, Robot

from .planar_lagrange import (
    JointProperties,
    PlanarLagrange,
    angle_of,
    intersection,
    made_joint,
    normal,
    random_body,
    random_joint,
    random_plane,
    translation,
    unit,
    wrapped,
)


@dataclass(frozen=True)
class FiveBar(PlanarLagrange):
    """cranks, rods: lengths, left and right [m]; ground [m]. bodies: PlanarBody of left crank, left rod, right crank,
    right rod, x along the link.

    joints: JointProperties of these four links' joints and of the cut joint. mode: 1 or −1, on which side of the line
    from the left rod's joint to the right one's the rods meet. plane: (4, 4) of the linkage in the world; gravity: (3,)
    [m/s²]. q: (2,) angles of the left and of the right crank.
    """

    cranks: tuple
    rods: tuple
    ground: float
    bodies: tuple
    joints: tuple = (JointProperties(),) * 5
    mode: int = 1
    plane: np.ndarray = None
    gravity: np.ndarray = EARTH_GRAVITY
    independent = (0, 2)

    def __post_init__(self):
        object.__setattr__(self, "plane", np.eye(4) if self.plane is None else np.asarray(self.plane, dtype=float))
        object.__setattr__(self, "gravity", np.asarray(self.gravity, dtype=float))

    def hinges(self, q):
        """(2,) and (2,): the ends of the cranks."""
        return self.cranks[0] * unit(q[0]), np.array([self.ground, 0.0]) + self.cranks[1] * unit(q[1])

    def link_angles(self, q):
        """(4,): angles of left crank, left rod, right crank and right rod to the x axis."""
        left, right = self.hinges(q)
        meeting = intersection(left, self.rods[0], right, self.rods[1], self.mode)
        return np.array([q[0], angle_of(meeting - left), q[1], angle_of(meeting - right)])

    def link_rates(self, q):
        """(4, 2): ω of the four links at unit rates of the two cranks.

        The closure a₁ e(φ₁) + b₁ e(φ₂) = g + a₂ e(φ₃) + b₂ e(φ₄), once differentiated, times e(φ₄), and times e(φ₂).
        """
        left, left_rod, right, right_rod = self.link_angles(q)
        (a1, a2), (b1, b2) = self.cranks, self.rods
        span = np.sin(right_rod - left_rod)
        of_left_rod = np.array([-a1 * np.sin(right_rod - left), a2 * np.sin(right_rod - right)]) / (b1 * span)
        of_right_rod = np.array([-a1 * np.sin(left_rod - left), a2 * np.sin(left_rod - right)]) / (b2 * span)
        return np.array([[1.0, 0.0], of_left_rod, [0.0, 1.0], of_right_rod])

    def joint_angles(self, q):
        left, left_rod, right, right_rod = self.link_angles(q)
        return np.array(
            [left, wrapped(left_rod - left), right, wrapped(right_rod - right), wrapped(right_rod - left_rod)]
        )

    def joint_rates(self, q):
        left, left_rod, right, right_rod = self.link_rates(q)
        return np.array([left, left_rod - left, right, right_rod - right, right_rod - left_rod])

    def bodies_at(self, q):
        angles, rates = self.link_angles(q), self.link_rates(q)
        left, right = self.hinges(q)
        still = np.zeros((2, 2))
        origins = [np.zeros(2), left, np.array([self.ground, 0.0]), right]
        origin_rates = [
            still,
            self.cranks[0] * np.outer(normal(q[0]), rates[0]),
            still,
            self.cranks[1] * np.outer(normal(q[1]), rates[2]),
        ]
        return list(zip(self.bodies, origins, angles, origin_rates, rates, strict=True))

    def robot(self, start):
        """Return the Robot with the initial positions at the cranks' angles `start` (2,) [rad].

        Joints: left (actuated), left_rod, right (actuated), right_rod, and cut, which moves a link without inertia.
        """
        names = ["left", "left_rod", "right", "right_rod", "cut"]
        placements = [
            self.plane,
            translation(self.cranks[0]),
            self.plane @ translation(self.ground),
            translation(self.cranks[1]),
            translation(self.rods[0]),
        ]
        joints = [
            made_joint(name, antecedent, placement, properties, name in ("left", "right"), angle)
            for name, antecedent, placement, properties, angle in zip(
                names, [0, 1, 0, 3, 2], placements, self.joints, self.positions(start), strict=True
            )
        ]
        links = [Link("base", Inertia())]
        links += [Link(name, body.about_origin()) for name, body in zip(names, self.bodies, strict=False)]
        links.append(Link("cut", Inertia()))
        return Robot(
            "five_bar",
            tuple(links),
            tuple(joints),
            tuple(Frame(link.name, number, np.eye(4)) for number, link in enumerate(links)),
            gravity=self.gravity,
            loops=(Loop("five_bar", LoopEnd(5, np.eye(4)), LoopEnd(4, translation(self.rods[1]))),),
        )


def random_five_bar(seed, friction=True, springs=False):
    """Return a five-bar anywhere in space, with rods long enough for full turns of the cranks."""
    rng = np.random.default_rng([seed, 5])
    cranks, rods = tuple(rng.uniform(0.15, 0.3, 2)), tuple(rng.uniform(0.7, 0.9, 2))
    return FiveBar(
        cranks,
        rods,
        rng.uniform(0.5, 0.6),
        tuple(random_body(rng, length) for pair in zip(cranks, rods, strict=True) for length in pair),
        tuple(random_joint(rng, friction, springs) for _ in range(5)),
        int(rng.choice([1, -1])),
        random_plane(rng),
        rng.normal(size=3) * 5,
    )
