"""Trajectories that excite a Panda: within its limits, better than chance, and worth it."""

import csv
import fcntl
import os
import pty
import re
import struct
import sys
import termios
import time
from dataclasses import replace
from subprocess import Popen

import numpy as np
import pinocchio as pin
import pytest
from peers.known_panda import NOISE
from peers.recorded import JOINTS, panda_model
from scipy.optimize import minimize

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.cli.main import main
from robot_dynamics.codegen.trace.derivatives import DifferentiableProgram
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.identification import excitation
from robot_dynamics.identification.condition_number import LogConditionNumber
from robot_dynamics.identification.excitation import TrajectoryParametrization, design_excitation, joint_bounds
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.samples import Samples
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_motions import Motion

COLUMNS = build_identification_model(Dynamics(load_robot("panda")), direct_drives(JOINTS))
ACCELERATION = 8.0
BOUNDS = joint_bounds(COLUMNS.dynamics, ACCELERATION)
RATE = 50.0


@pytest.fixture(scope="module")
def exciting():
    return design_excitation(COLUMNS, BOUNDS, iterations=12)


@pytest.fixture(scope="module")
def random():
    family, chance = TrajectoryParametrization(BOUNDS, 20.0, 5), np.random.default_rng(11)
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
    X = COLUMNS.regressor_at(*trajectory(np.arange(1000) / 50.0)).reshape(7000, -1)
    return np.linalg.cond(X / np.linalg.norm(X, axis=0))


def test_it_is_better_than_chance(exciting, random):
    by_chance = [condition(trajectory) for trajectory in random]
    found = condition(exciting[0])
    print(
        f"condition number {found:.2f}, random ones {np.median(by_chance):.1f} in the median, {min(by_chance):.1f} best"
    )
    assert found == pytest.approx(exciting[1], rel=0.1)
    assert 1.5 * found < np.median(by_chance) and 1.2 * found < min(by_chance)


TIMES = np.arange(60) * 20.0 / 60


def central_differences(function, x, step=1e-6):
    return np.array([(function(x + step * unit) - function(x - step * unit)) / (2 * step) for unit in np.eye(len(x))])


@pytest.mark.parametrize("acceleration", [np.inf, 8.0, 2.0])
def test_gradient_of_the_condition_number_by_the_numbers_of_a_trajectory(acceleration):
    """Whichever bound is the narrow one, that of position, velocity or acceleration."""
    family = TrajectoryParametrization(joint_bounds(COLUMNS.dynamics, acceleration), 20.0, 5)
    numbers = family.random(np.random.default_rng(5))
    criterion = LogConditionNumber(COLUMNS, np.full(7, 0.1))

    def value(numbers):
        return criterion.with_gradient(*family(numbers)(TIMES))[0]

    _, by_motion = criterion.with_gradient(*family(numbers)(TIMES))
    found = family.gradient(numbers, by_motion, TIMES)
    expected = central_differences(value, numbers)
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()
    assert criterion(*family(numbers)(TIMES)) == pytest.approx(value(numbers), abs=1e-9)
    exact = np.log(condition_at(family(numbers), TIMES))
    assert LogConditionNumber(COLUMNS)(*family(numbers)(TIMES)) == pytest.approx(exact, abs=1e-9)


def test_gradient_where_motors_are_coupled():
    """By positions, velocities and accelerations at some samples; and its value by NumPy."""
    ratios = np.eye(7)
    ratios[5, 4] = -0.5
    drives = replace(direct_drives(JOINTS), ratios=ratios)
    columns = build_identification_model(COLUMNS.dynamics, drives)
    assert len(columns.names) == len(COLUMNS.names) + 3
    rng = np.random.default_rng(6)
    motion, criterion = list(rng.uniform(-1, 1, (3, 30, 7))), LogConditionNumber(columns, np.full(7, 0.3))
    _, gradients = criterion.with_gradient(*motion)
    for place, found in enumerate(gradients):
        for sample, joint in ((0, 1), (7, 4), (12, 5), (29, 2)):
            values = []
            for sign in (1, -1):
                moved = [part.copy() for part in motion]
                moved[place][sample, joint] += sign * 1e-5
                values.append(criterion.with_gradient(*moved)[0])
            expected = (values[0] - values[1]) / 2e-5
            assert found[sample, joint] == pytest.approx(expected, abs=1e-7 + 1e-5 * abs(expected))
    X = columns.regressor_at(*motion).reshape(210, -1)
    s = np.linalg.svd(X / np.linalg.norm(X, axis=0), compute_uv=False)
    assert LogConditionNumber(columns)(*motion) == pytest.approx(np.log(s[0] / s[-1]), abs=1e-6)


def test_efforts_without_gravity_are_refused():
    columns = build_identification_model(
        COLUMNS.dynamics, replace(direct_drives(JOINTS), excludes_gravity=True), compiled=False
    )
    with pytest.raises(InvalidInputError, match="measured efforts exclude gravity"):
        design_excitation(columns, BOUNDS)


def condition_at(trajectory, times):
    X = COLUMNS.regressor_at(*trajectory(times)).reshape(7 * len(times), -1)
    return np.linalg.cond(X / np.linalg.norm(X, axis=0))


def test_it_ends_no_worse_than_finite_differences_with_a_tenth_of_the_evaluations(monkeypatch):
    """Of the same iterations from the same beginning, with steps that smooth the steps of friction as well as any."""
    evaluations, beginnings = [0], []
    counted = DifferentiableProgram.evaluate

    def count(self, *motion):
        evaluations[0] += 1
        return counted(self, *motion)

    monkeypatch.setattr(DifferentiableProgram, "evaluate", count)
    found = design_excitation(COLUMNS, BOUNDS, iterations=10, seed=3)
    by_gradients = evaluations[0] - excitation.INITIAL_TRAJECTORIES
    family, chance = TrajectoryParametrization(BOUNDS, 20.0, 5), np.random.default_rng(3)
    criterion = LogConditionNumber(COLUMNS)

    def value(numbers):
        return criterion(*family(numbers)(TIMES))

    beginnings = [family.random(chance) for _ in range(excitation.INITIAL_TRAJECTORIES)]
    evaluations[0] = 0
    search = minimize(value, min(beginnings, key=value), method="BFGS", options={"maxiter": 10, "eps": 0.03})
    by_differences = evaluations[0] - excitation.INITIAL_TRAJECTORIES
    print(f"condition number {found.condition:.3f} of {by_gradients} evaluations, by finite differences "
          f"{np.exp(search.fun):.3f} of {by_differences}")  # fmt: skip
    assert found.iterations == 10 and found.complete
    assert found.condition <= np.exp(search.fun) * 1.001
    assert 10 * by_gradients < by_differences


def test_a_time_limit_gives_the_best_trajectory_so_far(monkeypatch):
    told, estimates = [], []
    found = design_excitation(COLUMNS, BOUNDS, iterations=4, on_estimate=estimates.append,
                                on_iteration=lambda *each: told.append(each))  # fmt: skip
    assert found.complete and found.iterations == 4 and [done for done, _ in told] == [1, 2, 3, 4]
    assert [value for _, value in told] == sorted((value for _, value in told), reverse=True)
    assert len(estimates) == 1 and estimates[0] > 0
    at_once = design_excitation(COLUMNS, BOUNDS, iterations=4, time_limit=1e-9)
    assert not at_once.complete and at_once.iterations == 0 and at_once.condition >= found.condition
    assert_within_limits(*at_once.trajectory(np.linspace(0, 20, 2001)))
    now, clock = time.monotonic(), []
    monkeypatch.setattr(excitation.time, "monotonic", lambda: now + (10.0 if clock else 0.0))
    cut = design_excitation(COLUMNS, BOUNDS, iterations=4, time_limit=5.0,
                              on_iteration=lambda done, _: clock.append(1) if done == 2 else None)  # fmt: skip
    assert not cut.complete and cut.iterations == 2 and cut.condition == told[1][1]


def test_on_a_terminal_it_shows_how_far_it_is_and_says_when_time_is_over(tmp_path):
    """In a process of its own whose stderr is a terminal."""
    controlling, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("4H", 24, 100, 0, 0))  # of a new one the size is zero
    path = tmp_path / "trajectory.csv"
    with (tmp_path / "out").open("w") as out, (tmp_path / "shown").open("wb") as shown:
        command = [sys.executable, "-m", "robot_dynamics.cli.main", "excite", "panda", "--output", str(path)]
        process = Popen([*command, "--iterations", "60"], stdout=out, stderr=terminal)
        os.close(terminal)
        while True:
            try:
                piece = os.read(controlling, 4096)
            except OSError:  # the terminal is closed as the process ends
                break
            if not piece:
                break
            shown.write(piece)
        assert process.wait(timeout=60) == 0
    os.close(controlling)
    bar = (tmp_path / "shown").read_text()
    # the bar shows at most ten states a second, and is removed at the end
    assert "condition number" in bar and "0/60" in bar and re.search(r" [1-9]\d?/60", bar)
    said = (tmp_path / "out").read_text()
    assert "60 iterations for 69 parameters: about" in said and "condition number" in said and path.exists()


def test_the_command_says_that_time_was_over(tmp_path, capsys):
    path = tmp_path / "trajectory.csv"
    assert main(["excite", "panda", "--output", str(path), "--time-limit", "1e-9"]) == 0
    said = capsys.readouterr()
    assert "time limit of 1e-09 s reached after 0 of 50 iterations: this is the best trajectory so far" in said.out
    assert path.exists() and said.err == ""
    assert main(["excite", "panda", "--output", str(path), "--time-limit", "0"]) == 1
    assert "--time-limit 0: more than 0 is needed" in capsys.readouterr().err


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

    def motions(self, statistics, *, cutoff=None):
        yield self.motion


def test_it_makes_parameters_more_certain(exciting, random):
    """The deviations that are told, and the errors that there are."""
    truth = COLUMNS.grouping_matrix @ COLUMNS.dynamics.parameters
    for number, name in enumerate(COLUMNS.names[: len(truth)]):
        truth[number] += {"Fv": 1.5, "Fs": 0.5}.get(name.partition(".")[0], 0)
    truth = np.concatenate([truth, np.zeros(7)])
    usual = np.argsort([condition(trajectory) for trajectory in random])[len(random) // 2]
    standard_deviations, errors = [], []
    for trajectory in (exciting[0], random[usual]):
        fits = [fit_parameters(Samples([Simulated(trajectory, seed)], COLUMNS)) for seed in range(4)]
        standard_deviations.append(np.exp(np.mean([np.log(fit.standard_deviations) for fit in fits], axis=0)))
        errors.append(np.sqrt(np.mean([(fit.values - truth) ** 2 for fit in fits], axis=0)))
    gains = [np.exp(np.mean(np.log(by_chance / best))) for best, by_chance in (standard_deviations, errors)]
    print(f"deviations {gains[0]:.2f} times smaller than by chance, errors {gains[1]:.2f} times")
    assert gains[0] > 1.05 and gains[1] > 1.05 and (standard_deviations[0] < standard_deviations[1]).mean() > 0.6


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
    columns = build_identification_model(dynamics, direct_drives(dynamics.joint_names))
    with pytest.raises(InvalidInputError, match="without loops"):
        design_excitation(columns, joint_bounds(dynamics))


def test_joints_that_nobody_can_command_are_refused(tmp_path, capsys):
    path = tmp_path / "trajectory.csv"
    assert main(["excite", "manutec_r3", "--output", str(path), "--iterations", "1"]) == 1
    assert "'manutec_r3': no motor drives spring_1, spring_2, spring_3" in capsys.readouterr().err
    assert not path.exists()
