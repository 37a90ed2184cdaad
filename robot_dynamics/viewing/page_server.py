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

    from robot_dynamics.array_types import Array

HOST = "127.0.0.1"
BRAND_COLOUR = (42, 111, 187)
GRID_CELLS = 40
MOTION_DISTANCE = 0.65
"""Distance of the camera from the bounds of a motion: the robot is in a part of them at a time."""
SKY_COLOUR = (255, 255, 255)
GROUND_COLOUR = (170, 170, 180)
LIGHT = 1.5


def make_server(title: str, port: int, host: str) -> ViserServer:
    """Start a server with an empty scene. Raises MissingPackageError."""
    viser = import_optional("viser", "a page in three dimensions")
    with silenced():
        server: ViserServer = viser.ViserServer(host=host, port=port, label=title, verbose=False)
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND_COLOUR)
    server.gui.main_panel.dock_right()  # beside the scene, so that it hides nothing
    server.scene.set_up_direction("+z")
    light_scene(server)
    return server


def light_scene(server: ViserServer) -> None:
    """Light a scene from above and below.

    Shadows and light from a picture of the surroundings take most of the time to draw a robot without a graphics card,
    and change the colours of shapes.
    """
    server.scene.configure_default_lights(cast_shadow=False)
    server.scene.configure_environment_map(None)
    server.scene.add_light_hemisphere("/light", sky_color=SKY_COLOUR, ground_color=GROUND_COLOUR, intensity=LIGHT)


def stop_server(server: ViserServer) -> None:
    """Stop a server."""
    with silenced():
        server.stop()


@contextmanager
def silenced() -> Iterator[None]:
    """Drop what the block prints: viser prints a banner, by rich, which does not use stdout in a notebook."""
    console = import_optional("rich", "a page in three dimensions").get_console()
    was_quiet, console.quiet = console.quiet, True
    try:
        with redirect_stdout(io.StringIO()):
            yield
    finally:
        console.quiet = was_quiet


def frame_camera(server: ViserServer, bounds: Array, distance: float = 1.0) -> None:
    """Look at bounds (2, 3) [m] from the front, above a grid on the ground; distance: relative to the usual one."""
    extent = float(np.ptp(bounds, axis=0).max()) or 1.0
    centre = bounds.mean(axis=0)
    camera = server.initial_camera
    camera.look_at = centre
    camera.position = centre + distance * extent * np.array([0.8, -0.95, 0.5])
    cell = float(10.0 ** np.floor(np.log10(extent)))
    server.scene.add_grid(
        "/grid",
        width=GRID_CELLS * cell,
        height=GRID_CELLS * cell,
        cell_size=cell,
        section_size=5 * cell,
        position=(0.0, 0.0, min(0.0, float(bounds[0, 2]))),
    )
