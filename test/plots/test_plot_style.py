"""The style of pictures: whatever the settings of a user, readable in grey, safe with any name, the same each time."""

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from robot_dynamics.plots.plot_colours import COLOURS
from robot_dynamics.plots.plot_labels import MAX_LENGTH, plain_label
from robot_dynamics.plots.plot_limits import draw_limits
from robot_dynamics.plots.plot_style import LINE_STYLES, PAGE_WIDTH, new_figure, plot_style, save_figure


@plot_style()
def example(path, name="$\\frac$ and $x_$"):
    figure = new_figure(PAGE_WIDTH, 2)
    axes = figure.subplots()
    for k in range(6):
        axes.plot([0, 1], [k, k + 1], label=plain_label(name))
    axes.set_title(plain_label(name))
    axes.legend()
    save_figure(figure, path)
    return axes


@pytest.mark.parametrize("ending", ["svg", "pdf", "png"])
def test_same_figure_gives_the_same_file(tmp_path, ending):
    paths = [tmp_path / f"{k}.{ending}" for k in range(2)]
    for path in paths:
        example(path)
    first, second = (path.read_bytes() for path in paths)
    assert first == second and len(first) > 1000


def test_settings_of_a_user_neither_matter_nor_change(tmp_path):
    with matplotlib.rc_context({"font.size": 30, "lines.linewidth": 9, "text.usetex": True}):
        axes = example(tmp_path / "a.png")
        assert matplotlib.rcParams["font.size"] == 30
    assert axes.title.get_fontsize() < 10 and axes.lines[0].get_linewidth() < 2
    size = matplotlib.image.imread(tmp_path / "a.png").shape[1]
    assert size == PAGE_WIDTH * 160


def test_curves_differ_in_grey():
    """By their line style; and neighbours in brightness too."""
    assert len(COLOURS) == len(LINE_STYLES) == len({*map(str, LINE_STYLES)})
    brightness = [np.dot([0.2126, 0.7152, 0.0722], to_rgb(colour)) for colour in COLOURS]
    assert np.abs(np.diff(brightness)).min() > 0.1


@pytest.mark.parametrize("name", ["$\\badcommand{$", "a\nb\x00", "$" * 9, "x" * 500, "\\$x$"])
def test_any_name_can_be_drawn(tmp_path, name):
    assert len(plain_label(name).replace("\\$", "$")) <= MAX_LENGTH
    axes = example(tmp_path / "a.svg", name)
    assert "$" not in name or "$" in axes.title.get_text()


def test_near_limits_are_lines_and_far_ones_are_written():
    axes = new_figure(3, 2).subplots()
    axes.plot([0, 1], [-4, 5])
    draw_limits(axes, -6, 6, "N m")
    assert [line.get_ydata()[0] for line in axes.lines[1:]] == [-6, 6] and not axes.texts
    assert axes.get_ylim()[0] <= -6 and axes.get_ylim()[1] >= 6
    low, high = axes.get_ylim()
    draw_limits(axes, -87, 87, "N m")
    assert [text.get_text() for text in axes.texts] == ["limit ±87 N m"]
    assert axes.get_ylim()[0] == low and high < axes.get_ylim()[1] < high + 0.2 * (high - low)
    draw_limits(axes, -np.inf, np.inf, "N m")
    assert len(axes.lines) == 3 and len(axes.texts) == 1
