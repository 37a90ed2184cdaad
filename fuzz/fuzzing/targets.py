"""The targets by their names; each module is imported when its target is made."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from fuzzing.campaign import Summary, Target, read_corpus, run_campaign

TARGETS = {
    "descriptions": "DescriptionTarget",
    "recordings": "RecordingTarget",
    "requests": "RequestTarget",
}


NODE_TARGETS = {
    "node_requests": ("run_node_requests", "requests"),
    "node_states": ("run_node_states", "states"),
}
"""Functions of `node_targets` and the names of their corpora."""
ALL_TARGETS = (*TARGETS, *NODE_TARGETS)
CORPUS = Path(__file__).parents[1] / "corpus"


def run_target(name: str, folder: Path, inputs: int | None, seconds: float | None, seed: int) -> Summary:
    """Run a campaign against a target; see `run_campaign`."""
    if name in TARGETS:
        seeds = read_corpus(CORPUS / name)
        return run_campaign(make_target(name), seeds, folder / name, inputs=inputs, seconds=seconds, seed=seed)
    function, corpus = NODE_TARGETS[name]
    run = getattr(import_module("fuzzing.node_targets"), function)
    summary: Summary = run(read_corpus(CORPUS / corpus), folder / name, inputs, seconds, seed)
    return summary


def make_target(name: str) -> Target:
    """Return the target of a name."""
    target: Target = getattr(import_module(f"fuzzing.{name}"), TARGETS[name])()
    return target
