"""mobile_base_simulator over real topics: it computes the steps of the library, and survives invalid inputs."""

import threading

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped, WrenchStamped
from peers.wheeled_robots import DifferentialDrive
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics import Base, load_robot
from robot_dynamics.nodes.mobile_base_simulator.outputs import joint_state_message
from robot_dynamics.simulation import Simulation

from .service_requests import point
from .simulator_probe import SimulatorProbe, seconds

EFFORTS = np.array([5.0, -3.0, 2.0, 0.3, -0.2, 0.01])
TWIST = [0.1, -0.2, 0.05, 0.02, 0.1, -0.05]
QUIET = {"start_paused": True, "command_timeout": 5.0}


@pytest.fixture
def start(start_server, client):
    def started(**parameters):
        name = start_server(parameters, executable="mobile_base_simulator")
        return SimulatorProbe(name, client, stamped=parameters.get("stamped_cmd_vel", False))

    return started


def wrench_on(link, values):
    message = WrenchStamped()
    message.header.frame_id = link
    message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = map(float, values[:3])
    message.wrench.torque.x, message.wrench.torque.y, message.wrench.torque.z = map(float, values[3:])
    return message


def test_steps_are_those_of_the_library_and_reset_restores_the_state(start):
    joints = [f"arm_{name}_joint" for name in ("elbow", "shoulder_lift")]
    node = start(
        robot_file="free_flying_arm",
        **QUIET,
        **{"initial.joints": joints, "initial.positions": [1.2, -1.0], "initial.twist": TWIST, "odom_rate": 1000.0},
    )
    library = Simulation(load_robot("free_flying_arm"))
    q = [{"arm_elbow_joint": 1.2, "arm_shoulder_lift_joint": -1.0}.get(name, 0.0) for name in library.joint_names]
    library.start(q, base=Base(twist=TWIST))
    for _ in range(10):  # a reader may hear nothing of a writer that has already found it
        node.send_efforts(EFFORTS)
        node.client.spin(0.1)
    last = node.make_steps(10)
    state = library.advance(10, efforts=EFFORTS)
    assert list(last.name) == list(library.joint_names)
    np.testing.assert_array_equal(last.position, state.positions)
    np.testing.assert_array_equal(last.velocity, state.velocities)
    np.testing.assert_array_equal(last.effort, EFFORTS)
    assert seconds(last.header.stamp) == pytest.approx(0.010, abs=1e-9)
    odom = node.odom[-1]
    assert (odom.header.frame_id, odom.child_frame_id) == ("odom", library.robot.base_link)
    p, o, t = odom.pose.pose.position, odom.pose.pose.orientation, odom.twist.twist
    np.testing.assert_array_equal([p.x, p.y, p.z], state.pose[:3, 3])
    np.testing.assert_allclose(Rotation.from_quat([o.x, o.y, o.z, o.w]).as_matrix(), state.pose[:3, :3], atol=1e-15)
    published_twist = [t.linear.x, t.linear.y, t.linear.z, t.angular.x, t.angular.y, t.angular.z]
    np.testing.assert_array_equal(published_twist, state.twist)
    a = node.accelerations[-1].accel.linear
    np.testing.assert_allclose([a.x, a.y, a.z], library.accelerations(efforts=EFFORTS)[0][:3], rtol=1e-12)

    assert node.call_trigger("reset").success
    node.wait_until(lambda: node.joint_states[-1].position.tolist() == q, "the state as it began")
    stamp = seconds(node.joint_states[-1].header.stamp)
    assert stamp == pytest.approx(0.010, abs=1e-9)  # the clock goes on
    node.send_efforts(EFFORTS)
    node.client.spin(0.3)
    again = node.make_steps(10)
    np.testing.assert_array_equal(again.position, state.positions)
    np.testing.assert_array_equal(again.velocity, state.velocities)

    # a wrench on a link too, and efforts by name
    node.publish("external_wrench", wrench_on("arm_tool0", [3, 2, 1, 0.3, 0.2, 0.1]))
    node.publish("effort", JointState(name=["arm_elbow_joint"], effort=[1.5]))
    node.client.spin(0.3)
    efforts = EFFORTS.copy()
    efforts[library.joint_names.index("arm_elbow_joint")] = 1.5
    last = node.make_steps(5)
    state = library.advance(5, efforts=efforts, external_wrenches={"arm_tool0": [3, 2, 1, 0.3, 0.2, 0.1]})
    np.testing.assert_allclose(last.velocity, state.velocities, rtol=1e-13)


def test_invalid_messages_are_reported_and_commands_time_out(start):
    node = start(robot_file="ur5e", command_timeout=0.1, real_time_factor=0.5)
    node.wait_until(lambda: len(node.joint_states) > 50, "states")
    for topic, message, reason in (
        ("effort", JointState(name=["elbow_joint"], effort=[np.nan]), r"effort[0] is nan"),
        ("effort", JointState(name=["elbow"], effort=[1.0]), "unknown joint 'elbow'"),
        ("effort", JointState(name=["elbow_joint"], effort=[]), "0 efforts for 1 names"),
        ("external_wrench", wrench_on("hand", [0] * 6), "unknown link 'hand'"),
        ("external_wrench", wrench_on("tool0", [np.inf] * 6), "finite numbers are needed"),
        (f"{node.name.rpartition('/')[0]}/cmd_vel", Twist(), "this one is fixed"),
    ):

        def is_refused(topic=topic, message=message, reason=reason):
            node.publish(topic, message)  # again, until the node has discovered the publisher
            return node.has_diagnostic(reason)

        node.wait_until(is_refused, reason)
    node.send_efforts([1.0, 2.0])
    node.wait_until(lambda: node.has_diagnostic("commands has 2 values: 6 are needed"), "a refusal")
    assert all(np.all(np.array(state.effort) == 0) for state in node.joint_states)
    for _ in range(30):
        node.send_efforts([0.0, 0.0, 0.0, 0.0, 0.5, 0.0])
        node.client.spin(0.02)
    assert node.joint_states[-1].effort[4] == 0.5
    pushed = seconds(node.joint_states[-1].header.stamp)
    node.wait_until(lambda: node.joint_states[-1].effort[4] == 0, "efforts of zero")
    stopped = next(s for s in node.joint_states if seconds(s.header.stamp) > pushed and s.effort[4] == 0)
    assert seconds(stopped.header.stamp) - pushed < 0.2
    node.wait_until(lambda: node.has_diagnostic("commands stopped"), "diagnostics")


def test_wheels_are_driven_by_cmd_vel_and_stop_when_it_does(start):
    node = start(
        robot_description=DifferentialDrive.urdf,
        **{"wheels.joints": ["left", "right"], "wheels.radii": [0.1, 0.1], "real_time_factor": 1.0},
        **{"noise.position": 1e-3, "seed": 7},
    )
    command = Twist()
    command.linear.x, command.angular.z = 0.5, 0.8
    topic = f"{node.name.rpartition('/')[0]}/cmd_vel"

    def driven():
        node.publish(topic, command)
        return node.odom and abs(node.odom[-1].twist.twist.angular.z - 0.8) < 1e-3

    node.wait_until(driven, "the twist that was commanded")
    twist = node.odom[-1].twist.twist
    assert twist.linear.x == pytest.approx(0.5, abs=1e-3) and abs(twist.linear.y) < 1e-12
    node.wait_until(lambda: abs(node.odom[-1].twist.twist.linear.x) < 1e-3, "rest")
    assert np.hypot(node.odom[-1].pose.pose.position.x, node.odom[-1].pose.pose.position.y) > 0.01


def test_prescribed_joint_motion_moves_the_base_by_reaction(start):
    node = start(robot_file="free_flying_arm", moved_by="reference", gravity=[0.0, 0.0, 0.0], odom_rate=1000.0)
    library = Simulation(load_robot("free_flying_arm", gravity=[0, 0, 0]))
    goal = np.array([1.0, -1.0, 1.2, 0.5, 0.3, -0.4])
    message = JointTrajectory(joint_names=list(library.joint_names))
    message.points = [point(0, positions=goal, velocities=np.zeros(6), accelerations=np.zeros(6))]
    message.points[0].time_from_start.sec = 1
    node.publish("reference", message)
    node.wait_until(
        lambda: node.odom and node.joint_states and np.allclose(node.joint_states[-1].position, goal, atol=1e-12),
        "the goal",
    )

    def motion(time):
        s = min(time, 1.0)
        return (
            goal * (10 * s**3 - 15 * s**4 + 6 * s**5),
            goal * (30 * s**2 - 60 * s**3 + 30 * s**4),
            goal * (60 * s - 180 * s**2 + 120 * s**3) * (s < 1),
        )

    state = library.advance(1000, motion=motion)  # which is held against conservation of momentum elsewhere
    node.client.spin(0.1)
    p = node.odom[-1].pose.pose.position
    assert np.linalg.norm(state.pose[:3, 3]) > 1e-4
    np.testing.assert_allclose([p.x, p.y, p.z], state.pose[:3, 3], atol=1e-9)


def test_real_time_factor_sets_the_speed_and_parameters_are_checked(start):
    node = start(robot_file="ur5e", real_time_factor=0.1)
    node.wait_until(lambda: len(node.clock) > 5, "a clock")

    def rate():
        node.client.spin(0.2)
        begun, state = node.client.node.get_clock().now().nanoseconds, node.clock[-1]
        node.client.spin(1.0)
        return (seconds(node.clock[-1].clock) - seconds(state.clock)) / (
            (node.client.node.get_clock().now().nanoseconds - begun) * 1e-9
        )

    assert rate() == pytest.approx(0.1, rel=0.3)
    assert node.client.set_parameters(node.name, {"real_time_factor": 0.02}).successful
    assert rate() == pytest.approx(0.02, rel=0.3)
    for values, reason in (
        ({"step": -1.0}, "1e-06 or more, and less than 1,"),
        ({"step": 1e-9}, "1e-06 or more, and less than 1,"),
        ({"step": 1000.0}, "1e-06 or more, and less than 1,"),
        ({"wheels.joints": ["wheel"], "wheels.radii": [1e-300]}, "0.001 or more, and less than 1000,"),
        ({"payload.link": "tool0", "payload.mass": 1e300}, "less than 1e+09,"),
        ({"payload.link": "tool0", "payload.mass": 1.0, "payload.inertia": [1e300] * 6}, "below 1e+09 are needed"),
        ({"real_time_factor": "fast"}, "a number is needed"),
        ({"wheels.joints": ["wheel"], "wheels.radii": [0.1]}, "unknown joint 'wheel'"),
        ({"wheels.joints": ["wheel"]}, "0 values and wheels.joints 1"),
        ({"ground.points": ["foot"]}, "unknown link 'foot'"),
        ({"base_motion": "rolling"}, "fixed, free, planar"),
        ({"initial.pose": [0.0] * 7}, "quaternion of norm 0"),
        ({"stamped_cmd_vel": True}, "is read at startup"),
        ({"seed": -1}, "from 0 on"),
        ({"moved_by": "magic"}, "known are efforts, reference"),
    ):
        refused = node.client.set_parameters(node.name, values)
        assert not refused.successful and reason in refused.reason, refused
    assert node.set_paused(True).success
    node.client.spin(0.2)
    stood = node.clock[-1]
    node.client.spin(0.2)
    assert seconds(node.clock[-1].clock) == seconds(stood.clock) and node.clock[-1] is not stood  # published again
    assert not node.set_paused(False).message.startswith("paused")


def test_each_step_waits_for_efforts_on_request(start):
    node = start(robot_file="ur5e", wait_for_commands="each", command_timeout=0.5)
    node.wait_until(lambda: len(node.joint_states) > 5, "the same state again and again")
    assert {seconds(state.header.stamp) for state in node.joint_states} == {0.0}
    node.wait_until(
        lambda: node.has_diagnostic(f"until the first efforts come on {node.name}/commands"), "what it waits for"
    )
    library = Simulation(load_robot("ur5e"))
    for k in range(1, 11):
        node.send_efforts(EFFORTS * k)
        node.wait_until(lambda k=k: seconds(node.joint_states[-1].header.stamp) > (k - 0.5) * 1e-3, f"step {k}")
        state = library.advance(1, efforts=EFFORTS * k)
    node.client.spin(0.2)
    assert seconds(node.joint_states[-1].header.stamp) == pytest.approx(0.010)
    np.testing.assert_array_equal(node.joint_states[-1].velocity, state.velocities)


def test_efforts_without_stamps_that_never_pause_do_not_hold_time(start):
    """As those of a controller that sends zeros at its own rate because states are missing."""
    node = start(robot_file="ur5e", wait_for_commands="each", command_timeout=0.5)
    node.wait_until(lambda: len(node.joint_states) > 2, "the same state again: answers may come twice")
    is_over = threading.Event()

    def send_all_the_time():
        while not is_over.wait(0.005):
            node.send_efforts(EFFORTS)

    sender = threading.Thread(target=send_all_the_time)
    sender.start()
    try:
        node.wait_until(lambda: seconds(node.joint_states[-1].header.stamp) > 0.004, "steps", patience=5.0)
    finally:
        is_over.set()
        sender.join()


def test_standstill_without_a_controller_is_a_warning(start):
    node = start(robot_file="ur5e", wait_for_commands="each", command_timeout=0.5)

    def has_steps():
        node.send_efforts(EFFORTS)
        return node.joint_states and seconds(node.joint_states[-1].header.stamp) > 0.003

    def last():
        return node.diagnostics[-1][:2] if node.diagnostics else (None, "")

    node.wait_until(has_steps, "steps")
    reason = f"time stands still: no efforts came on {node.name}/commands or {node.name}/effort for "
    node.wait_until(lambda: last()[1].startswith(reason), "the warning")
    assert last()[0] == DiagnosticStatus.WARN

    def is_over():
        node.send_efforts(EFFORTS)
        return last()[0] == DiagnosticStatus.OK

    node.wait_until(is_over, "steps again")


def test_waiting_step_ignores_efforts_stamped_with_an_earlier_state(start):
    node = start(robot_file="ur5e", wait_for_commands="each", command_timeout=0.5)
    library = Simulation(load_robot("ur5e"))
    steps = lambda: round(seconds(node.joint_states[-1].header.stamp) * 1e3) if node.joint_states else 0  # noqa: E731

    def send_response(step, efforts):
        stamped = Header(stamp=Time(nanosec=step * 10**6))
        node.publish("effort", JointState(header=stamped, name=library.joint_names, effort=efforts.tolist()))

    def answered_until(step, efforts):
        def there():
            if steps() < step:
                send_response(step - 1, efforts)
            return steps() >= step

        node.wait_until(there, f"step {step}")

    def commanded():
        node.send_efforts(EFFORTS)
        return steps() > 0

    node.wait_until(commanded, "steps")
    node.client.spin(0.2)
    first = steps()
    answered_until(first + 1, EFFORTS)
    for _ in range(5):  # late answers to the state before
        send_response(first, 9 * EFFORTS)
    node.client.spin(0.3)
    assert steps() == first + 1
    answered_until(first + 2, 2 * EFFORTS)
    for scale in [1] * (first + 1) + [2]:
        state = library.advance(1, efforts=EFFORTS * scale)
    np.testing.assert_array_equal(node.joint_states[-1].velocity, state.velocities)


def test_parameter_changes_keep_the_state_of_the_robot(start):
    joints = [f"panda_joint{k}" for k in range(1, 8)]
    posture = [0.1, -0.3, 0.2, -1.9, 0.1, 1.8, 0.5]
    initial_state = {"initial.joints": joints, "initial.positions": posture, "gravity": [0.0, 0.0, 0.0]}
    node = start(robot_file="panda", command_timeout=60.0, **initial_state)

    def pushed():
        node.send_efforts([1.0] + [0.0] * 6)
        return node.joint_states and node.joint_states[-1].velocity[0] > 0.1

    node.wait_until(pushed, "a motion")
    for values in ({"payload.link": "panda_link8", "payload.mass": 1.0}, {"step": 0.002}, {"seed": 3}):
        before = node.joint_states[-1]
        assert node.client.set_parameters(node.name, values).successful
        node.wait_until(lambda before=before: seconds(node.joint_states[-1].header.stamp)
                        > seconds(before.header.stamp) + 0.1, "that time goes on")  # fmt: skip
        after = node.joint_states[node.joint_states.index(before) :]
        jumps = np.abs(np.diff([state.position for state in after], axis=0)).max()
        assert jumps < 0.02 and after[-1].velocity[0] > 0.1 and np.any(after[-1].effort), (values, jumps)
    assert node.client.set_parameters(node.name, {"initial.positions": [*posture[:6], 0.7]}).successful
    node.wait_until(lambda: abs(node.joint_states[-1].position[6] - 0.7) < 1e-3, "where it begins now")
    refused = node.client.set_parameters(node.name, {"initial.positions": [0.1]})
    assert not refused.successful


def test_messages_have_the_time_of_the_node_without_publish_clock(start):
    node = start(robot_file="ur5e", base_motion="planar", publish_clock=False, stamped_cmd_vel=True, step=0.005)
    command = TwistStamped()
    command.twist.linear.y = 0.3

    def driven():
        node.publish(f"{node.name.rpartition('/')[0]}/cmd_vel", command)
        return node.odom and abs(node.odom[-1].twist.twist.linear.y - 0.3) < 1e-3

    node.wait_until(driven, "the twist that was commanded")
    now = node.client.node.get_clock().now().nanoseconds * 1e-9
    assert abs(seconds(node.joint_states[-1].header.stamp) - now) < 5
    assert not node.clock


def test_noise_follows_its_seed():
    simulation, stamp = Simulation(load_robot("ur5e")), Time()
    received_count = [
        joint_state_message(simulation, EFFORTS, (1e-3, 2e-3, np.random.default_rng(seed)), stamp).position
        for seed in (7, 7, 8)
    ]
    assert received_count[0] == received_count[1] != received_count[2] and 1e-5 < np.std(received_count[0]) < 5e-3


def test_divergence_stops_before_it_is_published_and_can_be_reset(start):
    node = start(robot_file="ur5e", step=0.01, **{"initial.joints": ["elbow_joint"], "initial.velocities": [4000.0]},
                 **{"initial.positions": [0.1]})  # fmt: skip
    node.wait_until(lambda: node.has_diagnostic("faster than anything real"), "what is wrong")
    assert max(abs(speed) for state in node.joint_states for speed in state.velocity) <= 1e9
    assert node.client.set_parameters(node.name, {"initial.velocities": [0.0]}).successful
    received_count = len(node.joint_states)
    node.wait_until(lambda: len(node.joint_states) > received_count + 10, "states again")


PARALLELOGRAM = """
format: 1
robot: parallelogram
parameters: {crank: 0.2, ground: 0.4}
base: {link: frame}
joints:
  - {joint: crank, link: crank, mdh: {}, initial_position: 1.0, mass: 1, centre_of_mass: [crank/2, 0, 0],
     central_inertia: {yy: crank^2/12, zz: crank^2/12}}
  - {joint: coupler, link: coupler, role: passive, mdh: {d: crank}, initial_position: -1.0, mass: 1,
     centre_of_mass: [ground/2, 0, 0], central_inertia: {yy: ground^2/12, zz: ground^2/12}}
  - {joint: rocker, link: rocker, antecedent: frame, role: passive, mdh: {d: ground}, initial_position: 1.0, mass: 1,
     centre_of_mass: [crank/2, 0, 0], central_inertia: {yy: crank^2/12, zz: crank^2/12}}
loops:
  - {joint: pin, moved: {antecedent: coupler, mdh: {d: ground}}, closed_on: {antecedent: rocker, xyz: [crank, 0, 0]},
     initial_position: 1.0}
"""


def test_parallelogram_keeps_its_assembly_mode_through_flat_positions(start, tmp_path):
    path = tmp_path / "parallelogram.yaml"
    path.write_text(PARALLELOGRAM)
    node = start(robot_file=str(path), **QUIET, **{"initial.joints": ["crank"], "initial.velocities": [6.0]})
    for _ in range(6):  # 1.2 s: from 1 rad to more than 8, through π and 2π
        last = node.make_steps(200)
        crank, coupler, rocker, pin = last.position
        np.testing.assert_allclose([crank + coupler, rocker - crank, pin - crank], 0, atol=1e-7)
        np.testing.assert_allclose(last.velocity, [6.0, -6.0, 6.0, 6.0], rtol=1e-7)
    time = seconds(last.header.stamp)
    assert time > 1.1 and crank == pytest.approx(1.0 + 6.0 * time, abs=1e-6)
