"""Closure programs: Dynamics returns the same positions and raises the same errors with and without them."""

import os
import re
import threading
import time

import numpy as np
import pytest
from peers.large_robots import each_robot

pytest.importorskip("llvmlite")
from robot_dynamics import Dynamics, RobotDynamicsError, load_robot, shipped_robots
from robot_dynamics.codegen.jit.background import THREAD_NAME

pytestmark = pytest.mark.slow  # compiles models of all robots that ship

LOOPED = [name for name in shipped_robots() if load_robot(name).loops]
NUMBER = re.compile(r"[-+]?(\d+\.?\d*(e[-+]?\d+)?|inf|nan)")
LARGE = "delta"  # of the robots with ten joints and more


def wait_for_programs():
    end = time.monotonic() + 120
    while any(thread.name == THREAD_NAME for thread in threading.enumerate()):
        assert time.monotonic() < end
        time.sleep(0.01)


class Calls:
    """Calls of one Dynamics, each a function without arguments."""

    def __init__(self, dynamics):
        self.dynamics = dynamics
        numbers = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
        self.start = dynamics.initial_joint_positions
        self.motors = self.start[numbers]
        self.twist = np.linspace(-0.1, 0.1, 6)
        self.rates = dynamics.expand_velocities(np.ones(len(numbers)), self.start)

    def closure_calls(self, q, seed, previous):
        """Calls that close loops: q (n,) or (N, n), seed and previous (all joints,)."""
        dynamics = self.dynamics
        return [
            lambda: dynamics.expand_positions(q),
            lambda: dynamics.expand_positions(seed),
            lambda: dynamics.expand_positions(q, previous=previous),
            lambda: dynamics.expand_positions(q, previous=previous, velocities=self.rates),
            lambda: dynamics.expand_trajectory([self.motors, self.motors, q]),
        ]

    def model_calls(self, q, seed):
        """Calls of a model."""
        return [lambda: self.dynamics.gravity(q), lambda: self.dynamics.gravity(seed)]

    def platform_calls(self, pose, q, seed):
        """Calls of the geometry of the platform; none without one platform."""
        if len(self.dynamics.robot.platforms) != 1:
            return []
        platform = self.dynamics.platform
        return [
            lambda: platform.joint_positions(pose),
            lambda: platform.joint_positions(pose, seed=seed),
            lambda: platform.pose(q),
            lambda: platform.pose(seed),
            lambda: platform.inverse(pose, self.twist, self.twist),
            lambda: platform.direct(pose, self.twist, np.zeros(len(self.motors))),
        ]

    def all_calls(self, q, seed, pose):
        return [*self.geometry_calls(q, seed, pose), *self.model_calls(q, seed)]

    def geometry_calls(self, q, seed, pose):
        return [*self.closure_calls(q, seed, self.start), *self.platform_calls(pose, q, seed)]

    @property
    def pose(self):
        has_platform = len(self.dynamics.robot.platforms) == 1
        return self.dynamics.platform.pose(self.start) if has_platform else np.eye(4)

    def compile_all(self):
        """Call everything until it is compiled."""
        self.dynamics.compile("closure")
        self.dynamics.bind("gravity")
        for _ in range(2):
            for call in self.all_calls(self.motors, self.start, self.pose):
                deadline = time.monotonic() + 0.06  # Dynamics compiles what took 50 ms
                while time.monotonic() < deadline:
                    call()
            wait_for_programs()
        assert {"close_near", "close_from_reference", "continue_sequence"} <= self.compiled_names
        if len(self.dynamics.robot.platforms) == 1:
            assert any(name.startswith("direct_geometry") for name in self.compiled_names)
            platform_programs = self.dynamics.platform._closure.solver._programs._compilations.items()
            ready = [name for name, compilation in platform_programs if compilation.program is not None]
            assert sum(name.startswith("inverse_geometry") for name in ready) == 2

    @property
    def compiled_names(self):
        compilations = self.dynamics._closure_solver._programs._compilations
        return {name for name, compilation in compilations.items() if compilation.program is not None}


@pytest.fixture(scope="module", params=each_robot(LOOPED))
def calls(request):
    """Calls of a Dynamics that is compiled, and of a Dynamics that is not."""
    robot = load_robot(request.param)
    compiled = Calls(Dynamics(robot))
    compiled.compile_all()
    return compiled, Calls(Dynamics(robot, compiled=False))


def outcome(call):
    """The result of a call, or its error without the numbers in the text."""
    try:
        return call()
    except RobotDynamicsError as error:
        return type(error), NUMBER.sub("#", str(error))


def compare(calls, *arguments):
    """Assert that all calls have the same outcome; the numbers of results and errors."""
    return compare_calls(*(each.all_calls(*arguments) for each in calls))


def compare_calls(compiled_calls, recursion_calls):
    """As `compare`, for lists of calls."""
    results = errors = 0
    for compiled, recursion in zip(compiled_calls, recursion_calls, strict=True):
        expected, actual = outcome(recursion), outcome(compiled)
        if isinstance(expected, tuple):
            assert actual == expected
            errors += 1
        else:
            np.testing.assert_allclose(actual, expected, rtol=1e-7, atol=1e-7)
            results += 1
    return results, errors


def test_results_are_equal(calls):
    compiled, recursion = calls
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = compiled.motors + 0.02 * rng.uniform(-1, 1)  # along the velocities of the calls
        seed = recursion.dynamics.expand_positions(q) + 1e-4 * rng.uniform(-1, 1, len(compiled.start))
        pose = compiled.pose
        if len(compiled.dynamics.robot.platforms) == 1:
            pose = recursion.dynamics.platform.pose(q)
        results, errors = compare(calls, q, seed, pose)
        assert results and not errors
    assert compare(calls, np.tile(q, (2, 3, 1)), np.tile(seed, (2, 3, 1)), np.tile(pose, (2, 3, 1, 1)))[0]


def test_positions_out_of_reach_raise_the_same_errors(calls):
    compiled, _ = calls
    rng = np.random.default_rng(1)
    far = np.sign(rng.uniform(-1, 1, len(compiled.motors))) * 2 * compiled.dynamics.robot.characteristic_length
    pose = compiled.pose.copy()
    pose[:3, 3] += 50
    seed = compiled.start + rng.normal(size=len(compiled.start))
    seed[[compiled.dynamics.robot.joint_numbers[name] for name in compiled.dynamics.joint_names]] += far
    is_large = len(seed) >= 10
    if is_large and (compiled.dynamics.robot.name != LARGE or "EVERY_ROBOT" not in os.environ):
        pytest.skip(f"without programs the search takes long; of large robots `make soak` tests {LARGE}")
    cases = [(compiled.motors + 5 * far, seed, pose)]
    if not is_large:
        cases += [(compiled.motors + rng.uniform(-2, 2, len(far)), compiled.start, pose) for _ in range(4)]
    for case in cases:
        compare_calls(*(each.geometry_calls(*case) for each in calls))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_raise_the_same_errors(calls, value):
    compiled, _ = calls
    q, seed, pose = compiled.motors.copy(), compiled.start.copy(), compiled.pose.copy()
    q[-1] = value
    seed[compiled.dynamics._closure_solver.independent[0]] = value
    pose[0, 3] = value
    assert compare(calls, q, seed, pose)[1]


def test_wrong_shapes_and_types_raise_the_same_errors(calls):
    compiled, _ = calls
    n, joints = len(compiled.motors), len(compiled.start)
    wrong = [np.zeros(n + joints), np.zeros(0), np.zeros((3, n + joints)), "positions", None, [[1.0], [1.0, 2.0]]]
    for values in wrong:
        assert compare(calls, values, values, values)[1]
        assert compare(calls, values, values, compiled.pose)[1]
    poses = np.tile(compiled.pose, (3, 1, 1))
    compare(calls, compiled.motors, np.tile(compiled.start, (2, 1)), poses)
    skewed = np.eye(4)
    skewed[0, 1] = 1e-3
    for pose in (skewed, -np.eye(4), np.diag([1.0, 1, -1, 1]), np.full((4, 4), 2.0)):
        compare(calls, compiled.motors, compiled.start, pose)


def test_lists_integers_and_strided_arrays_are_accepted(calls):
    compiled, _ = calls
    q, seed, pose = compiled.motors, compiled.start, compiled.pose
    assert not compare(calls, q.tolist(), seed.tolist(), pose.tolist())[1]
    assert not compare(calls, np.repeat(q, 2)[::2], np.repeat(seed, 2)[::2], np.asfortranarray(pose))[1]
    integers = np.rint(q).astype(int)
    expand = compiled.dynamics.expand_positions
    actual, expected = outcome(lambda: expand(integers)), outcome(lambda: expand(integers.astype(float)))
    if isinstance(expected, tuple):
        assert actual == expected
    else:
        np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-12)


def test_seeds_with_unknown_positions(calls):
    compiled, recursion = calls
    seed = compiled.start.copy()
    seed[compiled.dynamics._closure_solver.dependent[-1]] = np.nan
    expected = recursion.dynamics.expand_positions(seed)
    np.testing.assert_allclose(compiled.dynamics.expand_positions(seed), expected, rtol=0, atol=1e-8)


def test_compiled_programs_can_be_switched_off(monkeypatch):
    dynamics = Dynamics(load_robot("gough_stewart"))
    calls = Calls(dynamics)
    calls.compile_all()
    assert dynamics._attempt("gravity", calls.motors) is not None
    assert dynamics._closure_solver.procedures.attempt("close_from_reference", calls.motors) is not None
    dynamics.compiled = False
    assert dynamics._attempt("gravity", calls.motors) is None
    solvers = (dynamics._closure_solver, dynamics.platform._closure.solver)
    for solver in solvers:
        assert solver.procedures.attempt("close_near", calls.start) is None
        assert solver._programs.get_ready("closure") is None
    np.testing.assert_allclose(dynamics.expand_positions(calls.motors), calls.start, rtol=0, atol=1e-9)
    dynamics.compiled = True
    assert dynamics._attempt("gravity", calls.motors) is not None
    assert dynamics._closure_solver.procedures.attempt("close_from_reference", calls.motors) is not None
