"""A Gough-Stewart platform with invented numbers, six legs of a universal, a sliding and a ball joint, as a Robot."""

import numpy as np

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.loop import Loop, LoopEnd
from robot_dynamics.model.placement import placement
from robot_dynamics.model.platform import COORDINATES, CYCLIC_ROTATION, PLATFORM_FRAME, Platform, make_coordinate_joints
from robot_dynamics.model.robot import Frame, Link, Robot

HEIGHT = 0.8  # [m] of the platform at the start
ON_BASE, ON_PLATFORM = np.deg2rad([10, 110, 130, 230, 250, 350]), np.deg2rad([50, 70, 170, 190, 290, 310])


def body(mass, moments, centre):
    return Inertia.about_centre_of_mass(mass, np.diag(moments), placement(translation=centre))


def gough_stewart(friction=True):
    """Return a Robot with rotors; friction: in the drives and one passive joint of each leg."""
    links, joints, ends = [("base", Inertia())], [], []
    for k, (here, there) in enumerate(zip(ON_BASE, ON_PLATFORM, strict=True)):
        low = 0.5 * np.array([np.cos(here), np.sin(here), 0])
        high = 0.3 * np.array([np.cos(there), np.sin(there), 0])
        along = high + np.array([0, 0, HEIGHT]) - low
        length = np.linalg.norm(along)
        # about x by q1, then about y by q2, z points along the leg: (sin q2, -sin q1 cos q2, cos q1 cos q2)
        x, y, z = along / length
        first = len(links)
        joints += [
            Joint(
                f"u{k}",
                0,
                False,
                placement(CYCLIC_ROTATION, low),
                actuated=False,
                initial_position=np.arctan2(-y, z),
                viscous_friction=0.1 * friction,
            ),
            Joint(f"v{k}", first, False, placement(CYCLIC_ROTATION), actuated=False, initial_position=np.arcsin(x)),
            Joint(
                f"leg{k}",
                first + 1,
                True,
                placement(CYCLIC_ROTATION),
                initial_position=length,
                rotor_inertia=0.3,
                viscous_friction=5.0 * friction,
                coulomb_friction=1.0 * friction,
            ),
        ]
        links += [
            (f"cross{k}", body(0.2, [1e-3, 2e-3, 1e-3], [0, 0, 0])),
            (f"cylinder{k}", body(2.0, [0.05, 0.05, 0.01], [0.2, 0, 0.01])),
            (f"rod{k}", body(1.0, [0.02, 0.02, 0.001], [0, 0, -0.2])),
        ]
        ends.append((first + 2, high))
    first = len(links)
    joints += make_coordinate_joints("platform", first, (0, 0, HEIGHT, 0, 0, 0))
    links += [(f"platform_{name}_link", Inertia()) for name in COORDINATES[:-1]]
    links.append(("platform", body(10.0, [0.3, 0.4, 0.6], [0.02, 0.01, 0.05]).transformed_by(PLATFORM_FRAME)))
    platform = len(links) - 1
    return Robot(
        "gough_stewart",
        tuple(Link(*link) for link in links),
        tuple(joints),
        tuple(Frame(name, k, PLATFORM_FRAME if k == platform else np.eye(4)) for k, (name, _) in enumerate(links)),
        loops=tuple(
            Loop(
                f"ball{k}",
                LoopEnd(link, np.eye(4)),
                LoopEnd(platform, PLATFORM_FRAME @ placement(translation=high)),
                is_spherical=True,
            )
            for k, (link, high) in enumerate(ends)
        ),
        platforms=(Platform(platform, tuple(range(first - 1, first + 5))),),
    )
