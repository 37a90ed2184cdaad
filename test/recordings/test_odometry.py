"""Recordings of a robot whose base moves: a simulated flying arm under external forces, with efforts by Pinocchio.
Odometry has the motion of the base, at an eighth of the rate of the joints."""

from pathlib import Path

import numpy as np
import pytest
from peers import flights
from peers.recorded import message, messages, odometry, panda_motion, write_bag

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.checking.check import check
from robot_dynamics.checking.live_check import LiveCheck
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.cli.main import main
from robot_dynamics.errors import InvalidInputError, RecordingError
from robot_dynamics.identification.base_parameters import compute_base_parameters
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.motion_samples import sample_random_motions
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_samples import sample_of_joint_state
from robot_dynamics.recordings.recording import open_recording

STRIDE = 8  # joint states for each odometry
DYNAMICS = Dynamics(load_robot("free_flying_arm", gravity=list(flights.GRAVITY)))
NAMES, BASE = DYNAMICS.joint_names, "base_body"


def flight(seed, duration=10.0):
    """[(topic, message)]"""
    pairs = []
    for number, sample in enumerate(flights.flight(seed, duration)):
        pairs.append(("/joint_states", message(sample.time, NAMES, sample.q, sample.qd, sample.efforts)))
        if number % STRIDE == 0:
            pairs.append(("/odom", odometry(sample.time, sample.pose, sample.twist)))
    return pairs


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flights")
    return [write_bag(folder / f"flight_{seed}", flight(seed)) for seed in (1, 2)]


@pytest.mark.slow
def test_check_of_a_flying_arm_passes_with_its_model(bags):
    recording = open_recording(bags[0], direct_drives(NAMES), base=BASE)
    result = check(recording, DYNAMICS, load_tolerances())
    assert result.passed and result.comparison.samples > 900
    normalised = [verdict.joint.normalised for verdict in result.verdicts]
    print("normalised RMS", np.round(normalised, 4))
    assert max(normalised) < 0.02


@pytest.mark.slow
def test_quaternions_with_changing_sign_give_the_same_check(bags, tmp_path):
    pairs = flight(1, 6.0)
    for number, (topic, odometry_message) in enumerate(pairs):
        if topic == "/odom" and number % 5 < 3:
            q = odometry_message.pose.pose.orientation
            q.x, q.y, q.z, q.w = -q.x, -q.y, -q.z, -q.w
    paths = write_bag(tmp_path / "turned", pairs), write_bag(tmp_path / "same", flight(1, 6.0))
    checks = [
        check(open_recording(path, direct_drives(NAMES), base=BASE), DYNAMICS, load_tolerances()) for path in paths
    ]
    rms = [[verdict.joint.rms for verdict in result.verdicts] for result in checks]
    assert rms[0] == pytest.approx(rms[1], rel=1e-9) and checks[0].passed


@pytest.mark.slow
def test_commands_check_and_identify_a_flying_arm(bags, tmp_path, capsys):
    """The first description has a gripper that the robot does not have, so that the check fails."""
    wrong, fitted, drives = (str(tmp_path / name) for name in ("wrong.yaml", "fitted.yaml", "drives.yaml"))
    robot = DYNAMICS.robot.with_payload("arm_tool0", Inertia(1.5, np.array([0.0, 0.0, 0.15])))
    Path(wrong).write_text(write_mdh_yaml(robot))
    paths = list(map(str, bags))
    assert main(["replay-check", *paths, "--robot", wrong]) == 3
    identify = ["identify", paths[0], "--validate", paths[1], "--robot", wrong]
    assert main([*identify, "--output", fitted, "--output-drives", drives]) == 0
    capsys.readouterr()
    assert main(["replay-check", paths[1], "--robot", fitted, "--drives", drives]) == 0
    assert main(["replay-check", paths[1], "--robot", wrong, "--topic", "/odom", "--topic", "/joint_states"]) == 3


@pytest.mark.slow
def test_base_parameters_of_joint_efforts_exclude_the_inertia_of_the_base():
    """The inertia of the flying body is in no row of the joints."""
    columns, whole = build_identification_model(DYNAMICS, direct_drives(NAMES)), compute_base_parameters(DYNAMICS)
    assert columns.inertial_count < sum(
        not name.startswith(("Fv", "Fs")) for name in np.array(whole.names)[whole.independent]
    )
    motions = sample_random_motions(DYNAMICS, 50, seed=3)
    rows = columns.regressor_at(motions.q, motions.qd, motions.qdd, motions.base)
    efforts = DYNAMICS.inverse(motions.q, motions.qd, motions.qdd, base=motions.base)
    values = np.concatenate([columns.grouping_matrix @ DYNAMICS.parameters, np.zeros(6)])
    assert np.abs(rows @ values - efforts).max() < 1e-8 * np.abs(efforts).max()


def test_open_recording_refuses_recordings_without_the_motion_of_the_base(bags, tmp_path):
    drives = direct_drives(NAMES)
    still = write_bag(tmp_path / "still", messages(panda_motion(2.0)))
    with pytest.raises(RecordingError, match="it has no topic of nav_msgs/msg/Odometry"):
        open_recording(still, drives, base=BASE)
    twice = write_bag(tmp_path / "twice", [*flight(1, 0.2), ("/slam", odometry(0.2, np.eye(4), np.zeros(6)))])
    with pytest.raises(RecordingError, match="name one of /odom, /slam"):
        open_recording(twice, drives, base=BASE)
    assert open_recording(twice, drives, ["/odom"], base=BASE).topics == ("/joint_states", "/odom")
    other_link = DYNAMICS.robot.base_link.replace("body", "footprint")
    with pytest.raises(RecordingError, match="/odom describes the motion of 'base_body': 'base_footprint' is the base"):
        check(open_recording(bags[0], drives, base=other_link), DYNAMICS, load_tolerances())
    table = tmp_path / "table.csv"
    table.write_text("time,a.position,a.effort\n0,0,0\n")
    with pytest.raises(RecordingError, match="only a bag has the motion of the base"):
        open_recording(table, drives, base=BASE)
    with pytest.raises(InvalidInputError, match=r"the base of .* moves: give its state"):
        check(open_recording(bags[0], drives), DYNAMICS, load_tolerances())


def test_live_check_of_a_moving_base_agrees_with_the_check_of_the_recording(bags):
    drives = direct_drives(NAMES)
    recording = open_recording(bags[0], drives, base=BASE)
    live = LiveCheck(DYNAMICS, drives, load_tolerances())
    for number, sample in enumerate(recording.source.samples(recording.topics, BASE)):
        live.feed(sample)
        if number % 20 == 0:
            live.advance()
    live.finish()
    live_result, result = live.result(), check(recording, DYNAMICS, load_tolerances())
    rms = [[verdict.joint.rms for verdict in each.verdicts] for each in (live_result, result)]
    assert live_result.passed and rms[0] == pytest.approx(rms[1], rel=0.01)  # splines of odometry end at each call
    waiting = LiveCheck(DYNAMICS, drives, load_tolerances())
    waiting.feed(sample_of_joint_state("/joint_states", 1, message(0.0, NAMES, np.zeros(6))))
    assert waiting.find_stale_names(2, 1.0) == ["the base"]
