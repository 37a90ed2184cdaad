"""The panel that puts a robot with loops into another assembly mode."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

from robot_dynamics.viewing.assembly_search import MAX_BATCHES, SEEDS_PER_BATCH, find_assembly_modes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from viser import GuiApi

    from robot_dynamics.array_types import Array
    from robot_dynamics.viewing.assembly_search import AssemblyMode
    from robot_dynamics.viewing.configuration import Configuration
    from robot_dynamics.viewing.robot_view import RobotView

SEARCH_SECONDS = 20.0
"""Time after which the search ends, whatever it has found."""
UNKNOWN = "not searched here"
HINT = (
    f"closes the loops from up to {MAX_BATCHES * SEEDS_PER_BATCH} positions of the dependent joints, "
    f"for at most {SEARCH_SECONDS:g} s"
)


class AssemblyPanel:
    """Finds the assembly modes for the present positions of the independent joints, and takes the robot there.

    Parameters
    ----------
    gui : viser.GuiApi
    view : RobotView
    """

    def __init__(self, gui: GuiApi, view: RobotView) -> None:
        self._view = view
        self._modes: dict[str, AssemblyMode] = {}
        self._searching = threading.Lock()
        self._is_closed = threading.Event()
        with gui.add_folder("Assembly mode", expand_by_default=False):
            self.button = gui.add_button("Find modes here", hint=HINT)
            self._message = gui.add_markdown("")
            self.choice: Any = gui.add_dropdown("mode", (UNKNOWN,))
        self.button.on_click(lambda event: self.search())
        self.choice.on_update(lambda event: self._choose(event))
        view.on_move.append(self._forget_other_positions)

    def close(self) -> None:
        """End a search that runs."""
        self._is_closed.set()
        with self._searching:
            pass

    def search(self) -> None:
        """Find the modes and list them; the robot can be moved meanwhile."""
        if not self._searching.acquire(blocking=False):
            return  # one runs
        try:
            self._message.content = "Searching."
            configuration = self._view.configuration
            q = configuration.q
            end = time.monotonic() + SEARCH_SECONDS
            modes = find_assembly_modes(
                configuration.dynamics, q, lambda: self._is_closed.is_set() or time.monotonic() > end
            )
            if not _same_independent(configuration, q, configuration.q):
                self._message.content = "The robot was moved during the search."
                return
            self._modes = dict(zip(mode_names(modes), modes, strict=True))
            self._message.content = f"{len(modes)} found; there may be more."
            self.choice.options = tuple(self._modes)
            self._follow()
        finally:
            self._searching.release()

    def _choose(self, event: Any) -> None:
        mode = self._modes.get(str(self.choice.value))
        if event.client is not None and mode is not None:
            self._view.move(lambda configuration: configuration.place(mode.q))

    def _follow(self) -> None:
        """Show the mode in which the robot is."""
        present = next((name for name, mode in self._modes.items() if self._view.configuration.is_at(mode.q)), None)
        if present is not None and self.choice.value != present:
            self.choice.value = present

    def _forget_other_positions(self) -> None:
        """Drop the modes if the robot has other independent positions now: they do not hold there."""
        if not self._modes:
            return
        configuration = self._view.configuration
        if _same_independent(configuration, next(iter(self._modes.values())).q, configuration.q):
            self._follow()
            return
        self._modes = {}
        self._message.content = ""
        self.choice.options = (UNKNOWN,)
        self.choice.value = UNKNOWN


def _same_independent(configuration: Configuration, first: Array, second: Array) -> bool:
    """Return whether the independent joints have the same positions in two positions (all joints,)."""
    independent = configuration.independent
    return bool((abs(first[independent] - second[independent]) < 1e-9).all())


def mode_names(modes: Sequence[AssemblyMode]) -> list[str]:
    """Return names of modes: a number, how far the farthest point is from the first mode, and limits exceeded."""
    names = []
    for number, mode in enumerate(modes, start=1):
        place = "description" if mode.is_of_description else f"{mode.distance:.3g} m away" if number > 1 else "here"
        names.append(f"{number} ({place}{'' if mode.is_within_limits else ', beyond limits'})")
    return names
