"""Acceptance run of the controller with a real controller manager: python3 try_ros2_control.py [--mujoco]

It needs ROS 2 Jazzy with ros2_control and ros2_controllers, and a sourced workspace with robot_dynamics_control. It
starts its own controller manager on simulated hardware, then on mock_components, and with --mujoco on MuJoCo (package
mujoco_ros2_control). It runs the checks below, prints a line for each, and exits with 1 where one failed. CI does not
run it, because it has no ros2_control.

It takes about two minutes. Use a ROS_DOMAIN_ID of its own.
"""

from __future__ import annotations

import argparse
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path

import numpy as np
import rclpy
from ros2_control_bench import (
    CONTROLLER,
    EFFORT,
    JOINTS,
    NO_PAYLOAD,
    PAYLOAD,
    TRAJECTORY,
    Bench,
    Failed,
    expect,
    initialise,
    is_finite,
    largest_jump,
    percentiles,
    write_report,
)
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

START = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.8])
GOAL = START + np.array([0.5, 0.3, -0.4, 0.4, 0.5, -0.3, 0.6])
RAMP_TIME = 0.1  # [s] default of the controller


def spawn(bench: Bench) -> str:
    """The spawner loads, configures and activates the chain."""
    begin = time.monotonic()
    bench.spawn("joint_state_broadcaster", CONTROLLER, TRAJECTORY)
    states = bench.states()
    expect(set(states.values()) == {"active"}, f"states {states}")
    return f"3 controllers active after {time.monotonic() - begin:.1f} s"


def follow(bench: Bench) -> str:
    """A trajectory through the chain; model and robot agree."""
    expect(not bench.set_named(PAYLOAD), "the payload is refused")
    time.sleep(1.5)  # the error that the payload caused vanishes
    if bench.hardware == "mujoco":  # it has fallen until the controllers were active
        expect(bench.move(START, 3.0) == 0, "the robot does not come from where it had fallen to")
    bench.tracking.clear()
    code = bench.move(GOAL, 2.0)
    expect(code == 0, f"error code {code}")
    errors = np.array([state.error.positions for state in bench.tracking])
    worst = float(np.abs(errors).max())
    # steps of MuJoCo do not wait for the update loop
    expect(worst < (1e-2 if bench.hardware == "mujoco" else 2e-3), f"tracking error {worst:.2e} rad")
    return f"goal reached, largest tracking error {worst:.1e} rad"


def change_payload(bench: Bench) -> str:
    """The payload changes while the robot holds still: the efforts do not jump, the error follows."""
    errors = []
    jumps = []
    for payload in (NO_PAYLOAD, PAYLOAD):
        recorded = bench.record(1.5, lambda payload=payload: bench.set_named(payload))
        expect(is_finite(recorded["position"]), "positions are not finite")
        errors.append(float(np.abs(recorded["position"][-1] - GOAL).max()))
        jumps.append(largest_jump(recorded))
    expect(errors[0] > 1e-2 > 1e-3 > errors[1], f"errors {errors} rad without and with the payload")
    expect(max(jumps) < 1.0, f"the efforts jump by {jumps} N m")
    change = f"largest change in 1 ms {max(jumps):.2f} N m"
    return f"error {errors[0]:.3f} rad without, {errors[1]:.1e} rad with it; {change}"


def set_payload_in_parts(bench: Bench) -> str:
    """Parameters of the payload one after the other, in the worst order: no body has what is set in between."""
    jumps, errors = [], []
    for name in ("payload.mass", "payload.first_moments", "payload.inertia"):  # from the payload to none
        recorded = bench.record(0.5, lambda name=name: bench.set_named({name: NO_PAYLOAD[name]}))
        jumps.append(largest_jump(recorded))
        errors.append(float(np.abs(recorded["position"][-1] - GOAL).max()))
    for name in ("payload.first_moments", "payload.inertia", "payload.mass"):
        recorded = bench.record(1.5, lambda name=name: bench.set_named({name: PAYLOAD[name]}))
        jumps.append(largest_jump(recorded))
        errors.append(float(np.abs(recorded["position"][-1] - GOAL).max()))
    expect(max(errors[:2]) < 1e-3, f"the payload did not stay in force: errors {errors} rad")
    expect(errors[2] > 1e-2 and errors[-1] < 1e-3, f"the payload did not change: errors {errors} rad")
    expect(max(jumps) < 1.0, f"the efforts jump by {jumps} N m")
    return f"nothing changes before all three are those of a body; largest change in 1 ms {max(jumps):.2f} N m"


def refuse_parameters(bench: Bench) -> str:
    """Wrong parameters are refused with a reason, and change nothing."""
    wrong = [
        {"kp": [1.0, 2.0]},
        {"kd": [-1.0]},
        {"mode": "position"},
        {"payload.mass": float("nan")},
        {"payload.first_moments": [0.0]},
        {"effort_limits": [1.0]},
        {"effort_limits": [0.0] * 7},
        {"model_library": "other.so"},
        {"ramp_time": -1.0},
    ]
    reasons = [bench.set_named(values) for values in wrong]
    expect(all(reasons), f"accepted: {[values for values, found in zip(wrong, reasons, strict=True) if not found]}")
    recorded = bench.record(0.3)
    expect(largest_jump(recorded) < 0.1, "the efforts changed")
    return f"{len(wrong)} refused, such as: {reasons[0][0]}"


def change_modes(bench: Bench) -> str:
    """All modes, and back, without a jump of the efforts."""
    jumps = []
    for mode in ("pd_gravity", "feedforward", "gravity_compensation", "computed_torque"):
        recorded = bench.record(0.4, lambda mode=mode: bench.set_named({"mode": mode}))
        jumps.append(largest_jump(recorded))
    expect(max(jumps) < 2.0, f"the efforts jump by {jumps} N m")
    expect(bench.move(GOAL, 1.0) == 0, "the robot does not follow afterwards")
    return f"largest change in 1 ms {max(jumps):.2f} N m"


def unchain(bench: Bench) -> str:
    """The trajectory controller stops and starts; the controller after it is restarted by the manager each time."""
    figures = []
    for at_once in (True, False):
        for name, switch in (
            ("off", {"deactivate": [TRAJECTORY]}),
            ("on", {"activate": [TRAJECTORY]}),
        ):
            recorded = bench.record(0.5, lambda switch=switch, at_once=at_once: bench.switch(**switch, at_once=at_once))
            moved = float(np.abs(recorded["position"] - recorded["position"][0]).max())
            jump = largest_jump(recorded)
            zeros = int((recorded["effort"] == 0.0).all(axis=1).sum())
            figures.append(f"{name}{'' if at_once else ' (not at once)'}: {zeros} zeros, moved {moved:.1e} rad")
            expect(bench.states()[CONTROLLER] == "active", "the controller is no longer active")
            expect(moved < 5e-3, f"{name}: the robot moved by {moved:.4f} rad")
            expect(not at_once or jump < 2.0, f"{name}: the efforts jump by {jump:.2f} N m")
    return "; ".join(figures)


def restart_chain(bench: Bench) -> str:
    """The trajectory controller restarts in one update without the payload: its reference jumps, the efforts do not."""
    expect(not bench.set_named(NO_PAYLOAD), "the payload is refused")
    before = bench.record(1.5)
    error = float(np.abs(before["position"][-1] - GOAL).max())
    expect(error > 1e-2, f"error {error} rad: the payload is not missing")
    recorded = bench.record(1.0, lambda: bench.switch(activate=[TRAJECTORY], deactivate=[TRAJECTORY]))
    jump = largest_jump(recorded)
    expect(jump < 1.0, f"the efforts jump by {jump:.2f} N m")
    expect(not bench.set_named(PAYLOAD), "the payload is refused")
    expect(bench.move(GOAL, 1.0) == 0, "the robot does not follow afterwards")
    return f"reference from {error:.3f} rad away; largest change in 1 ms {jump:.2f} N m"


def unchain_in_motion(bench: Bench) -> str:
    """The trajectory controller stops in the middle of a motion: the robot is damped, and the efforts do not jump."""
    motion = threading.Thread(target=lambda: bench.move(START, 2.0))

    def interrupt() -> None:
        motion.start()
        time.sleep(1.0)
        bench.switch(deactivate=[TRAJECTORY])

    recorded = bench.record(1.0, interrupt)
    motion.join()
    speeds = np.abs(recorded["velocity"]).max(axis=1)
    jump = largest_jump(recorded)
    expect(speeds.max() > 0.2 and speeds[-1] < 1e-3, f"speeds {speeds.max():.2f}, {speeds[-1]:.4f} rad/s at the end")
    expect(jump < 2.0, f"the efforts jump by {jump:.2f} N m")
    bench.switch(activate=[TRAJECTORY])
    expect(bench.move(GOAL, 2.0) == 0, "the robot does not follow afterwards")
    return f"from {speeds.max():.2f} rad/s to rest; largest change in 1 ms {jump:.2f} N m"


def stream_points(bench: Bench) -> str:
    """Without a chain: points of a topic, until they stop."""
    bench.switch(deactivate=[TRAJECTORY])
    begin = time.monotonic()
    amplitude, rate = 0.1, 2.0
    errors = []
    for step in range(400):
        t = 0.005 * step
        s, v = amplitude * np.sin(rate * t) ** 2, amplitude * rate * np.sin(2 * rate * t)
        a = 2 * amplitude * rate**2 * np.cos(2 * rate * t)
        point = JointTrajectoryPoint(
            positions=(GOAL + s).tolist(), velocities=[float(v)] * 7, accelerations=[float(a)] * 7
        )
        bench.reference_points.publish(JointTrajectory(joint_names=JOINTS, points=[point]))
        errors.append(float(np.abs(np.array(bench.samples[-1][1]) - GOAL - s).max()))
        time.sleep(max(0.0, begin + t + 0.005 - time.monotonic()))
    time.sleep(0.4)
    expect("none came for longer than reference_timeout" in bench.read_log(), "the end of the stream is not noticed")
    settled = float(np.median(errors[200:]))
    expect(settled < 0.02, f"error {settled:.4f} rad")
    bench.switch(activate=[TRAJECTORY])
    expect(bench.move(GOAL, 1.0) == 0, "the robot does not follow afterwards")
    return f"200 points a second: median difference {settled:.1e} rad; then damped"


def survive_nan(bench: Bench) -> str:
    """The state becomes nan: the efforts go to zero in ramp_time, and come back with the state."""
    bench.spawn("fault_controller")

    def break_for_a_moment() -> None:  # without efforts the robot falls
        bench.break_sensors(True)
        time.sleep(RAMP_TIME + 0.05)
        bench.break_sensors(False)

    recorded = bench.record(0.5, break_for_a_moment)
    broken = np.isnan(recorded["position"]).any(axis=1)
    expect(bool(broken.any()), "the fault did not arrive")
    first = int(np.argmax(broken))
    efforts, times = np.abs(recorded["effort"]).max(axis=1), recorded["time"] - recorded["time"][first]
    expect(is_finite(recorded["effort"]), "efforts are not finite")
    after = efforts[(times > RAMP_TIME + 0.005) & broken]
    expect(len(after) > 10 and after.max() == 0.0, f"efforts of {after.max()} N m after ramp_time")
    zero_after = float(times[first:][efforts[first:] == 0.0][0])
    expect(zero_after > 0.5 * RAMP_TIME, "there was no ramp")
    expect("not finite" in bench.read_log(), "the log does not say why")
    expect(efforts[-1] > 1.0, "the efforts did not come back")
    jump = largest_jump(recorded)
    expect(bench.move(GOAL, 2.0) == 0, "the robot does not follow afterwards")
    return f"zero {1e3 * zero_after:.0f} ms after the first nan, then back; largest change in 1 ms {jump:.2f} N m"


def report_errors(bench: Bench) -> str:
    """With error_on_fault the manager deactivates the controller, and its efforts are zero."""
    bench.set_parameters(error_on_fault=True)
    bench.record(0.3, lambda: bench.break_sensors(True))
    states = bench.states()
    expect(states[CONTROLLER] == "inactive", f"states {states}")
    bench.break_sensors(False)
    bench.set_parameters(error_on_fault=False)
    time.sleep(0.2)
    recorded = bench.record(0.2)
    expect(float(np.abs(recorded["effort"]).max()) == 0.0, "efforts are not zero")
    bench.switch(activate=[CONTROLLER, TRAJECTORY], deactivate=[n for n in (TRAJECTORY,) if states[n] == "active"])
    expect(bench.move(GOAL, 2.0) == 0, "the robot does not follow afterwards")
    return f"after the error {states[CONTROLLER]}, {TRAJECTORY} {states[TRAJECTORY]}; active again by a switch"


def stall(bench: Bench) -> str:
    """The process stops for 0.2 s: a fault, and then on."""
    bench.process.send_signal(signal.SIGSTOP)
    time.sleep(0.2)
    bench.process.send_signal(signal.SIGCONT)
    time.sleep(0.5)
    text = bench.read_log()
    recorded = bench.record(0.5)
    expect(is_finite(recorded["effort"]), "efforts are not finite")
    expect(bench.states()[CONTROLLER] == "active", "the controller is no longer active")
    expect(bench.move(GOAL, 2.0) == 0, "the robot does not follow afterwards")
    return "follows afterwards" + (", the stall is logged" if "stalled" in text else "")


def compare_jitter(bench: Bench, duration: float) -> str:
    """Times of updates beside those of a forward controller, in the same manager, one after the other."""
    bench.spawn_inactive(EFFORT)
    bench.switch(deactivate=[TRAJECTORY, CONTROLLER])
    phases = (
        (EFFORT, [EFFORT], []),
        (CONTROLLER, [CONTROLLER, TRAJECTORY], [EFFORT]),
    )
    lines = []
    for name, activate, deactivate in phases:
        bench.switch(activate=activate, deactivate=deactivate)
        if name == EFFORT:
            bench.effort_commands.publish(Float64MultiArray(data=[0.0] * 7))
        time.sleep(2.0)
        logged = len(bench.read_log())
        times = bench.record(duration)["time"]
        overruns = bench.read_log()[logged:].count("Overrun detected")
        periods = 1e6 * np.diff(times)
        jitter = np.abs(periods - 1e3 * np.rint(periods / 1e3))  # this process may lose messages
        activity = bench.diagnostics.get("controller_manager: Controllers Activity", {})
        update = activity.get(f"{name}.execution_time", "unknown")
        lines.append(f"{name}: jitter of updates {percentiles(jitter)} us, {overruns} overruns, update {update}")
    return "; ".join(lines)


def deactivate(bench: Bench) -> str:
    """Deactivation leaves zeros in the command interfaces; the unspawner unloads."""
    bench.switch(deactivate=[TRAJECTORY, CONTROLLER])
    recorded = bench.record(0.2)
    expect(float(np.abs(recorded["effort"]).max()) == 0.0, "efforts are not zero")
    bench.unspawn(TRAJECTORY, CONTROLLER)
    expect(CONTROLLER not in bench.states(), "the controller is still loaded")
    bench.spawn(CONTROLLER, TRAJECTORY)
    expect(not bench.set_named(PAYLOAD), "the payload is refused")
    time.sleep(1.5)
    expect(bench.move(START, 2.0) == 0, "the robot does not follow after it was loaded again")
    return "zeros; unloaded, loaded and followed again"


def kill(bench: Bench) -> str:
    """SIGKILL of the manager, and another one."""
    bench.stop(signal.SIGKILL)
    bench.restart()
    time.sleep(1.0)
    bench.spawn("joint_state_broadcaster", CONTROLLER, TRAJECTORY)
    expect(not bench.set_named(PAYLOAD), "the payload is refused")
    time.sleep(1.5)
    expect(bench.move(GOAL, 2.0) == 0, "the robot does not follow")
    return "another manager takes over; the efforts of the killed one stay with the hardware, which must time out"


def hold_mock(bench: Bench) -> str:
    """mock_components: the efforts at rest are the gravity of the model."""
    bench.spawn("joint_state_broadcaster", CONTROLLER, TRAJECTORY)
    recorded = bench.record(0.5)
    efforts = recorded["effort"][-1]
    try:
        from robot_dynamics import Dynamics, load_robot
    except ImportError:
        return f"efforts {efforts.round(2).tolist()} N m; robot_dynamics is not importable, so they are not compared"
    gravity = Dynamics(load_robot("panda")).gravity(recorded["position"][-1])
    difference = float(np.abs(efforts - gravity).max())
    expect(difference < 1e-9, f"the efforts differ from gravity by {difference:.2e} N m")
    return f"equal to gravity of the library to {difference:.0e} N m"


def run_checks(bench: Bench, checks: list[Callable[[Bench], str]]) -> list[tuple[str, str, str]]:
    """Run checks, and print their results."""
    rows = []
    for check in checks:
        name = getattr(check, "__name__", "compare_jitter")
        try:
            row = (name, "ok", check(bench))
        except (Failed, OSError, KeyError, IndexError) as error:
            row = (name, "FAILED", f"{error}")
            if not isinstance(error, Failed):
                traceback.print_exc()
        print(f"{row[1]:7}{row[0]}: {row[2]}", flush=True)
        rows.append(row)
    return rows


def main() -> int:
    """Run the checks; the status is 1 where one failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mujoco", action="store_true", help="run checks on mujoco_ros2_control too")
    parser.add_argument("--jitter", type=float, default=20.0, metavar="S", help="time of each jitter record [s]")
    parser.add_argument("--report", type=Path, help="JSON file for the results")
    options = parser.parse_args()
    initialise()
    print(f"load average {os.getloadavg()[0]:.2f}, {os.cpu_count()} processors", flush=True)

    def compare(bench: Bench) -> str:
        return compare_jitter(bench, options.jitter)

    compare.__name__ = "compare_jitter"
    checks = [spawn, follow, change_payload, set_payload_in_parts, refuse_parameters, change_modes, unchain]
    checks_of_mujoco = [*checks, restart_chain, unchain_in_motion, stream_points]
    with Bench("simulated") as bench:
        checks += [restart_chain, unchain_in_motion, stream_points, survive_nan, report_errors, stall, deactivate, kill]
        rows = run_checks(bench, checks)
        log = bench.log
    with Bench("mock") as bench:
        rows += run_checks(bench, [hold_mock, compare])
    if options.mujoco:
        with Bench("mujoco") as bench:
            rows += run_checks(bench, checks_of_mujoco)
    rclpy.shutdown()
    if options.report is not None:
        write_report(options.report, rows)
    failures = sum(row[1] != "ok" for row in rows)
    print(f"{len(rows) - failures} passed, {failures} failed; log of the manager: {log}")
    return 1 if failures else 0


if __name__ == "__main__":
    raise SystemExit(main())
