"""Payloads of a real UR10e that `identify-payload` finds, beside their known masses.

The recordings are those of shamilmamedov/dynamic_calibration: currents without a load and with one of known mass.
Currents are converted to torques with the gains that the controller of the robot uses, which are found without any load
(`drive_gains.py`). A model without load is fitted to each recording without load, with `identify`. Every loaded
recording is then analysed with every model: whole, with the recording without load of its pair (`--empty`), and in
parts of a few seconds. The last block has the published URDF as the model, which is not that of this robot.

    python benchmarks/real_recordings/payload.py CHECKOUT

CHECKOUT is a checkout of github.com/shamilmamedov/dynamic_calibration.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import itertools
import json
import logging
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from drive_gains import LINK, PAIRS, Pair, controller_gains, read_signals

from robot_dynamics import load_robot
from robot_dynamics.cli.main import main as run_verb

PART = 10.0  # [s]


class Model(NamedTuple):
    """A description of the robot without load, with its drives, as arguments of verbs."""

    name: str
    arguments: tuple[str, ...]


class Result(NamedTuple):
    """An identified mass with its deviation and the true one [kg], and the centre with its deviations (3,) [m]."""

    mass: float
    deviation: float
    truth: float
    centre: np.ndarray
    centre_deviations: np.ndarray

    @property
    def error(self) -> float:
        """Relative error of the mass."""
        return self.mass / self.truth - 1

    @property
    def normalised(self) -> float:
        """Error of the mass in standard deviations."""
        return (self.mass - self.truth) / self.deviation


def write_table(source: Path, target: Path, rows: tuple[int, int], gains: np.ndarray, joints: Sequence[str]) -> str:
    """Write the rows of a recording with torques as a CSV file for verbs, and return its path."""
    signals = read_signals(source.parent, source.stem, rows)
    values = np.stack([signals.q, signals.qd, signals.currents * gains], axis=-1).reshape(len(signals.q), -1)
    titles = [f"{joint}.{kind}" for joint in joints for kind in ("position", "velocity", "effort")]
    table = np.column_stack([signals.times, values])
    np.savetxt(target, table, delimiter=",", header=",".join(["time", *titles]), comments="")
    return str(target)


def run_quietly(arguments: Sequence[str]) -> None:
    """Run a verb without its output."""
    with contextlib.redirect_stdout(io.StringIO()):
        status = run_verb(arguments)
    if status == 1:
        raise SystemExit(f"robot-dynamics {' '.join(arguments)} failed")


def fit_model(folder: Path, recording: str, robot: str) -> Model:
    """Fit a model to a recording without load."""
    name = Path(recording).stem
    files = (str(folder / f"{name}.yaml"), str(folder / f"{name}_drives.yaml"))
    run_quietly(["identify", recording, "--robot", robot, "--output", files[0], "--output-drives", files[1]])
    return Model(name, ("--robot", files[0], "--drives", files[1]))


def identify(folder: Path, recording: str, truth: float, model: Model, options: Sequence[str] = ()) -> Result:
    """Identify the payload of a recording."""
    file = folder / "payload.json"
    run_quietly(["identify-payload", recording, *model.arguments, "--link", LINK, "--json", str(file), *options])
    figures = json.loads(file.read_text())
    return Result(
        figures["mass"]["value"],
        figures["mass"]["deviation"],
        truth,
        np.array(figures["centre"]["value"]),
        np.array(figures["centre"]["deviation"]),
    )


def print_result(title: str, result: Result) -> None:
    """Print a row of a table."""
    centre = " ".join(f"{c:6.3f} ± {d:.3f}" for c, d in zip(result.centre, result.centre_deviations, strict=True))
    print(
        f"{title:58} {result.mass:6.3f} ± {result.deviation:.3f} kg {100 * result.error:+6.1f} % "
        f"{result.normalised:+5.1f} deviations  centre {centre}",
        flush=True,
    )


def print_summary(title: str, results: Sequence[Result]) -> None:
    """Print the largest error of several results, and how they agree with their deviations."""
    errors = np.array([result.error for result in results])
    normalised = np.array([result.normalised for result in results])
    print(
        f"{title}: {len(results)} results, errors {100 * errors.min():+.1f} to {100 * errors.max():+.1f} %, RMS in "
        f"deviations {np.sqrt(np.mean(normalised**2)):.2f}, within one {np.sum(np.abs(normalised) < 1)}, within two "
        f"{np.sum(np.abs(normalised) < 2)}, deviations up to "
        f"{100 * max(result.deviation / result.truth for result in results):.1f} %\n",
        flush=True,
    )


def part_options(duration: float) -> list[tuple[str, ...]]:
    """Options that select the parts of a recording."""
    starts = np.arange(0, duration - PART, PART).tolist()
    return [("--from", str(start), "--to", str(start + PART)) for start in starts]


def main() -> None:
    """Print the tables of a checkout."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path)
    checkout = parser.parse_args().checkout
    logging.disable(logging.WARNING)
    source = checkout / "dataset_ur10e/identification_data"
    robot = str(checkout / "URe/urdf/ur10e.urdf")
    joints = [joint.name for joint in load_robot(robot).joints]
    gains = np.mean(
        [controller_gains(read_signals(source, pair.loaded, pair.loaded_rows))[0] for pair in PAIRS.values()], axis=0
    )
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)

        def table(name: str, rows: tuple[int, int]) -> str:
            return write_table(source / f"{name}.csv", folder / f"{name}.csv", rows, gains, joints)

        loaded = {name: table(pair.loaded, pair.loaded_rows) for name, pair in PAIRS.items()}
        empty = {name: table(pair.unloaded, pair.unloaded_rows) for name, pair in PAIRS.items()}
        models = {name: fit_model(folder, path, robot) for name, path in empty.items()}
        print_pairs(folder, loaded, models, {})
        print_pairs(folder, loaded, models, empty)
        first = next(iter(models.values()))
        results = []
        for name, path in loaded.items():
            pair: Pair = PAIRS[name]
            duration = float(read_signals(source, pair.loaded, pair.loaded_rows).times[-1])
            results += [identify(folder, path, pair.mass, first, options) for options in part_options(duration)]
        print_summary(f"parts of {PART:g} s, model of {first.name}", results)
        published = Model("published URDF", ("--robot", robot))
        for title, options in (("alone", {}), ("with --empty", empty)):
            print(f"published URDF, {title}")
            print_pairs(folder, loaded, {"published URDF": published}, options)


def print_pairs(folder: Path, loaded: dict[str, str], models: dict[str, Model], empty: dict[str, str]) -> None:
    """Print the payload of each loaded recording with each model, with the recordings without load if there are any."""
    results = []
    for (model_name, model), (name, path) in itertools.product(models.items(), loaded.items()):
        options = ("--empty", empty[name]) if empty else ()
        result = identify(folder, path, PAIRS[name].mass, model, options)
        print_result(f"{name}, model of {model_name}{', --empty' if empty else ''}", result)
        results.append(result)
    print_summary("with --empty" if empty else "loaded recordings alone", results)


if __name__ == "__main__":
    main()
