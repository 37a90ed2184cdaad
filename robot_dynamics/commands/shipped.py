"""List the robots that ship."""

from robot_dynamics.commands.text_table import print_table
from robot_dynamics.model.library import load_robot, shipped_robots

NAME = "robots"


def add_arguments(parser):
    pass


def run(told):
    robots = {name: load_robot(name) for name in shipped_robots()}
    rows = [
        [name, len(robot.joints), "moving" if robot.moving_base else "fixed", path.name]
        for (name, path), robot in zip(shipped_robots().items(), robots.values(), strict=True)
    ]
    print_table(["name", "joints", "base", "file"], rows)
