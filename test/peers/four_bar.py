"""A planar four-bar linkage: as a Robot with a loop, and as Lagrange's equation m(q) q̈ + ½ m′(q) q̇² + V′(q) = Γ.

In the plane, the crank turns about the origin and carries the coupler at its end; the rocker turns about (ground, 0);
the coupler's end is hinged to the rocker's. Angles of links are to the x axis. The actuated joint is the crank's; the
angle of the coupler's joint is that between crank and coupler, of the cut joint that between coupler and rocker.
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
class FourBar(PlanarLagrange):
    """crank, coupler, rocker, ground: lengths [m]. bodies: PlanarBody of crank, coupler and rocker, x along the link.

    joints: JointProperties of crank, coupler, rocker and cut joint. mode: 1 or −1, on which side of the line from the
    coupler's joint to the rocker's the two meet. plane: (4, 4) of the linkage in the world; gravity: (3,) [m/s²].
    """

    crank: float
    coupler: float
    rocker: float
    ground: float
    bodies: tuple
    joints: tuple = (JointProperties(),) * 4
    mode: int = 1
    plane: np.ndarray = None
    gravity: np.ndarray = EARTH_GRAVITY
    independent = (0,)

    def __post_init__(self):
        object.__setattr__(self, "plane", np.eye(4) if self.plane is None else np.asarray(self.plane, dtype=float))
        object.__setattr__(self, "gravity", np.asarray(self.gravity, dtype=float))

    def link_angles(self, q):
        """(3,): angles of crank, coupler and rocker to the x axis."""
        hinge, pivot = self.crank * unit(q[0]), np.array([self.ground, 0.0])
        meeting = intersection(hinge, self.coupler, pivot, self.rocker, self.mode)
        return np.array([q[0], angle_of(meeting - hinge), angle_of(meeting - pivot)])

    def link_rates(self, q):
        """(3, 1): ω of crank, coupler and rocker at unit rate of the crank.

        The closure a e(φ₁) + b e(φ₂) = g + c e(φ₃), once differentiated, times e(φ₃), and times e(φ₂).
        """
        crank, coupler, rocker = self.link_angles(q)
        span = np.sin(rocker - coupler)
        of_coupler = self.crank * np.sin(crank - rocker) / (self.coupler * span)
        of_rocker = self.crank * np.sin(crank - coupler) / (self.rocker * span)
        return np.array([[1.0], [of_coupler], [of_rocker]])

    def joint_angles(self, q):
        crank, coupler, rocker = self.link_angles(q)
        return np.array([crank, wrapped(coupler - crank), rocker, wrapped(rocker - coupler)])

    def joint_rates(self, q):
        crank, coupler, rocker = self.link_rates(q)
        return np.array([crank, coupler - crank, rocker, rocker - coupler])

    def bodies_at(self, q):
        angles, rates = self.link_angles(q), self.link_rates(q)
        hinge_rate = self.crank * np.outer(normal(q[0]), rates[0])
        still = np.zeros((2, 1))
        origins = [np.zeros(2), self.crank * unit(q[0]), np.array([self.ground, 0.0])]
        return list(zip(self.bodies, origins, angles, [still, hinge_rate, still], rates, strict=True))

    def robot(self, start, ball=False):
        """Return the Robot, initially at the crank's angle `start` [rad], a number or (1,).

        Joints: crank (actuated), coupler, rocker, and cut, which moves a link without inertia.
        ball: the loop is cut at a ball joint, and the cut joint is absent.
        """
        angles = self.positions(np.atleast_1d(start))
        names = ["crank", "coupler", "rocker", "cut"]
        placements = [self.plane, translation(self.crank), self.plane @ translation(self.ground)]
        placements.append(translation(self.coupler))
        joints = [
            made_joint(name, antecedent, placement, properties, name == "crank", angle)
            for name, antecedent, placement, properties, angle in zip(
                names, [0, 1, 0, 2], placements, self.joints, angles, strict=True
            )
        ]
        links = [Link("base", Inertia())]
        links += [Link(name, body.about_origin()) for name, body in zip(names, self.bodies, strict=False)]
        links.append(Link("cut", Inertia()))
        moved, kept = LoopEnd(4, np.eye(4)), 4
        if ball:
            moved, kept = LoopEnd(2, translation(self.coupler)), 3
        return Robot(
            "four_bar",
            tuple(links[: kept + 1]),
            tuple(joints[:kept]),
            tuple(Frame(link.name, number, np.eye(4)) for number, link in enumerate(links[: kept + 1])),
            gravity=self.gravity,
            loops=(Loop("four_bar", moved, LoopEnd(3, translation(self.rocker)), ball),),
        )


def random_four_bar(seed, friction=True, springs=False):
    """Return a crank-rocker anywhere in space, whose crank can make full turns.

    By Grashof's rule the shortest link, the crank, and the longest are together shorter than the other two.
    """
    rng = np.random.default_rng([seed, 4])
    crank = rng.uniform(0.15, 0.3)
    coupler, rocker = rng.uniform(0.6, 0.9, 2)
    ground = rng.uniform(0.6, 0.9)
    return FourBar(
        crank,
        coupler,
        rocker,
        ground,
        tuple(random_body(rng, length) for length in (crank, coupler, rocker)),
        tuple(random_joint(rng, friction, springs) for _ in range(4)),
        int(rng.choice([1, -1])),
        random_plane(rng),
        rng.normal(size=3) * 5,
    )
