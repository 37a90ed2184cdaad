"""The YAML files that go with recordings: read, and held against the schema of their kind."""

import json
from functools import cache

from robot_dynamics.model.formats.decoding import read_file_bytes
from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument, make_validator

MAX_FILE_SIZE = 1024 * 1024


def read_document(path, schema, expected):
    """The YamlDocument of a file that a JSON schema (its path) describes; need: what it should be. Raises DescriptionError."""
    document = YamlDocument(read_file_bytes(path, MAX_FILE_SIZE), path, expected)
    if not isinstance(document.data, dict):
        document.fail((), f"{expected} is needed: `format: 1`, and what it tells")
    document.validate(_validator(schema))
    return document


@cache
def _validator(schema):
    return make_validator(json.loads(schema.read_text(encoding="utf-8")))
