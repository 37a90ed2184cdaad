"""Kinematics of frames, momentum and energy by Pinocchio, in the conventions of this project."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

AXES = {"frame": pin.LOCAL, "world": pin.LOCAL_WORLD_ALIGNED}


class FrameState(NamedTuple):
    """pose: (4, 4) in the world; jacobian: (6, m) by all joints, those of the base first; twist, bias, acceleration:
    (6,), accelerations classical; bias without those of the joints and of the base."""

    pose: np.ndarray
    jacobian: np.ndarray
    twist: np.ndarray
    bias: np.ndarray
    acceleration: np.ndarray


class BodyState(NamedTuple):
    """centre, velocity: (3,) of the centre of mass; jacobian: (3, m); momentum: (6,), matrix: (6, m), bias, rate: (6,)
    of the momentum about it; kinetic, potential: [J], of weights only."""

    centre: np.ndarray
    velocity: np.ndarray
    jacobian: np.ndarray
    momentum: np.ndarray
    matrix: np.ndarray
    bias: np.ndarray
    rate: np.ndarray
    kinetic: float
    potential: float


def frame_state(peer, name, axes, q, qd, qdd, pose=None, twist=(), base_acceleration=()):
    """FrameState of a link frame of a PinocchioModel; base_acceleration: (6,), classical."""
    model, data, axes = peer.model, peer.data, AXES[axes]
    frame = model.getFrameId(name, pin.FrameType.BODY)
    position, velocity = peer.position(q, pose), peer.vector(qd, twist)
    jacobian = pin.computeFrameJacobian(model, data, position, frame, axes)[:, peer.rows]
    accelerations = []
    for of_joints, of_base in ((np.zeros(len(qd)), np.zeros(peer.base_size)), (qdd, np.array(base_acceleration))):
        pin.forwardKinematics(model, data, position, velocity, peer.vector(of_joints, peer.spatial(of_base, twist)))
        accelerations.append(pin.getFrameClassicalAcceleration(model, data, frame, axes).vector)
    placement = pin.updateFramePlacement(model, data, frame).homogeneous
    return FrameState(placement, jacobian, pin.getFrameVelocity(model, data, frame, axes).vector, *accelerations)


def body_state(peer, q, qd, qdd, pose=None, twist=(), base_acceleration=()):
    """BodyState of a PinocchioModel; base_acceleration: (6,), classical."""
    model, data = peer.model, peer.data
    position, velocity = peer.position(q, pose), peer.vector(qd, twist)
    rates = []
    for of_joints, of_base in ((np.zeros(len(qd)), np.zeros(peer.base_size)), (qdd, np.array(base_acceleration))):
        acceleration = peer.vector(of_joints, peer.spatial(of_base, twist))
        pin.computeCentroidalMomentumTimeVariation(model, data, position, velocity, acceleration)
        rates.append(data.dhg.vector.copy())
    pin.ccrba(model, data, position, velocity)
    matrix, momentum = data.Ag[:, peer.rows].copy(), data.hg.vector.copy()
    jacobian = pin.jacobianCenterOfMass(model, data, position)[:, peer.rows].copy()
    pin.centerOfMass(model, data, position, velocity)
    centre, centre_velocity = data.com[0].copy(), data.vcom[0].copy()
    armature = model.armature.copy()
    model.armature[:] = 0  # computeKineticEnergy of Pinocchio 4.1 leaves it out for joints of some kinds, unlike crba
    kinetic = pin.computeKineticEnergy(model, data, position, velocity) + 0.5 * velocity @ (armature * velocity)
    model.armature[:] = armature
    potential = pin.computePotentialEnergy(model, data, position)
    return BodyState(centre, centre_velocity, jacobian, momentum, matrix, *rates, kinetic, potential)
