"""Named set-ups of pages. The comment `% setup: NAME` in a page calls the function NAME(folder) of this file.

A function makes files in the folder in which the blocks of the page run.
"""

from pathlib import Path

import numpy as np
import pinocchio as pin
from peers.recorded import loaded_panda, messages, panda_model, panda_motion, write_bag

DURATION = 12.0  # [s]


def run(folder: Path) -> None:
    """A bag `run`: joint_states of a Panda in motion, with the efforts of its model."""
    write_bag(folder / "run", messages(panda_motion(duration=DURATION)))


def run_loaded(folder: Path) -> None:
    """A bag `run_loaded`: the same motion with 2.5 kg at the flange, which the description does not have."""
    write_bag(folder / "run_loaded", messages(panda_motion(duration=DURATION, model=loaded_panda(2.5))))


def nightly_bags(folder: Path) -> None:
    """Four bags of a Panda with friction and noisy efforts: three sound ones, `thursday` with 1 kg at the flange."""
    for seed, day in enumerate(("monday", "tuesday", "wednesday", "thursday")):
        model = loaded_panda(1.0) if day == "thursday" else None
        motion = panda_motion(duration=15.0, seed=seed, viscous=0.05, coulomb=0.05, model=model)
        noise = np.random.default_rng(seed).normal(scale=0.1, size=motion.efforts.shape)
        write_bag(folder / "bags" / day, messages(motion._replace(efforts=motion.efforts + noise)))


def control_package(folder: Path) -> None:
    """The package `robot_dynamics_control` of the checkout."""
    (folder / "robot_dynamics_control").symlink_to(Path(__file__).parents[1] / "robot_dynamics_control")


def sound_and_pushed(folder: Path) -> None:
    """Bags of a Panda with noisy efforts: `sound`, and `pushed`, with 20 N downwards on the flange from 6 to 7 s."""
    sound = panda_motion(duration=40.0, seed=1, speed=2.0)
    pushed = panda_motion(duration=DURATION, seed=2, speed=2.0)
    model = panda_model()
    data, frame = model.createData(), model.getFrameId("panda_link8")
    for k in np.flatnonzero((pushed.times >= 6) & (pushed.times < 7)):
        J = pin.computeFrameJacobian(model, data, pushed.q[k], frame, pin.LOCAL_WORLD_ALIGNED)
        pushed.efforts[k] += J.T @ np.array([0, 0, 20.0, 0, 0, 0])  # the motors act against the force
    for name, motion in (("sound", sound), ("pushed", pushed)):
        noise = np.random.default_rng(3).normal(scale=0.2, size=motion.efforts.shape)
        write_bag(folder / name, messages(motion._replace(efforts=motion.efforts + noise)))
