"""Excitation trajectories of a Panda: they respect its limits and reduce the condition number and errors of fits."""

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

MODEL = build_identification_model(Dynamics(load_robot("panda")), direct_drives(JOINTS))
ACCELERATION = 8.0
BOUNDS = joint_bounds(MODEL.dynamics, ACCELERATION)
RATE = 50.0


@pytest.fixture(scope="module")
def exciting():
    return design_excitation(MODEL, BOUNDS, iterations=12)


@pytest.fixture(scope="module")
def random():
    parametrization, rng = TrajectoryParametrization(BOUNDS, 20.0, 5), np.random.default_rng(11)
    return [parametrization(parametrization.random(rng)) for _ in range(12)]


def assert_within_limits(q, qd, qdd):
    model = panda_model()
    assert (q > model.lowerPositionLimit).all() and (q < model.upperPositionLimit).all()
    assert (np.abs(qd) < model.velocityLimit).all() and np.abs(qdd).max() <= ACCELERATION * (1 + 1e-12)
    assert max(np.abs(rates[[0, -1]]).max() for rates in (qd, qdd)) < 1e-9


def test_trajectories_respect_limits_between_grid_points(exciting, random):
    times = np.linspace(0, 20, 20_001)
    for trajectory in (exciting[0], *random[:4]):
        q, qd, qdd = trajectory(times)
        assert_within_limits(q, qd, qdd)
        assert np.abs(np.gradient(q, times, axis=0) - qd)[1:-1].max() < 1e-5  # consistent derivatives
        assert np.abs(np.gradient(qd, times, axis=0) - qdd)[1:-1].max() < 1e-4
        usage = [np.abs(qd).max(0) / panda_model().velocityLimit, np.abs(qdd).max(0) / ACCELERATION,
                np.ptp(q, axis=0) / (BOUNDS.upper - BOUNDS.lower)]  # fmt: skip
        if trajectory is not exciting[0]:
            assert np.max(usage, axis=0).min() > 0.8  # the bounds are reached


def condition(trajectory):
    X = MODEL.regressor_at(*trajectory(np.arange(1000) / 50.0)).reshape(7000, -1)
    return np.linalg.cond(X / np.linalg.norm(X, axis=0))


@pytest.mark.slow
def test_designed_trajectory_has_a_lower_condition_number_than_random_ones(exciting, random):
    random_conditions = [condition(trajectory) for trajectory in random]
    designed = condition(exciting[0])
    print(
        f"condition number {designed:.2f}, random ones {np.median(random_conditions):.1f} in the median, "
        f"{min(random_conditions):.1f} best"
    )
    assert designed == pytest.approx(exciting[1], rel=0.1)
    assert 1.5 * designed < np.median(random_conditions) and 1.2 * designed < min(random_conditions)


TIMES = np.arange(60) * 20.0 / 60


def central_differences(function, x, step=1e-6):
    return np.array([(function(x + step * unit) - function(x - step * unit)) / (2 * step) for unit in np.eye(len(x))])


@pytest.mark.slow
@pytest.mark.parametrize("acceleration", [np.inf, 8.0, 2.0])
def test_gradient_by_trajectory_parameters_agrees_with_finite_differences(acceleration):
    """The bound of position, velocity or acceleration is the active one."""
    parametrization = TrajectoryParametrization(joint_bounds(MODEL.dynamics, acceleration), 20.0, 5)
    parameters = parametrization.random(np.random.default_rng(5))
    criterion = LogConditionNumber(MODEL, np.full(7, 0.1))

    def value(parameters):
        return criterion.with_gradient(*parametrization(parameters)(TIMES))[0]

    _, motion_gradient = criterion.with_gradient(*parametrization(parameters)(TIMES))
    gradient = parametrization.gradient(parameters, motion_gradient, TIMES)
    expected = central_differences(value, parameters)
    assert np.abs(gradient - expected).max() < 1e-4 * np.abs(expected).max()
    assert criterion(*parametrization(parameters)(TIMES)) == pytest.approx(value(parameters), abs=1e-9)
    exact = np.log(condition_at(parametrization(parameters), TIMES))
    assert LogConditionNumber(MODEL)(*parametrization(parameters)(TIMES)) == pytest.approx(exact, abs=1e-9)


def test_gradient_with_coupled_motors_agrees_with_finite_differences():
    """Derivatives by positions, velocities and accelerations at some samples, and the value by NumPy."""
    ratios = np.eye(7)
    ratios[5, 4] = -0.5
    drives = replace(direct_drives(JOINTS), ratios=ratios)
    model = build_identification_model(MODEL.dynamics, drives)
    assert len(model.names) == len(MODEL.names) + 3
    rng = np.random.default_rng(6)
    motion, criterion = list(rng.uniform(-1, 1, (3, 30, 7))), LogConditionNumber(model, np.full(7, 0.3))
    _, gradients = criterion.with_gradient(*motion)
    for index, gradient in enumerate(gradients):
        for sample, joint in ((0, 1), (7, 4), (12, 5), (29, 2)):
            values = []
            for sign in (1, -1):
                moved = [part.copy() for part in motion]
                moved[index][sample, joint] += sign * 1e-5
                values.append(criterion.with_gradient(*moved)[0])
            expected = (values[0] - values[1]) / 2e-5
            assert gradient[sample, joint] == pytest.approx(expected, abs=1e-7 + 1e-5 * abs(expected))
    X = model.regressor_at(*motion).reshape(210, -1)
    s = np.linalg.svd(X / np.linalg.norm(X, axis=0), compute_uv=False)
    assert LogConditionNumber(model)(*motion) == pytest.approx(np.log(s[0] / s[-1]), abs=1e-6)


def test_efforts_without_gravity_are_refused():
    model = build_identification_model(
        MODEL.dynamics, replace(direct_drives(JOINTS), excludes_gravity=True), compiled=False
    )
    with pytest.raises(InvalidInputError, match="measured efforts exclude gravity"):
        design_excitation(model, BOUNDS)


def condition_at(trajectory, times):
    X = MODEL.regressor_at(*trajectory(times)).reshape(7 * len(times), -1)
    return np.linalg.cond(X / np.linalg.norm(X, axis=0))


@pytest.mark.slow
def test_exact_gradients_need_a_tenth_of_the_evaluations_of_finite_differences(monkeypatch):
    """The same number of iterations starts from the same trajectory, with steps that smooth friction well."""
    evaluations, candidates = [0], []
    evaluate = DifferentiableProgram.evaluate

    def count(self, *motion):
        evaluations[0] += 1
        return evaluate(self, *motion)

    monkeypatch.setattr(DifferentiableProgram, "evaluate", count)
    design = design_excitation(MODEL, BOUNDS, iterations=10, seed=3)
    by_gradients = evaluations[0] - excitation.INITIAL_TRAJECTORIES
    parametrization, rng = TrajectoryParametrization(BOUNDS, 20.0, 5), np.random.default_rng(3)
    criterion = LogConditionNumber(MODEL)

    def value(parameters):
        return criterion(*parametrization(parameters)(TIMES))

    candidates = [parametrization.random(rng) for _ in range(excitation.INITIAL_TRAJECTORIES)]
    evaluations[0] = 0
    search = minimize(value, min(candidates, key=value), method="BFGS", options={"maxiter": 10, "eps": 0.03})
    by_differences = evaluations[0] - excitation.INITIAL_TRAJECTORIES
    print(f"condition number {design.condition:.3f} of {by_gradients} evaluations, by finite differences "
          f"{np.exp(search.fun):.3f} of {by_differences}")  # fmt: skip
    assert design.iterations == 10 and design.complete
    assert design.condition <= np.exp(search.fun) * 1.001
    assert 10 * by_gradients < by_differences


@pytest.mark.slow
def test_time_limit_returns_the_best_trajectory_so_far(monkeypatch):
    progress, estimates = [], []
    design = design_excitation(MODEL, BOUNDS, iterations=4, on_estimate=estimates.append,
                                on_iteration=lambda *iteration: progress.append(iteration))  # fmt: skip
    assert design.complete and design.iterations == 4 and [done for done, _ in progress] == [1, 2, 3, 4]
    assert [value for _, value in progress] == sorted((value for _, value in progress), reverse=True)
    assert len(estimates) == 1 and estimates[0] > 0
    immediate = design_excitation(MODEL, BOUNDS, iterations=4, time_limit=1e-9)
    assert not immediate.complete and immediate.iterations == 0 and immediate.condition >= design.condition
    assert_within_limits(*immediate.trajectory(np.linspace(0, 20, 2001)))
    now, clock = time.monotonic(), []
    monkeypatch.setattr(excitation.time, "monotonic", lambda: now + (10.0 if clock else 0.0))
    limited = design_excitation(MODEL, BOUNDS, iterations=4, time_limit=5.0,
                              on_iteration=lambda done, _: clock.append(1) if done == 2 else None)  # fmt: skip
    assert not limited.complete and limited.iterations == 2 and limited.condition == progress[1][1]


@pytest.mark.slow
def test_command_shows_a_progress_bar_on_a_terminal(tmp_path):
    """The command runs in a process whose stderr is a terminal."""
    controlling, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("4H", 24, 100, 0, 0))  # the size of a new terminal is zero
    path = tmp_path / "trajectory.csv"
    with (tmp_path / "out").open("w") as out, (tmp_path / "shown").open("wb") as shown:
        command = [sys.executable, "-m", "robot_dynamics.cli.main", "excite", "panda", "--output", str(path)]
        process = Popen([*command, "--iterations", "60"], stdout=out, stderr=terminal)
        os.close(terminal)
        while True:
            try:
                chunk = os.read(controlling, 4096)
            except OSError:  # the process has closed the terminal
                break
            if not chunk:
                break
            shown.write(chunk)
        assert process.wait(timeout=60) == 0
    os.close(controlling)
    bar = (tmp_path / "shown").read_text()
    # the bar is updated ten times a second at most, and removed at the end
    assert "condition number" in bar and "0/60" in bar and re.search(r" [1-9]\d?/60", bar)
    output = (tmp_path / "out").read_text()
    assert "60 iterations for 69 parameters: about" in output and "condition number" in output and path.exists()


def test_command_reports_the_time_limit(tmp_path, capsys):
    path = tmp_path / "trajectory.csv"
    assert main(["excite", "panda", "--output", str(path), "--time-limit", "1e-9"]) == 0
    printed = capsys.readouterr()
    assert "time limit of 1e-09 s reached after 0 of 50 iterations: this is the best trajectory so far" in printed.out
    assert path.exists() and printed.err == ""
    assert main(["excite", "panda", "--output", str(path), "--time-limit", "0"]) == 1
    assert "--time-limit 0: more than 0 is needed" in capsys.readouterr().err


class Simulated:
    """A recording of a trajectory with efforts of Pinocchio, friction and noise."""

    name, notes = "simulated", ()

    def __init__(self, trajectory, seed):
        times = np.arange(1000) / RATE
        q, qd, qdd = trajectory(times)
        model = panda_model()
        data = model.createData()
        efforts = np.array([pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)])
        efforts += 1.5 * qd + 0.5 * np.sign(qd) + NOISE * np.random.default_rng(seed).normal(size=q.shape)
        self.motion = Motion(
            0.0, RATE, 8.0, q, qd, qdd, efforts, efforts, np.ones(7, dtype=bool), np.ones(q.shape, dtype=bool)
        )

    source = part = message_count = None
    time_range = (-np.inf, np.inf)

    def motions(self, statistics, *, cutoff=None):
        yield self.motion


def test_designed_trajectory_reduces_the_errors_of_parameters(exciting, random):
    """Estimated standard deviations and actual errors are compared with those of a random trajectory.

    The description has the true inertias, and what the random trajectory does not show keeps its values.
    """
    truth = MODEL.grouping_matrix @ MODEL.dynamics.parameters
    for number, name in enumerate(MODEL.names[: len(truth)]):
        truth[number] += {"Fv": 1.5, "Fs": 0.5}.get(name.partition(".")[0], 0)
    truth = np.concatenate([truth, np.zeros(7)])
    median = np.argsort([condition(trajectory) for trajectory in random])[len(random) // 2]
    standard_deviations, errors = [], []
    for trajectory in (exciting[0], random[median]):
        fits = [fit_parameters(Samples([Simulated(trajectory, seed)], MODEL)) for seed in range(4)]
        standard_deviations.append(np.exp(np.mean([np.log(fit.standard_deviations) for fit in fits], axis=0)))
        errors.append(np.sqrt(np.mean([(fit.values - truth) ** 2 for fit in fits], axis=0)))
    gains = [np.exp(np.mean(np.log(typical / best))) for best, typical in (standard_deviations, errors)]
    print(f"deviations {gains[0]:.2f} times smaller than with random motion, errors {gains[1]:.2f} times")
    assert gains[0] > 1.05 and gains[1] > 1.0 and (standard_deviations[0] < standard_deviations[1]).mean() > 0.6


def test_command_writes_the_trajectory(tmp_path, capsys):
    path = tmp_path / "out" / "trajectory.csv"
    command = ["excite", "panda", "--output", str(path), "--iterations", "1", "--acceleration", str(ACCELERATION)]
    assert main(command) == 0
    printed = capsys.readouterr()
    assert "condition number" in printed.out and printed.err == ""
    with path.open() as lines:
        header = next(csv.reader(lines))
        rows = np.loadtxt(lines, delimiter=",")
    assert header[:4] == ["time", "panda_joint1.position", "panda_joint1.velocity", "panda_joint1.acceleration"]
    assert rows.shape == (2001, 22) and rows[-1, 0] == 20
    assert_within_limits(*(rows[:, first::3] for first in (1, 2, 3)))
    again = tmp_path / "again.csv"
    assert main([*command[:3], str(again), *command[4:]]) == 0 and again.read_text() == path.read_text()
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
    model = build_identification_model(dynamics, direct_drives(dynamics.joint_names))
    with pytest.raises(InvalidInputError, match="without loops"):
        design_excitation(model, joint_bounds(dynamics))


def test_unactuated_joints_are_refused(tmp_path, capsys):
    path = tmp_path / "trajectory.csv"
    assert main(["excite", "manutec_r3", "--output", str(path), "--iterations", "1"]) == 1
    assert "'manutec_r3': no motor drives spring_1, spring_2, spring_3" in capsys.readouterr().err
    assert not path.exists()
