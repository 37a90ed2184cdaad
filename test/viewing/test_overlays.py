"""What is drawn over a robot, against closed forms and against the description."""

import numpy as np
import pytest

from robot_dynamics import Inertia, load_robot

pytest.importorskip("viser")
from robot_dynamics.viewing.mass_overlays import inertia_ellipsoid
from robot_dynamics.viewing.overlays import FULL_ARC, effort_line, mdh_corners, mdh_text


def test_ellipsoid_has_the_inertia_of_a_solid_ellipsoid():
    """I_x = m (b² + c²) / 5 about the centre, turned and displaced."""
    mass, axes, centre = 3.0, np.array([0.3, 0.2, 0.1]), np.array([0.5, -0.2, 0.1])
    angle = 0.7
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    a, b, c = axes**2
    central = R @ np.diag(mass / 5 * np.array([b + c, a + c, a + b])) @ R.T
    about_origin = central + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    found, pose = inertia_ellipsoid(Inertia(mass, mass * centre, about_origin))
    assert np.sort(found) == pytest.approx(np.sort(axes), rel=1e-12)
    assert pose[:3, 3] == pytest.approx(centre, abs=1e-12)
    shape = pose[:3, :3] @ np.diag(found**2) @ pose[:3, :3].T
    assert shape == pytest.approx(R @ np.diag(axes**2) @ R.T, abs=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)


def test_impossible_inertias_and_point_masses_have_no_ellipsoid():
    assert inertia_ellipsoid(Inertia(1.0, [0, 0, 0], np.diag([1.0, 1.0, 3.0]))) is None
    assert inertia_ellipsoid(Inertia(1.0, [0, 0, 0], np.zeros((3, 3)))) is None
    assert inertia_ellipsoid(Inertia()) is None


@pytest.mark.parametrize("name", ["puma560", "rx90", "panda", "navaro", "irb460"])
def test_mdh_line_leads_to_the_axis_of_the_joint(name):
    """Its pieces are along z_i, x, and z_j in turn; from its last corner the origin of frame j is along z_j."""
    for joint in load_robot(name).joints:
        corners = mdh_corners(joint.placement)
        rest = joint.placement[:3, 3] - corners[-1]
        assert np.abs(np.cross(rest, joint.placement[:3, 2])).max() < 1e-9
        assert np.abs((corners[1] - corners[0])[:2]).max() < 1e-12
        if len(corners) == 3:
            normal = corners[2] - corners[1]
            assert abs(normal @ joint.placement[:3, 2]) < 1e-9 and abs(normal[2]) < 1e-9


def test_mdh_text_has_the_published_parameters():
    """Armstrong, Khatib and Burdick 1986: joint 3 of the PUMA 560 has d3 = 0.4318 m and r3 = -0.0934 m."""
    assert mdh_text(load_robot("puma560"), 2) == "joint_3: d 0.4318, r -0.0934; θ moves"


@pytest.mark.parametrize("share", [-1.0, -0.3, 0.2, 1.0])
def test_arc_of_an_effort_is_as_long_as_the_effort(share):
    arc = effort_line(False, share)[:-3]
    angles = np.unwrap(np.arctan2(arc[:, 1], arc[:, 0]))
    assert angles[-1] - angles[0] == pytest.approx(share * FULL_ARC)
    assert np.linalg.norm(arc[:, :2], axis=1) == pytest.approx(1) and not arc[:, 2].any()
    line = effort_line(True, share)[:-3]
    assert np.abs(line[-1, 2]) == pytest.approx(1.5 * abs(share)) and np.sign(line[-1, 2]) == np.sign(share)
