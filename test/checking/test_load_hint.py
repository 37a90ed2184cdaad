"""A load that the description lacks is suspected, other errors of a description are not. Efforts by Pinocchio."""

import numpy as np
import pytest
from peers.recorded import loaded_panda, messages, panda_motion, write_bag

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.checking.batch_check import CheckOptions, check_recording
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.recording import open_recording


@pytest.fixture(scope="module")
def options():
    dynamics = Dynamics(load_robot("panda"))
    return CheckOptions(dynamics, direct_drives(dynamics.joint_names), (), load_tolerances())


def checked(path, motion, options):
    noise = np.random.default_rng(0).normal(scale=0.1, size=motion.q.shape)
    bag = write_bag(path, messages(motion._replace(efforts=motion.efforts + noise)))
    result, _ = check_recording(open_recording(bag, options.drives), options)
    return result, [note for note in result.notes if "does the" in note]


def test_load_throughout_is_suspected_with_its_mass(tmp_path, options):
    result, (hint,) = checked(tmp_path / "loaded", panda_motion(model=loaded_panda(2.0)), options)
    assert not result.passed and "does the robot carry a load that the description lacks?" in hint
    mass = float(hint.partition("load of ")[2].split()[0])
    assert mass == pytest.approx(2.0, abs=0.2)


def test_other_errors_are_no_load(tmp_path, options):
    motion = panda_motion(viscous=6.0, coulomb=6.0)
    efforts = panda_motion().efforts
    swapped = efforts[:, [0, 1, 2, 4, 3, 5, 6]]
    for number, wrong in enumerate((motion.efforts, swapped, 1.2 * efforts, -efforts)):
        result, hints = checked(tmp_path / str(number), motion._replace(efforts=wrong), options)
        assert not result.passed and hints == [], number
    result, hints = checked(tmp_path / "sound", panda_motion(), options)
    assert result.passed and hints == []
