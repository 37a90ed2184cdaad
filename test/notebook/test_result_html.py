"""The HTML of results: their numbers for one sample, plots for batches; each class that has HTML is listed once."""

from importlib import import_module

import numpy as np
import pytest
from lxml import html

from robot_dynamics import Dynamics, FrequencyMap, compute_base_parameters, load_robot, pose_map, simulate
from robot_dynamics.notebook.formatters import FORMATTERS, format_html

pytest.importorskip("matplotlib")


def content(value):
    return html.fromstring(value._repr_html_())


def rows(value):
    """Return the cells of the first table of the HTML of a value, without its header."""
    table = next(content(value).iter("table"))
    return [[cell.text_content() for cell in row] for row in table.iter("tr")][1:]


@pytest.fixture(scope="module")
def arm():
    return Dynamics(load_robot("rx90"), compiled=False)


@pytest.mark.parametrize("name", FORMATTERS)
def test_listed_classes_exist_and_have_html(name):
    module, _, class_name = name.rpartition(".")
    cls = getattr(import_module(f"robot_dynamics.{module}"), class_name)
    assert cls.__qualname__ == class_name and callable(cls._repr_html_)


def test_other_objects_have_no_html():
    assert format_html(3) is None


def test_one_sample_is_a_table(arm):
    q = np.linspace(-0.3, 0.4, 6)
    result = arm.solve(q, np.zeros(6), qdd=np.ones(6))
    table = rows(result)
    np.testing.assert_allclose([float(row[1]) for row in table], result.efforts, rtol=1e-5)
    assert [row[0] for row in table] == [str(number) for number in range(1, 7)]
    assert not list(content(result).iter("img"))


def test_batch_is_a_plot_and_a_table_of_ranges(arm):
    q = np.random.default_rng(0).uniform(-1, 1, (50, 6))
    result = arm.solve(q, np.zeros_like(q), qdd=np.ones_like(q))
    table = np.array([[float(cell) for cell in row[1:3]] for row in rows(result)])
    np.testing.assert_allclose(table.T, [result.efforts.min(axis=0), result.efforts.max(axis=0)], rtol=1e-5)
    for value in (result, result.motion):
        assert len(list(content(value).iter("img"))) == 1
        assert "50 samples" in content(value).text_content()


def test_equilibrium_says_whether_it_is_stable():
    equilibrium = Dynamics(load_robot("four_bar"), compiled=False).equilibrium([0.3])
    text = content(equilibrium).text_content()
    assert ("stable" in text) and f"{equilibrium.efforts[0]:.6g}" in text


def test_simulations_are_plotted(arm):
    rollouts = simulate(arm.robot, np.zeros(6), np.zeros(6), np.zeros((20, 6)))
    assert "1 simulations of 20 steps" in content(rollouts).text_content()
    assert len(list(content(rollouts).iter("img"))) == 1


def test_base_parameters_are_sums(arm):
    parameters = compute_base_parameters(arm)
    assert [row[1] for row in rows(parameters)] == list(parameters.expressions)


def test_frequencies_and_maps():
    elastic = Dynamics(load_robot("manutec_r3"), compiled=False).elastodynamics
    natural = elastic.natural_frequencies(np.zeros(len(elastic.robot.joints)), count=3)
    np.testing.assert_allclose([float(row[1]) for row in rows(natural)], natural.frequencies, rtol=1e-5)
    grid = {"x": np.linspace(-3, 1, 4), "z": np.linspace(1.9, 2.1, 3)}
    shape = (4, 3, 2)
    frequencies = FrequencyMap(grid, np.ones(shape[:2], dtype=bool), 40 + np.arange(24.0).reshape(shape))
    frequencies.frequencies[0, 0] = np.nan
    hexapod = Dynamics(load_robot("gough_stewart"), compiled=False)
    for result, values in (
        (frequencies, frequencies.frequencies[..., 0]),
        (poses := pose_map(hexapod, grid), np.where(poses.is_nonsingular, poses.condition_number, np.nan)),
    ):
        least, greatest = map(float, rows(result)[0][1:3])
        np.testing.assert_allclose([least, greatest], [np.nanmin(values), np.nanmax(values)], rtol=1e-5)
        assert len(list(content(result).iter("img"))) == 1
