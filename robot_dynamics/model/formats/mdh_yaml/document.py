"""The text of a YAML document as plain data, with the line and column of each part.

Stricter than YAML: a key occurs once in a mapping; anchors, aliases and tags are refused; plain scalars are only
numbers, true, false, null or text: `no` and `on` are names, 010 is ten. A document that begins with the directive
`%YAML` must end with the line `...`, so that a file that was cut is refused; `write_mdh_yaml` writes both.
"""

import re
from collections.abc import Iterable, Mapping
from itertools import islice
from typing import Any, NamedTuple, NoReturn, TypeAlias

import jsonschema
import yaml

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.decoding import decode_text

MAX_DOCUMENT_LENGTH = 1024 * 1024  # characters; a humanoid has fifty thousand
DIRECTIVE = "%YAML"
DOCUMENT_END = "..."
MAX_DEPTH = 40  # levels; a description has six
MAX_NODES = 200_000
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
SCALAR_KEYWORDS = {"true": True, "false": False, "null": None, "~": None, "": None}

YamlPath: TypeAlias = tuple[str | int, ...]
"""Keys and indices that lead from the root of a document to a part."""
YamlMapping: TypeAlias = dict[str, Any]
"""A mapping of a validated document: its schema defines the types of the values."""


class YamlPart(NamedTuple):
    """A mapping in a document, and its path."""

    mapping: YamlMapping
    path: YamlPath


class YamlDocument:
    """A YAML document as plain data: dicts, lists, numbers, texts, booleans and None.

    Parameters
    ----------
    text : str or bytes
        The document, or the bytes of its file.
    source : object
        Name of the document in error messages.
    need : str
        What the document should be, for error messages.

    Raises
    ------
    DescriptionError
        If the text is not YAML.
    """

    def __init__(self, text: str | bytes, source: object, need: str) -> None:
        self.source = source
        text = decode_text(text, source, need, MAX_DOCUMENT_LENGTH)
        self._refuse_cut_text(text)
        try:
            self._root = _Composer(text).get_single_node()
        except yaml.MarkedYAMLError as error:
            self._fail_at(error.problem_mark or error.context_mark, _describe_syntax_error(error))
        except (yaml.YAMLError, ValueError) as error:  # ValueError: an escape that is no character
            raise DescriptionError(f"{source} is no YAML: {' '.join(str(error).split())[:200]}") from None
        if self._root is None:
            raise DescriptionError(f"{source} is empty: {need} is needed")
        self.data: Any = self._to_plain_data(self._root)

    def _refuse_cut_text(self, text: str) -> None:
        """Raise DescriptionError where a text begins with the directive and has no end."""
        lines = text.rstrip().splitlines()
        if lines[0].startswith(DIRECTIVE) and lines[-1].rstrip() != DOCUMENT_END:
            raise DescriptionError(
                f"{self.source} breaks off at line {len(lines)}: a document that begins with {DIRECTIVE} ends with the "
                f"line {DOCUMENT_END}. Write the file again"
            )

    def fail(self, path: YamlPath, message: str) -> NoReturn:
        """Raise DescriptionError with the line and column of the part at a path."""
        self._fail_at(self._node(path).start_mark, message)

    def _fail_at(self, mark: yaml.Mark | None, message: str) -> NoReturn:
        """Raise DescriptionError with the line and column of a mark."""
        position = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise DescriptionError(f"{self.source}{position}: {message}") from None

    def _node(self, path: Iterable[str | int]) -> yaml.Node:
        """Return the node at a path, or the last node on the path that exists."""
        node = self._root
        for step in path:
            child = None
            if isinstance(node, yaml.MappingNode):
                child = next((value for key, value in node.value if key.value == step), None)
            elif isinstance(step, int) and step < len(node.value):
                child = node.value[step]
            if child is None:
                return node
            node = child
        return node

    def _key_node(self, path: Iterable[str | int], key: str) -> yaml.Node:
        """Return the node of a key itself in the mapping at a path."""
        return next(node for node, _ in self._node(path).value if node.value == key)

    def _to_plain_data(self, node: yaml.Node) -> object:
        """Return the data of a node."""
        if isinstance(node, yaml.SequenceNode):
            return [self._to_plain_data(item) for item in node.value]
        if isinstance(node, yaml.ScalarNode):
            return _scalar(node)
        data: dict[str, object] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                self._fail_at(key.start_mark, "a key of a mapping is a text")
            if key.value in data:
                self._fail_at(key.start_mark, f"{key.value!r} is already present: a key occurs once")
            data[key.value] = self._to_plain_data(value)
        return data

    def validate(self, validator: jsonschema.Draft7Validator, hints: Mapping[str, str] | None = None) -> None:
        """Raise DescriptionError for the first part that violates a schema.

        Parameters
        ----------
        validator : Draft7Validator
            Validator of the schema.
        hints : mapping of str to str, optional
            Corrections of keys that users confuse with others: {key: what to write instead}.
        """

        def order(error: jsonschema.ValidationError) -> tuple[list[str], bool]:
            """Return the sort key of a violation. An unknown key is first: often it is a misspelt required one."""
            return [*map(str, error.absolute_path)], error.validator != "additionalProperties"

        errors = sorted(islice(validator.iter_errors(self.data), 100), key=order)
        if not errors:
            return
        error = _deepest(errors[0])
        path = list(error.absolute_path)
        if error.validator != "additionalProperties":
            self._fail_at(self._node(path).start_mark, f"{_format_path(path)}{_describe_violation(error)}")
        key = _unknown_key(error)
        hint = (hints or {}).get(key)
        message = _describe_violation(error) if hint is None else f"{key!r}: {hint}"
        self._fail_at(self._key_node(path, key).start_mark, f"{_format_path(path)}{message}")


class _Composer(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML has no types
    """Composes nodes; refuses constructs that could make a small text large or deep."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0
        self._count = 0

    def compose_node(self, parent: yaml.Node | None, index: object) -> yaml.Node:
        """Return the next node."""
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise yaml.composer.ComposerError(None, None, "anchors and aliases are not supported", event.start_mark)
        if getattr(event, "tag", None):
            message = f"the tag {event.tag!r:.60} is not supported"
            raise yaml.composer.ComposerError(None, None, message, event.start_mark)
        self._depth += 1
        self._count += 1
        if self._depth > MAX_DEPTH:
            message = f"the document is nested more than {MAX_DEPTH} deep"
            raise yaml.composer.ComposerError(None, None, message, event.start_mark)
        if self._count > MAX_NODES:
            message = f"the document has more than {MAX_NODES} parts"
            raise yaml.composer.ComposerError(None, None, message, event.start_mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node


def _describe_syntax_error(error: yaml.MarkedYAMLError) -> str:
    """Return the message of PyYAML on one line, with a remedy where one is known."""
    text = ", ".join(part for part in (error.context, error.problem) if part)
    if "'\\t'" in text:
        return f"{text}. Indent with spaces, YAML has no tabs"
    if "block" in text or "mapping values" in text or "simple key" in text:
        text += (
            ". The mistake is here or above: keys of one mapping, and the dashes of one list, stand in one column; "
            "`key: value` has a colon and a space"
        )
    return text


def _scalar(node: yaml.ScalarNode) -> str | float | bool | None:
    """Return the value of a scalar node."""
    text: str = node.value
    if node.style is not None:  # quoted, or a block
        return text
    if text in SCALAR_KEYWORDS:
        return SCALAR_KEYWORDS[text]
    if NUMBER.fullmatch(text):
        return int(text) if text.lstrip("+-").isdigit() and len(text) < 20 else float(text)
    return text


def _deepest(error: jsonschema.ValidationError) -> jsonschema.ValidationError:
    """Return the violation of the alternative in a schema that the author probably meant: the deepest one."""
    while error.context:
        error = max(error.context, key=lambda inner: (len(inner.absolute_path), inner.validator != "type"))
    return error


def _unknown_key(error: jsonschema.ValidationError) -> str:
    """Return the first key of a mapping that its schema does not define."""
    known = error.schema.get("properties", {})
    patterns = error.schema.get("patternProperties", {})
    keys: Iterable[str] = error.instance
    return next(key for key in keys if key not in known and not any(re.search(pattern, key) for pattern in patterns))


def _format_path(path: Iterable[str | int]) -> str:
    """Return a path as text: `joints[2].inertia: `."""
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).lstrip(".")
    return f"{text[:100]}: " if text else ""


def _describe_violation(error: jsonschema.ValidationError) -> str:
    """Return the violation of a schema and its remedy, which the schema states in `description` or `$comment`."""
    if error.validator == "additionalProperties":
        return describe_unknown_name("key", _unknown_key(error), error.schema.get("properties", {}))
    if error.validator == "required":
        missing = [key for key in error.validator_value if key not in error.instance]
        return f"{', '.join(missing)} missing"
    if error.validator == "enum":
        return f"{error.instance!r:.60} is none of {', '.join(map(str, error.validator_value))}"
    if error.validator in ("minItems", "maxItems"):
        return f"{len(error.instance)} entries: {error.schema.get('description', error.message)} is needed"
    if error.validator in ("not", "dependentRequired", "dependencies"):
        return str(error.schema.get("$comment", error.message))
    need = error.schema.get("description", f"{error.validator} {error.validator_value}")
    return f"{error.instance!r:.60} is invalid: {need} is needed"


def make_validator(schema: Mapping[str, object]) -> jsonschema.Draft7Validator:
    """Return the validator of a schema of draft 7, for `YamlDocument.validate`."""
    return jsonschema.Draft7Validator(schema)
