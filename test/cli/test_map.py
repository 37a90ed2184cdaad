"""robot-dynamics map: the table agrees with closed forms and with the library, the picture shows it, and wrong
arguments are refused before the computation."""

import csv
import fcntl
import os
import pty
import select
import struct
import subprocess
import sys
import termios

import numpy as np
import pytest
from matplotlib.image import imread
from peers.gough_stewart import gough_stewart

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.cli.main import main
from robot_dynamics.parallel.platform_dynamics import pose_from_coordinates
from robot_dynamics.parallel.pose_map import pose_map
from robot_dynamics.plots.pose_classes import POSE_CLASSES
from robot_dynamics.plots.pose_map_plot import draw_pose_map


def table(path):
    with path.open(encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return header, np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])


def shows(path, kind):
    """Whether more than 1 % of a picture has the colour of a class of poses."""
    colour = [int(POSE_CLASSES[kind][k : k + 2], 16) / 255 for k in (1, 3, 5)]
    return (np.abs(imread(path)[..., :3] - colour).max(axis=-1) < 0.01).mean() > 0.01


def leg_lengths(x, z):
    """Leg lengths of the Gough-Stewart platform that ships: distances between joints on circles of 3 m and 1 m."""
    around = np.radians(np.arange(3) * 120)
    below, above = (np.sort([*(around - np.radians(angle)), *(around + np.radians(angle))]) for angle in (2.5, 50))
    legs = np.array([np.cos(above) + x - 3 * np.cos(below), np.sin(above) - 3 * np.sin(below), z + 0 * above])
    return np.linalg.norm(legs, axis=0)


@pytest.mark.slow
def test_map_over_two_coordinates_agrees_with_closed_forms(tmp_path, capsys):
    picture, numbers = tmp_path / "map.png", tmp_path / "map.csv"
    over = "x:-1.5:1.5:7,z:0.6:3.4:8"
    assert main(["map", "gough_stewart", "--over", over, "--output", str(picture), "--csv", str(numbers)]) == 0
    printed = capsys.readouterr()
    assert not printed.err  # no progress bar without a terminal
    header, rows = table(numbers)
    assert header[:5] == ["x [m]", "z [m]", "legs close", "in reach", "condition number"] and len(rows) == 56
    assert header[5] == "position leg_1 [m]" and header[-1] == "effort leg_6 [N]" and len(header) == 17
    home = leg_lengths(0, 2)[0]
    lengths = np.array([leg_lengths(*row[:2]) for row in rows])
    within = np.all((0.76 * home <= lengths) & (lengths <= 1.28 * home), axis=1)
    assert np.array_equal(rows[:, 3] == 1, within) and 5 < within.sum() < 50
    assert f"{within.sum()} of 56 poses are in reach" in printed.out and "largest efforts: leg_1" in printed.out
    np.testing.assert_allclose(rows[within, 5:11], lengths[within], rtol=1e-12)
    assert np.isnan(rows[~within, 4:]).all()
    dynamics = Dynamics(load_robot("gough_stewart"))
    poses = pose_from_coordinates(np.array([[x, 0, z, 0, 0, 0] for x, z in rows[within, :2]]))
    np.testing.assert_allclose(rows[within, 11:], dynamics.platform.inverse(poses), rtol=1e-9)
    assert shows(picture, "in reach") and shows(picture, "motors beyond their limits")
    assert not shows(picture, "singular: the motors do not hold it")


@pytest.mark.slow
def test_map_over_one_coordinate_with_an_acceleration(tmp_path, capsys):
    numbers, acceleration = tmp_path / "map.csv", [0, 0, 1.5, 0, 0.2, 0]
    arguments = ["--over", "roll:-0.2:0.2:5", "--at", "z=2.2,yaw=0.1", "--csv", str(numbers)]
    output = ["--output", str(tmp_path / "map.svg"), "--acceleration", *map(str, acceleration)]
    assert main(["map", "gough_stewart", *arguments, *output]) == 0
    _, rows = table(numbers)
    poses = pose_from_coordinates(np.array([[0, 0, 2.2, 0.1, 0, roll] for roll in np.linspace(-0.2, 0.2, 5)]))
    expected = Dynamics(load_robot("gough_stewart")).platform.inverse(poses, None, acceleration)
    np.testing.assert_allclose(rows[:, -6:], expected, rtol=1e-9)
    assert "5 of 5 poses are in reach" in capsys.readouterr().out and (tmp_path / "map.svg").stat().st_size > 1000


@pytest.mark.slow
def test_singular_poses_differ_from_poses_out_of_reach(tmp_path):
    """A level platform turned by 90 degrees is singular at every position (Fichter)."""
    robot = gough_stewart()
    result = pose_map(Dynamics(robot), {"yaw": np.array([0.0, 0.5, np.pi / 2]), "x": np.array([0.0, 0.01])})
    assert result.within_limits.all() and result.is_nonsingular.tolist() == [[True, True], [True, True], [False, False]]
    draw_pose_map(tmp_path / "map.png", result, robot)
    assert shows(tmp_path / "map.png", "singular: the motors do not hold it")
    assert not shows(tmp_path / "map.png", "out of reach of the legs")


@pytest.mark.slow
def test_progress_bar_is_shown_on_a_terminal(tmp_path):
    controlling, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    command = [sys.executable, "-m", "robot_dynamics.cli.main", "map", "gough_stewart", "--over", "x:-0.1:0.1:3"]
    process = subprocess.run(
        [*command, "--output", tmp_path / "map.png"], stdout=subprocess.PIPE, stderr=terminal, timeout=120, check=True
    )
    assert select.select([controlling], [], [], 1)[0], "nothing was shown"
    shown = os.read(controlling, 100_000).decode()
    os.close(terminal)
    os.close(controlling)
    assert "/3" in shown and "poses/s" in shown and b"poses/s" not in process.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["gough_stewart", "--over", "q:-1:1:3"], "unknown coordinate of a platform 'q'"),
        (["gough_stewart", "--over", "x:-1:1:3", "--at", "w=1"], "unknown coordinate of a platform 'w'"),
        (["gough_stewart", "--over", "x:-1:1:3", "--at", "x=1"], "x of the platform varies over the grid"),
        (["gough_stewart", "--over", "x:-1:1:3", "--at", "z"], "--at z: NAME=VALUE with a finite number is needed"),
        (["gough_stewart", "--over", "x:-1:1:3", "--at", "z=nan"], "with a finite number is needed"),
        (["gough_stewart", "--over", "x:-1:1"], "NAME:FROM:TO:COUNT is needed, such as x:-0.1:0.1:41"),
        (["gough_stewart", "--over", "x:-1:1:1"], "in 2 to 2000 values"),
        (["gough_stewart", "--over", "x:1:1:5"], "from a number to a larger one"),
        (["gough_stewart", "--over", "x:0:inf:5"], "from a number to a larger one"),
        (["gough_stewart", "--over", "x:0:1:5,y:0:1:5,z:1:2:5"], "one or two coordinates vary"),
        (["gough_stewart", "--over", "x:0:1:5,x:1:2:5"], "each once"),
        (
            ["gough_stewart", "--over", "x:0:1:5", "--output", "map.bmp"],
            ".pdf, .svg, .jpg or .html",
        ),
        (["gough_stewart", "--over", "x:0:1:5", "--csv", "/proc/no/folder/map.csv"], "map.csv cannot be written"),
        (["panda", "--over", "x:0:1:5"], "has no platform"),
        (["hexapod_stack", "--over", "x:0:1:5"], "a map is of one alone"),
    ],
)
def test_wrong_arguments_are_refused_with_a_reason(arguments, reason, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["map", *arguments]) == 1
    printed = capsys.readouterr()
    assert reason in printed.err and "Traceback" not in printed.err and not printed.out
    assert not list(tmp_path.iterdir())
