"""Functions that procedures use: in machine code they compute what NumPy computes."""

import numpy as np
import pytest

pytest.importorskip("llvmlite")
from robot_dynamics.codegen.jit.procedure_code import compile_procedure
from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface
from robot_dynamics.procedures import arctangent, procedure


@procedure
def angle(point):
    return np.array([arctangent(point[1], point[0])])


@pytest.fixture(scope="module")
def compiled_angle():
    return compile_procedure("angle", angle, ProcedureInterface({"point": 2}, {"angle": (1,)}))


def test_angles_of_points_in_all_directions(compiled_angle):
    angles = np.concatenate([np.linspace(-np.pi, np.pi, 20_001), np.logspace(-300, -1, 1000)])
    points = 3.7 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    expected = np.arctan2(points[:, 1], points[:, 0])
    errors = np.abs(compiled_angle.batch(points)[:, 0] - expected)
    assert (errors <= 4 * np.spacing(np.abs(expected))).all()


@pytest.mark.parametrize(
    "point", [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1e300, 1), (-1, 1e-320)]
)
def test_angles_on_axes_and_of_extreme_points(compiled_angle, point):
    expected = np.arctan2(float(point[1]), float(point[0]))
    assert compiled_angle.evaluate(np.array(point, dtype=float))[0] == pytest.approx(expected, rel=1e-15, abs=0)
    assert angle(np.array(point, dtype=float))[0] == expected


def test_points_that_are_not_finite(compiled_angle):
    for point in ((np.nan, 1), (1, np.nan)):
        assert np.isnan(compiled_angle.evaluate(np.array(point)))
