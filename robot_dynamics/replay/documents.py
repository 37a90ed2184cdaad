"""The YAML files that go with recordings: read, and held against the schema of their kind."""

import json
from functools import cache
from pathlib import Path

from robot_dynamics.model.formats.text import read_path
from robot_dynamics.model.formats.yaml_document import YamlDocument, validator_of

LARGEST = 1024 * 1024


def read_document(path, kind, need):
    """The YamlDocument of a file of a kind: tolerances or drives; need: what it should be. Raises DescriptionError."""
    document = YamlDocument(read_path(path, LARGEST), path, need)
    if not isinstance(document.data, dict):
        document.fail((), f"{need} is needed: `format: 1`, and what it tells")
    document.validate(_validator(kind))
    return document


@cache
def _validator(kind):
    schema = Path(__file__).with_name(f"{kind}.schema.json")
    return validator_of(json.loads(schema.read_text(encoding="utf-8")))
