"""Whether the standard deviations of identified parameters hold: fits of different runs of one robot are compared.

    python benchmarks/real_recordings/coverage.py FOLDER --robot robot.urdf

Every recording in the folder is fitted by itself; a single recording is cut into halves. The differences of each
parameter that both runs of a pair show, divided by the root of the sum of both variances, have the RMS 1 if the
deviations are right. The columns are

* white: deviations that assume white noise and an exact model;
* within run: deviations from the scatter between seconds of the run;
* stated: these, with the change of friction between runs; what `robot-dynamics identify` prints.

The RMS of a pair scatters by chance, also where the stated deviations are right: its parameters are correlated, so that
they count as fewer independent ones, and the deviations themselves are estimated from a few dozen seconds. The line
`by chance` has the intervals that contain 95 % of the RMS of simulated runs, in the columns `all`, `inertial` and
`friction`: errors along the fitted directions of all runs are drawn with the stated variances, and so are the estimates
of these variances. Each pair has such an interval too (`--pairs`). The number of independent parameters is that of
uncorrelated parameters whose mean square scatters as much: m² / tr(R²) for the correlations R of m differences.

Runs that do not determine the robot are listed, and left out of the pairs. Runs of the same motion share the errors of
the model, so that their differences are smaller. Runs on different days differ by the friction, which depends on
temperature.
"""

from __future__ import annotations

import argparse
import itertools
import logging
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from folders import find_recordings

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.array_types import Array
from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.identification.determination import judge_determination
from robot_dynamics.identification.fitting import Fit, fit_parameters
from robot_dynamics.identification.identification_model import FRICTION_PREFIXES, build_identification_model
from robot_dynamics.identification.samples import Samples
from robot_dynamics.recordings.drives import load_drives
from robot_dynamics.recordings.recording import moving_base_link, open_recording

DRAWS = 2000
DeviationFunction = Callable[[Fit], Array]


def white_deviations(fit: Fit) -> Array:
    """Standard deviations (P,) for white noise and an exact model."""
    deviations: Array = np.sqrt(np.square(fit.directions).sum(axis=1) / fit.white_share)
    return deviations


DEVIATIONS: dict[str, DeviationFunction] = {
    "white": white_deviations,
    "within run": lambda fit: fit.standard_deviations,
    "stated": lambda fit: fit.deviations_between_runs,
}


def fit_runs(arguments: argparse.Namespace) -> Iterator[tuple[str, Fit]]:
    """Fit each run of a folder; runs that cannot be fitted are printed."""
    dynamics = Dynamics(load_robot(arguments.robot))
    drives = load_drives(arguments.drives, dynamics.joint_names)
    model = build_identification_model(dynamics, drives, rotor_inertia=not arguments.no_rotor_inertia)
    folder = Path(arguments.folder)
    paths = [folder] if drives.tables is not None else find_recordings(folder)
    parts = [(0.0, 0.5), (0.5, 1.0)] if len(paths) == 1 else [(0.0, 1.0)]
    for path, (start, end) in itertools.product(paths, parts):
        name = path.stem if len(parts) == 1 else f"{path.stem} from {100 * start:.0f} to {100 * end:.0f} %"
        try:
            recording = open_recording(path, drives, (), moving_base_link(dynamics))
            samples = Samples([recording], model, cutoff=arguments.cutoff, start_fraction=start, end_fraction=end)
            yield name, fit_parameters(samples)
        except RobotDynamicsError as error:
            print(f"{name}: {error}")


def normalised_differences(first: Fit, second: Fit, deviations: DeviationFunction) -> Array:
    """Differences (P,) of two fits over the root of the sum of both variances; nan where not seen by both."""
    seen = first.seen & second.seen
    scale = np.hypot(deviations(first), deviations(second))
    difference: Array = np.where(seen, (first.values - second.values) / np.where(seen, scale, 1.0), np.nan)
    return difference


def draw_errors(fit: Fit, generator: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Errors (count, P) of the values of a fit, and as many estimates (count, P) of their variances, between runs.

    The variance of each direction is estimated from the scatter between blocks, as the mean of one square less.
    """
    inverse = np.linalg.pinv(fit.prior.root)
    basis = inverse @ fit.directions
    basis /= np.square(basis).sum(axis=0)
    coordinates = basis.T @ inverse
    variances = np.einsum("kp,pq,kq->k", coordinates, fit.covariance, coordinates)
    blocks = max(len(fit.blocks) - 1, 1)
    estimates = variances * generator.chisquare(blocks, (count, len(variances))) / blocks
    errors = np.sqrt(variances) * generator.normal(size=estimates.shape) @ fit.directions.T
    not_fitted = np.square(fit.standard_deviations) - np.square(fit.directions) @ variances  # not seen
    change = np.square(fit.deviations_between_runs) - np.square(fit.standard_deviations)
    others = np.maximum(not_fitted, 0) + change
    errors += np.sqrt(others) * generator.normal(size=errors.shape)
    return errors, estimates @ np.square(fit.directions).T + others


def draw_normalised_differences(fits: Sequence[Fit]) -> Array:
    """Normalised differences (pairs, draws, P) of simulated fits with right deviations; nan where not seen by both."""
    generator = np.random.default_rng(0)
    draws = [draw_errors(fit, generator, DRAWS) for fit in fits]
    return np.array(
        [
            np.where(fits[i].seen & fits[j].seen, draws[i][0] - draws[j][0], np.nan)
            / np.sqrt(draws[i][1] + draws[j][1])
            for i, j in itertools.combinations(range(len(fits)), 2)
        ]
    )


def chance_interval(z: Array) -> Array:
    """Least and largest RMS (2,) by chance (95 %), of normalised differences z (..., draws, P)."""
    squares = np.nanmean(np.square(z), axis=tuple(axis for axis in range(z.ndim) if axis != z.ndim - 2))
    interval: Array = np.quantile(np.sqrt(squares), [0.025, 0.975])
    return interval


def count_independent(z: Array) -> float:
    """Number of uncorrelated parameters whose mean square scatters as much as that of z (draws, P)."""
    seen = np.isfinite(z[0])
    return float(seen.sum() ** 2 / np.square(np.corrcoef(z[:, seen], rowvar=False)).sum())


def root_mean_square(values: Array) -> float:
    """RMS of the values that are not nan."""
    return float(np.sqrt(np.nanmean(np.square(values)))) if np.isfinite(values).any() else np.nan


def main() -> None:
    """Print the table of a folder of recordings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", help="folder of CSV files or bags of one robot, or one recording")
    parser.add_argument("--robot", required=True, help="description, or the name of a robot that ships")
    parser.add_argument("--drives", help="drives file, or none")
    parser.add_argument("--cutoff", type=float, help="cut-off frequency [Hz]")
    parser.add_argument("--no-rotor-inertia", action="store_true")
    parser.add_argument("--pairs", action="store_true", help="print every pair")
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    runs = dict(fit_runs(arguments))
    determined: dict[str, Fit] = {}
    for name, fit in runs.items():
        verdict = judge_determination(fit).verdict
        print(
            f"{name}: {verdict}, condition {fit.condition:.3g}, {fit.seen.sum()} of {len(fit.seen)} parameters seen, "
            f"{len(fit.blocks)} blocks, variance {fit.noise_inflation:.1f} times that of white noise"
        )
        if verdict != "not determined":
            determined[name] = fit
    pairs = list(itertools.combinations(determined.values(), 2))
    if not pairs:
        print("no pair: at least two runs that determine the robot are needed")
        return
    is_friction = np.array([name.startswith(FRICTION_PREFIXES) for name in pairs[0][0].model.names])
    columns = "all  inertial  friction   lowest pair  highest  in 0.8-1.3  in 95 %  largest"
    print(f"\n{f'{len(pairs)} pairs':20s} {columns:>76s}")
    for title, deviations in DEVIATIONS.items():
        z = np.array([normalised_differences(*pair, deviations) for pair in pairs])
        by_pair = np.array([root_mean_square(values) for values in z])
        covered = np.mean(np.abs(z[np.isfinite(z)]) < 1.96) if np.isfinite(z).any() else np.nan
        print(
            f"{title:20s} {root_mean_square(z):8.2f} {root_mean_square(z[:, ~is_friction]):9.2f} "
            f"{root_mean_square(z[:, is_friction]):9.2f} {np.nanmin(by_pair):13.2f} {np.nanmax(by_pair):8.2f} "
            f"{((by_pair > 0.8) & (by_pair < 1.3)).sum():6d} of {len(pairs):d} {100 * covered:7.1f} "
            f"{np.nanmax(np.abs(z), initial=0):8.1f}"
        )
    simulated = draw_normalised_differences(list(determined.values()))
    intervals = [
        chance_interval(simulated),
        *(chance_interval(simulated[..., each]) for each in (~is_friction, is_friction)),
    ]
    print(f"{'stated, by chance':20s}    {'  '.join(f'{least:.2f}-{largest:.2f}' for least, largest in intervals)}")
    by_chance = np.array([chance_interval(pair) for pair in simulated])
    independent = [count_independent(pair) for pair in simulated]
    low, high = by_pair < by_chance[:, 0], by_pair > by_chance[:, 1]
    print(
        f"pairs within their interval: {(~low & ~high).sum()} of {len(pairs)}, below: {low.sum()}, above: "
        f"{high.sum()}; independent parameters: {min(independent):.0f} to {max(independent):.0f}"
    )
    if arguments.pairs:
        rows = zip(itertools.combinations(determined, 2), by_pair, by_chance, independent, strict=True)
        for (first, second), value, (least, largest), number in rows:
            print(
                f"    {first} - {second}: {value:.2f}, by chance {least:.2f} to {largest:.2f}, independent {number:.0f}"
            )


if __name__ == "__main__":
    main()
