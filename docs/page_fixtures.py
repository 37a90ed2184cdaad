"""Named set-ups of pages. The comment `% setup: NAME` in a page calls the function NAME(folder) of this file.

A function makes files in the folder in which the blocks of the page run.
"""

from pathlib import Path

from peers.recorded import loaded_panda, messages, panda_motion, write_bag

DURATION = 12.0  # [s]


def run(folder: Path) -> None:
    """A bag `run`: joint_states of a Panda in motion, with the efforts of its model."""
    write_bag(folder / "run", messages(panda_motion(duration=DURATION)))


def run_loaded(folder: Path) -> None:
    """A bag `run_loaded`: the same motion with 2.5 kg at the flange, which the description does not have."""
    write_bag(folder / "run_loaded", messages(panda_motion(duration=DURATION, model=loaded_panda(2.5))))
