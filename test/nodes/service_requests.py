"""Requests from arrays and arrays from responses, written apart from what the server uses."""

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Transform, Twist, WrenchStamped
from trajectory_msgs.msg import JointTrajectoryPoint, MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from robot_dynamics_interfaces.srv import (
    DirectDynamics,
    DynamicsTerms,
    InverseDynamics,
    NaturalFrequencies,
    StaticEquilibrium,
)

STEP_NS = 2_000_000  # ns between points
PANDA = [f"panda_joint{k}" for k in range(1, 8)]
SERVICES = {
    InverseDynamics.Request: (InverseDynamics, "inverse_dynamics"),
    DirectDynamics.Request: (DirectDynamics, "direct_dynamics"),
    DynamicsTerms.Request: (DynamicsTerms, "dynamics_terms"),
    StaticEquilibrium.Request: (StaticEquilibrium, "static_equilibrium"),
    NaturalFrequencies.Request: (NaturalFrequencies, "natural_frequencies"),
}


def call_service(client, server, request):
    """The response to a request, whatever it says."""
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
    made = JointTrajectoryPoint(time_from_start=Duration(sec=seconds, nanosec=nanoseconds))
    for field, values in fields.items():
        setattr(made, field, np.asarray(values, dtype=float).tolist())
    return made


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
    """MultiDOFJointTrajectory of poses (x, y, z, w), positions and twists, and accelerations where given."""
    message = MultiDOFJointTrajectory()
    for k, (quaternion, position, velocity) in enumerate(zip(quaternions, positions, twists, strict=True)):
        transform = Transform()
        transform.rotation.x, transform.rotation.y, transform.rotation.z, transform.rotation.w = map(float, quaternion)
        transform.translation.x, transform.translation.y, transform.translation.z = map(float, position)
        made = MultiDOFJointTrajectoryPoint(transforms=[transform], velocities=[twist(velocity)])
        if accelerations is not None:
            made.accelerations = [twist(accelerations[k])]
        message.points.append(made)
    return message


def twist(values):
    made = Twist()
    made.linear.x, made.linear.y, made.linear.z = map(float, values[:3])
    made.angular.x, made.angular.y, made.angular.z = map(float, values[3:])
    return made


def wrench(link, values, stamp=None):
    """WrenchStamped; stamp: number of the point, None for every point."""
    made = WrenchStamped()
    made.header.frame_id = link
    if stamp is not None:
        made.header.stamp = Time(sec=stamp * STEP_NS // 10**9, nanosec=stamp * STEP_NS % 10**9)
    made.wrench.force.x, made.wrench.force.y, made.wrench.force.z = map(float, values[:3])
    made.wrench.torque.x, made.wrench.torque.y, made.wrench.torque.z = map(float, values[3:])
    return made


def field(trajectory, name):
    return np.array([getattr(point, name) for point in trajectory.points])


def twist_values(told):
    return np.array([*(getattr(part, axis) for part in (told.linear, told.angular) for axis in "xyz")])


def base_accelerations(base):
    return np.array([twist_values(point.accelerations[0]) for point in base.points])


def wrench_values(stamped):
    f, m = stamped.wrench.force, stamped.wrench.torque
    return np.array([f.x, f.y, f.z, m.x, m.y, m.z])


Q, QD, QDD = motion(3, 7)


def assert_still_serves(client, server, panda_dynamics):
    """Assert that a server of the Panda answers as the library does."""
    answer = call_successfully(client, server, inverse_request(PANDA, Q, QD, QDD))
    np.testing.assert_array_equal(field(answer.trajectory, "effort"), panda_dynamics.inverse(Q, QD, QDD))


def inverse(names=PANDA, q=Q, qd=QD, qdd=QDD, **others):
    """A good question to a server of the Panda, but for what is given."""
    return inverse_request(names, q, qd, qdd, **others)
