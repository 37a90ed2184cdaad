"""Random simple chains in MDH frames, with numbers or with symbols for their parameters."""

import numpy as np

from robot_dynamics import Robot
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.model.robot import Frame, Link

MOMENTS = {"XX": (0, 0), "XY": (0, 1), "XZ": (0, 2), "YY": (1, 1), "YZ": (1, 2), "ZZ": (2, 2)}


def random_chain(seed, joints=6):
    """Return a chain of revolute and prismatic joints, right angles and others between their axes."""
    rng = np.random.default_rng([seed, 7])
    links, made, frames = [Link("base", Inertia())], [], [Frame("base", 0, np.eye(4))]
    for j in range(1, joints + 1):
        alpha = rng.choice([0.0, np.pi / 2, -np.pi / 2, rng.uniform(-3, 3)])
        row = MDHParameters(
            alpha=alpha,
            d=rng.choice([0.0, rng.uniform(-1, 1)]),
            theta=rng.choice([0.0, rng.uniform(-3, 3)]),
            r=rng.uniform(-1, 1),
        )
        J = rng.uniform(-0.2, 0.2, (3, 3))
        inertia = Inertia(rng.uniform(0.5, 5), rng.uniform(-1, 1, 3), J + J.T + np.eye(3))
        made.append(
            Joint(
                f"joint_{j}", j - 1, bool(rng.random() < 0.4), placement_from_mdh(row), rotor_inertia=rng.uniform(0, 1)
            )
        )
        links.append(Link(f"link_{j}", inertia))
        frames.append(Frame(f"link_{j}", j, np.eye(4)))
    return Robot(f"chain_{seed}", tuple(links), tuple(made), tuple(frames))


def with_symbols(robot, trace):
    """Return the same robot with a symbol for each inertial parameter, and the values of the symbols by name."""
    values, links, joints = {}, [robot.links[0]], []

    def symbol(name, value):
        values[name] = float(value)
        return trace.parameter(name)

    for j, (joint, link) in enumerate(zip(robot.joints, robot.links[1:], strict=True), start=1):
        second = np.empty((3, 3), dtype=object)
        for key, (row, column) in MOMENTS.items():
            second[row, column] = second[column, row] = symbol(f"{key}{j}", link.inertia.second_moments[row, column])
        first = [symbol(f"M{axis}{j}", link.inertia.first_moments[k]) for k, axis in enumerate("XYZ")]
        mass = symbol(f"M{j}", link.inertia.mass)
        links.append(Link(link.name, Inertia(mass, np.array(first, dtype=object), second)))
        rotor = symbol(f"IA{j}", joint.rotor_inertia)
        joints.append(Joint(joint.name, joint.antecedent, joint.prismatic, joint.placement, rotor_inertia=rotor))
    return Robot(robot.name, tuple(links), tuple(joints), robot.frames, gravity=robot.gravity), values
