"""Fuzz the targets: python fuzz/run.py descriptions --seconds 600.

Inputs that reach new lines are kept in build/fuzz/<target>/kept, where the next campaign continues; finds are in
build/fuzz/<target>/finds, each with a text that says what went wrong. The status is 1 if there are any.
"""

import argparse
import os
import sys
import time
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"
ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "fuzz"), str(ROOT)]

from fuzzing.targets import ALL_TARGETS, TARGETS, make_target, run_target  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "targets", nargs="*", default=list(ALL_TARGETS), help=f"of {', '.join(ALL_TARGETS)}; default: all"
    )
    parser.add_argument("--seconds", type=float, help="divided among the targets")
    parser.add_argument("--inputs", type=int, help="for each target")
    parser.add_argument("--seed", type=int, default=None, help="of the mutations; default: the time")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "fuzz", help="for what is kept")
    parser.add_argument("--input", type=Path, help="run a single input, without limits")
    options = parser.parse_args()
    if unknown := set(options.targets) - set(ALL_TARGETS):
        parser.error(f"unknown targets {', '.join(sorted(unknown))}")
    if options.input is not None:
        if options.targets[0] not in TARGETS:
            parser.error(f"--input is for one of {', '.join(TARGETS)}")
        print(make_target(options.targets[0]).run(options.input.read_bytes()))
        return 0
    seconds = None if options.seconds is None else options.seconds / len(options.targets)
    if seconds is None and options.inputs is None:
        seconds = 60.0
    seed = int(time.time()) % 10**6 if options.seed is None else options.seed
    finds = 0
    for name in options.targets:
        summary = run_target(name, options.folder, options.inputs, seconds, seed)
        print(summary.text(), flush=True)
        for find in summary.finds:
            print(f"  find {find}")
        finds += len(summary.finds)
    return min(1, finds)


if __name__ == "__main__":
    sys.exit(main())
