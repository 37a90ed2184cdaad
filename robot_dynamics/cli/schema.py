"""Print the JSON schema of MDH tables, which editors use to complete and check them.

Run robot-dynamics schema > mdh.schema.json, and write at the top of a table:
# yaml-language-server: $schema=mdh.schema.json
"""

from argparse import ArgumentParser, Namespace

from robot_dynamics.model.formats.mdh_yaml.reader import SCHEMA

NAME = "schema"


def add_arguments(parser: ArgumentParser) -> None:
    """Add no arguments."""


def run(arguments: Namespace) -> None:
    """Print the schema."""
    print(SCHEMA.read_text(encoding="utf-8"), end="")
