"""A Panda in MuJoCo that moves fast and is pushed, with friction in the joints and realistic signals.

It runs in this process, much faster than real time: the plant has MuJoCo's dynamics, and a controller that knows them
follows sums of sines. Efforts are those of the motors, with noise; positions come from encoders, velocities are their
differences over 4 ms, 2 ms late."""

from typing import NamedTuple

import mujoco
import numpy as np

from peers.known_panda import COULOMB, VISCOUS
from peers.recorded import MIDDLE
from robot_dynamics.model.loading import shipped_robots

STEP = 0.001  # [s] between two states
SUBSTEPS = 2  # of MuJoCo in one step
ARMATURE = np.array([0.3, 0.3, 0.2, 0.2, 0.08, 0.08, 0.05])  # rotor inertia [kg m²]
NOISE = np.array([0.2, 0.2, 0.2, 0.2, 0.08, 0.08, 0.06])  # [N m] standard deviation of white noise on efforts
RESOLUTION = 2 * np.pi / 2**20  # [rad] of the encoders
DIFFERENCE = 4  # samples over which velocities are differences
STIFFNESS = 400.0  # [1/s²] of the controller
DAMPING = 40.0  # [1/s]
HAND = "panda_link7"
FLANGE = np.array([0.0, 0.0, 0.107])  # of panda_link8 in panda_link7 [m]
FASTEST = 0.7  # [Hz]


class State(NamedTuple):
    """time [s]; q, qd, efforts (7,) as they are measured; force (3,) [N] that pushes the flange, in the world."""

    time: float
    q: np.ndarray
    qd: np.ndarray
    efforts: np.ndarray
    force: np.ndarray


class Sines:
    """Reference of the joints: sums of sines of random phase, fast enough for velocities of 2 rad/s."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.rates = 2 * np.pi * rng.uniform(0.1, FASTEST, (4, 7))
        self.phases = rng.uniform(0, 2 * np.pi, (4, 7))
        self.amplitudes = rng.uniform(0.5, 1.0, (4, 7)) * np.array([0.3, 0.2, 0.3, 0.2, 0.4, 0.3, 0.5]) * 0.9

    def __call__(self, t):
        angles = self.rates * t + self.phases
        sines, cosines = self.amplitudes * np.sin(angles), self.amplitudes * np.cos(angles)
        return (
            MIDDLE + sines.sum(axis=0),
            (self.rates * cosines).sum(axis=0),
            -(self.rates**2 * sines).sum(axis=0),
        )


def run(duration, seed, push=lambda t: None):
    """Yield states of a run, one for each STEP.

    duration: [s]; push: returns a force (3,) [N] on the flange in the world at a time [s], or None."""
    model = mujoco.MjModel.from_xml_string(shipped_robots()["panda"].read_text())
    model.opt.timestep = STEP / SUBSTEPS
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.dof_damping[:] = VISCOUS
    model.dof_frictionloss[:] = COULOMB
    model.dof_armature[:] = ARMATURE
    model.jnt_limited[:] = 0
    model.geom_contype[:] = 0
    data = mujoco.MjData(model)
    hand = model.body(HAND).id
    reference, rng = Sines(seed), np.random.default_rng([seed, 1])
    data.qpos[:], data.qvel[:], _ = reference(0.0)
    history = [np.round(data.qpos / RESOLUTION) * RESOLUTION - data.qvel * STEP * k for k in range(DIFFERENCE, 0, -1)]
    inertial = np.zeros(7)
    nothing, pushed = np.zeros(3), np.zeros(7)
    applied = np.zeros(7)
    for number in range(round(duration / STEP)):
        t = number * STEP
        mujoco.mj_forward(model, data)
        q, qd, qdd = reference(t)
        wanted = qdd + STIFFNESS * (q - data.qpos) + DAMPING * (qd - data.qvel)
        mujoco.mj_mulM(model, data, inertial, wanted)
        applied = inertial + data.qfrc_bias + VISCOUS * qd + COULOMB * np.tanh(qd / 0.02)
        force = push(t)
        force = nothing if force is None else force
        encoder = np.round(data.qpos / RESOLUTION) * RESOLUTION
        velocity = (encoder - history.pop(0)) / (DIFFERENCE * STEP)
        history.append(encoder)
        yield State(t, encoder, velocity, applied + NOISE * rng.normal(size=7), force)
        pushed[:] = 0
        if force is not nothing:
            point = data.body(hand).xpos + data.body(hand).xmat.reshape(3, 3) @ FLANGE
            mujoco.mj_applyFT(model, data, force, nothing, point, hand, pushed)
        data.qfrc_applied[:] = applied + pushed
        mujoco.mj_step(model, data, SUBSTEPS)
