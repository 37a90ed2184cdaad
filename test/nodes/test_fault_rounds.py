"""Running nodes are hurt: a few rounds of some faults, in the harness of `faults/`.

`make faults` runs all faults, 100 rounds of each. The disk, the network and the clients need namespaces of Linux.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROUNDS = int(os.environ.get("FAULT_ROUNDS", "2"))
FAULTS = "robot (killed|stopped)|node stopped|subscriber stopped|behind|invalid states|no network"
PATHS = [str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]


@pytest.mark.timeout(120 + 30 * ROUNDS)
def test_invariants_hold_in_each_round_of_each_fault():
    done = subprocess.run(
        [sys.executable, "-m", "nodes.faults.harness", "--rounds", str(ROUNDS), "--faults", FAULTS],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(PATHS)},
        stdout=subprocess.PIPE,
        text=True,
    )
    print(done.stdout)
    assert done.returncode == 0, done.stdout
    assert done.stdout.count(f"| {ROUNDS} | 0 |") >= 2 * 6  # each row when it is ready, and in the table
