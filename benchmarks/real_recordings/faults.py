"""False alarms of the search for faults, and faults added to sound recordings that it finds.

    python benchmarks/real_recordings/faults.py FOLDER --robot robot.urdf [--moments 20]

Every recording in the folder is fitted by itself, and checked with the model of every other one: what is named then is
a false alarm, if the recordings are sound. Runs that do not determine the robot give no model. With `--moments`, faults
of all kinds are added to one recording at random moments, and searched for with the model of another one. Counted are
those that are named with their kind and joints, and those of them that are dated within 0.5 s.

With `--union` a model is fitted to all recordings but one, and the one is checked: for recordings that are too short to
determine the robot alone.
"""

from __future__ import annotations

import argparse
import itertools
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from folders import find_recordings

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.array_types import Array
from robot_dynamics.checking.check import Predictor
from robot_dynamics.checking.fault_search import Fault
from robot_dynamics.checking.faults import Evidence
from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.identification.determination import judge_determination
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.friction_fit import choose_friction_model
from robot_dynamics.identification.friction_terms import PARAMETER_OF_MODEL
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.physical_consistency import fit_consistent_robot
from robot_dynamics.identification.samples import Samples
from robot_dynamics.model.minimal_frames import snap_angles
from robot_dynamics.recordings.alignment import resample_samples
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_motions import filter_motions
from robot_dynamics.recordings.joint_samples import JointSample
from robot_dynamics.recordings.recording import open_recording
from robot_dynamics.recordings.sample_statistics import SampleStatistics

KINDS = ("payload", "friction", "gain", "swapped", "sign", "delay", "contact", "offset", "missing")
PAYLOAD = Inertia.about_centre_of_mass(1.0, np.diag([0.001, 0.001, 0.001]), [0.0, 0.0, 0.05])
GAIN = 1.1
DELAY = 0.03  # [s]
OFFSET = 0.05  # [rad or m]
PUSH = 30.0  # [N]
PUSH_DURATION = 1.0  # [s]
FRICTION_SHARE = 0.015  # of the effort limit: least step of Coulomb friction
LOSS = 0.2  # part of the rows
MARGIN = 3.0  # [s] of motion before and after an onset, unless --margin is given


@dataclass(frozen=True)
class Model:
    """A robot that is fitted to recordings; trained_on: their names."""

    trained_on: frozenset[str]
    predictor: Predictor

    @property
    def name(self) -> str:
        """The names of the recordings."""
        return ", ".join(sorted(self.trained_on))


class Signals:
    """The samples of a recording whose messages have all joints, and its motion."""

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        drives = direct_drives(names)
        recording = open_recording(path, drives)
        self.samples = list(recording.source.samples(recording.topics))
        self.columns = [self.samples[0].names.index(name) for name in names]
        stamps = np.array([sample.stamp for sample in self.samples])
        self.times = (stamps - stamps[0]) * 1e-9
        self.efforts = np.array([sample.effort for sample in self.samples])[:, self.columns]
        self.motions = list(recording.motions(SampleStatistics()))

    def at_samples(self, values: Sequence[Array]) -> Array:
        """Values (N, n) of each motion at the times of the samples."""
        times = np.concatenate([motion.times for motion in self.motions])
        stacked = np.concatenate(list(values))
        return np.stack([np.interp(self.times, times, column) for column in stacked.T], axis=1)

    @property
    def moving_range(self) -> tuple[float, float]:
        """First and last time [s] at which a joint moves."""
        times = np.concatenate([motion.times for motion in self.motions])
        moves = np.concatenate([motion.moving.any(axis=1) for motion in self.motions])
        return float(times[moves][0]), float(times[moves][-1])


def fit_models(arguments: argparse.Namespace, paths: Sequence[Path]) -> Iterator[Model]:
    """Yield the models of recordings, or of all recordings but one, that determine the robot."""
    robot = load_robot(arguments.robot)
    dynamics = Dynamics(robot if arguments.snap is None else snap_angles(robot, arguments.snap))
    drives = direct_drives(dynamics.joint_names)
    model = build_identification_model(dynamics, drives)
    for path in paths:
        chosen = [each for each in paths if each != path] if arguments.union else [path]
        label = f"all but {path.stem}" if arguments.union else path.stem
        try:
            opened = [open_recording(each, drives) for each in chosen]
            fit = fit_parameters(Samples(opened, model))
            if arguments.friction == "auto":
                samples_of = partial(Samples, opened)
                friction_model, choice = choose_friction_model(
                    fit, samples_of, tuple(PARAMETER_OF_MODEL), required=False
                )
                if choice.terms:
                    fit = fit_parameters(samples_of(friction_model))
            verdict = judge_determination(fit).verdict
            if verdict == "not determined":
                print(f"{label}: {verdict}")
                continue
            consistent = fit_consistent_robot(fit)
        except RobotDynamicsError as error:
            print(f"{label}: {error}")
            continue
        trained_on = frozenset(each.stem for each in chosen)
        yield Model(trained_on, Predictor(Dynamics(consistent.robot), consistent.drives))


def search(samples: Sequence[JointSample], predictor: Predictor) -> Fault | None:
    """Search for the fault of samples."""
    statistics = SampleStatistics()
    evidence = Evidence(predictor)
    drives = predictor.drives
    for motion in filter_motions(resample_samples(samples, drives.names, statistics), drives, statistics):
        evidence.add(motion, predictor(motion))
    return evidence.find_fault()


def add_fault(
    signals: Signals, predictor: Predictor, kind: str, onset: float, rng: np.random.Generator
) -> tuple[list[JointSample], set[str]]:
    """Return the samples with a fault from its onset [s] on, and the names of its joints."""
    dynamics = predictor.dynamics
    names = dynamics.joint_names
    efforts = signals.efforts.copy()
    offsets = np.zeros_like(efforts)
    after = signals.times >= onset
    first, second = rng.choice(len(names), 2, replace=False)
    joints = {names[first], names[second]} if kind == "swapped" else {names[first]}
    if kind in ("payload", "contact", "delay", "missing"):
        joints = set()
    link = Evidence(predictor).link
    if kind == "payload":
        loaded = Dynamics(dynamics.robot.with_payload(link, PAYLOAD))
        effect = [predictor.efforts(loaded, motion) - predictor(motion) for motion in signals.motions]
        efforts[after] += signals.at_samples(effect)[after]
    if kind == "contact":
        force = rng.normal(size=3)
        wrench = np.r_[PUSH * force / np.linalg.norm(force), np.zeros(3)]
        effect = [_push_efforts(dynamics, motion.q, link, wrench) for motion in signals.motions]
        phase = np.clip((signals.times - onset) / PUSH_DURATION, 0, 1)
        efforts += np.sin(np.pi * phase)[:, None] * signals.at_samples(effect)
    if kind == "friction":
        joint = dynamics.robot.joints[dynamics.robot.joint_numbers[names[first]]]
        step = max(joint.coulomb_friction, FRICTION_SHARE * joint.limits.effort)
        velocity = signals.at_samples([motion.qd for motion in signals.motions])[:, first]
        efforts[after, first] += step * np.sign(velocity[after])
    if kind == "gain":
        efforts[after, first] *= GAIN
    if kind == "sign":
        efforts[after, first] *= -1
    if kind == "swapped":
        efforts[after, first], efforts[after, second] = efforts[after, second], efforts[after, first].copy()
    if kind == "delay":
        delayed = [np.interp(signals.times - DELAY, signals.times, column) for column in signals.efforts.T]
        efforts[after] = np.stack(delayed, axis=1)[after]
    if kind == "offset":
        offsets[after, first] = OFFSET
    kept = ~after | (rng.random(len(after)) >= LOSS) if kind == "missing" else np.ones(len(after), dtype=bool)
    return [_replace(signals, row, efforts[row], offsets[row]) for row in np.flatnonzero(kept).tolist()], joints


def _push_efforts(dynamics: Dynamics, q: Array, link: str, wrench: Array) -> Array:
    """Change of the efforts (N, n) where a wrench (6,) acts on a link."""
    zero = np.zeros_like(q)
    pushed = dynamics.inverse(q, zero, zero, external_wrenches={link: np.tile(wrench, (len(q), 1))})
    change: Array = pushed - dynamics.inverse(q, zero, zero)
    return change


def _replace(signals: Signals, row: int, efforts: Array, offsets: Array) -> JointSample:
    """A sample with other efforts (n,), and positions larger by offsets (n,)."""
    sample = signals.samples[row]
    effort = sample.effort.copy()
    position = sample.position.copy()
    effort[signals.columns] = efforts
    position[signals.columns] += offsets
    return sample._replace(effort=effort, position=position)


def print_false_alarms(models: Sequence[Model], recordings: dict[str, Signals]) -> None:
    """Search for faults in each recording, with the model of each other one."""
    alarms = 0
    pairs = [(model, name) for model, name in itertools.product(models, recordings) if name not in model.trained_on]
    for model, name in pairs:
        fault = search(recordings[name].samples, model.predictor)
        if fault is not None:
            alarms += 1
            print(f"{name} with the model of {model.name}: {fault.sentence}")
    print(f"{alarms} alarms in {len(pairs)} pairs of a recording and a model of another one")


def print_detections(model: Model, signals: Signals, moments: int, kinds: Sequence[str], margin: float) -> None:
    """Add faults of some kinds at random moments; print how many are named, and dated within 0.5 s."""
    print(f"\n{'fault':10s} {'named':>6s} {'dated':>6s}   of {moments}")
    begin, end = signals.moving_range
    if end - begin <= 2 * margin:
        print(f"the motion lasts {end - begin:.2g} s: no moment is {margin:g} s from both of its ends")
        return
    for kind in kinds:
        number = KINDS.index(kind)
        named = dated = 0
        for moment in range(moments):
            rng = np.random.default_rng([moment, number])
            onset = rng.uniform(begin + margin, end - margin)
            samples, joints = add_fault(signals, model.predictor, kind, onset, rng)
            fault = search(samples, model.predictor)
            if fault is not None and fault.kind == kind and (kind == "contact" or set(fault.joints) == joints):
                named += 1
                dated += abs(fault.onset - onset) < 0.5
        print(f"{kind:10s} {named:6d} {dated:6d}", flush=True)


def main() -> None:
    """Print false alarms and detections for a folder of recordings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder of CSV files or bags of one robot")
    parser.add_argument("--robot", required=True, help="description, or the name of a robot that ships")
    parser.add_argument("--snap", type=float, help="largest angle [rad] to a multiple of 90 degrees that is snapped")
    parser.add_argument(
        "--friction", choices=("auto", "viscous-coulomb"), default="auto", help="as that of identify (default: auto)"
    )
    parser.add_argument("--moments", type=int, default=0, help="number of faults of each kind (default: none)")
    parser.add_argument("--detect-in", help="name of the recording that faults are added to (default: the last)")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS, help="faults to add (default: all)")
    parser.add_argument("--margin", type=float, default=MARGIN, help="motion before and after a moment [s]")
    parser.add_argument("--union", action="store_true", help="fit a model to all recordings but one, for each one")
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    paths = find_recordings(arguments.folder)
    models = list(fit_models(arguments, paths))
    if not models:
        print("no recording determines the robot")
        return
    names = models[0].predictor.dynamics.joint_names
    recordings = {path.stem: Signals(path, names) for path in paths}
    print_false_alarms(models, recordings)
    if arguments.moments:
        faulty = arguments.detect_in or paths[-1].stem
        model = next(each for each in models if faulty not in each.trained_on)
        print_detections(model, recordings[faulty], arguments.moments, arguments.kinds, arguments.margin)


if __name__ == "__main__":
    main()
