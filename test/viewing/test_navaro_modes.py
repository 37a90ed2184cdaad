"""The modes in docs/images/navaro_modes.png: frequencies of Table 2, shapes of an independent frame, and what moves."""

import ast
from pathlib import Path

import numpy as np
import pytest
from peers.navaro import navaro_frame
from scipy.linalg import eigh

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.parallel.platform_dynamics import pose_from_coordinates

pytest.importorskip("trimesh")
from robot_dynamics.viewing.mode_geometry import ModeGeometry

SCRIPT = Path(__file__).parents[2] / "docs" / "images" / "navaro_modes.py"
POSE_C = (0.0, -0.135)
PRINTED = (36.98, 49.31, 53.37, 67.28, 91.80)  # Hz, Table 2 of Briot and Khalil at pose (c); the sixth is not printed


@pytest.fixture(scope="module")
def modes():
    """Return (geometry, points at rest (N, 3), [(frequency, displacements (N, 3) with a largest of 1)])."""
    elastodynamics = Dynamics(load_robot("navaro"), compiled=False).elastodynamics
    q = elastodynamics.positions(pose=pose_from_coordinates(np.array([*POSE_C, 0, 0, 0, 0])))
    natural = elastodynamics.natural_frequencies(q, count=6)
    geometry = ModeGeometry(elastodynamics, q)
    points, _ = elastodynamics.node_positions(q)
    drawn = []
    for frequency, shape in zip(natural.frequencies, natural.mode_shapes, strict=True):
        displacements = geometry.displacements(shape)[: len(points), :3]
        drawn.append((frequency, displacements / np.linalg.norm(displacements, axis=1).max()))
    links = [elastodynamics.robot.links[node.link].name for node in elastodynamics.structure.nodes]
    return links, points, drawn


def test_frequencies_are_those_of_table_2(modes):
    assert np.abs(np.array([frequency for frequency, _ in modes[2]])[:5] - PRINTED).max() < 0.01


def test_drawn_shapes_are_those_of_a_frame_of_finite_elements(modes):
    """The displacement of each joint and of the platform's centre, up to the sign and size of the whole mode."""
    _, points, drawn = modes
    frame = navaro_frame(*POSE_C, 0.0)
    M, K = frame.matrices()
    kept = [number for number in range(frame.size) if number not in frame.fixed]
    _, vectors = eigh(K, M)
    nearest = [int(np.linalg.norm(points - position, axis=1).argmin()) for position in frame.positions]
    assert np.abs(points[nearest] - frame.positions).max() < 1e-9
    for (_, displacements), vector in zip(drawn, vectors.T, strict=False):
        full = np.zeros(frame.size)
        full[kept] = vector
        expected = np.array([full[numbers[:3]] for numbers in frame.numbers])
        actual = displacements[nearest]
        factor = (expected * actual).sum() / (actual**2).sum()
        assert np.abs(factor * actual - expected).max() < 1e-6 * np.abs(expected).max()


def test_captions_say_what_moves(modes):
    """Modes 1 to 3 and 5, 6 in the plane, 4 out of it; the platform moves in 1 to 4, one leg in 5 and in 6."""
    links, _, drawn = modes
    spokes = [k for k, link in enumerate(links) if link == "platform"]
    out_of_plane = [bool(np.abs(u[:, 2]).max() > 1 - 1e-9) for _, u in drawn]
    assert out_of_plane == [False, False, False, True, False, False]
    assert all(np.abs(u[:, 2]).max() < 1e-9 for (_, u), out in zip(drawn, out_of_plane, strict=True) if not out)
    centres = np.array([u[spokes].mean(axis=0) for _, u in drawn])
    assert [int(np.abs(centre).argmax()) for centre in centres[[0, 1, 3]]] == [0, 1, 2]
    assert (np.abs(centres[[0, 1, 3]]).max(axis=1) > 0.5).all()
    tips = [k for k, link in enumerate(links) if link.startswith("spoke")]
    assert np.abs(centres[[2, 4, 5]]).max() < 0.15 < 0.5 < np.linalg.norm(drawn[2][1][tips], axis=1).max()
    for number, leg in ((4, "1"), (5, "2")):
        largest = {link: np.linalg.norm(drawn[number][1][links.index(link)]) for link in links}
        of_leg = max(value for link, value in largest.items() if link in (f"arm_{leg}", f"rod_{leg}"))
        others = max(value for link, value in largest.items() if not link.endswith(f"_{leg}"))
        assert of_leg > 0.9 and others < 0.5


def test_figure_has_a_caption_for_each_mode():
    constants = {}
    for statement in ast.parse(SCRIPT.read_text(encoding="utf-8")).body:
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) in ("CAPTIONS", "POSE_C"):
            constants[ast.unparse(statement.targets[0])] = ast.literal_eval(statement.value)
    captions = constants["CAPTIONS"]
    assert constants["POSE_C"] == POSE_C and len(captions) == 6
    assert [caption.startswith("out of the plane") for caption in captions] == [False] * 3 + [True] + [False] * 2
    assert ["leg 1" in captions[4], "leg 2" in captions[5]] == [True, True]
    assert SCRIPT.with_suffix(".png").stat().st_size < 150_000
