"""The panel that plays a motion: a time line, and the efforts of a joint beside it."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from viser import GuiApi

    from robot_dynamics.viewing.played_motion import PlayedMotion
    from robot_dynamics.viewing.robot_view import RobotView

FRAME_SECONDS = 1 / 30
MAX_PLOT_POINTS = 2000
MODEL_COLOUR = "#2a6fbb"
MEASURED_COLOUR = "#d0702a"
LIMIT_COLOUR = "#c23030"


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
        with gui.add_folder("Motion"):
            duration = max(motion.duration, FRAME_SECONDS)
            self._time: Any = gui.add_slider("time [s]", min=0.0, max=duration, step=duration / 1000, initial_value=0.0)
            self._is_playing = gui.add_checkbox("play", initial_value=False)
            self._speed = gui.add_slider("speed", min=0.1, max=4.0, step=0.1, initial_value=1.0)
            self._joint = gui.add_dropdown("efforts of", [joint.name for joint in joints])
            self._plot = gui.add_uplot(**self._plot_content(0), height=220)
        self._time.on_update(lambda event: self._show(event))
        self._joint.on_update(lambda event: self._draw_plot())
        self._thread = threading.Thread(target=self._play, name="motion", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread that plays."""
        self._is_closed.set()
        self._thread.join()

    def _show(self, event: Any) -> None:
        if event.client is not None:
            self._move_to(float(self._time.value))

    def _move_to(self, moment: float) -> None:
        positions = self._motion.at(moment)
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
            self._move_to(moment)

    def _draw_plot(self) -> None:
        names = self._joint.options
        content = self._plot_content(names.index(self._joint.value))
        self._plot.data = content["data"]
        self._plot.series = content["series"]

    def _plot_content(self, column: int) -> dict[str, Any]:
        """Return data and series of the efforts of a joint: the model, the measured ones, and the limits."""
        motion = self._motion
        chosen = slice(None, None, max(1, len(motion.times) // MAX_PLOT_POINTS))
        times = motion.times[chosen]
        data = [times, motion.efforts[chosen, column], motion.measured_efforts[chosen, column]]
        series: list[dict[str, Any]] = [
            {"label": "s"},
            {"label": "model", "stroke": MODEL_COLOUR, "width": 1.5},
            {"label": "measured", "stroke": MEASURED_COLOUR, "width": 1},
        ]
        limit = self._view.robot.joints[self._view.configuration.independent[column]].limits.effort
        if np.isfinite(limit):
            data += [np.full_like(times, limit), np.full_like(times, -limit)]
            series += [{"label": "limit", "stroke": LIMIT_COLOUR, "width": 1, "dash": [6, 4]}] * 2
        return {"data": tuple(data), "series": tuple(series)}
