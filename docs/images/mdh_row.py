"""Draw docs/images/mdh_row.svg: the six parameters of one row of an MDH table.

Run ``python docs/images/mdh_row.py`` by hand after a change of this file. It needs matplotlib.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt

OUTPUT = Path(__file__).with_suffix(".svg")
GAMMA, B, ALPHA, D, THETA, R = np.radians(45), 1.4, np.radians(35), 3.6, np.radians(80), 2.6
AZIMUTH, ELEVATION = np.radians(-92), np.radians(20)
GREY, FRAME, PARAMETER = "0.55", "#1f4e9c", "#b3261e"


def about_z(angle: float) -> np.ndarray:
    """Rotation (3, 3) about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def about_x(angle: float) -> np.ndarray:
    """Rotation (3, 3) about x."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def project(points: np.ndarray) -> np.ndarray:
    """Points (..., 3) on the paper (..., 2), seen from far away."""
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0])
    forward = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0])
    up = np.array([0, 0, 1]) * np.cos(ELEVATION) - forward * np.sin(ELEVATION)
    return np.stack([points @ right, points @ up], axis=-1)


class Drawing:
    """Lines, arrows, arcs and labels in space."""

    def __init__(self) -> None:
        self.figure, self.axes = plt.subplots(figsize=(9, 7))
        self.axes.set_aspect("equal")
        self.axes.axis("off")

    def line(self, start: np.ndarray, end: np.ndarray, color: str = GREY, width: float = 1.0, style: str = "-") -> None:
        """Draw a line."""
        x, y = project(np.array([start, end])).T
        self.axes.plot(x, y, color=color, linewidth=width, linestyle=style, solid_capstyle="round")

    def arrow(self, start: np.ndarray, end: np.ndarray, color: str, width: float = 2.0, both: bool = False) -> None:
        """Draw an arrow."""
        style = {"arrowstyle": "<|-|>" if both else "-|>", "color": color, "linewidth": width}
        style |= {"shrinkA": 0, "shrinkB": 0, "mutation_scale": 13}
        self.axes.annotate("", project(end), project(start), arrowprops=style)

    def arc(self, centre: np.ndarray, axes: np.ndarray, angle: float, radius: float) -> None:
        """Draw an arrow along an arc from the first of two axes (3, 2) towards the second one."""
        angles = np.linspace(0, angle, 40)
        points = centre + radius * (np.cos(angles)[:, None] * axes[:, 0] + np.sin(angles)[:, None] * axes[:, 1])
        x, y = project(points).T
        self.axes.plot(x[:-2], y[:-2], color=PARAMETER, linewidth=1.6)
        self.arrow(points[-4], points[-1], PARAMETER, 1.6)

    def label(self, point: np.ndarray, text: str, color: str, shift: tuple[float, float] = (0, 0)) -> None:
        """Write a text, shifted on the paper by points."""
        self.axes.annotate(
            text, project(point), shift, textcoords="offset points", color=color, fontsize=15, ha="center", va="center"
        )


def draw() -> Drawing:
    """Draw frame i, the common normal of both axes, and frame j."""
    drawing = Drawing()
    origin = np.zeros(3)
    x, y, z = np.eye(3)
    turned = about_z(GAMMA)
    normal = turned[:, 0]
    foot = B * z
    corner = foot + D * normal
    tilted = turned @ about_x(ALPHA)
    rotated = tilted @ about_z(THETA)
    axis = tilted[:, 2]
    end = corner + R * axis

    drawing.line(origin - 0.5 * z, foot + 1.5 * z, style="--")  # axis of joint i
    drawing.line(corner - 0.7 * axis, end + 1.7 * axis, style="--")  # axis of joint j
    drawing.line(origin, 1.5 * normal, style=":")
    drawing.line(foot, corner, width=1.4)
    drawing.line(corner, corner + 1.3 * z, style=":")
    drawing.line(end, end + 1.3 * normal, style=":")

    drawing.arrow(origin, 1.5 * x, FRAME)
    drawing.label(1.5 * x, "$x_i$", FRAME, (10, -6))
    drawing.arrow(origin, 0.75 * z, FRAME)
    drawing.label(0.75 * z, "$z_i$", FRAME, (15, 0))
    drawing.label(origin, "$O_i$", FRAME, (14, -15))
    drawing.arrow(end, end + 1.3 * rotated[:, 0], FRAME)
    drawing.label(end + 1.3 * rotated[:, 0], "$x_j$", FRAME, (-12, 6))
    drawing.arrow(end, end + 1.5 * axis, FRAME)
    drawing.label(end + 1.5 * axis, "$z_j$", FRAME, (14, 6))
    drawing.label(end, "$O_j$", FRAME, (-16, 6))

    shift = -0.55 * normal
    drawing.line(foot, foot + 1.2 * shift, width=0.7)
    drawing.line(origin, 1.2 * shift, width=0.7)
    drawing.arrow(shift, foot + shift, PARAMETER, 1.5, both=True)
    drawing.label(foot / 2 + shift, "$b$", PARAMETER, (-11, 0))
    drawing.arrow(foot, corner, PARAMETER, 1.5, both=True)
    drawing.label((foot + corner) / 2, "$d$", PARAMETER, (0, 13))
    side = 0.42 * normal
    drawing.line(corner, corner + 1.2 * side, width=0.7)
    drawing.arrow(corner + side, end + side, PARAMETER, 1.5, both=True)
    drawing.label((corner + end) / 2 + side, "$r$", PARAMETER, (12, 2))
    drawing.arc(origin, np.stack([x, y], axis=-1), GAMMA, 1.05)
    drawing.label(1.05 * (about_z(GAMMA / 2) @ x), r"$\gamma$", PARAMETER, (14, 0))
    drawing.arc(corner, np.stack([z, np.cross(normal, z)], axis=-1), ALPHA, 1.05)
    drawing.label(corner + 1.05 * (turned @ about_x(ALPHA / 2) @ z), r"$\alpha$", PARAMETER, (0, 13))
    drawing.arc(end, np.stack([normal, tilted[:, 1]], axis=-1), THETA, 0.9)
    drawing.label(end + 0.9 * (tilted @ about_z(THETA / 2) @ x), r"$\theta$", PARAMETER, (13, 5))
    return drawing


if __name__ == "__main__":
    mpl.rcParams.update({"svg.hashsalt": "mdh_row", "svg.fonttype": "path", "mathtext.fontset": "dejavusans"})
    figure = draw().figure
    figure.savefig(OUTPUT, bbox_inches="tight", facecolor="white", metadata={"Date": None})
    print(OUTPUT)
