"""The verb frequencies: it prints the published frequencies of Briot and writes self-contained drawings."""

import re

import pytest

from robot_dynamics.cli.main import main


def printed(arguments, capsys):
    assert main(["frequencies", *arguments]) == 0
    output = capsys.readouterr()
    assert not output.err
    return output.out


def test_frequencies_at_pose_d_of_the_paper(capsys):
    out = printed(["navaro", "--pose", "x=0,y=-0.21,yaw=0", "--count", "5"], capsys)
    assert "90 in all" in out
    frequencies = [float(value) for value in re.findall(r"^ +\d+ +([\d.]+) ", out, re.MULTILINE)]
    assert frequencies == pytest.approx([40.17, 50.32, 52.99, 67.36, 91.52], abs=0.01)


def test_frequencies_of_elastic_gears(capsys):
    """With the motors held, three springs move."""
    assert "3 in all" in printed(["manutec_r3", "--joints", "motor_2=1.2"], capsys)


@pytest.mark.slow
def test_mode_and_map_are_drawn_as_html(tmp_path, capsys):
    pytest.importorskip("plotly", reason="plotly, which draws in HTML, is not installed")
    pytest.importorskip("viser", reason="viser, which draws in three dimensions, is not installed")
    mode, picture = tmp_path / "mode.html", tmp_path / "map.html"
    assert "mode 2, 4" in printed(["navaro", "--mode", "2", "--output", str(mode)], capsys)
    page = mode.read_text()
    assert "<title>navaro: mode 2, 4" in page and "<script src" not in page and len(page) < 3e6
    out = printed(
        ["navaro", "--map", "x:-0.01:0.01:2,yaw:-0.1:0.1:3", "--count", "2", "--output", str(picture)], capsys
    )
    assert "6 of 6 poses reached" in out
    assert "Plotly.newPlot" in picture.read_text()


@pytest.mark.slow
def test_map_is_drawn_as_png(tmp_path, capsys):
    picture = tmp_path / "map.png"
    out = printed(["navaro", "--map", "x:-0.01:0.01:2,y:-0.1:0.1:2", "--count", "2", "--output", str(picture)], capsys)
    assert "4 of 4 poses reached" in out and picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments, reason",
    [
        (["navaro", "--pose", "u=0"], "unknown coordinate of a platform 'u'"),
        (["navaro", "--pose", "z=1"], "the legs do not leave z of the platform free, only x, y, yaw"),
        (["panda"], "neither beams nor elastic joints"),
        (["navaro", "--pose", "x=a"], "--pose x=a: NAME=VALUE with a finite number is needed"),
        (["navaro", "--pose", "x=0", "--joints", "crank_1=0"], "twice"),
        (["navaro", "--pose", "x=0.6"], "does not close"),
        (["panda", "--pose", "x=0"], "has no platform"),
        (["navaro", "--map", "x:0:1:5"], "two coordinates vary in a map"),
        (["navaro", "--map", "x:0:1,y:0:1:5"], "NAME:FROM:TO:COUNT is needed"),
        (
            ["navaro", "--map", "x:0:1:3,y:0:1:3", "--output", "map.csv"],
            "--output map.csv: the path of the output file must end with .html, .png, .pdf or .svg",
        ),
        (["navaro", "--mode", "91"], "modes 1 to 90"),
        (["navaro", "--held", "nobody"], "unknown joint 'nobody'"),
        (["navaro", "--count", "0"], "1 or more"),
        (["hexapod_stack"], "has the platforms lower, upper: --pose is for one platform"),
    ],
)
def test_wrong_arguments_are_refused_with_a_reason(arguments, reason, capsys):
    assert main(["frequencies", *arguments]) == 1
    assert reason in capsys.readouterr().err
