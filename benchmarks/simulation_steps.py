"""Time of one step of a simulation of 1 ms, beside MuJoCo's step in the same run.

Our steps are of order 6 with an estimate of their error; loops are closed to rounding after each. MuJoCo's RK4 is of
order 4, its Euler method of order 1. Its loops are equality constraints, which are soft. Both compute from states that
continue: `--steps` in one call of ours, in a loop of Python over mj_step, and in one call of MuJoCo's rollout. Rounds
alternate; the ratio is the median of the ratios of the rounds: above 1, we are that many times faster. All times are
processor time on one thread.
"""

import argparse
import sys
import time
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from inverse_direct import time_both
from mujoco_loops import MujocoLoops

from robot_dynamics import Simulation, load_robot, shipped_robots, simulate

LOOPED = ("four_bar", "irb460", "gough_stewart")
STEP = 0.001
ROLLOUTS = 256
INTEGRATORS = {"RK4": mujoco.mjtIntegrator.mjINT_RK4, "Euler": mujoco.mjtIntegrator.mjINT_EULER}
SPEED = 0.1
"""Largest velocity at the start [rad/s or m/s]."""


def panda():
    """The Panda in MuJoCo, without contacts."""
    model = mujoco.MjModel.from_xml_string(shipped_robots()["panda"].read_text())
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return model


def rows(name, model, q, steps):
    """(label, our call, the peer's call, simulations in each) of a robot whose start in MuJoCo is q (nq,)."""
    simulation = Simulation(load_robot(name), step=STEP)
    velocities = np.random.default_rng(0).uniform(-SPEED, SPEED, len(simulation.joint_names))
    simulation.start(velocities=velocities)
    model.opt.timestep = STEP

    def advance():
        simulation.reset()
        simulation.advance(steps)

    data = mujoco.MjData(model)
    start = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    for label, integrator in INTEGRATORS.items():
        model.opt.integrator = integrator
        data.qpos[:], data.qvel[:] = q, 0
        mujoco.mj_getState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)

        def step_by_step():
            mujoco.mj_setState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
            for _ in range(steps):
                mujoco.mj_step(model, data)

        def in_one_call():
            rollout.rollout(model, data, start[None], nstep=steps)

        yield f"{name}, beside mj_step, {label}", advance, step_by_step, 1
        yield f"{name}, beside rollout, {label}", advance, in_one_call, 1


def rollout_row(model, steps):
    """Many simulations of the Panda with efforts of their own, each step recorded, beside MuJoCo's rollout."""
    robot = load_robot("panda")
    simulation = Simulation(robot)
    rng = np.random.default_rng(0)
    shape = (ROLLOUTS, len(simulation.joint_names))
    positions = simulation.state.positions + 0.01 * rng.normal(size=shape)
    velocities = rng.uniform(-SPEED, SPEED, shape)
    efforts = rng.uniform(-1, 1, (ROLLOUTS, steps, shape[1]))
    model.opt.timestep, model.opt.integrator = STEP, INTEGRATORS["RK4"]
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec = mujoco.mjtState.mjSTATE_QFRC_APPLIED
    data = mujoco.MjData(model)
    columns = [model.joint(name).dofadr[0] for name in simulation.joint_names]
    start = np.zeros((ROLLOUTS, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    for row, (q, qd) in enumerate(zip(positions, velocities, strict=True)):
        data.qpos[columns], data.qvel[columns] = q, qd
        mujoco.mj_getState(model, data, start[row], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    controls = np.zeros((ROLLOUTS, steps, model.nv))
    controls[..., columns] = efforts

    def ours():
        simulate(robot, positions, velocities, efforts, threads=1)

    def theirs():
        rollout.rollout(model, data, start, control=controls, control_spec=spec.value)

    yield f"panda, {ROLLOUTS} rollouts, beside rollout, RK4", ours, theirs, ROLLOUTS


def cases(steps):
    """The rows of all robots."""
    yield from rows("panda", panda(), np.zeros(9)[: panda().nq], steps)
    yield from rollout_row(panda(), steps)
    for name in LOOPED:
        robot = load_robot(name)
        q = Simulation(robot).state.joint_positions
        peer = MujocoLoops(robot, q)
        yield from rows(name, peer.model, peer.to_mujoco_order(q), steps)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--steps", type=int, default=100)
    options = parser.parse_args()
    print(f"{'a step of 1 ms':40} {'ours':>10} {'peer':>10} {'ratio':>7}")
    for label, ours, theirs, simulations in cases(options.steps):
        seconds, peer_seconds, ratio = time_both(ours, theirs, options.rounds, time.process_time)
        micro = 1e6 / options.steps / simulations
        print(f"{label:40} {micro * seconds:7.2f} µs {micro * peer_seconds:7.2f} µs {1 / ratio:7.2f}")


if __name__ == "__main__":
    main()
