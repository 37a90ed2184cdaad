"""Beams in MDH tables: reading, writing and errors."""

import re

import numpy as np
import pytest

from robot_dynamics import DescriptionError, Dynamics, Inertia, load_robot
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.formats.urdf.writer import write_urdf
from robot_dynamics.model.minimal_frames import minimal_frames

ARM = """
robot: arm
materials:
  alloy: {youngs_modulus: 70e9, poissons_ratio: 0.3, density: 2700}
  steel: {youngs_modulus: 210e9, shear_modulus: 80e9, density: 7850}
sections:
  bar: {rectangle: {y: 0.01, z: 0.02}}
  pipe: {tube: {diameter: 0.03, wall: 0.002}}
joints:
  - joint: shoulder
    link: upper
    mdh: {r: 0.2, alpha: 0.3}
    mass: 0.5
    centre_of_mass: [0.01, 0, 0]
    beams:
      - {to: [0.3, 0, 0.1], section: bar, material: alloy, elements: 2, y: [0, 1, 0.2]}
      - {from: [0.15, 0, 0.05], to: [0.15, 0.2, 0.05], section: pipe, material: steel}
  - {type: fixed, link: weight, antecedent: upper, mdh: {d: 0.3, r: 0.1}, mass: 0.7}
  - joint: elbow
    link: fore
    antecedent: upper
    mdh: {d: 0.3, alpha: pi/2, theta: 0.4, r: 0}
    role: passive
    brake: true
    beams: [{from: [0.02, 0, 0], to: [0.4, 0, 0], section: pipe, material: alloy, rotary_inertia: false}]
"""


def test_beams_are_unchanged_by_write_and_read():
    robot = load_robot(ARM)
    expected = Dynamics(robot).elastodynamics.frequencies([0.3, 0.2])
    for copy in (
        load_robot(write_mdh_yaml(robot)),
        minimal_frames(robot),
        load_robot(write_mdh_yaml(minimal_frames(robot))),
    ):
        actual = Dynamics(copy).elastodynamics.frequencies([0.3, 0.2])
        assert np.abs(actual / expected - 1).max() < 1e-9
        assert [joint.brake for joint in copy.joints] == [False, True]
        for link, same in zip(robot.links, copy.links, strict=True):
            assert link.inertia.mass == pytest.approx(same.inertia.mass, rel=1e-12)


def test_mass_of_a_flexible_link_is_that_of_its_beams_and_bodies():
    robot = load_robot(ARM)
    bar, pipe = 0.01 * 0.02, np.pi / 4 * (0.03**2 - 0.026**2)
    upper = bar * np.hypot(0.3, 0.1) * 2700 + pipe * 0.2 * 7850 + 0.5 + 0.7
    assert robot.links[1].inertia.mass == pytest.approx(upper)
    assert robot.links[2].inertia.mass == pytest.approx(pipe * 0.38 * 2700)
    moment = bar * np.hypot(0.3, 0.1) * 2700 * 0.15 + pipe * 0.2 * 7850 * 0.15 + 0.5 * 0.01 + 0.7 * 0.3
    assert robot.links[1].inertia.first_moments[0] == pytest.approx(moment)
    assert not robot.warnings


def test_payload_on_a_flexible_link_is_at_its_frame():
    robot = load_robot(ARM)
    plain = Dynamics(robot).elastodynamics.frequencies([0.3, 0.2], count=1)
    at_weight = Dynamics(robot.with_payload("weight", Inertia(mass=1.0))).elastodynamics.frequencies(
        [0.3, 0.2], count=1
    )
    heavier = load_robot(ARM.replace("mass: 0.7", "mass: 1.7"))
    assert at_weight == pytest.approx(Dynamics(heavier).elastodynamics.frequencies([0.3, 0.2], count=1), rel=1e-9)
    assert at_weight < plain


def test_flexible_links_are_refused_by_urdf():
    with pytest.raises(DescriptionError, match="link 'upper' is flexible"):
        write_urdf(load_robot(ARM))
    assert "is flexible" in write_urdf(load_robot(ARM), lossy=True)


@pytest.mark.parametrize(
    "change, message",
    [
        (
            ("material: alloy, elements", "material: aloy, elements"),
            r"line 16.*unknown material of a beam 'aloy': did you mean 'alloy'",
        ),
        (("section: bar,", "section: plank,"), "unknown section of a beam 'plank': known are bar, pipe"),
        (
            (
                "{rectangle: {y: 0.01, z: 0.02}}",
                "{area: -1e-4, second_moment_y: 1, second_moment_z: 1, torsion_constant: 1}",
            ),
            r"line 7.*area of a section is -0.0001: it must be positive",
        ),
        (("{rectangle: {y: 0.01, z: 0.02}}", "{area: 1e-4}"), "second_moment_y missing"),
        (
            ("{rectangle: {y: 0.01, z: 0.02}}", "{area: 1, circle: {diameter: 1}}"),
            "circle defines the section completely",
        ),
        (
            ("{rectangle: {y: 0.01, z: 0.02}}", "{rectangle: {y: 0.01, z: 0}}"),
            "z of a rectangle is 0 m: it must be positive",
        ),
        (("wall: 0.002", "wall: 0.02"), "the maximum is half"),
        (("poissons_ratio: 0.3", "poissons_ratio: 0.7"), "between -1 and 0.5"),
        (("poissons_ratio: 0.3, ", ""), "shear_modulus or poissons_ratio is needed"),
        (("density: 2700", "density: -1"), "density of a material is -1: it must be zero or more"),
        (("to: [0.3, 0, 0.1]", "to: [0, 0, 0]"), "0 m long"),
        (("elements: 2", "elements: 0"), "1 or more"),
        (("y: [0, 1, 0.2]", "y: [3, 0, 1]"), "must lie across"),
        (("from: [0.15, 0, 0.05]", "from: [0.1, 0, 0.05]"), "which is on no beam"),
        (("    role: passive\n    brake: true", "    brake: 3"), "true or false"),
        (("beams: [{from: [0.02", "type: fixed\n    beams: [{from: [0.02"), "which is on no beam"),
    ],
)
def test_invalid_beams_are_refused_with_a_reason(change, message):
    assert change[0] in ARM
    with pytest.raises(DescriptionError, match=re.compile(message, re.DOTALL)):
        load_robot(ARM.replace(*change, 1))


def test_flexible_base_is_refused():
    text = "robot: a\nmaterials: {m: {youngs_modulus: 1, poissons_ratio: 0, density: 1}}\n"
    text += "sections: {s: {circle: {diameter: 1}}}\n"
    text += "joints:\n  - {type: fixed, link: post, beams: [{to: [1, 0, 0], section: s, material: m}]}\n"
    with pytest.raises(DescriptionError, match="the base cannot be flexible"):
        load_robot(text)
