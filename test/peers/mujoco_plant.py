"""A robot in MuJoCo in the place of a real one, a separate process with topics: joint_states, /clock out, commands in.

It runs in lockstep: each step waits for the command for its state.

python mujoco_plant.py robot.urdf result.npz --seconds 4 --controller /computed_torque
"""

import argparse
import time

import mujoco
import numpy as np
import rclpy
from builtin_interfaces.msg import Duration, Time
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_dynamics.nodes.runner import make_events_executor

STEP = 1_000_000  # [ns] between two states
SUBSTEPS = 4  # of MuJoCo in one step
START_STEPS = 200  # before the trajectory begins
RAMP_STEPS = 300  # at its beginning in which errors are not counted: efforts begin with a ramp
TIMEOUT = 20.0  # [s] to wait for the controller, and for its first command
HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.6])
SWINGS = np.array([0.5, 0.35, 0.5, 0.45, 0.6, 0.5, 0.8])
RATES = 2 * np.pi * np.array([0.4, 0.5, 0.45, 0.6, 0.55, 0.5, 0.7])  # [rad/s]


def motion(t):
    """(3, ..., 7): positions, velocities, accelerations of swings about HOME that grow from rest, at times t (...)."""
    t = np.asarray(t)[..., None]
    growth = np.where(t < 1, t**3 * (10 - 15 * t + 6 * t**2), 1.0)
    growth_rate = np.where(t < 1, 30 * t**2 * (1 - t) ** 2, 0.0)
    growth_acceleration = np.where(t < 1, 60 * t * (1 - t) * (1 - 2 * t), 0.0)
    s, c = SWINGS * np.sin(RATES * t), SWINGS * RATES * np.cos(RATES * t)
    a = -(RATES**2) * s
    positions = HOME + growth * s
    velocities = growth_rate * s + growth * c
    accelerations = growth_acceleration * s + 2 * growth_rate * c + growth * a
    return np.stack([positions, velocities, accelerations])


class Plant:
    """The robot and its node."""

    def __init__(self, urdf, controller):
        self.model = mujoco.MjModel.from_xml_string(urdf)
        self.model.opt.timestep = STEP * 1e-9 / SUBSTEPS
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.data = mujoco.MjData(self.model)
        self.names = [self.model.joint(k).name for k in range(self.model.njnt)]
        self.data.qpos[:] = HOME
        self.node = rclpy.create_node("plant")
        self.executor = make_events_executor()
        self.executor.add_node(self.node)
        shallow = QoSProfile(depth=1)
        self.states = self.node.create_publisher(JointState, "joint_states", shallow)
        self.clock = self.node.create_publisher(Clock, "/clock", shallow)
        self.reference = self.node.create_publisher(JointTrajectory, f"{controller}/reference", shallow)
        self.commands, self.missed = None, 0
        self.node.create_subscription(Float64MultiArray, f"{controller}/commands", self.on_commands, shallow)

    def on_commands(self, message):
        self.commands = message.data

    def wait_for_controller(self):
        deadline = time.monotonic() + TIMEOUT
        while not (self.states.get_subscription_count() and self.reference.get_subscription_count()):
            if time.monotonic() > deadline:
                raise TimeoutError("no controller subscribes")
            time.sleep(0.05)

    def step(self, number, timeout):
        """Publish the state, wait for its command, and step; q, qd and efforts before the step."""
        ns = (number + 1) * STEP
        stamp = Time(sec=ns // 10**9, nanosec=ns % 10**9)
        state = JointState(name=self.names, position=self.data.qpos.tolist(), velocity=self.data.qvel.tolist())
        state.header.stamp = stamp
        self.commands = None
        self.clock.publish(Clock(clock=stamp))
        self.states.publish(state)
        deadline = time.monotonic() + timeout
        while self.commands is None and time.monotonic() < deadline:
            self.executor.spin_once(timeout_sec=0.05)
            if self.commands is None and number == 0:  # the controller may not have discovered this process yet
                self.states.publish(state)
        if self.commands is None:
            self.missed += 1
        else:
            self.data.qfrc_applied[:] = self.commands
        before = self.data.qpos.copy(), self.data.qvel.copy(), self.data.qfrc_applied.copy()
        mujoco.mj_step(self.model, self.data, SUBSTEPS)
        return before

    def send_reference(self, steps):
        """Publish the trajectory: points with all derivatives every 20 ms, from rest to rest."""
        times = np.arange(0.0, (steps - START_STEPS) * STEP * 1e-9 + 1.0, 0.02)
        message = JointTrajectory(joint_names=self.names)
        start = (START_STEPS + 1) * STEP
        message.header.stamp = Time(sec=start // 10**9, nanosec=start % 10**9)
        for t, (q, qd, qdd) in zip(times, np.swapaxes(motion(times), 0, 1), strict=True):
            ns = round(t * 1e9)
            point = JointTrajectoryPoint(positions=q, velocities=qd, accelerations=qdd)
            point.time_from_start = Duration(sec=ns // 10**9, nanosec=ns % 10**9)
            message.points.append(point)
        message.points[-1].velocities = message.points[-1].accelerations = np.zeros(7)
        self.reference.publish(message)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("urdf")
    parser.add_argument("result")
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--controller", default="/computed_torque")
    parser.add_argument("--namespace", default="/")
    options = parser.parse_args()
    rclpy.init(args=["--ros-args", "-r", f"__ns:={options.namespace}"])
    with open(options.urdf) as file:
        plant = Plant(file.read(), options.controller)
    plant.wait_for_controller()
    steps = START_STEPS + round(options.seconds / (STEP * 1e-9))
    records, start = [], time.monotonic()
    for number in range(steps):
        if number == START_STEPS // 2:
            plant.send_reference(steps)
        records.append(plant.step(number, TIMEOUT if number == 0 else 1.0))
    q, qd, efforts = (np.array(values) for values in zip(*records, strict=True))
    t = (np.arange(steps) - START_STEPS) * STEP * 1e-9
    reference = motion(np.maximum(t, 0.0))
    counted = slice(START_STEPS + RAMP_STEPS, None)
    np.savez(
        options.result,
        t=t[counted],
        error=(reference[0] - q)[counted],
        wanted=reference[:, counted],
        q=q,
        qd=qd,
        efforts=efforts,
        missed=plant.missed,
        took=time.monotonic() - start,
    )
    plant.executor.shutdown()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
