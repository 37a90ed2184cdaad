"""A robot in MuJoCo that stands in for the real one, as a process of its own over real topics: joint_states and /clock
out, commands in, in lockstep: each step waits for the command that answers its state.

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
SUBSTEPS = 4  # of MuJoCo in one of them
STARTS = 200  # steps before the trajectory begins
SETTLES = 300  # steps that the errors are not counted in, at its beginning: efforts come in by a ramp
PATIENCE = 20.0  # [s] for the controller to come, and for its first command
HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.6])
SWINGS = np.array([0.5, 0.35, 0.5, 0.45, 0.6, 0.5, 0.8])
RATES = 2 * np.pi * np.array([0.4, 0.5, 0.45, 0.6, 0.55, 0.5, 0.7])  # [rad/s]


def motion(t):
    """(3, ..., 7): positions, velocities, accelerations of swings about HOME that grow from rest, at times t (...)."""
    t = np.asarray(t)[..., None]
    grown, dgrown, ddgrown = (np.where(t < 1, f, g) for f, g in (
        (t**3 * (10 - 15 * t + 6 * t**2), 1.0),
        (30 * t**2 * (1 - t) ** 2, 0.0),
        (60 * t * (1 - t) * (1 - 2 * t), 0.0),
    ))  # fmt: skip
    s, c = SWINGS * np.sin(RATES * t), SWINGS * RATES * np.cos(RATES * t)
    a = -(RATES**2) * s
    return np.stack([HOME + grown * s, dgrown * s + grown * c, ddgrown * s + 2 * dgrown * c + grown * a])


class Plant:
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
        deadline = time.monotonic() + PATIENCE
        while not (self.states.get_subscription_count() and self.reference.get_subscription_count()):
            if time.monotonic() > deadline:
                raise TimeoutError("no controller came")
            time.sleep(0.05)

    def step(self, number, patience):
        """One step in lockstep: (q, qd, efforts)."""
        ns = (number + 1) * STEP
        stamp = Time(sec=ns // 10**9, nanosec=ns % 10**9)
        state = JointState(name=self.names, position=self.data.qpos.tolist(), velocity=self.data.qvel.tolist())
        state.header.stamp = stamp
        self.commands = None
        self.clock.publish(Clock(clock=stamp))
        self.states.publish(state)
        deadline = time.monotonic() + patience
        while self.commands is None and time.monotonic() < deadline:
            self.executor.spin_once(timeout_sec=0.05)
            if self.commands is None and number == 0:  # the controller may not know this process yet
                self.states.publish(state)
        if self.commands is None:
            self.missed += 1
        else:
            self.data.qfrc_applied[:] = self.commands
        before = self.data.qpos.copy(), self.data.qvel.copy(), self.data.qfrc_applied.copy()
        mujoco.mj_step(self.model, self.data, SUBSTEPS)
        return before

    def send_reference(self, steps):
        """The trajectory: points each 20 ms, of which all derivatives are told, from rest to rest."""
        times = np.arange(0.0, (steps - STARTS) * STEP * 1e-9 + 1.0, 0.02)
        message = JointTrajectory(joint_names=self.names)
        start = (STARTS + 1) * STEP
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
    told = parser.parse_args()
    rclpy.init(args=["--ros-args", "-r", f"__ns:={told.namespace}"])
    with open(told.urdf) as file:
        plant = Plant(file.read(), told.controller)
    plant.wait_for_controller()
    steps = STARTS + round(told.seconds / (STEP * 1e-9))
    recorded, began = [], time.monotonic()
    for number in range(steps):
        if number == STARTS // 2:
            plant.send_reference(steps)
        recorded.append(plant.step(number, PATIENCE if number == 0 else 1.0))
    q, qd, efforts = (np.array(values) for values in zip(*recorded, strict=True))
    t = (np.arange(steps) - STARTS) * STEP * 1e-9
    wanted = motion(np.maximum(t, 0.0))
    counted = slice(STARTS + SETTLES, None)
    np.savez(told.result, t=t[counted], error=(wanted[0] - q)[counted], wanted=wanted[:, counted], q=q, qd=qd,
             efforts=efforts, missed=plant.missed, took=time.monotonic() - began)  # fmt: skip
    plant.executor.shutdown()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
