"""YAML files that accompany recordings: read, and validated with the JSON schema of their kind."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from robot_dynamics.model.formats.decoding import read_file_bytes
from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument, make_validator

if TYPE_CHECKING:
    from jsonschema.protocols import Validator

MAX_FILE_SIZE = 1024 * 1024


def read_document(path: Path, schema: Path, expected: str) -> YamlDocument:
    """Read a YAML file and validate it with a JSON schema.

    expected: noun phrase for error messages, such as "a YAML file of drives". Raises DescriptionError.
    """
    document = YamlDocument(read_file_bytes(path, MAX_FILE_SIZE), path, expected)
    if not isinstance(document.data, dict):
        document.fail((), f"{expected} is needed: a mapping that begins with `format: 1`")
    document.validate(_validator(schema))
    return document


@cache
def _validator(schema: Path) -> Validator:
    return make_validator(json.loads(schema.read_text(encoding="utf-8")))
