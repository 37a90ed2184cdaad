"""Random robots as URDF text, and random states of robots."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics import Base, Dynamics

from .reachable import reachable


def numbers(values):
    return " ".join(repr(float(value)) for value in np.atleast_1d(values))


def origin(rng):
    return f'<origin xyz="{numbers(rng.uniform(-0.4, 0.4, 3))}" rpy="{numbers(rng.uniform(-3, 3, 3))}"/>'


def inertial(rng):
    """Return an <inertial> that a physical body can have, with a mass from 1e-2 to 1e2 kg and turned principal axes."""
    mass = 10 ** rng.uniform(-2, 2)
    spread = mass * rng.uniform(0.02, 0.2, 3) ** 2  # second moments of mass along the principal axes
    turned = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    central = turned @ np.diag(spread.sum() - spread) @ turned.T
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    attributes = " ".join(f'{name}="{numbers(central[index])}"' for name, index in entries.items())
    return f'<inertial>{origin(rng)}<mass value="{numbers(mass)}"/><inertia {attributes}/></inertial>'


def random_urdf(seed, joints=None):
    """Return a tree of 1 to 40 revolute, continuous and prismatic joints with arbitrary axes.

    It has fixed links with and without inertia, and intermediate links without mass.
    """
    rng = np.random.default_rng(seed)
    joints = int(rng.integers(1, 41)) if joints is None else joints
    links, parts = ["link_0"], [f'<link name="link_0">{inertial(rng)}</link>']
    hollow = set()  # links without mass: their children must have mass, else their joints move no inertia
    count, moving = 0, 0
    while moving < joints:
        count += 1
        pending = next(iter(hollow), None)
        # chains are favoured over stars, as in real robots
        parent = pending or links[-1 if rng.random() < 0.6 else rng.integers(len(links))]
        fixed = rng.random() < 0.2 and pending is None
        kind = "fixed" if fixed else rng.choice(["revolute", "continuous", "prismatic"])
        child = f"link_{count}"
        last = moving == joints - 1
        massless = rng.random() < (0.3 if fixed else 0.15) and pending is None and not (last and not fixed)
        hollow.discard(parent)
        if massless and not fixed:
            hollow.add(child)
        body = "" if massless else inertial(rng)
        parts.append(f'<link name="{child}">{body}</link>')
        limit = '<limit lower="-3" upper="3" effort="100" velocity="10"/>' if kind in ("revolute", "prismatic") else ""
        axis = f'<axis xyz="{numbers(rng.normal(size=3) * 10 ** rng.uniform(-2, 2))}"/>'
        parts.append(
            f'<joint name="joint_{count}" type="{kind}">{origin(rng)}<parent link="{parent}"/><child link="{child}"/>'
            f"{axis}{limit}</joint>"
        )
        links.append(child)
        moving += not fixed
    return f'<robot name="random_{seed}">{"".join(parts)}</robot>'


@dataclass
class States:
    """Random states of a robot, a batch of `count`; wrenches on some of its links; base is None where it is fixed."""

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    base: Base | None
    wrenches: dict

    def base_of(self, k):
        """Return (pose, twist) of sample k, in the form that PinocchioModel takes."""
        return (None, ()) if self.base is None else (self.base.pose[k], self.base.twist[k])

    def wrenches_of(self, k):
        return {name: wrench[k] for name, wrench in self.wrenches.items()}


def random_states(robot, joints, count, seed):
    """Return States; with loops, q closes them, with the actuated joints within their limits."""
    rng = np.random.default_rng([seed, 1])
    q, qd, qdd = rng.uniform(-2, 2, (3, count, joints))
    if robot.loops:
        dynamics = Dynamics(robot, compiled=False)
        q = dynamics.expand_positions(reachable(dynamics, count, rng))
    base = None
    if robot.moving_base:
        pose = np.tile(np.eye(4), (count, 1, 1))
        pose[:, :3, :3] = Rotation.random(count, random_state=int(rng.integers(2**31))).as_matrix().reshape(-1, 3, 3)
        pose[:, :3, 3] = rng.uniform(-1, 1, (count, 3))
        base = Base(pose, rng.uniform(-1, 1, (count, 6)))
    names = [frame.name for frame in robot.frames]
    loaded = rng.choice(names, size=min(3, len(names)), replace=False)
    return States(q, qd, qdd, base, {str(name): rng.uniform(-20, 20, (count, 6)) for name in loaded})


def digits_left(inertia_matrix, forces, accelerations):
    """Return the relative error of accelerations from rounding of the forces, large where the inertia is small.

    inertia_matrix: (..., n, n) of as many samples as the forces and accelerations (..., n).
    """
    stretch = np.linalg.norm(np.linalg.inv(inertia_matrix), 2, axis=(-2, -1)).max(initial=0)
    return 1e-14 * stretch * np.abs(forces).max(initial=0) / max(np.abs(accelerations).max(initial=0), 1e-6)
