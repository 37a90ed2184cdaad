"""The panel that shows the modes of a robot with beams or elastic joints."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.viewing.markdown import escape_markdown
from robot_dynamics.viewing.mode_geometry import ModeGeometry
from robot_dynamics.viewing.mode_view import ModeView

if TYPE_CHECKING:
    from viser import ViserServer

    from robot_dynamics.flexible.elastodynamics import NaturalFrequencies
    from robot_dynamics.viewing.robot_view import RobotView

FRAME_SECONDS = 1 / 30
CYCLE_SECONDS = 1.6
"""Duration of an oscillation as it is drawn, whatever its frequency."""
MAX_MODES = 40
HIDDEN = "none: the rigid robot"


class ModePanel:
    """Lists the natural frequencies where the robot is, and draws the mode that is chosen.

    Parameters
    ----------
    server : viser.ViserServer
    view : RobotView
    """

    def __init__(self, server: ViserServer, view: RobotView) -> None:
        self._server = server
        self._view = view
        self._modes: NaturalFrequencies | None = None
        self._drawn: ModeView | None = None
        self._lock = threading.Lock()
        self._is_closed = threading.Event()
        gui = server.gui
        with gui.add_folder("Natural frequencies", expand_by_default=False):
            self._button = gui.add_button("Compute them here", hint="motors and brakes hold the robot")
            self._message = gui.add_markdown("")
            self._choice: Any = gui.add_dropdown("mode", (HIDDEN,))
            self._amplitude = gui.add_slider("amplitude", min=0.0, max=0.3, step=0.005, initial_value=0.1)
            self._is_moving = gui.add_checkbox("animate", initial_value=True)
        self._button.on_click(lambda event: self._compute())
        self._choice.on_update(lambda event: self._choose())
        self._amplitude.on_update(lambda event: self._choose())
        view.on_move.append(self._hide)
        self._thread = threading.Thread(target=self._animate, name="mode", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread that animates."""
        self._is_closed.set()
        self._thread.join()

    def _compute(self) -> None:
        elastodynamics = self._view.configuration.dynamics.elastodynamics
        try:
            self._modes = elastodynamics.natural_frequencies(self._view.configuration.q, count=MAX_MODES)
        except RobotDynamicsError as error:
            self._message.content = escape_markdown(str(error))
            return
        self._message.content = ""
        frequencies = [
            f"{number}: {frequency:.4g} Hz" for number, frequency in enumerate(self._modes.frequencies, start=1)
        ]
        self._choice.options = (HIDDEN, *frequencies)
        self._choice.value = frequencies[0] if frequencies else HIDDEN
        self._choose()

    def _choose(self) -> None:
        """Draw the chosen mode."""
        name = str(self._choice.value)
        if name == HIDDEN or self._modes is None:
            self._hide()
            return
        with self._lock:
            if self._drawn is None:
                configuration = self._view.configuration
                geometry = ModeGeometry(configuration.dynamics.elastodynamics, configuration.q)
                self._drawn = ModeView(self._server.scene, geometry)
                self._view.scene.show(False)
            self._drawn.choose(self._modes.mode_shapes[int(name.partition(":")[0]) - 1], float(self._amplitude.value))
            self._drawn.draw(np.pi / 2)

    def _hide(self) -> None:
        """Draw the rigid robot: the modes are those of another pose, or none is chosen."""
        with self._lock:
            if self._drawn is not None:
                self._drawn.remove()
                self._drawn = None
                self._view.scene.show(True)
        self._choice.value = HIDDEN

    def _animate(self) -> None:
        while not self._is_closed.wait(FRAME_SECONDS):
            with self._lock:
                if self._drawn is not None and self._is_moving.value:
                    with self._server.atomic():
                        self._drawn.draw(2 * np.pi * time.monotonic() / CYCLE_SECONDS)
