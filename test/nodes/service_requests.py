"""Requests from arrays and arrays from responses, independent of the codecs of the server."""

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Transform, Twist, WrenchStamped
from trajectory_msgs.msg import JointTrajectoryPoint, MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from robot_dynamics_interfaces.srv import (
    DirectDynamics,
    DynamicsTerms,
    FrameKinematics,
    InverseDynamics,
    Linearize,
    NaturalFrequencies,
    StaticEquilibrium,
    WholeBody,
)

STEP_NS = 2_000_000  # ns between points
PANDA = [f"panda_joint{k}" for k in range(1, 8)]
SERVICES = {
    InverseDynamics.Request: (InverseDynamics, "inverse_dynamics"),
    DirectDynamics.Request: (DirectDynamics, "direct_dynamics"),
    DynamicsTerms.Request: (DynamicsTerms, "dynamics_terms"),
    StaticEquilibrium.Request: (StaticEquilibrium, "static_equilibrium"),
    FrameKinematics.Request: (FrameKinematics, "frame_kinematics"),
    WholeBody.Request: (WholeBody, "whole_body"),
    Linearize.Request: (Linearize, "linearize"),
    NaturalFrequencies.Request: (NaturalFrequencies, "natural_frequencies"),
}


def call_service(client, server, request):
    """The response to a request, successful or not."""
    kind, service = SERVICES[type(request)]
    return client.call(kind, f"{server}/{service}", request)


def call_successfully(client, server, request):
    """The successful response to a request."""
    response = call_service(client, server, request)
    assert response.success, response.message
    assert response.message == ""
    return response


def motion(count, joints, seed=0):
    """Positions, velocities, accelerations (count, joints)."""
    return np.random.default_rng(seed).uniform(-1, 1, (3, count, joints))


def point(k, **fields):
    seconds, nanoseconds = divmod(k * STEP_NS, 10**9)
    built = JointTrajectoryPoint(time_from_start=Duration(sec=seconds, nanosec=nanoseconds))
    for field, values in fields.items():
        setattr(built, field, np.asarray(values, dtype=float).tolist())
    return built


def inverse_request(joints, q, qd, qdd, **others):
    request = InverseDynamics.Request(**others)
    request.trajectory.joint_names = list(joints)
    request.trajectory.points = [
        point(k, positions=q[k], velocities=qd[k], accelerations=qdd[k]) for k in range(len(q))
    ]
    return request


def direct_request(joints, q, qd, efforts, **others):
    request = DirectDynamics.Request(**others)
    request.trajectory.joint_names = list(joints)
    request.trajectory.points = [point(k, positions=q[k], velocities=qd[k], effort=efforts[k]) for k in range(len(q))]
    return request


def terms_request(joints, q, qd, base=None):
    request = DynamicsTerms.Request(joint_names=list(joints), state=point(0, positions=q, velocities=qd))
    if base is not None:
        request.base = base
    return request


def equilibrium_request(joints, q, **others):
    request = StaticEquilibrium.Request(**others)
    request.trajectory.joint_names = list(joints)
    request.trajectory.points = [point(k, positions=q[k]) for k in range(len(q))]
    return request


def base_trajectory(quaternions, positions, twists, accelerations=None):
    """MultiDOFJointTrajectory of quaternions (x, y, z, w), positions, twists and, if present, accelerations."""
    message = MultiDOFJointTrajectory()
    for k, (quaternion, position, velocity) in enumerate(zip(quaternions, positions, twists, strict=True)):
        transform = Transform()
        transform.rotation.x, transform.rotation.y, transform.rotation.z, transform.rotation.w = map(float, quaternion)
        transform.translation.x, transform.translation.y, transform.translation.z = map(float, position)
        built = MultiDOFJointTrajectoryPoint(transforms=[transform], velocities=[twist(velocity)])
        if accelerations is not None:
            built.accelerations = [twist(accelerations[k])]
        message.points.append(built)
    return message


def twist(values):
    built = Twist()
    built.linear.x, built.linear.y, built.linear.z = map(float, values[:3])
    built.angular.x, built.angular.y, built.angular.z = map(float, values[3:])
    return built


def wrench(link, values, stamp=None):
    """WrenchStamped; stamp: index of the point, None for every point."""
    built = WrenchStamped()
    built.header.frame_id = link
    if stamp is not None:
        built.header.stamp = Time(sec=stamp * STEP_NS // 10**9, nanosec=stamp * STEP_NS % 10**9)
    built.wrench.force.x, built.wrench.force.y, built.wrench.force.z = map(float, values[:3])
    built.wrench.torque.x, built.wrench.torque.y, built.wrench.torque.z = map(float, values[3:])
    return built


def assert_same(values, expected):
    """Assert that values agree up to rounding: after some time of use the server computes by compiled programs."""
    np.testing.assert_allclose(values, expected, rtol=1e-11, atol=1e-11)


def field(trajectory, name):
    return np.array([getattr(point, name) for point in trajectory.points])


def twist_values(message):
    return np.array([*(getattr(part, axis) for part in (message.linear, message.angular) for axis in "xyz")])


def base_accelerations(base):
    return np.array([twist_values(point.accelerations[0]) for point in base.points])


def wrench_values(stamped):
    f, m = stamped.wrench.force, stamped.wrench.torque
    return np.array([f.x, f.y, f.z, m.x, m.y, m.z])


Q, QD, QDD = motion(3, 7)


def assert_still_serves(client, server, panda_dynamics):
    """Assert that a server of the Panda returns the results of the library."""
    served = call_successfully(client, server, inverse_request(PANDA, Q, QD, QDD))
    assert_same(field(served.trajectory, "effort"), panda_dynamics.inverse(Q, QD, QDD))


def inverse(names=PANDA, q=Q, qd=QD, qdd=QDD, **others):
    """A valid request to a server of the Panda, apart from the arguments."""
    return inverse_request(names, q, qd, qdd, **others)
