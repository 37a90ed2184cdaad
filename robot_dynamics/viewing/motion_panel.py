"""The panel that plays a motion: a time line, and positions and efforts of a joint beside it."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from viser import GuiApi

    from robot_dynamics.array_types import Array
    from robot_dynamics.viewing.played_motion import PlayedMotion
    from robot_dynamics.viewing.robot_view import RobotView

FRAME_SECONDS = 1 / 30
MAX_PLOT_POINTS = 2000
PLOT_HEIGHT = 190  # [px]
MODEL_COLOUR = "#2a6fbb"
MEASURED_COLOUR = "#d0702a"
LIMIT_COLOUR = "#c23030"


def plot_series(first: str, second: str) -> Any:
    """Return how a plot draws two signals and their limits."""
    return (
        {"label": "s"},
        {"label": first, "stroke": MODEL_COLOUR, "width": 1.5},
        {"label": second, "stroke": MEASURED_COLOUR, "width": 1},
        *[{"label": label, "stroke": LIMIT_COLOUR, "width": 1, "dash": [6, 4]} for label in ("lower", "upper limit")],
    )


POSITION_SERIES = plot_series("played", "reference")
EFFORT_SERIES = plot_series("model", "measured")


class MotionPanel:
    """Plays a motion.

    Parameters
    ----------
    gui : viser.GuiApi
    view : RobotView
    motion : PlayedMotion
    """

    def __init__(self, gui: GuiApi, view: RobotView, motion: PlayedMotion) -> None:
        self._view = view
        self._motion = motion
        self._is_closed = threading.Event()
        joints = [view.robot.joints[index] for index in view.configuration.independent]
        self._names = [joint.name for joint in joints]
        with gui.add_folder("Motion"):
            if motion.reference is not None:
                view.add_reference()
                gui.add_markdown("The translucent orange robot is the reference.")
            duration = max(motion.duration, FRAME_SECONDS)
            self._time: Any = gui.add_slider("time [s]", min=0.0, max=duration, step=duration / 1000, initial_value=0.0)
            self._is_playing = gui.add_checkbox("play", initial_value=False)
            self._speed = gui.add_slider("speed", min=0.1, max=4.0, step=0.1, initial_value=1.0)
            self._joint = gui.add_dropdown("joint", self._names)
            form: Any = {"height": PLOT_HEIGHT, "scales": {"x": {"time": False}}}  # seconds, not dates
            self.position_plot = gui.add_uplot(self._position_data(0), POSITION_SERIES, title="position", **form)
            self.effort_plot = gui.add_uplot(self._effort_data(0), EFFORT_SERIES, title="effort", **form)
        self._time.on_update(lambda event: self._show(event))
        self._joint.on_update(lambda event: self._draw_plots())
        self._thread = threading.Thread(target=self._play, name="motion", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread that plays."""
        self._is_closed.set()
        self._thread.join()

    def _show(self, event: Any) -> None:
        if event.client is not None:
            self.move_to(float(self._time.value))

    def move_to(self, moment: float) -> None:
        """Show the robot at a time [s] of the motion."""
        positions = self._motion.at(moment)
        self._view.reference = self._motion.reference_at(moment)
        self._view.move(lambda configuration: configuration.place(positions))

    def _play(self) -> None:
        last = time.monotonic()
        while not self._is_closed.wait(FRAME_SECONDS):
            now = time.monotonic()
            elapsed, last = now - last, now
            if not self._is_playing.value:
                continue
            moment = (float(self._time.value) + elapsed * float(self._speed.value)) % self._time.max
            self._time.value = moment
            self.move_to(moment)

    def _draw_plots(self) -> None:
        column = self._names.index(str(self._joint.value))
        self.position_plot.data = self._position_data(column)
        self.effort_plot.data = self._effort_data(column)

    def _position_data(self, column: int) -> tuple[Array, ...]:
        """Return times, positions of a joint, those of the reference, and the limits; nan where there is none."""
        index = self._view.configuration.independent[column]
        limits = self._view.robot.joints[index].limits
        nothing = np.full(len(self._motion.times), np.nan)
        reference = nothing if self._motion.reference is None else self._motion.reference[:, index]
        return self._plot_data(self._motion.positions[:, index], reference, limits.lower, limits.upper)

    def _effort_data(self, column: int) -> tuple[Array, ...]:
        """Return times, efforts of the model at a joint, the measured ones, and the limits; nan where there is none."""
        motion = self._motion
        limit = self._view.robot.joints[self._view.configuration.independent[column]].limits.effort
        return self._plot_data(motion.efforts[:, column], motion.measured_efforts[:, column], -limit, limit)

    def _plot_data(self, first: Array, second: Array, lower: float, upper: float) -> tuple[Array, ...]:
        times = self._motion.times
        chosen = slice(None, None, max(1, len(times) // MAX_PLOT_POINTS))
        limits = [np.full(len(times), limit if np.isfinite(limit) else np.nan) for limit in (lower, upper)]
        return tuple(np.asarray(values[chosen], dtype=float) for values in (times, first, second, *limits))
