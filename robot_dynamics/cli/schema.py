"""Print the JSON schema of MDH tables, by which editors complete and check them.

robot-dynamics schema > mdh.schema.json, and in a table: # yaml-language-server: $schema=mdh.schema.json
"""

from robot_dynamics.model.formats.mdh_yaml.reader import SCHEMA

NAME = "schema"


def add_arguments(parser):
    pass


def run(arguments):
    print(SCHEMA.read_text(encoding="utf-8"), end="")
