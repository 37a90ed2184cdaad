"""From the text of a YAML document to plain data that knows the line and column of each of its parts.

Stricter than YAML: a key stands once in a mapping, there are no anchors and aliases, no tags; plain scalars are
numbers, true, false, null or text, and nothing else: `no` and `on` are names, 010 is ten.
"""

import re
from itertools import islice

import jsonschema
import yaml

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.decoding import decode_text

MAX_DOCUMENT_LENGTH = 1024 * 1024  # characters; a humanoid has fifty thousand
MAX_DEPTH = 40  # levels; a description has six
MAX_NODES = 200_000
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
SCALAR_KEYWORDS = {"true": True, "false": False, "null": None, "~": None, "": None}


class YamlDocument:
    """A YAML document as plain data: dicts, lists, numbers, texts, booleans and None.

    text: str or bytes; source: what to call it in errors; need: what it should be. Raises DescriptionError.
    """

    def __init__(self, text, source, need):
        self.source = source
        text = decode_text(text, source, need, MAX_DOCUMENT_LENGTH)
        try:
            self._root = _Composer(text).get_single_node()
        except yaml.MarkedYAMLError as error:
            self._fail_at(error.problem_mark or error.context_mark, _sentence(error))
        except (yaml.YAMLError, ValueError) as error:  # ValueError: an escape that is no character
            raise DescriptionError(f"{source} is no YAML: {' '.join(str(error).split())[:200]}") from None
        if self._root is None:
            raise DescriptionError(f"{source} is empty: {need} is needed")
        self.data = self._plain(self._root)

    def fail(self, path, message):
        """Raise DescriptionError for the part that a path of keys and indices leads to."""
        self._fail_at(self._node(path).start_mark, message)

    def _fail_at(self, mark, message):
        where = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise DescriptionError(f"{self.source}{where}: {message}") from None

    def _node(self, path):
        """The node that a path leads to, or the last one on the way that is there."""
        node = self._root
        for step in path:
            if isinstance(node, yaml.MappingNode):
                found = next((value for key, value in node.value if key.value == step), None)
            else:
                found = node.value[step] if isinstance(step, int) and step < len(node.value) else None
            if found is None:
                return node
            node = found
        return node

    def _key(self, path, key):
        """The node of a key itself in the mapping that a path leads to."""
        return next(node for node, _ in self._node(path).value if node.value == key)

    def _plain(self, node):
        if isinstance(node, yaml.SequenceNode):
            return [self._plain(item) for item in node.value]
        if isinstance(node, yaml.ScalarNode):
            return _scalar(node)
        data = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                self._fail_at(key.start_mark, "a key of a mapping is a text")
            if key.value in data:
                self._fail_at(key.start_mark, f"{key.value!r} is there already: once is right")
            data[key.value] = self._plain(value)
        return data

    def validate(self, validator, hints=()):
        """Raise DescriptionError for the first part that a jsonschema validator objects to.

        hints: {key: what to write instead} for keys that are unknown here and known elsewhere.
        """

        def order(error):  # a strange key first: it often is what is missing, under another name
            return [*map(str, error.absolute_path)], error.validator != "additionalProperties"

        objections = sorted(islice(validator.iter_errors(self.data), 100), key=order)
        if objections:
            error = _deepest(objections[0])
            path = list(error.absolute_path)
            mark = self._node(path).start_mark
            if error.validator == "additionalProperties":
                mark = self._key(path, _strange_key(error)).start_mark
                if _strange_key(error) in hints:
                    self._fail_at(mark, f"{_place(path)}{_strange_key(error)!r}: {hints[_strange_key(error)]}")
            self._fail_at(mark, f"{_place(path)}{_objection(error)}")


class _Composer(yaml.SafeLoader):
    """Composes nodes; refuses what could make a small text large, or deep."""

    def __init__(self, text):
        super().__init__(text)
        self._depth = self._count = 0

    def compose_node(self, parent, index):
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise yaml.composer.ComposerError(None, None, "anchors and aliases are not read", event.start_mark)
        if getattr(event, "tag", None):
            raise yaml.composer.ComposerError(None, None, f"the tag {event.tag!r:.60} is not read", event.start_mark)
        self._depth, self._count = self._depth + 1, self._count + 1
        if self._depth > MAX_DEPTH or self._count > MAX_NODES:
            what = (
                f"nested more than {MAX_DEPTH} deep" if self._depth > MAX_DEPTH else f"of more than {MAX_NODES} parts"
            )
            raise yaml.composer.ComposerError(None, None, f"a document {what} is not read", event.start_mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node


def _sentence(error):
    """What PyYAML says, on one line, and what helps where it is known."""
    told = ", ".join(part for part in (error.context, error.problem) if part)
    if "'\\t'" in told:
        return f"{told}. Indent with spaces, YAML knows no tabs"
    if "block" in told or "mapping values" in told or "simple key" in told:
        told += (
            ". The mistake is here or above: keys of one mapping, and the dashes of one list, stand in one column; "
            "`key: value` has a colon and a space"
        )
    return told


def _scalar(node):
    text = node.value
    if node.style is not None:  # quoted, or a block
        return text
    if text in SCALAR_KEYWORDS:
        return SCALAR_KEYWORDS[text]
    if NUMBER.fullmatch(text):
        return int(text) if text.lstrip("+-").isdigit() and len(text) < 20 else float(text)
    return text


def _deepest(error):
    """Of the objections to each alternative, the one of the alternative that was meant: the one that came farthest."""
    while error.context:
        error = max(error.context, key=lambda inner: (len(inner.absolute_path), inner.validator != "type"))
    return error


def _strange_key(error):
    known = error.schema.get("properties", {})
    patterns = error.schema.get("patternProperties", {})
    return next(key for key in error.instance if key not in known and not any(re.search(p, key) for p in patterns))


def _place(path):
    """`joints[2].inertia: ` of a path."""
    told = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).lstrip(".")
    return f"{told[:100]}: " if told else ""


def _objection(error):
    """What was wrong and what would be right, in a sentence. Schemas say the latter in `description`."""
    if error.validator == "additionalProperties":
        return describe_unknown_name("key", _strange_key(error), error.schema.get("properties", {}))
    if error.validator == "required":
        missing = [key for key in error.validator_value if key not in error.instance]
        return f"{', '.join(missing)} missing"
    if error.validator == "enum":
        return f"{error.instance!r:.60} is none of {', '.join(map(str, error.validator_value))}"
    if error.validator in ("minItems", "maxItems"):
        return f"{len(error.instance)} entries: {error.schema.get('description', error.message)} is needed"
    if error.validator in ("not", "dependentRequired", "dependencies"):
        return error.schema.get("$comment", error.message)
    need = error.schema.get("description", f"{error.validator} {error.validator_value}")
    return f"{error.instance!r:.60} is not right: {need} is needed"


def make_validator(schema):
    """The jsonschema validator of a schema of draft 7, for `YamlDocument.validate`."""
    return jsonschema.Draft7Validator(schema)
