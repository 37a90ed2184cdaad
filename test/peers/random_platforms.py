"""Random parallel robots of four kinds, closed at their initial positions: 3-RPS, 3-PRS, 6-UPS and 3-UPU.

Letters name the joints of a leg from the base on; the prismatic joint is the actuated one: R revolute, P prismatic, S
ball, U universal. Each joint is placed by its axis at the initial positions, in the frame of the ground.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.loop import Loop, LoopEnd
from robot_dynamics.model.placement import invert_placement, placement
from robot_dynamics.model.platform import PLATFORM_FRAME, Platform, make_coordinate_joints
from robot_dynamics.model.robot import Frame, Link, Robot

KINDS = ("3-RPS", "3-PRS", "6-UPS", "3-UPU")
FREE = {
    "3-RPS": ("z", "pitch", "roll"),
    "3-PRS": ("z", "pitch", "roll"),
    "6-UPS": ("x", "y", "z", "yaw", "pitch", "roll"),
    "3-UPU": ("x", "y", "z"),
}


def random_platform(kind, seed, own=None, irregular=True):
    """Return a Robot of a kind, actuated at its prismatic joints.

    own: rotation (3, 3) of the platform's own frame in the ground at home, None: the identity; irregular: whether
    anchors are up to 8 % away from a regular figure.
    """
    rng = np.random.default_rng([seed, KINDS.index(kind), 3])
    legs = 6 if kind == "6-UPS" else 3
    spread = 0.08 if irregular else 0.0
    around = np.linspace(0, 2 * np.pi, legs, endpoint=False)
    skew = rng.uniform(0.25, 0.4) if kind == "6-UPS" else 0.0
    base_at = around + skew * (-1) ** np.arange(legs) + spread * rng.uniform(-1, 1, legs)
    platform_at = around - skew * (-1) ** np.arange(legs) + spread * rng.uniform(-1, 1, legs)
    height, outer, inner = rng.uniform(0.4, 0.7), rng.uniform(0.35, 0.55), rng.uniform(0.15, 0.3)
    if kind in ("3-RPS", "3-PRS"):
        platform_at = base_at  # in the planes of the legs
    builder = _Builder(height, np.eye(3) if own is None else own, FREE[kind] if own is None else FREE["6-UPS"])
    for low, high in zip(base_at, platform_at, strict=True):
        ground = outer * np.array([np.cos(low), np.sin(low), 0])
        met = np.array([inner * np.cos(high), inner * np.sin(high), height])
        tangent = np.array([-np.sin(low), np.cos(low), 0])
        getattr(builder, {"3-RPS": "rps", "3-PRS": "prs", "6-UPS": "ups", "3-UPU": "upu"}[kind])(ground, met, tangent)
    return builder.robot(f"{kind}_{seed}", rng)


def frame_along(z, x):
    """Return a rotation (3, 3) with z along a direction, and x as near as possible to another one."""
    z = z / np.linalg.norm(z)
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


class _Builder:
    def __init__(self, height, own, free):
        self.joints, self.links, self.ends = [], [("base", Inertia())], []
        self.poses = [np.eye(4)]
        self.home, self.free = placement(own, (0, 0, height)), free

    def add_joint(self, antecedent, kind, z, x, origin, q=0.0):
        """Add a joint with its axis along z; the frame of its link is at the origin at position q. Return the link."""
        here, number = placement(frame_along(z, x), origin), len(self.links)
        sliding = kind == "P"
        moved = placement(translation=(0, 0, q)) if sliding else placement(Rotation.from_rotvec([0, 0, q]).as_matrix())
        stands = invert_placement(self.poses[antecedent]) @ here @ invert_placement(moved)
        self.joints.append(
            Joint(
                f"{kind}{number}",
                antecedent,
                sliding,
                stands,
                actuated=sliding,
                initial_position=q,
                rotor_inertia=0.2 * sliding,
            )
        )
        self.links.append((f"link{number}", _bar()))
        self.poses.append(here)
        return number

    def rps(self, ground, met, tangent):
        along = met - ground
        link = self.add_joint(0, "R", tangent, along, ground)
        self.add_ball_joint(self.add_joint(link, "P", along, tangent, met, np.linalg.norm(along)), met)

    def prs(self, ground, met, tangent):
        foot = ground + np.array([0, 0, 0.3 * met[2]])
        link = self.add_joint(0, "P", np.array([0, 0, 1.0]), tangent, foot, foot[2])
        self.add_ball_joint(self.add_joint(link, "R", tangent, met - foot, foot), met)

    def ups(self, ground, met, tangent):
        along = met - ground
        across = np.cross(along, tangent)
        link = self.add_joint(0, "U", np.cross(across, along), along, ground, 0.3)
        link = self.add_joint(link, "V", across, along, ground, -0.2)
        self.add_ball_joint(self.add_joint(link, "P", along, tangent, met, np.linalg.norm(along)), met)

    def upu(self, ground, met, tangent):
        """Add a leg with equal universal joints: the first axis is parallel to the last, the second to the third."""
        along = met - ground
        second = np.cross(tangent, along)
        link = self.add_joint(0, "U", tangent, along, ground, 0.4)
        link = self.add_joint(link, "V", second, along, ground, 0.1)
        link = self.add_joint(link, "P", along, tangent, met, np.linalg.norm(along))
        link = self.add_joint(link, "W", second, along, met, -0.3)
        link = self.add_joint(link, "X", tangent, along, met, 0.2)
        self.ends.append((link, np.eye(4), self.poses[link], False))

    def add_ball_joint(self, link, point):
        """Add a ball joint between a leg and the platform."""
        self.ends.append(
            (
                link,
                invert_placement(self.poses[link]) @ placement(translation=point),
                placement(translation=point),
                True,
            )
        )

    def robot(self, name, rng):
        first = len(self.links)
        yaw, pitch, roll = Rotation.from_matrix(self.home[:3, :3]).as_euler("ZYX")
        self.joints += make_coordinate_joints("platform", first, (*self.home[:3, 3], yaw, pitch, roll))
        self.links += [(f"platform_{index}", Inertia()) for index in range(5)]
        spread = rng.uniform(0.02, 0.06, 3)
        body = Inertia.about_centre_of_mass(
            3.0, np.diag(spread.sum() - spread), placement(translation=(0.02, 0.01, 0.03))
        )
        self.links.append(("platform", body.transformed_by(PLATFORM_FRAME)))
        platform = len(self.links) - 1
        loops = []
        for number, (link, at_leg, met, ball) in enumerate(self.ends):
            at_leg, in_platform = np.array(at_leg), invert_placement(self.home) @ met
            if ball:
                at_leg, in_platform = placement(translation=at_leg[:3, 3]), placement(translation=in_platform[:3, 3])
            loops.append(
                Loop(f"end{number}", LoopEnd(link, at_leg), LoopEnd(platform, PLATFORM_FRAME @ in_platform), ball)
            )
        frames = [
            Frame(name, number, PLATFORM_FRAME if number == platform else np.eye(4))
            for number, (name, _) in enumerate(self.links)
        ]
        coordinates = tuple(range(first - 1, first + 5))
        return Robot(
            name,
            tuple(Link(*link) for link in self.links),
            tuple(self.joints),
            tuple(frames),
            loops=tuple(loops),
            platforms=(Platform(platform, coordinates, self.free),),
        )


def _bar():
    return Inertia.about_centre_of_mass(0.8, np.diag([0.01, 0.012, 0.005]), placement(translation=(0.01, 0.02, -0.1)))
