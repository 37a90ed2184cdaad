"""Simulated flights of the free-flying arm in gravity: thrust carries and shakes its body; efforts by Pinocchio."""

from typing import NamedTuple

import numpy as np

from peers.flying_arm import flying

RATE = 100.0  # samples per second [1/s]
GRAVITY = (0.0, 0.0, -9.81)


class Sample(NamedTuple):
    """A sample at a time [s]: q, qd, efforts (6,) of the joints; pose (4, 4) and twist (6,) of the body."""

    time: float
    q: np.ndarray
    qd: np.ndarray
    efforts: np.ndarray
    pose: np.ndarray
    twist: np.ndarray


def swing(seed):
    """Random joint motion: a function of the time that returns positions, velocities and accelerations (6,)."""
    rng = np.random.default_rng(seed)
    rates = 2 * np.pi * rng.uniform(0.2, 0.7, (3, 6))
    phases, amplitudes = rng.uniform(0, 6, (3, 6)), rng.uniform(0.2, 0.5, (3, 6))

    def motion(time):
        angles = rates * time + phases
        positions = (amplitudes * np.sin(angles)).sum(0)
        velocities = (amplitudes * rates * np.cos(angles)).sum(0)
        accelerations = -(amplitudes * rates**2 * np.sin(angles)).sum(0)
        return positions, velocities, accelerations

    return motion


def flight(seed, duration):
    """Yield the Samples of a flight of a duration [s]."""
    simulation, peer = flying(GRAVITY, step=1 / RATE)
    motion = swing(seed)
    mass = sum(link.inertia.mass for link in simulation.robot.links)
    simulation.start(*motion(0.0)[:2])
    for number in range(int(duration * RATE)):
        state, time = simulation.state, number / RATE
        lift = state.pose[:3, :3].T @ (mass * np.array([0.0, 0.0, 9.81]))
        force = lift + 0.8 * mass * np.sin([3.0 * time, 2.3 * time + 1, 1.7 * time])
        torque = 0.3 * mass * np.sin([2.1 * time, 2.9 * time + 2, 3.7 * time])
        inputs = {"external_wrenches": {"base_body": np.concatenate([force, torque])}, "motion": motion}
        base_acceleration, qdd = simulation.accelerations(**inputs)
        q, qd = state.positions, state.velocities
        inertia_efforts = peer.inertia_matrix(q) @ np.concatenate([base_acceleration, qdd])
        efforts = (inertia_efforts + peer.bias(q, qd, state.pose, state.twist))[6:]
        yield Sample(time, q, qd, efforts, state.pose, state.twist)
        simulation.advance(**inputs)
