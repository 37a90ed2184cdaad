"""Tables of the parameters of all nodes, in Markdown: `python -m robot_dynamics.nodes.parameter_tables [NODE ...]`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from robot_dynamics.nodes import robot_parameters
from robot_dynamics.nodes.computed_torque import parameters as computed_torque
from robot_dynamics.nodes.contact_monitor import parameters as contact_monitor
from robot_dynamics.nodes.dynamics_server import parameters as dynamics_server
from robot_dynamics.nodes.joint_state_completer import parameters as joint_state_completer
from robot_dynamics.nodes.mobile_base_simulator import parameters as mobile_base_simulator
from robot_dynamics.nodes.payload_identifier import parameters as payload_identifier
from robot_dynamics.nodes.replay_check import parameters as replay_check

if TYPE_CHECKING:
    from robot_dynamics.nodes.parameters import ParameterSpec, ParameterSpecs

NODES: dict[str, ParameterSpecs] = {
    "all": robot_parameters.PARAMETERS,
    "dynamics_server": dynamics_server.PARAMETERS,
    "computed_torque": computed_torque.PARAMETERS,
    "mobile_base_simulator": mobile_base_simulator.PARAMETERS,
    "replay_check": replay_check.PARAMETERS,
    "payload_identifier": payload_identifier.PARAMETERS,
    "contact_monitor": contact_monitor.PARAMETERS,
    "joint_state_completer": joint_state_completer.PARAMETERS,
}
"""Parameters by node; "all": of every node."""

HEADER = ("parameter", "default", "unit", "range", "read", "description")


def markdown_table(specs: ParameterSpecs) -> str:
    """Return the table of the parameters of a node, one row for each parameter."""
    rows = [HEADER, tuple("---" for _ in HEADER), *map(_row, specs.values())]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _row(spec: ParameterSpec) -> tuple[str, ...]:
    return (
        f"`{spec.name}`",
        _format_default(spec.default),
        spec.unit,
        _format_range(spec),
        spec.read_at,
        spec.description.replace("|", "\\|"),
    )


def _format_default(default: object) -> str:
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    return "" if default == "" else f"`{default}`"


def _format_range(spec: ParameterSpec) -> str:
    """Return the accepted values: choices, or bounds and special values."""
    if spec.choices:
        return ", ".join(f"`{choice}`" for choice in spec.choices)
    if spec.lower_bound is None:
        return ""
    bound = f"{'>' if spec.is_bound_excluded else '≥'} {spec.lower_bound:g}"
    return " or ".join([*(f"{value:g}" for value in spec.special_values), bound])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="parameter_tables", description=__doc__)
    parser.add_argument("nodes", nargs="*", metavar="NODE", help=f"{', '.join(NODES)} (default: each of them)")
    names = parser.parse_args(arguments).nodes or list(NODES)
    unknown = [name for name in names if name not in NODES]
    if unknown:
        parser.error(f"unknown node {unknown[0]!r}: known are {', '.join(NODES)}")
    for name in names:
        title = "every node" if name == "all" else name
        print(f"Parameters of {title}\n\n{markdown_table(NODES[name])}\n")


if __name__ == "__main__":
    main()
