"""A viser server with an empty scene, and the view of a robot in it."""

from __future__ import annotations

import io
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.optional_packages import import_optional

if TYPE_CHECKING:
    from collections.abc import Iterator

    from viser import ViserServer

    from robot_dynamics.viewing.robot_view import RobotView

HOST = "127.0.0.1"
BRAND_COLOUR = (42, 111, 187)
GRID_CELLS = 40


def make_server(title: str, port: int, host: str) -> ViserServer:
    """Start a server with an empty scene. Raises MissingPackageError."""
    viser = import_optional("viser", "the viewer")
    with silenced():
        server: ViserServer = viser.ViserServer(host=host, port=port, label=title, verbose=False)
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND_COLOUR)
    server.scene.set_up_direction("+z")
    return server


def stop_server(server: ViserServer) -> None:
    """Stop a server."""
    with silenced():
        server.stop()


@contextmanager
def silenced() -> Iterator[None]:
    """Drop what the block prints: viser prints a banner."""
    with redirect_stdout(io.StringIO()):
        yield


def frame_camera(server: ViserServer, view: RobotView) -> None:
    """Look at the whole robot from the front, above a grid on the ground."""
    camera = server.initial_camera
    camera.look_at = view.centre
    camera.position = view.centre + view.extent * np.array([1.0, -1.2, 0.65])
    cell = float(10.0 ** np.floor(np.log10(view.extent)))
    lowest = min(0.0, float(view.origins[:, 2].min()))
    server.scene.add_grid(
        "/grid",
        width=GRID_CELLS * cell,
        height=GRID_CELLS * cell,
        cell_size=cell,
        section_size=5 * cell,
        position=(0.0, 0.0, lowest),
    )
