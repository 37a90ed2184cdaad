"""Motion of a robot from Pinocchio's aba, integrated at high order by SciPy, with a quaternion for the base."""

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation


def integrated(peer, q, qd, efforts, seconds, pose=None, twist=()):
    """(pose (4, 4) or None, twist, q, qd) after some seconds, by DOP853 at a tolerance of 1e-12.

    peer: PinocchioModel; efforts: a function of the time [s] that gives (n,).
    """
    n, base = len(q), peer.base_size
    start = [] if not base else [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat(), *twist]

    def derivative(time, y):
        joints = y[-2 * n :]
        if not base:
            return np.concatenate([joints[n:], peer.direct(joints[:n], joints[n:], efforts(time))[0]])
        R = Rotation.from_quat(y[3:7])
        placed = pin.SE3(R.as_matrix(), y[:3]).homogeneous
        velocity, push = peer.vector(joints[n:], y[7:13]), peer.vector(efforts(time), np.zeros(6))
        found = pin.aba(peer.model, peer.data, peer.position(joints[:n], placed), velocity, push)[peer.rows]
        x, y_, z, w = y[3:7]
        a, b, c = y[10:13]
        turning = 0.5 * np.array([w * a + y_ * c - z * b, w * b + z * a - x * c, w * c + x * b - y_ * a,
                                  -x * a - y_ * b - z * c])  # fmt: skip
        return np.concatenate([R.apply(y[7:10]), turning, found[:6], joints[n:], found[6:]])

    found = solve_ivp(derivative, (0, seconds), np.concatenate([start, q, qd]), method="DOP853", rtol=1e-12, atol=1e-12)
    y = found.y[:, -1]
    if not base:
        return None, np.zeros(6), y[:n], y[n:]
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = Rotation.from_quat(y[3:7]).as_matrix(), y[:3]
    return placed, y[7:13], y[13 : 13 + n], y[13 + n :]


def momentum(peer, q, qd, pose, twist):
    """(6,) [linear; angular] momentum in the world, at the world's origin."""
    pin.computeCentroidalMomentum(peer.model, peer.data, peer.position(q, pose), peer.vector(qd, twist))
    found = peer.data.hg
    return np.concatenate([found.linear, found.angular + np.cross(peer.data.com[0], found.linear)])


def energy(peer, q, qd, pose=None, twist=()):
    """(kinetic, potential) [J]."""
    position, velocity = peer.position(q, pose), peer.vector(qd, twist)
    kinetic = pin.computeKineticEnergy(peer.model, peer.data, position, velocity)
    return kinetic, pin.computePotentialEnergy(peer.model, peer.data, position)
