"""Inertias from values about the centre of mass, against the parallel axis theorem."""

import numpy as np
import pytest

from robot_dynamics import Inertia, InvalidInputError


def test_centre_of_mass_may_stand_in_the_place_of_a_frame():
    mass, centre, central = 2.0, np.array([0.1, -0.2, 0.3]), np.diag([0.01, 0.02, 0.025])
    inertia = Inertia.about_centre_of_mass(mass, central, centre)
    steiner = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    assert inertia.first_moments == pytest.approx(mass * centre)
    assert inertia.second_moments == pytest.approx(central + steiner, abs=1e-15)
    frame = np.eye(4)
    frame[:3, 3] = centre
    assert (inertia.second_moments == Inertia.about_centre_of_mass(mass, central, frame).second_moments).all()


@pytest.mark.parametrize("frame", [0.1, [0.1, 0.2], np.eye(3)])
def test_frame_of_another_shape_is_refused(frame):
    with pytest.raises(InvalidInputError, match=r"a placement \(4, 4\) or a centre \(3,\) is needed"):
        Inertia.about_centre_of_mass(1.0, np.eye(3), frame)
