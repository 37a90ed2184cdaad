"""Operations of inverse and direct models: general arms, the Puma 560 and the Stanford arm, beside printed counts.

Sines and cosines are not counted. A printed count stands here only where its source was read. It depends on
assumptions:

- general arms have revolute joints, arbitrary angles and distances between axes, and arbitrary bodies. The rows "right
  angles" have angles of 90 degrees instead, as most arms have;
- the Puma 560 has the parameters of config/robots/puma560.yaml without friction. The model of Armstrong and others
  leaves out terms below 1 % of the largest in the same sum; the one here is exact;
- the Stanford arm has diagonal inertias and rotors, and centres of mass on an axis or in a plane of its frames, at the
  places of the table of R. Paul, Robot Manipulators, 1981. No printed count with these assumptions was at hand.

Renaud's arm is in test/codegen/trace/test_renaud.py.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from robot_dynamics import load_robot
from robot_dynamics.codegen.trace.models import direct_model, inverse_model
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.model.robot import Frame, Link, Robot

RIGHT_ANGLE = np.pi / 2

PUMA_TOTAL = 305
"""B. Armstrong, O. Khatib, J. Burdick, The explicit dynamic model and inertial parameters of the PUMA 560 arm, 1986,
abstract: it takes 305 calculations, "one fifth the number required by the recursive Newton-Euler method"."""

STANFORD_ROWS = (
    {"r": 0.412},
    {"alpha": -RIGHT_ANGLE, "r": 0.154},
    {"alpha": RIGHT_ANGLE},
    {"theta": -RIGHT_ANGLE},
    {"alpha": -RIGHT_ANGLE},
    {"alpha": RIGHT_ANGLE},
)
"""MDH rows of the Stanford arm [rad, m]; its third joint is prismatic."""

STANFORD_BODIES = (  # mass, centre of mass, moments of inertia about it
    (9.29, (0, 0.0175, -0.1105), (0.276, 0.255, 0.071)),
    (5.01, (0, -0.1054, 0), (0.108, 0.018, 0.100)),
    (4.25, (0, 0, -0.6447), (2.51, 2.51, 0.006)),
    (1.08, (0, 0.0092, -0.0054), (0.002, 0.001, 0.001)),
    (0.63, (0, -0.0566, 0), (0.003, 0.003, 0.0004)),
    (0.51, (0, 0, 0.1554), (0.013, 0.013, 0.0003)),
)
STANFORD_ROTORS = (0.953, 2.193, 0.782, 0.106, 0.097, 0.020)


def chain(name, rows, bodies, prismatic=(), rotors=None):
    """A Robot that is a chain of MDH rows."""
    joints, links = [], [Link("base", Inertia())]
    for number, (row, body) in enumerate(zip(rows, bodies, strict=True), start=1):
        rotor = rotors[number - 1] if rotors else 0.0
        placement = placement_from_mdh(MDHParameters(**row))
        joints.append(Joint(f"joint_{number}", number - 1, number in prismatic, placement, rotor_inertia=rotor))
        links.append(Link(f"link_{number}", body))
    frames = [Frame(link.name, number, np.eye(4)) for number, link in enumerate(links)]
    return Robot(name, tuple(links), tuple(joints), tuple(frames))


def general_arm(n, right_angles):
    """An arm with n revolute joints, random distances, and random bodies."""
    rng = np.random.default_rng(0)
    rows = [{}]
    for _ in range(n - 1):
        alpha = rng.choice([-1, 1]) * RIGHT_ANGLE if right_angles else rng.uniform(0.3, 1.2)
        rows.append({"alpha": alpha, "d": rng.uniform(0.1, 0.5), "r": rng.uniform(0.1, 0.5)})
    bodies = []
    for _ in range(n):
        factor = rng.uniform(-1, 1, (3, 3))
        bodies.append(Inertia.about_centre_of_mass(rng.uniform(1, 3), factor @ factor.T, rng.uniform(-0.3, 0.3, 3)))
    return chain("general arm", rows, bodies)


def stanford_arm():
    bodies = [
        Inertia.about_centre_of_mass(mass, np.diag(moments), np.array(centre))
        for mass, centre, moments in STANFORD_BODIES
    ]
    return chain("Stanford arm", STANFORD_ROWS, bodies, prismatic=(3,), rotors=STANFORD_ROTORS)


def puma_560():
    robot = load_robot("puma560")
    joints = [replace(joint, viscous_friction=0.0, coulomb_friction=0.0) for joint in robot.joints]
    return replace(robot, joints=tuple(joints))


def print_row(label, multiplications, additions):
    print(f"{label:<82} {multiplications:>5} {additions:>5} {multiplications + additions:>6}")


def main():
    print(f"{'inverse model':<82} {'×':>5} {'+':>5} {'total':>6}")
    for n in (6, 7):
        for right_angles in (False, True):
            operations = inverse_model(general_arm(n, right_angles)).operations
            angles = ", right angles" if right_angles else ""
            print_row(f"general arm, n = {n}{angles}: here", *operations[:2])
    print(f"{'Puma 560: Armstrong, Khatib, Burdick, 1986, abbreviated':<94} {PUMA_TOTAL:>6}")
    for robot in (puma_560(), stanford_arm()):
        print_row(f"{robot.name}: here", *inverse_model(robot).operations[:2])
        print_row(f"{robot.name}, direct model: here", *direct_model(robot).operations[:2])


if __name__ == "__main__":
    main()
