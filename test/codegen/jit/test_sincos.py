"""Sine and cosine of compiled programs agree with the C library in extended precision."""

import numpy as np
import pytest

from robot_dynamics.codegen.jit import compiled_program
from robot_dynamics.codegen.jit.compiled_program import compile_program
from robot_dynamics.codegen.jit.sincos import MAX_ANGLE
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace

llvm_engine = pytest.importorskip("robot_dynamics.codegen.jit.engine", reason="llvmlite is not installed")
EXTENDED = np.finfo(np.longdouble).nmant >= 63
PIECES = 3  # angles that the function of one sample computes in one wider vector


def sines_and_cosines():
    trace = Trace()
    angles = trace.input("angles", PIECES)
    return build_program(trace, "angles", {"angles": PIECES}, {"sines": np.sin(angles), "cosines": np.cos(angles)})


@pytest.fixture(scope="module")
def functions():
    return compile_program(sines_and_cosines())


def both(functions, angles):
    """(sines, cosines) by `batch` and by `evaluate`; the number of angles is a multiple of PIECES."""
    rows = angles.reshape(-1, PIECES)
    single = [functions.evaluate(row) for row in rows]
    return [
        [array.ravel() for array in functions.batch(rows)],
        [np.concatenate(arrays) for arrays in zip(*single, strict=True)],
    ]


def ulps(actual, exact):
    """Distance in units of the last place of the exact value's double."""
    return np.abs((actual - exact) / np.spacing(np.abs(exact.astype(float)))).astype(float)


def angles_in_range():
    rng = np.random.default_rng(1)
    kinds = [rng.uniform(-limit, limit, 6000) for limit in (1e-8, 1.0, 10.0, 1e3, 1e5, MAX_ANGLE)]
    quarter_turns = np.concatenate([np.arange(1, 4001), rng.integers(1, int(MAX_ANGLE / 1.6), 8000)])
    nearest = (quarter_turns * np.longdouble("1.5707963267948966192313216916397514")).astype(float)
    kinds += [nearest, np.nextafter(nearest, 0), np.nextafter(nearest, np.inf)]  # all leading digits cancel there
    return np.concatenate([*kinds, [MAX_ANGLE, -MAX_ANGLE, 5e-324]])


@pytest.mark.skipif(not EXTENDED, reason="no extended precision on this machine")
def test_sincos_is_within_two_units_of_the_last_place(functions):
    angles = angles_in_range()
    for sines, cosines in both(functions, angles):
        assert ulps(sines, np.sin(angles.astype(np.longdouble))).max() <= 2
        assert ulps(cosines, np.cos(angles.astype(np.longdouble))).max() <= 2


@pytest.mark.skipif(not EXTENDED, reason="no extended precision on this machine")
def test_sincos_of_angles_out_of_range_is_as_exact(functions):
    rng = np.random.default_rng(2)
    angles = MAX_ANGLE * 2.0 ** rng.uniform(0, 990, 3000) * rng.choice([-1, 1], 3000)
    angles[::5] = rng.uniform(-4, 4, 600)  # beside angles out of range in the same vector
    for sines, cosines in both(functions, angles):
        assert ulps(sines, np.sin(angles.astype(np.longdouble))).max() <= 2
        assert ulps(cosines, np.cos(angles.astype(np.longdouble))).max() <= 2


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("lane", range(11))
def test_sincos_of_non_finite_angles_affects_one_lane(functions, value, lane):
    angles = np.linspace(-3, 3, 11 * PIECES)
    angles[lane * PIECES + 1] = value
    for sines, cosines in both(functions, angles):
        bad = np.arange(len(angles)) == lane * PIECES + 1
        assert np.array_equal(np.isnan(sines), bad)
        assert np.array_equal(np.isnan(cosines), bad)
        np.testing.assert_allclose(sines[~bad], np.sin(angles[~bad]), rtol=1e-15)
        np.testing.assert_allclose(cosines[~bad], np.cos(angles[~bad]), rtol=1e-15)


@pytest.mark.parametrize("vector_lanes", [4, 8])
@pytest.mark.parametrize("fused", [False, True])
def test_sincos_on_processors_without_fused_multiply_add(vector_lanes, fused, monkeypatch):
    monkeypatch.setenv("ROBOT_DYNAMICS_CACHE", "")
    monkeypatch.setattr(llvm_engine, "vector_lanes", lambda: vector_lanes)
    if not fused:
        triple, _, features = llvm_engine.host_target()
        if not triple.startswith("x86_64"):
            pytest.skip("has always a fused multiply-add")
        lacking = ",".join(f"-{feature[1:]}" for feature in features.split(",") if feature[1:4] in ("fma", "avx"))
        monkeypatch.setattr(llvm_engine, "host_target", lambda: (triple, "x86-64", lacking))
        assert not llvm_engine.has_fused_multiply_add()
    functions = compiled_program.compile_program(sines_and_cosines())
    angles = np.concatenate([np.linspace(-50, 50, 90), [1e300, -1e20, 0.0]])
    for sines, cosines in both(functions, angles):
        np.testing.assert_allclose(sines, np.sin(angles), rtol=1e-13, atol=1e-15)
        np.testing.assert_allclose(cosines, np.cos(angles), rtol=1e-13, atol=1e-15)
