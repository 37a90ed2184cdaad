"""The first part of the demo: calls of a dynamics_server, a table of the results and a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.model.loading import load_robot
from robot_dynamics.nodes.demo.motion import trajectory_points
from robot_dynamics.plots.plot_labels import plain_label
from robot_dynamics.plots.plot_limits import draw_limits
from robot_dynamics.plots.plot_style import PAGE_WIDTH, new_figure, plot_style, save_figure
from robot_dynamics_interfaces.srv import DirectDynamics, DynamicsTerms, InverseDynamics

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.nodes.client import ServiceClient
    from robot_dynamics.nodes.demo.motion import Motion

POINTS = 401
PAYLOAD_LINK = "panda_link8"
PAYLOAD_MASS = 2.0  # [kg]
PAYLOAD_HEIGHT = 0.1  # [m] beyond the flange


class DynamicsClient:
    """Calls the services of a dynamics_server; raises RobotDynamicsError if a request is refused."""

    def __init__(self, client: ServiceClient, server: str, joint_names: list[str]) -> None:
        self._client = client
        self._server = server
        self._joint_names = joint_names

    def efforts(self, times: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """Return efforts (N, n) of a motion."""
        request = InverseDynamics.Request()
        request.trajectory.joint_names = self._joint_names
        request.trajectory.points = trajectory_points(times, positions=q, velocities=qd, accelerations=qdd)
        response = self._call(InverseDynamics, "inverse_dynamics", request)
        return np.array([point.effort for point in response.trajectory.points])

    def accelerations(self, times: Array, q: Array, qd: Array, efforts: Array) -> Array:
        """Return accelerations (N, n) of efforts."""
        request = DirectDynamics.Request()
        request.trajectory.joint_names = self._joint_names
        request.trajectory.points = trajectory_points(times, positions=q, velocities=qd, effort=efforts)
        response = self._call(DirectDynamics, "direct_dynamics", request)
        return np.array([point.accelerations for point in response.trajectory.points])

    def terms(self, q: Array, qd: Array) -> DynamicsTerms.Response:
        """Return the terms of the model at one state (n,)."""
        request = DynamicsTerms.Request(joint_names=self._joint_names)
        request.state = JointTrajectoryPoint(positions=q.tolist(), velocities=qd.tolist())
        return self._call(DynamicsTerms, "dynamics_terms", request)

    def set_payload(self, link: str, mass: float, height: float) -> None:
        """Attach a point mass [kg] to a link, at a height [m] on its z axis."""
        inertia = mass * height**2
        payload = {
            "payload.link": link,
            "payload.mass": mass,
            "payload.first_moments": [0.0, 0.0, mass * height],
            "payload.inertia": [inertia, 0.0, 0.0, inertia, 0.0, 0.0],
        }
        result = self._client.set_parameters(self._server, payload)
        if not result.successful:
            raise RobotDynamicsError(result.reason)

    def _call(self, kind: type, service: str, request: object) -> Any:
        response = self._client.call(kind, f"{self._server}/{service}", request)
        if not response.success:
            raise RobotDynamicsError(f"{service}: {response.message}")
        return response


def show_services(client: ServiceClient, server: str, motion: Motion, picture: str) -> int:
    """Print and draw the joint torques of a motion of the Panda.

    Returns the exit status: 0 if direct dynamics returns the accelerations of the motion.
    """
    robot = load_robot("panda")
    names = [joint.name for joint in robot.joints]
    limits = np.array([joint.limits.effort for joint in robot.joints])
    times = np.linspace(0, motion.duration, POINTS)
    q, qd, qdd = motion.sample(times)
    middle = POINTS // 2

    dynamics = DynamicsClient(client, server, names)
    unloaded = dynamics.efforts(times, q, qd, qdd)
    accelerations = dynamics.accelerations(times, q, qd, unloaded)
    terms = dynamics.terms(q[middle], qd[middle])
    dynamics.set_payload(PAYLOAD_LINK, PAYLOAD_MASS, PAYLOAD_HEIGHT)
    loaded = dynamics.efforts(times, q, qd, qdd)

    print(f"\n{POINTS} points of a motion of {motion.duration} s, computed by {server}/inverse_dynamics [N m]\n")
    print("joint          peak torque   gravity, half way   Coriolis, half way   peak with 2 kg   limit")
    for k, name in enumerate(names):
        print(
            f"{name:<14} {np.abs(unloaded[:, k]).max():11.2f} {terms.gravity[k]:19.2f} {terms.coriolis[k]:20.2f} "
            f"{np.abs(loaded[:, k]).max():16.2f} {limits[k]:7.0f}"
        )
    error = np.abs(accelerations - qdd).max()
    print(f"\ndirect_dynamics returns these accelerations to {error:.1e} rad/s²")
    draw(picture, times, unloaded, loaded, robot.joints)
    print(f"picture: {picture}")
    return 0 if error < 1e-6 else 1


@plot_style()
def draw(picture: str, times: Array, unloaded: Array, loaded: Array, joints: Sequence[Joint]) -> None:
    """Draw efforts (N, n) without and with the payload into a file."""
    figure = new_figure(PAGE_WIDTH, 3.5)
    panels = figure.subplots(2, 4, sharex=True).ravel()
    for k, joint in enumerate(joints):
        axes = panels[k]
        axes.plot(times, unloaded[:, k], label="empty")
        axes.plot(times, loaded[:, k], label=f"with {PAYLOAD_MASS:g} kg\nat the flange")
        axes.set_title(plain_label(joint.name))
        draw_limits(axes, -joint.limits.effort, joint.limits.effort, "N m")
    # of all panels: a limit is near the curves in some of them
    entries = {
        label: line for axes in figure.axes for line, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    panels[-1].axis("off")
    panels[-1].legend(entries.values(), entries.keys(), loc="center")
    figure.supxlabel("time [s]")
    figure.supylabel("torque [N m]")
    figure.suptitle("Franka Panda: joint torques of one motion, computed by dynamics_server")
    save_figure(figure, picture)
