"""The tables of parameters that the documentation shows have every parameter, with values that its node accepts."""

from importlib.metadata import entry_points

import pytest

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.parameter_tables import HEADER, NODES, main, markdown_table


@pytest.mark.parametrize("node", NODES)
def test_table_has_a_row_for_each_parameter_with_as_many_cells_as_the_header(node):
    header, rule, *rows = markdown_table(NODES[node]).splitlines()
    cells = [row.replace("\\|", "").strip("|").split("|") for row in rows]
    assert [row[0].strip(" `") for row in cells] == list(NODES[node])
    assert {len(row) for row in cells} == {len(HEADER)} == {header.count("|") - 1} == {rule.count("---")}


def test_every_node_has_a_table():
    executables = {script.name for script in entry_points(group="console_scripts") if ".nodes." in script.value}
    assert set(NODES) - {"all"} == executables - {"demo"}


@pytest.mark.parametrize("node", NODES)
def test_defaults_are_accepted(node):
    for spec in NODES[node].values():
        assert spec.validate(spec.default) is not None


def test_refused_numbers_are_told_which_are_accepted():
    with pytest.raises(InvalidInputError, match=r"cutoff is -1: 0, or 0\.1 or more, and less than"):
        NODES["replay_check"]["cutoff"].validate(-1.0)


def test_command_prints_the_tables_of_the_named_nodes(capsys):
    main(["replay_check"])
    printed = capsys.readouterr().out
    assert "| `cutoff` | `0.0` | Hz | 0 or ≥ 0.1 | configuration |" in printed and "`kp`" not in printed
