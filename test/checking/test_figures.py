"""Pictures of a check: curves of the samples, effort limits of the description, units, and names of any text."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import html

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.checking.check import check
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.recording import open_recording

pytest.importorskip("matplotlib")
pytest.importorskip("rosbags")
from robot_dynamics.checking.figures import effort_figure, write_figures
from robot_dynamics.plots.plot_limits import LABEL

BAG = Path(__file__).parents[1] / "recordings" / "data" / "panda_mcap"


@pytest.fixture(scope="module")
def result():
    dynamics = Dynamics(load_robot("panda"), compiled=False)
    return check(open_recording(BAG, direct_drives(dynamics.joint_names)), dynamics, load_tolerances())


def with_effort_limit(result, limit):
    joints = [replace(joint, limits=replace(joint.limits, effort=limit)) for joint in result.joints]
    return replace(result, joints=tuple(joints))


def test_curves_are_the_samples_with_units(result):
    samples = result.comparison.plot_samples
    panels = effort_figure(result).axes
    assert len(panels) == 14
    for column, (efforts, residual) in enumerate(zip(panels[::2], panels[1::2], strict=True)):
        for line, values in zip(efforts.lines, (samples.measured, samples.predicted), strict=False):
            np.testing.assert_array_equal(line.get_ydata(), values[:, column])
        assert efforts.get_ylabel() == "effort [N m]" and residual.get_ylabel() == "[N m]"
        assert efforts.get_title() == f"panda_joint{column + 1}: passed"


def test_limits_far_away_are_written_and_near_ones_are_lines(result):
    notes = [text.get_text() for panel in effort_figure(result).axes for text in panel.texts]
    assert notes == ["limit ±87 N m"] * 4 + ["limit ±12 N m"] * 3
    largest = float(np.nanmax(np.abs(result.comparison.plot_samples.measured[:, 1])))
    panel = effort_figure(with_effort_limit(result, 1.1 * largest)).axes[2]
    assert -1.1 * largest in [line.get_ydata()[0] for line in panel.lines if line.get_label() == LABEL]
    assert not [text for panel in effort_figure(with_effort_limit(result, np.inf)).axes for text in panel.texts]


def test_report_has_units_and_limits(result):
    pytest.importorskip("plotly")
    from robot_dynamics.checking.report import html_report

    page = html_report(result)
    assert [page.count(f'limit \\u00b1{limit}"') for limit in (87, 12)] == [4, 3] and "effort [N m]" in page


def test_names_that_are_no_formulas_can_be_drawn(result, tmp_path):
    verdicts = tuple(
        replace(verdict, joint=replace(verdict.joint, joint="$\\bad{" + "x" * 99)) for verdict in result.verdicts
    )
    paths = write_figures(replace(result, verdicts=verdicts, joints=()), tmp_path)
    assert [path.name for path in paths] == ["efforts.png", "histograms.png", "friction.png"]
    assert all(path.stat().st_size > 1000 for path in paths)


def test_notebook_shows_the_verdicts_and_the_efforts(result):
    content = html.fromstring(result._repr_html_())
    header, *rows = [[cell.text_content() for cell in row] for row in content.iter("tr")]
    assert header[:3] == ["joint", "verdict", "RMS"] and [row[1] for row in rows] == ["passed"] * 7
    assert [float(row[2]) for row in rows] == pytest.approx([v.joint.rms for v in result.verdicts], rel=1e-5)
    assert len(list(content.iter("img"))) == 1 and "panda_mcap against panda: passed" in content.text_content()
