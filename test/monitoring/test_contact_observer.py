"""The observer of whole robots beside simulations with known contacts: loops, springs, a moving base, drives; and what
it does with bad stamps and states."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from peers import flights
from peers.recorded import panda_motion

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.monitoring.collision_thresholds import CollisionThresholds
from robot_dynamics.monitoring.contact_observer import ContactObserver
from robot_dynamics.monitoring.momentum_balance import MomentumBalance
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.simulation import Simulation

K = 50.0
STEP = 1e-3


def undecided(names, bandwidth=K):
    return CollisionThresholds(tuple(names), np.full(len(names), np.inf), np.zeros(len(names)), bandwidth)


def observer_of(dynamics, drives=None, bandwidth=K, **options):
    return ContactObserver(MomentumBalance(dynamics, drives), undecided(dynamics.joint_names, bandwidth), **options)


def observe(observer, stamp, q, qd, efforts):
    balance = observer.balance
    balance.position[:], balance.velocity[:], balance.effort[:] = q, qd, efforts
    return observer.update(stamp)


@pytest.mark.parametrize(
    ("name", "link", "push", "force"),
    [("five_bar", "tool", 0.3, 8.0), ("delta", "platform", 2.0, 5.0), ("manutec_r3", "load", 5.0, 20.0),
     ("sr400", "link_7", 4.0, 30.0)],
)  # fmt: skip
def test_simulated_contact_shows_as_the_virtual_work_of_its_force(name, link, push, force):
    """Loops are observed by their independent joints, springs by their deflections.

    The simulation integrates the direct model without friction, with constant efforts that let the robot move. The
    expected torques are the work of the force in small displacements of the joints."""
    robot = load_robot(name)
    robot = replace(robot, joints=tuple(joint.without_friction() for joint in robot.joints))
    simulation = Simulation(robot, step=STEP / 4)
    simulation.start()
    dynamics = Dynamics(robot)
    actuated = np.array([joint not in dynamics.unactuated_joint_names for joint in dynamics.joint_names])
    weights = dynamics.gravity(simulation.state.positions)
    efforts = np.where(actuated, weights + push * (-1.0) ** np.arange(len(weights)), 0.0)
    observer = observer_of(dynamics)
    wrench = np.zeros(6)
    residuals, torques = [], []
    for k in range(250):
        if k == 100:
            wrench[:3] = force * np.array([0.6, -0.64, 0.48])
        q, qd = np.array(simulation.state.positions), np.array(simulation.state.velocities)
        residuals.append(observe(observer, k * 1_000_000, q, qd, efforts).efforts)
        torques.append(work(dynamics.frame(link), q, wrench))
        simulation.advance(4, efforts=efforts, external_wrenches={link: wrench})
    filtered = [np.zeros(len(q))]
    for before, after in pairwise(torques):
        external = 0.5 * (before + after)
        filtered.append(external + np.exp(-K * STEP) * (filtered[-1] - external))
    residuals, filtered = np.array(residuals), np.array(filtered)
    scale = np.abs(filtered).max()
    assert scale > 0.1 and np.abs(simulation.state.velocities).max() > 0.1
    # the force begins within a step, of which the mean of both ends has half
    assert np.abs(residuals - filtered).max() < 0.6 * K * STEP * scale
    assert np.abs(residuals - filtered)[180:].max() < 2e-3 * scale
    assert np.abs(residuals[:101]).max() < 1e-3 * scale


def work(frame, q, wrench):
    """Work (n,) of a wrench on a frame, in its axes, for unit displacements of the joints."""
    step = 1e-6
    force = frame.pose(q)[:3, :3] @ wrench[:3]
    moved = [frame.pose(q + step * unit)[:3, 3] - frame.pose(q - step * unit)[:3, 3] for unit in np.eye(len(q))]
    return np.array(moved) @ force / (2 * step)


def test_moving_base_has_the_thrust_that_carries_it():
    """The wrench of the peer's flights, in closed form, and no external torque on the joints."""
    robot = replace(load_robot("free_flying_arm"), gravity=np.array(flights.GRAVITY))
    observer = observer_of(Dynamics(robot), bandwidth=20.0)
    mass = sum(link.inertia.mass for link in robot.links)
    mean, errors, torques = np.zeros(6), [], []
    for k, sample in enumerate(flights.flight(3, 3.0)):
        observer.balance.twist[:] = sample.twist
        observer.balance.gravity[:] = sample.pose[:3, :3].T @ robot.gravity
        observation = observe(observer, k * 10_000_000, sample.q, sample.qd, sample.efforts)
        lift = sample.pose[:3, :3].T @ (mass * np.array([0.0, 0.0, 9.81]))
        t = sample.time
        force = lift + 0.8 * mass * np.sin([3.0 * t, 2.3 * t + 1, 1.7 * t])
        thrust = np.r_[force, 0.3 * mass * np.sin([2.1 * t, 2.9 * t + 2, 3.7 * t])]
        mean = thrust + np.exp(-20 * 0.01) * (mean - thrust)
        if observation.is_settled:
            errors.append(observation.base_wrench - mean)
            torques.append(observation.efforts)
    assert len(errors) > 250 and observation.base_wrench.shape == (6,)
    assert np.abs(errors).max() < 0.03 * 9.81 * mass
    assert np.abs(torques).max() < 0.02 * 9.81 * mass


MOTION = panda_motion(duration=1.0, rate=500.0)


def panda_residuals(drives, position, velocity, effort):
    observer = observer_of(Dynamics(load_robot("panda")), drives)
    rows = zip(position, velocity, effort, strict=True)
    return np.array([observe(observer, k * 2_000_000, *row).efforts for k, row in enumerate(rows)])


def test_motors_with_ratios_gains_and_offsets():
    dynamics = Dynamics(load_robot("panda"))
    rng = np.random.default_rng(2)
    ratios = np.diag(rng.uniform(20, 100, 7))
    ratios[6, 5] = 30.0  # a coupled wrist
    drives = replace(
        direct_drives(dynamics.joint_names),
        names=tuple(f"motor_{k}" for k in range(7)),
        ratios=ratios,
        position_offsets=rng.uniform(-1, 1, 7),
        effort_gains=rng.uniform(0.5, 2, 7),
        effort_offsets=rng.uniform(-2, 2, 7),
    )
    position, velocity = (MOTION.q - drives.position_offsets) @ ratios.T, MOTION.qd @ ratios.T
    effort = (MOTION.efforts + drives.effort_offsets) @ np.linalg.inv(ratios) / drives.effort_gains
    assert np.abs(panda_residuals(drives, position, velocity, effort)).max() < 5e-3
    assert np.abs(panda_residuals(None, MOTION.q, MOTION.qd, MOTION.efforts)).max() < 5e-3


def test_rotor_of_a_coupled_motor_adds_momentum():
    """Its efforts by `drive_efforts` at the accelerations, which the observer does not know."""
    names = Dynamics(load_robot("panda")).joint_names
    ratios = np.eye(7)
    ratios[6, 5] = 0.7
    drives = replace(
        direct_drives(names), ratios=ratios, names=tuple(f"m{k}" for k in range(7)),
        coupling_parameters={"m6": (0.4, 0.3, 0.0)},
    )  # fmt: skip
    efforts = MOTION.efforts + drives.drive_efforts(MOTION.qd, MOTION.qdd)
    residuals = panda_residuals(drives, MOTION.q @ ratios.T, MOTION.qd @ ratios.T, efforts @ np.linalg.inv(ratios))
    assert np.abs(residuals).max() < 5e-3
    assert np.abs(MOTION.efforts - efforts).max() > 0.1


def test_efforts_that_exclude_gravity():
    dynamics = Dynamics(load_robot("panda"))
    drives = replace(direct_drives(dynamics.joint_names), excludes_gravity=True)
    efforts = MOTION.efforts - dynamics.gravity(MOTION.q)
    assert np.abs(panda_residuals(drives, MOTION.q, MOTION.qd, efforts)).max() < 5e-3


@pytest.fixture
def running():
    """An observer after 0.2 s of exact motion with constant external torques of 1 N m."""
    observer = observer_of(Dynamics(load_robot("panda")))
    for k in range(100):
        observe(observer, k * 2_000_000, MOTION.q[k], MOTION.qd[k], MOTION.efforts[k] - 1.0)
    return observer


def following(observer, stamp, k=100, spoil=None):
    effort = MOTION.efforts[k] - 1.0
    velocity = MOTION.qd[k].copy()
    if spoil is not None:
        velocity[3] = spoil
    return observe(observer, stamp, MOTION.q[k], velocity, effort)


def test_observation_goes_on_after_a_lost_sample_and_a_repeated_stamp(running):
    assert following(running, 99 * 2_000_000) is None and running.repeated == 1
    assert following(running, 101 * 2_000_000, 101).efforts == pytest.approx(np.ones(7), abs=1e-3)
    assert running.restarts == 0


@pytest.mark.parametrize(
    ("stamp", "reason"), [(100_000_000, "stamps went back by 0.098 s"), (10**9, "no samples for 0.802 s")]
)
def test_gaps_and_backward_stamps_restart_it(running, stamp, reason):
    assert not following(running, stamp).efforts.any()
    assert (running.restarts, running.restart_reason) == (1, reason)
    second = following(running, stamp + 2_000_000, 101)
    assert second.efforts == pytest.approx(np.full(7, 1 - np.exp(-K * 0.002)), abs=1e-3) and not second.is_settled


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_state_that_is_not_finite_restarts_it(running, value):
    with pytest.raises(InvalidInputError, match=f"velocity of 'panda_joint4' is {value}"):
        following(running, 200_000_000, spoil=value)
    assert running.restarts == 1 and "panda_joint4" in running.restart_reason
    assert not following(running, 202_000_000, 101).efforts.any()


def test_settling_takes_three_time_constants():
    observer = observer_of(Dynamics(load_robot("panda")), bandwidth=100.0)
    settled = [
        observe(observer, k * 2_000_000, MOTION.q[k], MOTION.qd[k], MOTION.efforts[k]).is_settled for k in range(30)
    ]
    assert settled == [k * 0.002 >= 0.03 - 1e-12 for k in range(30)]


def test_payload_of_the_description_counts():
    robot = load_robot("panda")
    loaded = robot.with_payload("panda_link8", Inertia(2.0, np.zeros(3), np.zeros((3, 3))))
    heavy, light = (observer_of(Dynamics(each)) for each in (loaded, robot))
    dynamics = Dynamics(loaded)
    for k in range(100):
        effort = dynamics.inverse(MOTION.q[k], MOTION.qd[k], MOTION.qdd[k])
        with_load, without = (
            observe(each, k * 2_000_000, MOTION.q[k], MOTION.qd[k], effort).efforts for each in (heavy, light)
        )
    assert np.abs(with_load).max() < 5e-3 and np.abs(without).max() > 5.0


def test_robot_without_masses_is_refused():
    robot = load_robot(
        '<robot name="bare"><link name="base"/><link name="arm"/><joint name="turn" type="continuous">'
        '<parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint></robot>'
    )
    with pytest.raises(InvalidInputError, match="'bare' has no masses"):
        MomentumBalance(Dynamics(robot))


def test_errors_name_the_motor():
    dynamics = Dynamics(load_robot("rx90"))
    balance = MomentumBalance(dynamics, replace(direct_drives(dynamics.joint_names), names=tuple("abcdef")))
    balance.position[4] = np.nan
    with pytest.raises(InvalidInputError, match="position of 'e' is nan"):
        balance.evaluate()
