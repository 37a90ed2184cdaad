"""The HTML of a robot: its numbers are those of the robot, and names of any text are text."""

import logging
import math

import numpy as np
import pytest
from lxml import html

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.model.loading import read_robot
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.notebook.markup import printable

pytest.importorskip("trimesh")
pytest.importorskip("PIL")

HOSTILE = '"></p><script>document.title="taken"</script><img src=x onerror=alert(1)>'
HOSTILE_TABLE = f"""
format: 1
robot: {HOSTILE!r}
base: {{link: base}}
joints:
  - joint: {HOSTILE!r}
    link: {"link" + HOSTILE!r}
    mdh: {{alpha: 0, d: 0.3, theta: 0, r: 0}}
    mass: 1
"""


def tables(robot):
    """Return the tables of the HTML of a robot, as lists of {title: text}."""
    content = html.fromstring(robot._repr_html_())
    result = []
    for table in content.iter("table"):
        header, *rows = [[cell.text_content() for cell in row] for row in table.iter("tr")]
        result.append([dict(zip(header, row, strict=True)) for row in rows])
    return result


def number(text):
    """Return the number of a cell, such as `-0.35` or `-3π/4`."""
    if "π" not in text:
        return float(text)
    factor, _, divisor = text.partition("/")
    factor = factor.replace("π", "")
    return (-1 if factor == "-" else float(factor or 1)) * math.pi / float(divisor or 1)


@pytest.mark.parametrize("name", ["panda", "delta", "gough_stewart", "ur5e"])
def test_table_has_masses_limits_and_placements(name):
    robot = load_robot(name)
    base, *rows = tables(robot)[0]
    assert base["moves link"] == robot.base_link and base["type"] == "base"
    placement = np.eye(4)
    joints = iter(zip(robot.joints, robot.links[1:], strict=True))
    for row in rows:
        numbers = [number(row.get(key, "0")) for key in "γbαdθr"]
        placement = placement @ placement_from_mdh(MDHParameters(*numbers))
        if row["type"] == "fixed":
            continue
        joint, link = next(joints)
        np.testing.assert_allclose(placement, joint.placement, atol=3e-5)
        placement = np.eye(4)
        assert (row["joint"], row["moves link"]) == (joint.name, link.name)
        assert row["type"].startswith("prismatic" if joint.prismatic else "revolute")
        np.testing.assert_allclose(float(row["mass [kg]"] or 0), link.inertia.mass, rtol=1e-5)
        for key in ("lower", "upper"):
            limit = getattr(joint.limits, key)
            assert (key in row and row[key] != "") == np.isfinite(limit)
            np.testing.assert_allclose(float(row.get(key) or limit), limit, rtol=1e-5)
    assert next(joints, None) is None
    assert len(tables(robot)) == 1 + bool(robot.loops)


def test_html_has_a_picture_and_is_small():
    text = load_robot("gough_stewart")._repr_html_()
    (image,) = html.fromstring(text).iter("img")
    assert image.get("src").startswith("data:image/png;base64,") and len(text) < 40_000
    assert "6 loops" in text and "platform 'platform', free in x, y, z, yaw, pitch, roll" in text


def test_html_of_dynamics_names_the_joints_of_the_models():
    text = html.fromstring(Dynamics(load_robot("four_bar"))._repr_html_()).text_content()
    assert "(Dynamics.joint_names): crank" in text and "Loops determine coupler, rocker, knee" in text


def test_hostile_names_are_text():
    robot = read_robot(HOSTILE_TABLE, source="a table")
    content = html.fromstring(robot._repr_html_())
    assert {element.tag for element in content.iter()} <= {
        *("div", "style", "p", "b", "img", "table", "thead", "tbody", "tr", "th", "td")
    }
    assert {key for element in content.iter() for key in element.attrib} <= {"class", "src", "alt"}
    (link,) = (row for row in tables(robot)[0] if row["joint"])
    assert link["joint"] == HOSTILE


def test_characters_that_xml_does_not_allow_become_spaces():
    assert printable("a\x00b\x1bc\ud800d") == "a b c d"


def test_what_cannot_be_formatted_is_shown_as_text(caplog):
    robot = load_robot("rx90")
    object.__setattr__(robot, "joints", None)
    with caplog.at_level(logging.WARNING):
        assert robot._repr_html_() is None
    assert "Robot has no HTML" in caplog.text


def test_tables_remain_where_a_robot_cannot_be_drawn():
    robot = load_robot("panda")
    object.__setattr__(robot, "visuals", None)
    text = robot._repr_html_()
    assert "There is no picture" in text and "panda_joint7" in text
