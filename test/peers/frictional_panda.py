"""Recordings of a Panda whose joints have friction of several kinds.

Efforts are those of Pinocchio without friction, and friction in closed form, joint by joint, with these efforts as
loads."""

import numpy as np

from peers.known_panda import NOISE
from peers.recorded import panda_motion
from robot_dynamics.recordings.joint_motions import Motion

RATE = 50.0
VISCOUS = np.array([3.0, 2.5, 2.0, 2.0, 0.5, 0.4, 0.3])
COULOMB = np.array([4.0, 5.0, 3.0, 3.0, 1.2, 0.9, 0.8])
PLAIN = [{} for _ in range(7)]
VARIED = [
    {"Fst": 3.0, "vs": 0.1},
    {"mu": 0.2},
    {"Fst": -2.5, "vs": 0.2},
    {"mu": 0.25},
    {},
    {"Fva": -0.3},
    {},
]


def friction_of_joint(number, velocity, load, further):
    """Friction [N m] of a joint at a velocity under a load; further: parameters beside Fv and Fs."""
    if velocity == 0:
        return 0.0
    direction = 1 if velocity > 0 else -1
    viscous = VISCOUS[number] + direction * further.get("Fva", 0.0)
    dry = COULOMB[number] + further.get("mu", 0.0) * abs(load)
    if "Fst" in further:
        dry += further["Fst"] * further["vs"] ** 2 / (further["vs"] ** 2 + velocity**2)
    return viscous * velocity + direction * dry


class FrictionalPanda:
    """A recording with exact motions.

    further: parameters of the 7 joints beside Fv and Fs; noise: relative to NOISE."""

    notes = ()

    def __init__(self, further, seed=0, noise=1.0, duration=60.0, motion_seed=0):
        self.name = f"frictional {motion_seed}"
        motion = panda_motion(duration=duration, rate=RATE, seed=motion_seed)
        friction = np.array(
            [
                [friction_of_joint(j, qd[j], load[j], further[j]) for j in range(7)]
                for qd, load in zip(motion.qd, motion.efforts, strict=True)
            ]
        )
        scatter = noise * NOISE * np.random.default_rng([seed, motion_seed]).normal(size=friction.shape)
        self.efforts = motion.efforts + friction + scatter
        moving = np.ones(friction.shape, dtype=bool)
        rows = motion.q, motion.qd, motion.qdd, self.efforts, self.efforts
        self.motion = Motion(0.0, RATE, 8.0, *rows, np.ones(7, dtype=bool), moving)

    source = part = message_count = None
    time_range = (-np.inf, np.inf)

    def motions(self, statistics, *, cutoff=None, progress=None):
        yield self.motion

    def signal_segments(self):
        return [self.motion]
