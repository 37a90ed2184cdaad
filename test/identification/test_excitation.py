"""Trajectories that excite a Panda: within its limits, better than chance, and worth it."""

import csv

import numpy as np
import pinocchio as pin
import pytest
from peers.known_panda import NOISE
from peers.recorded import JOINTS, panda_model

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.commands.main import main
from robot_dynamics.errors import QuestionError
from robot_dynamics.identification.effort_columns import effort_columns
from robot_dynamics.identification.excitation import TrajectoryFamily, exciting_trajectory, joint_bounds
from robot_dynamics.identification.fitting import fitted
from robot_dynamics.identification.samples import Samples
from robot_dynamics.replay.drives import direct_drives
from robot_dynamics.replay.motions import Motion

COLUMNS = effort_columns(Dynamics(load_robot("panda")), direct_drives(JOINTS))
ACCELERATION = 8.0
BOUNDS = joint_bounds(COLUMNS.dynamics, ACCELERATION)
RATE = 50.0


@pytest.fixture(scope="module")
def exciting():
    return exciting_trajectory(COLUMNS, BOUNDS, iterations=12)


@pytest.fixture(scope="module")
def random():
    family, chance = TrajectoryFamily(BOUNDS, 20.0, 5), np.random.default_rng(11)
    return [family(family.random(chance)) for _ in range(12)]


def assert_within_limits(q, qd, qdd):
    model = panda_model()
    assert (q > model.lowerPositionLimit).all() and (q < model.upperPositionLimit).all()
    assert (np.abs(qd) < model.velocityLimit).all() and np.abs(qdd).max() <= ACCELERATION * (1 + 1e-12)
    assert max(np.abs(rates[[0, -1]]).max() for rates in (qd, qdd)) < 1e-9


def test_limits_are_kept_between_the_points_of_the_grid_too(exciting, random):
    times = np.linspace(0, 20, 20_001)
    for trajectory in (exciting[0], *random[:4]):
        q, qd, qdd = trajectory(times)
        assert_within_limits(q, qd, qdd)
        assert np.abs(np.gradient(q, times, axis=0) - qd)[1:-1].max() < 1e-5  # they are derivatives
        assert np.abs(np.gradient(qd, times, axis=0) - qdd)[1:-1].max() < 1e-4
        busy = [np.abs(qd).max(0) / panda_model().velocityLimit, np.abs(qdd).max(0) / ACCELERATION,
                np.ptp(q, axis=0) / (BOUNDS.upper - BOUNDS.lower)]  # fmt: skip
        if trajectory is not exciting[0]:
            assert np.max(busy, axis=0).min() > 0.8  # what is allowed is used


def condition(trajectory):
    X = COLUMNS.rows_at(*trajectory(np.arange(1000) / 50.0)).reshape(7000, -1)
    return np.linalg.cond(X / np.linalg.norm(X, axis=0))


def test_it_is_better_than_chance(exciting, random):
    by_chance = [condition(trajectory) for trajectory in random]
    found = condition(exciting[0])
    print(
        f"condition number {found:.2f}, random ones {np.median(by_chance):.1f} in the median, {min(by_chance):.1f} best"
    )
    assert found == pytest.approx(exciting[1], rel=0.1)
    assert 1.5 * found < np.median(by_chance) and 1.2 * found < min(by_chance)


class Simulated:
    """A recording of a trajectory: efforts by Pinocchio, friction, and noise."""

    name, notes = "simulated", ()

    def __init__(self, trajectory, seed):
        times = np.arange(1000) / RATE
        q, qd, qdd = trajectory(times)
        model = panda_model()
        data = model.createData()
        efforts = np.array([pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)])
        efforts += 1.5 * qd + 0.5 * np.sign(qd) + NOISE * np.random.default_rng(seed).normal(size=q.shape)
        self.motion = Motion(0.0, RATE, 8.0, q, qd, qdd, efforts, efforts, np.ones(7, dtype=bool))

    def motions(self, tally, *, cutoff=None):
        yield self.motion


def test_it_makes_parameters_more_certain(exciting, random):
    """The deviations that are told, and the errors that there are."""
    truth = COLUMNS.from_parameters @ COLUMNS.dynamics.parameters
    for number, name in enumerate(COLUMNS.names[: len(truth)]):
        truth[number] += {"Fv": 1.5, "Fs": 0.5}.get(name.partition(".")[0], 0)
    truth = np.concatenate([truth, np.zeros(7)])
    usual = np.argsort([condition(trajectory) for trajectory in random])[len(random) // 2]
    deviations, errors = [], []
    for trajectory in (exciting[0], random[usual]):
        fits = [fitted(Samples([Simulated(trajectory, seed)], COLUMNS)) for seed in range(4)]
        deviations.append(np.exp(np.mean([np.log(fit.deviations) for fit in fits], axis=0)))
        errors.append(np.sqrt(np.mean([(fit.values - truth) ** 2 for fit in fits], axis=0)))
    gains = [np.exp(np.mean(np.log(by_chance / best))) for best, by_chance in (deviations, errors)]
    print(f"deviations {gains[0]:.2f} times smaller than by chance, errors {gains[1]:.2f} times")
    assert gains[0] > 1.05 and gains[1] > 1.05 and (deviations[0] < deviations[1]).mean() > 0.6


def test_the_command_writes_it(tmp_path, capsys):
    path = tmp_path / "out" / "trajectory.csv"
    told = ["excite", "panda", "--output", str(path), "--iterations", "1", "--acceleration", str(ACCELERATION)]
    assert main(told) == 0
    said = capsys.readouterr()
    assert "condition number" in said.out and said.err == ""
    with path.open() as lines:
        head = next(csv.reader(lines))
        rows = np.loadtxt(lines, delimiter=",")
    assert head[:4] == ["time", "panda_joint1.position", "panda_joint1.velocity", "panda_joint1.acceleration"]
    assert rows.shape == (2001, 22) and rows[-1, 0] == 20
    assert_within_limits(*(rows[:, first::3] for first in (1, 2, 3)))
    again = tmp_path / "again.csv"
    assert main([*told[:3], str(again), *told[4:]]) == 0 and again.read_text() == path.read_text()
    capsys.readouterr()
    for arguments, expected in (
        (["--harmonics", "1"], "at least 2"), (["--margin", "0.5"], "margin 0.5"),
        (["--duration", "-1"], "more than 0"),
        (["--acceleration", "nan"], "more than 0"), (["--rate", "inf"], "less than 10 million"),
    ):  # fmt: skip
        assert main(["excite", "panda", "--output", str(path), *arguments]) == 1
        assert expected in capsys.readouterr().err


def test_robots_with_loops_are_refused():
    dynamics = Dynamics(load_robot("five_bar"))
    columns = effort_columns(dynamics, direct_drives(dynamics.joint_names))
    with pytest.raises(QuestionError, match="without loops"):
        exciting_trajectory(columns, joint_bounds(dynamics))


def test_joints_that_nobody_can_command_are_refused(tmp_path, capsys):
    path = tmp_path / "trajectory.csv"
    assert main(["excite", "manutec_r3", "--output", str(path), "--iterations", "1"]) == 1
    assert "'manutec_r3': no motor drives spring_1, spring_2, spring_3" in capsys.readouterr().err
    assert not path.exists()
