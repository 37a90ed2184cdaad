"""Time of one step of a simulation of 1 ms, beside MuJoCo's step in the same run.

Our steps are of order 6 with an estimate of their error; loops are closed to rounding after each. MuJoCo's RK4 is of
order 4, its Euler method of order 1. Its loops are equality constraints, which are soft. Both compute from states that
continue: `--steps` in one call of ours, in a loop of Python over mj_step, and in one call of MuJoCo's rollout. Rounds
alternate; the ratio is the median of the ratios of the rounds: above 1, we are that many times faster. All times are
processor time on one thread.

The Panda with friction has all kinds of friction, as `identify` fits it: MuJoCo has viscous and dry friction alone.
Robots on moving bases: the Panda that flies freely, beside that of MuJoCo with a free joint; a TurtleBot3 that is
driven on its wheels, without a peer (wheels of MuJoCo need contacts).
"""

import argparse
import sys
import time
from copy import copy
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from inverse_direct import time_both
from mujoco_loops import MujocoLoops

from robot_dynamics import Inertia, Simulation, load_robot, shipped_robots, simulate
from robot_dynamics.simulation import Wheel

LOOPED = ("four_bar", "irb460", "gough_stewart")
STEP = 0.001
ROLLOUTS = 256
INTEGRATORS = {"RK4": mujoco.mjtIntegrator.mjINT_RK4, "Euler": mujoco.mjtIntegrator.mjINT_EULER}
CENTRE = np.array([0.0, 0.0, 0.05])
"""Centre of mass of payloads [m]."""
SPEED = 0.1
"""Largest velocity at the start [rad/s or m/s]."""


FRICTION = {
    "viscous_friction": 5.0,
    "viscous_asymmetry": 0.5,
    "coulomb_friction": 2.0,
    "coulomb_asymmetry": 0.3,
    "stribeck_friction": 1.0,
    "stribeck_velocity": 0.1,
    "load_friction": 0.05,
}
"""Friction of a joint as `identify` fits it."""
FLOATING = (
    '<link name="world_root"/><joint name="root" type="floating"><parent link="world_root"/>'
    '<child link="panda_link0"/></joint></robot>'
)


def panda(ending="</robot>"):
    """The Panda in MuJoCo, without contacts."""
    model = mujoco.MjModel.from_xml_string(shipped_robots()["panda"].read_text().replace("</robot>", ending))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return model


def start(robot, inputs=None, **options):
    """A function that takes some steps of a robot from one state, with efforts of zero and other inputs."""
    simulation = Simulation(robot, step=STEP, **options)
    velocities = np.random.default_rng(0).uniform(-SPEED, SPEED, len(simulation.joint_names))
    simulation.start(velocities=velocities)

    def advance(steps):
        simulation.reset()
        simulation.advance(steps, **(inputs or {}))

    return advance


def rows(label, advance, model, q, steps):
    """(label, our call, the peer's call, simulations in each) of a robot whose start in MuJoCo is q (nq,)."""
    model.opt.timestep = STEP

    def ours():
        advance(steps)

    data = mujoco.MjData(model)
    start = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    for integrator_name, integrator in INTEGRATORS.items():
        model.opt.integrator = integrator
        data.qpos[:], data.qvel[:] = q, 0
        mujoco.mj_getState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)

        def step_by_step():
            mujoco.mj_setState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
            for _ in range(steps):
                mujoco.mj_step(model, data)

        def in_one_call():
            rollout.rollout(model, data, start[None], nstep=steps)

        yield f"{label}, beside mj_step, {integrator_name}", ours, step_by_step, 1
        yield f"{label}, beside rollout, {integrator_name}", ours, in_one_call, 1


def rollout_rows(model, steps):
    """Many simulations of the Panda with efforts of their own, each step recorded, beside MuJoCo's rollout."""
    robot = load_robot("panda")
    simulation = Simulation(robot, step=STEP)
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
        simulate(simulation, positions, velocities, efforts, threads=1)

    def with_programs_loaded():
        simulate(robot, positions, velocities, efforts, threads=1)

    def theirs():
        rollout.rollout(model, data, start, control=controls, control_spec=spec.value)

    name = robot.frames[-1].name
    masses = rng.uniform(0, 2, ROLLOUTS)
    loaded_robots = [
        robot.with_payload(name, Inertia.about_centre_of_mass(m, 1e-3 * np.eye(3), CENTRE)) for m in masses
    ]
    loaded_models = [copy(model) for _ in masses]
    for loaded_model, mass in zip(loaded_models, masses, strict=True):
        loaded_model.body_mass[-1] += mass

    def with_payloads():
        simulate(loaded_robots, positions, velocities, efforts, threads=1)

    def theirs_with_payloads():
        rollout.rollout(loaded_models, data, start, control=controls, control_spec=spec.value)

    label = f"panda, {ROLLOUTS} rollouts"
    yield f"{label}, beside rollout, RK4", ours, theirs, ROLLOUTS
    yield f"{label}, programs loaded each time", with_programs_loaded, theirs, ROLLOUTS
    yield f"{label}, the same, a payload each", with_payloads, theirs_with_payloads, ROLLOUTS


def looped_rollout_row(name, peer, q, steps):
    """Many simulations of a robot with loops, each step recorded, beside MuJoCo's rollout."""
    simulation = Simulation(load_robot(name), step=STEP)
    rng = np.random.default_rng(0)
    shape = (ROLLOUTS, len(simulation.joint_names))
    velocities = rng.uniform(-SPEED, SPEED, shape)
    positions = np.tile(simulation.state.positions, (ROLLOUTS, 1))
    efforts = np.zeros((ROLLOUTS, steps, shape[1]))
    model = peer.model
    model.opt.timestep, model.opt.integrator = STEP, INTEGRATORS["RK4"]
    data = mujoco.MjData(model)
    data.qpos[:] = peer.to_mujoco_order(q)
    start = np.zeros((ROLLOUTS, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    mujoco.mj_getState(model, data, start[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start[:] = start[0]

    def ours():
        simulate(simulation, positions, velocities, efforts, threads=1)

    def theirs():
        rollout.rollout(model, data, start, nstep=steps)

    yield f"{name}, {ROLLOUTS} rollouts, beside rollout, RK4", ours, theirs, ROLLOUTS


def tree_rows(steps):
    """The rows of single simulations without loops."""
    robot = load_robot("panda")
    yield from rows("panda", start(robot), panda(), np.zeros(panda().nq), steps)
    with_friction = replace(robot, joints=tuple(replace(joint, **FRICTION) for joint in robot.joints))
    model = panda()
    model.dof_damping[:] = FRICTION["viscous_friction"]
    model.dof_frictionloss[:] = FRICTION["coulomb_friction"]
    yield from rows("panda, friction", start(with_friction), model, np.zeros(model.nq), steps)
    link = robot.links[-1].name
    pushed = start(robot, {"external_wrenches": {link: [1.0, 2, 3, 0.1, 0.2, 0.3]}})
    yield from rows("panda, wrench on the tip", pushed, panda(), np.zeros(panda().nq), steps)
    model = panda(FLOATING)
    yield from rows("panda, free base", start(robot, base="free"), model, model.qpos0, steps)
    wheels = [Wheel("wheel_left_joint", 0.033), Wheel("wheel_right_joint", 0.033)]
    driven = start(load_robot("turtlebot3_burger"), {"drive": [0.1, 0, 0, 0, 0, 0.5]}, wheels=wheels)
    yield "turtlebot3_burger, driven", lambda: driven(steps), None, 1


def cases(steps, with_single):
    """The rows of all robots; with_single: not only those of rollouts."""
    if with_single:
        yield from tree_rows(steps)
    yield from rollout_rows(panda(), steps)
    for name in LOOPED:
        robot = load_robot(name)
        q = Simulation(robot).state.joint_positions
        peer = MujocoLoops(robot, q)
        if with_single:
            yield from rows(name, start(robot), peer.model, peer.to_mujoco_order(q), steps)
        yield from looped_rollout_row(name, peer, q, steps)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--rollouts", action="store_true", help="only the rows of rollouts")
    options = parser.parse_args()
    print(f"{'a step of 1 ms':40} {'ours':>10} {'peer':>10} {'ratio':>7}")
    for label, ours, theirs, simulations in cases(options.steps, not options.rollouts):
        micro = 1e6 / options.steps / simulations
        seconds, peer_seconds, ratio = time_both(ours, theirs or ours, options.rounds, time.process_time)
        if theirs is None:
            print(f"{label:40} {micro * seconds:7.2f} µs")
            continue
        print(f"{label:40} {micro * seconds:7.2f} µs {micro * peer_seconds:7.2f} µs {1 / ratio:7.2f}")


if __name__ == "__main__":
    main()
