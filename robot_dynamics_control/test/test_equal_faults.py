"""The law in C++ and the controller in Python do the same for the same events: rows of a table, random sequences.

Compared are efforts, what they follow, faults, the reference, saturation and counts of stalls.
"""

from pathlib import Path

import numpy as np
import pytest
from player import POINT_RESULTS, Script, Sent

from robot_dynamics import Dynamics, Inertia, InvalidInputError, load_robot
from robot_dynamics.control.control_law import ControlLaw
from robot_dynamics.control.controller import Controller
from robot_dynamics.control.controller_settings import Settings
from robot_dynamics.control.modes import FIXED_MODEL_MODES, NO_REFERENCE_ACTIONS
from robot_dynamics.control.transit import TransitTimes
from robot_dynamics.model.inertia import symmetric_entries

ARM = Path(__file__).with_name("load_friction.yaml")
LAW = ControlLaw(Dynamics(load_robot(ARM)), ("elbow", "shoulder"))
LIMITS = np.array([1.5, 9.0])
MS = 1e-3
START = 50.0  # [s]

FAULTS = (
    ("position of joint", "a position of the state is not finite"),
    ("velocity of joint", "a velocity of the state is not finite"),
    ("this node stalled", "the program stalled, or its clock jumped ahead"),
    ("the efforts for the last", "efforts are late"),
    (
        "the clock jumped back by",
        "the clock jumped back; a new reference, another mode or a new activation clears this fault",
    ),
    ("no joint_states yet", "no state yet"),
    ("no joint_states since", "no state since the clock jumped back"),
    ("blocked", "efforts are blocked"),
)
"""Beginnings of faults in Python, and the same faults in C++."""

NO_REFERENCE = {
    "": "",
    "no reference yet": "none yet",
    "the reference was ended": "ended",
    "no point of the stream": "timed out",
    "it was dropped": "dropped",
}


def translated_fault(fault):
    """The fault of C++ for that of Python."""
    if fault.startswith("no joint_states for more than"):
        _, separator, reason = fault.partition("; the last ones could not be used: ")
        return "no state for longer than state_timeout" + (f"; {translated_fault(reason)}" if separator else "")
    for beginning, translation in FAULTS:
        if fault.startswith(beginning):
            return translation
    return fault


def translated_reference(reason):
    return next(value for key, value in NO_REFERENCE.items() if (reason.startswith(key) if key else not reason))


class Pair:
    """The controller in Python, and a script for the law in C++: each event goes to both."""

    def __init__(self, law=LAW, **changes):
        self.law = law
        joints = len(law.joints)
        values = {
            "mode": "computed_torque",
            "kp": np.full(joints, 100.0),
            "kd": np.full(joints, 20.0),
            "limits": LIMITS,
        }
        self.settings = {**values, **changes}
        law.q[:] = law.qd[:] = 0.0
        self.controller = Controller(law, Settings(**self.settings))
        self.script = Script()
        self.script.add("joints", *law.joints)
        self._write(self.settings)
        self.script.add("configure")
        self.expected = [["configured"]]
        self.now = START

    def _write(self, settings):
        for name, value in settings.items():
            self.script.add(name, value)

    def _record(self, efforts, command, *values):
        """Record what the controller sends, None without a fault, and the command that does the same."""
        self.script.add(command, *values)
        controller = self.controller
        self.expected.append(
            Sent(
                np.zeros(0) if efforts is None else efforts.copy(),
                controller.activity,
                translated_fault(controller.fault),
                translated_reference(controller.no_reference_reason),
                tuple(bool(value) for value in controller.saturated),
                controller.watchdog.stall_count,
            )
        )

    def state(self, q=(0.3, -0.2), qd=(0.1, -0.2), dt=MS, age=0.0):
        """A state after dt [s], published `age` [s] ago."""
        self.now += dt
        self.law.q[:], self.law.qd[:] = q, qd
        self.script.add("q", q)
        self.script.add("qd", qd)
        times = (self.now, self.now, self.now - age)
        self._record(self.controller.step(*times), "step", *times)

    def states(self, count, **options):
        for _ in range(count):
            self.state(**options)

    def reject(self, count=1, dt=MS):
        for _ in range(count):
            self.now += dt
            self._record(self.controller.reject_state(self.now, "a test rejects it"), "reject", self.now)

    def tick(self, count=1, dt=MS):
        for _ in range(count):
            self.now += dt
            self._record(self.controller.tick(self.now), "tick", self.now)

    def halt(self):
        self._record(self.controller.halt("a test halts it"), "halt")

    def overdue(self):
        self._record(self.controller.handle_overdue_efforts(self.now), "overdue", self.now)

    def point(self, values, age=0.0):
        try:
            self.controller.track_point(self.now, self.now - age, values)
            result = "accepted"
        except InvalidInputError as error:
            result = "too old" if "old" in str(error) else "beyond limits"
        self.script.add("point", self.now, self.now - age, values)
        self.expected.append(["point", str(POINT_RESULTS.index(result))])

    def end_reference(self):
        self.controller.follow(self.now, 0.0, None)
        self.script.add("end_reference")

    def latency(self, seconds):
        self.controller.watchdog.record_latency(seconds)
        self.script.add("latency", seconds)

    def block(self, is_blocked):
        self.controller.watchdog.block("blocked" if is_blocked else "")
        self.script.add("block", float(is_blocked))

    def restart(self):
        self.controller.restart()
        self.script.add("restart")

    def apply(self, **changes):
        self.settings.update(changes)
        self.controller.apply(Settings(**self.settings))
        self._write(changes)
        self.script.add("apply")
        self.expected.append(["applied", "1"])

    def compare(self, module="loads", sanitized=True):
        """Play the script and compare; the results."""
        results = self.script.play(module, sanitized)
        assert len(results) == len(self.expected)
        tolerance = 1e-12 * self._scale()
        for number, (result, expected) in enumerate(zip(results, self.expected, strict=True)):
            if isinstance(expected, Sent):
                assert result[1:] == expected[1:], number
                np.testing.assert_allclose(result.efforts, expected.efforts, rtol=0, atol=tolerance)
            else:
                assert result == expected, number
        return results

    def _scale(self):
        efforts = [np.abs(sent.efforts).max(initial=0) for sent in self.expected if isinstance(sent, Sent)]
        return max(efforts) or 1.0


POINT = [[0.35, -0.1], [0.2, 0.1], [1.0, -1.0]]


def no_state(pair):
    pair.tick(130)


def state_is_not_finite(pair):
    for bad in ((np.nan, 0.0), (np.inf, 0.0), (1e200, 0.0)):
        pair.states(60, q=bad)
        pair.states(120)
        pair.states(10, qd=bad)


def state_is_incomplete(pair):
    pair.reject(130)
    pair.tick(30)


def stamp_is_old(pair):
    pair.states(30, age=0.015)
    pair.states(130, age=0.021)


def program_stalls(pair):
    for seconds in (0.03, 0.09, 0.4):
        pair.state(dt=seconds)
        pair.states(30)
        pair.tick(dt=seconds)
        pair.states(30)


def clock_jumps_back(pair):
    pair.state(dt=-0.01)
    pair.states(5)
    pair.state(dt=-0.5)
    pair.states(130)
    pair.tick(10)
    pair.point(POINT)
    pair.states(20)
    pair.state(dt=-0.5)
    pair.apply(mode="pd_gravity")


def clock_stands_still(pair):
    pair.halt()
    pair.tick(5)


def sending_takes_too_long(pair):
    pair.overdue()
    pair.states(3)
    pair.overdue()
    pair.halt()


def description_does_not_fit(pair):
    pair.block(True)
    pair.states(120)
    pair.point(POINT)
    pair.states(5)
    pair.block(False)


def efforts_are_late(pair):
    for _ in range(12):
        pair.latency(0.006)
        pair.state()
    pair.states(110)
    pair.latency(0.004)


def no_point_comes(pair):
    for action in NO_REFERENCE_ACTIONS:
        pair.apply(without_reference=action)
        pair.point(POINT)
        pair.states(240)
    pair.apply(without_reference="damp")
    pair.point(POINT)
    pair.states(10)
    pair.end_reference()


def effort_is_beyond_its_limit(pair):
    pair.apply(limits=np.array([0.5, 2.0]))
    pair.states(120)
    pair.apply(limits=np.array([np.inf, 3.0]))


def reference_is_wrong(pair):
    pair.point(POINT)
    pair.states(5)
    pair.point(POINT, age=0.2)
    pair.states(5)


def fault_is_longer_than_the_ramp(pair):
    pair.apply(reference_timeout=10.0)
    pair.point(POINT)
    pair.states(20)
    pair.reject()
    pair.states(20)
    pair.reject(104)
    pair.point(POINT)
    pair.reject(90)
    pair.states(5)
    pair.reject(120)


def settings_change(pair):
    pair.point(POINT)
    for mode in FIXED_MODEL_MODES:
        pair.apply(mode=mode)
        pair.states(20)
    pair.apply(kp=np.full(2, 10.0), ramp_time=0.01, friction_velocity="measured", mode="computed_torque")
    pair.states(20)
    pair.apply(ramp_time=0.0)
    pair.restart()


ROWS = (
    *(no_state, state_is_not_finite, state_is_incomplete, stamp_is_old, program_stalls, clock_jumps_back),
    *(clock_stands_still, sending_takes_too_long, description_does_not_fit, efforts_are_late, no_point_comes),
    *(effort_is_beyond_its_limit, reference_is_wrong, fault_is_longer_than_the_ramp, settings_change),
)


@pytest.mark.parametrize("row", ROWS)
@pytest.mark.parametrize("mode", ["computed_torque", "gravity_compensation"])
def test_row_of_the_table(row, mode):
    pair = Pair(mode=mode)
    pair.tick(3)
    pair.states(120)
    pair.point(POINT)
    pair.states(30)
    row(pair)
    pair.states(130)
    results = [result for result in pair.compare() if isinstance(result, Sent)]
    assert {bool(result.fault) for result in results} == {False, True}
    assert any(result.efforts.any() for result in results[-20:])  # they come back


@pytest.mark.parametrize("seed", range(6))
def test_random_events(seed):
    rng = np.random.default_rng(seed)
    pair = Pair(mode=FIXED_MODEL_MODES[seed % 4], without_reference=NO_REFERENCE_ACTIONS[seed % 3])
    q = np.array([0.3, -0.2])
    for _ in range(1500):
        kind = rng.choice(
            ["state", "old", "bad", "reject", "tick", "stall", "back", "point", "apply", "late", "other"],
            p=[0.6, 0.05, 0.03, 0.05, 0.08, 0.02, 0.005, 0.1, 0.02, 0.025, 0.02],
        )
        dt = float(rng.choice([MS, 3 * MS, 12 * MS]))
        q = q + rng.normal(scale=0.01, size=2)
        if kind in ("state", "old"):
            pair.state(q, rng.normal(size=2), dt, age=rng.uniform(0, 0.03) if kind == "old" else 0.0)
        elif kind == "bad":
            pair.state(q * rng.choice([np.nan, 1.0], 2), np.array([0.1, rng.choice([np.inf, 1.0])]), dt)
        elif kind in ("reject", "tick"):
            getattr(pair, kind)(int(rng.integers(1, 40)), dt)
        elif kind in ("stall", "back"):
            pair.state(q, dt=rng.uniform(0.02, 0.3) * (1 if kind == "stall" else -1))
        elif kind == "point":
            pair.point(np.stack([q, *rng.normal(size=(2, 2))]), age=rng.uniform(0, 0.11))
        elif kind == "apply":
            pair.apply(
                mode=str(rng.choice(FIXED_MODEL_MODES)),
                without_reference=str(rng.choice(NO_REFERENCE_ACTIONS)),
                ramp_time=float(rng.choice([0.0, 0.05, 0.1])),
                limits=rng.uniform(1, 20, 2),
            )
        elif kind == "late":
            for _ in range(int(rng.integers(1, 14))):
                pair.latency(float(rng.choice([0.006, 0.0051])))
        else:
            action = rng.choice(["halt", "overdue", "end", "block", "unblock", "unblock", "late", "restart"])
            if action in ("halt", "overdue", "restart"):
                getattr(pair, action)()
            elif action == "end":
                pair.end_reference()
            elif action == "late":
                pair.latency(0.001)
            else:
                pair.block(action == "block")
    results = [result for result in pair.compare() if isinstance(result, Sent)]
    assert len({result.fault for result in results}) > 6


def test_payload_changes_as_a_law_is_replaced():
    frame, robot = "panda_link8", load_robot("panda")
    joints = [joint.name for joint in robot.joints]
    payload = Inertia.about_centre_of_mass(1.5, np.diag([0.01, 0.02, 0.03]), np.array([0.1, 0.0, 0.1]))
    changes = {"kp": np.full(7, 50.0), "kd": np.full(7, 10.0), "limits": np.full(7, 87.0)}
    pair = Pair(ControlLaw(Dynamics(robot), joints), **changes)
    q, qd = [0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.8], np.full(7, 0.1)
    pair.states(150, q=q, qd=qd)
    for inertia in (payload, Inertia()):
        loaded = ControlLaw(Dynamics(robot.with_payload(frame, inertia)), joints)
        pair.controller.replace_law(loaded)
        pair.law = loaded
        pair.script.add("payload", inertia.mass, inertia.first_moments, symmetric_entries(inertia.second_moments))
        pair.expected.append(["payload", "1"])
        pair.states(150, q=q, qd=qd)
    efforts = np.array([result.efforts for result in pair.compare("loaded_panda") if isinstance(result, Sent)])
    assert np.abs(efforts[299] - efforts[149]).max() > 5
    assert np.abs(np.diff(efforts[150:], axis=0)).max() < 0.2  # no jump
    np.testing.assert_allclose(efforts[-1], efforts[149], rtol=0, atol=1e-9)


def test_reference_beyond_position_limits_is_refused():
    robot = load_robot("panda")
    names = [joint.name for joint in robot.joints]
    pair = Pair(ControlLaw(Dynamics(robot), names), kp=np.zeros(7), kd=np.zeros(7), limits=np.full(7, 87.0))
    q = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.8])
    pair.state(q, np.zeros(7))
    for position in (q[3], -0.0698 + 9e-7, -0.0698 + 2e-6):
        values = np.zeros((3, 7))
        values[0] = q
        values[0, 3] = position
        pair.point(values)
        pair.state(q, np.zeros(7))
    points = [result[1] for result in pair.compare("loaded_panda")[1:] if not isinstance(result, Sent)]
    assert points == ["0", "0", "4"]


def test_delays_of_messages():
    rng = np.random.default_rng(0)
    transit, script, expected = TransitTimes(), Script(), []
    received = 10**15
    for number in range(3500):
        received += int(rng.integers(900_000, 1_100_000))
        published = 0 if number % 50 == 0 else received - 7_000_000 - int(rng.exponential(200_000)) - 1000 * number
        expected.append(transit.delay(received, published))
        script.add("transit", received, published)
    results = np.array(script.play("panda"), dtype=float)[:, 0]
    np.testing.assert_allclose(results, expected, rtol=0, atol=1e-15)
