"""Parameters that are adapted along the natural gradient: bodies that can exist, whatever the errors are."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from robot_dynamics import load_robot
from robot_dynamics.control.natural_adaptation import AdaptationLimits, NaturalAdaptation
from robot_dynamics.newton_euler.pseudo_inertia import dual_matrices, link_parameters, pseudo_inertias
from robot_dynamics.newton_euler.regressor import parameters


def panda_links():
    return parameters(load_robot("panda")).reshape(7, 13)[:, :10]


def physical(links):
    """Whether bodies (L, 10) have a mass, and principal moments about their centres that obey the triangle inequality.

    From the definition of the parameters, not from pseudo-inertias."""
    for xx, xy, xz, yy, yz, zz, *first, mass in links:
        c = np.array(first) / mass
        J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - mass * (c @ c * np.eye(3) - np.outer(c, c))
        moments = np.linalg.eigvalsh(J)
        if mass <= 0 or moments[0] <= 0 or moments[0] + moments[1] <= moments[2]:
            return False
    return True


def test_pseudo_inertia_of_points_is_their_sum():
    """∫ [r; 1] [r; 1]ᵀ dm of point masses, whose parameters are sums too."""
    rng = np.random.default_rng(0)
    masses, points = rng.uniform(0.1, 2, 8), rng.uniform(-1, 1, (8, 3))
    J = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, points, strict=True))
    entries = [J[0, 0], J[0, 1], J[0, 2], J[1, 1], J[1, 2], J[2, 2]]
    theta = np.array([*entries, *(masses @ points), masses.sum()])
    extended = np.column_stack([points, np.ones(8)])
    P = np.einsum("k,ki,kj->ij", masses, extended, extended)
    np.testing.assert_allclose(pseudo_inertias(theta), P, rtol=1e-13)
    np.testing.assert_allclose(link_parameters(P), theta, rtol=1e-13)
    g = rng.uniform(-1, 1, 10)
    assert np.trace(dual_matrices(g) @ P) == pytest.approx(g @ theta, rel=1e-12)


def test_estimates_follow_the_differential_equation():
    """dP/dt = γ P B P and dx/dt = γ x² g, integrated by SciPy."""
    links, gain, duration = panda_links()[:1], 0.7, 0.5
    rng = np.random.default_rng(1)
    scales = np.abs(links) + 1e-3
    g, number_gradient = rng.uniform(-1, 1, (1, 10)) / scales / 10, np.array([0.8])
    B = dual_matrices(g[0])

    def rates(_, y):
        P = y[:16].reshape(4, 4)
        return np.append(gain * (P @ B @ P).ravel(), gain * y[16] ** 2 * number_gradient[0])

    start = np.append(pseudo_inertias(links[0]).ravel(), 0.4)
    expected = solve_ivp(rates, (0, duration), start, rtol=1e-10, atol=1e-14).y[:, -1]
    adaptation = NaturalAdaptation(links, np.array([0.4]), AdaptationLimits(max_ratio=1e3, max_rate=1e6))
    steps = 2000
    for _ in range(steps):
        adaptation.update(duration / steps, gain, g, number_gradient)
    P = pseudo_inertias(adaptation.links[0])
    np.testing.assert_allclose(P.ravel(), expected[:16], rtol=2e-3, atol=1e-6)
    assert np.abs(expected[:16] / start[:16] - 1).max() > 0.5
    assert adaptation.numbers[0] == pytest.approx(expected[16], rel=1e-3)


@pytest.mark.parametrize("gain", [1.0, 1e3, 1e9])
def test_parameters_stay_physical_under_noise(gain):
    """Hours of noise of 1 rad/s and 100 N m at steps of a second, at any gain."""
    links = panda_links()
    limits = AdaptationLimits(max_ratio=5.0, max_rate=1e3)
    adaptation = NaturalAdaptation(links, np.array([0.1, 0.0]), limits)
    rng = np.random.default_rng(2)
    for _ in range(3000):
        gradients = 100 * rng.standard_normal(links.shape)
        adaptation.update(1.0, gain, gradients, rng.standard_normal(2))
        assert np.isfinite(adaptation.links).all()
    assert physical(adaptation.links)
    assert adaptation.largest_ratio <= 5.0 * (1 + 1e-9)
    assert 0.02 * (1 - 1e-12) <= adaptation.numbers[0] <= 0.5 * (1 + 1e-12) and adaptation.numbers[1] == 0
    mass_ratios = adaptation.links[:, 9] / links[:, 9]
    assert mass_ratios.max() <= 5.0 * (1 + 1e-9) and mass_ratios.min() >= 0.2 * (1 - 1e-9)


def test_rate_is_limited():
    links = panda_links()
    adaptation = NaturalAdaptation(links, np.zeros(0), AdaptationLimits(max_ratio=100.0, max_rate=2.0))
    adaptation.update(0.1, 1e6, np.ones_like(links), np.zeros(0))
    assert adaptation.largest_ratio == pytest.approx(np.exp(0.2), rel=1e-9)


def test_reset_returns_to_the_initial_parameters():
    links = panda_links()
    adaptation = NaturalAdaptation(links, np.array([0.5]), AdaptationLimits())
    adaptation.update(0.1, 1.0, np.ones_like(links), np.ones(1))
    assert not np.array_equal(adaptation.links, links)
    adaptation.reset()
    np.testing.assert_array_equal(adaptation.links, links)
    np.testing.assert_array_equal(adaptation.numbers, [0.5])


def test_bodies_without_mass_and_gradients_that_are_not_finite_change_nothing():
    links = np.vstack([panda_links()[0], np.zeros(10)])
    adaptation = NaturalAdaptation(links, np.zeros(0), AdaptationLimits())
    adaptation.update(0.1, 1.0, np.full_like(links, np.nan), np.zeros(0))
    np.testing.assert_array_equal(adaptation.links, links)
    adaptation.update(0.1, 1.0, np.ones_like(links), np.zeros(0))
    np.testing.assert_array_equal(adaptation.is_adapted, [True, False])
    assert not np.array_equal(adaptation.links[0], links[0]) and not adaptation.links[1].any()
