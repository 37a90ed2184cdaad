"""Payloads in feedback: those with which the mass matrix of a robot can have a negative eigenvalue are objected to."""

import numpy as np
import pytest

from robot_dynamics import Inertia
from robot_dynamics.model.payload import find_control_objection, point_mass


def body_of_points(rng):
    """Return mass, first moments and second moments of some point masses, as sums over the points."""
    masses, points = rng.uniform(0.1, 1.0, 5), rng.uniform(-0.2, 0.2, (5, 3))
    second = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
    return masses.sum(), masses @ points, second


@pytest.mark.parametrize("seed", range(20))
def test_objection_is_there_where_a_motion_of_the_payload_has_negative_energy(seed):
    rng = np.random.default_rng(seed)
    mass, first, second = body_of_points(rng)
    objections = []
    for share in (1.0, 0.9, 0.5, 0.0):  # of the second moments; with none the body is a point mass without its moments
        inertia = Inertia(mass, first, share * second)
        smallest = np.linalg.eigvalsh(inertia.spatial)[0]  # twice the least kinetic energy of a unit twist
        objections.append(find_control_objection("tool", inertia))
        assert bool(objections[-1]) == bool(smallest < -1e-6)
        assert not objections[-1] or objections[-1].startswith(
            "payload on link 'tool': inertia is not positive definite"
        )
    assert not objections[0]
    assert objections[-1]


@pytest.mark.parametrize("seed", range(20))
def test_point_mass_has_no_objection_when_its_numbers_are_rounded(seed):
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-0.3, 0.3, 3)
    inertia = point_mass(2.0, 2.0 * centre)
    assert inertia.second_moments @ centre == pytest.approx(0.0, abs=1e-15)  # no moment about the line to the centre
    assert inertia.second_moments.trace() == pytest.approx(4.0 * centre @ centre)
    rounded = Inertia(2.0, inertia.first_moments, np.round(inertia.second_moments, 7))
    assert not find_control_objection("tool", rounded)


def test_moments_without_mass_are_objected_to():
    assert find_control_objection("tool", Inertia(0.0, [0.0, 0.0, 0.1])) == (
        "payload on link 'tool': mass is zero but moments are not"
    )
    assert not find_control_objection("tool", Inertia())
