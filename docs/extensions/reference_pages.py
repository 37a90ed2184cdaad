"""Directives that write parts of the reference from their sources: .srv files, parameters, schema, parser, robots."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

if TYPE_CHECKING:
    from docutils import nodes
    from sphinx.application import Sphinx

logger = logging.getLogger(__name__)

ROOT = Path(__file__).parents[2]
SERVICES = ROOT / "robot_dynamics_interfaces" / "srv"
SCHEMA = ROOT / "robot_dynamics" / "model" / "formats" / "mdh_yaml" / "mdh.schema.json"
HELP_WIDTH = 88
NO_COMMENT = {"success": ["Whether the request could be computed."]}
"""Fields without a comment in the .srv files."""
OPTION = re.compile(r"(?<![\w`-])(--[a-z][a-z-]*)")
IDENTIFIER = re.compile(r"(?<![\w./`~])(~?/?[a-z]\w*[._][\w.]*\w|~/\w+)(?![\w/`])")
"""A name of a field, topic or file in a comment: it has a dot or an underscore inside, or begins with ~/."""


class MarkdownDirective(SphinxDirective):
    """A directive that stands for text in Markdown."""

    has_content = False
    optional_arguments = 1
    final_argument_whitespace = False

    def run(self) -> list[nodes.Node]:
        """Parse the text in the place of the directive."""
        for path in self.sources():
            self.env.note_dependency(path)
        return self.parse_text_to_nodes("\n".join(self.lines()), allow_section_headings=True)

    def sources(self) -> Iterable[Path]:
        """Files from which the text is made."""
        return ()

    def lines(self) -> Iterator[str]:
        """Lines of the text."""
        raise NotImplementedError


class ServiceDirective(MarkdownDirective):
    """`service NAME`: the fields of a service, from its .srv file."""

    def sources(self) -> Iterable[Path]:
        """The .srv file."""
        return (SERVICES / f"{self.arguments[0]}.srv",)

    def lines(self) -> Iterator[str]:
        """Introduction, fields of the request, fields of the response."""
        (path,) = self.sources()
        introduction, request, response = parse_service(path.read_text(encoding="utf-8"))
        yield from format_comment(introduction)
        for title, fields in (("Request", request), ("Response", response)):
            yield from ("", f"**{title}**", "")
            for _, group in groupby(fields, key=lambda field: id(field[2])):  # fields that share a comment
                described = list(group)
                yield ", ".join(f"`{name}` — `{kind}`" for kind, name, _ in described)
                _, first_name, comment = described[0]
                text = list(format_comment(comment or NO_COMMENT[first_name]))
                yield f":   {text[0]}"
                yield from (f"    {line}" if line else "" for line in text[1:])
                yield ""


def parse_service(text: str) -> tuple[list[str], list[tuple[str, str, list[str]]], list[tuple[str, str, list[str]]]]:
    """Return the comment at the top of a .srv file, and the fields (type, name, comment) of request and response.

    A comment belongs to the fields that follow it without an empty line. The comment at the top ends at the first empty
    line before a comment or field.
    """
    halves: tuple[list[tuple[str, str, list[str]]], list[tuple[str, str, list[str]]]] = ([], [])
    blocks = re.split(r"\n\s*\n", text.strip())
    introduction = []
    while blocks and all(line.startswith("#") for line in blocks[0].splitlines()):
        introduction += [*([""] if introduction else []), *strip_hashes(blocks.pop(0).splitlines())]
    half = 0
    for line_block in blocks:
        comment: list[str] = []
        for line in line_block.splitlines():
            if line.startswith("---"):
                half = 1
                comment = []
            elif line.startswith("#"):
                comment += strip_hashes([line])
            else:
                kind, name = line.split()[:2]
                halves[half].append((kind, name, comment))
    return introduction, *halves


def strip_hashes(lines: Iterable[str]) -> list[str]:
    """Return lines of comments without their marks."""
    return [re.sub(r"^#+ ?", "", line) for line in lines]


def format_comment(lines: Iterable[str]) -> Iterator[str]:
    """Return the lines of a comment as Markdown: indented lines are code, names of fields are code in the line."""
    is_code = False
    for line in lines:
        if line.startswith("  ") != is_code and (line.strip() or is_code):
            is_code = not is_code
            yield "```" if not is_code else "\n```none"
        yield line if is_code else escape_markdown(line)
    if is_code:
        yield "```"


def escape_markdown(text: str) -> str:
    """Return plain text as Markdown, names with dots or underscores as code."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(part if part.startswith("`") else _escape_plain(part) for part in parts)


def _escape_plain(text: str) -> str:
    pieces = IDENTIFIER.split(text)  # texts and names by turns
    escaped = (
        f"`{piece}`" if number % 2 else OPTION.sub(r"`\1`", re.sub(r"([\\*_<>\[\]|#])", r"\\\1", piece))
        for number, piece in enumerate(pieces)
    )
    return "".join(escaped)


class NodeParametersDirective(MarkdownDirective):
    """`node-parameters NODE`: the table of the parameters of a node, from their declarations."""

    def lines(self) -> Iterator[str]:
        """The table, with the range and the time of reading below the description."""
        from robot_dynamics.nodes.parameter_tables import NODES, markdown_table

        yield from ("| parameter | default | description |", "| --- | --- | --- |")
        for row in markdown_table(NODES[self.arguments[0]]).splitlines()[2:]:
            cells = re.split(r"(?<!\\)\|", row.strip().strip("|"))
            name, default, _unit, bounds, read_at, description = (cell.strip() for cell in cells)
            text = f"{escape_markdown(description.replace('^2', '²'))}."
            if bounds and not all(choice in description for choice in bounds.strip("`").split("`, `")):
                text += f" Range: {bounds}."
            if read_at != "runtime":
                text += f" Read at {read_at}."
            yield f"| {name} | {default or 'empty'} | {text} |"


class CommandLineDirective(MarkdownDirective):
    """`command-line`: all verbs of robot-dynamics with their options, from the parser."""

    def lines(self) -> Iterator[str]:
        """A section for each verb."""
        from robot_dynamics.cli.main import build_parser, verb_modules

        parser = build_parser(verb_modules())
        (verbs,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
        for name, verb in verbs.choices.items():
            yield from (f"## {name}", "")
            yield from _describe_verb(verb)


def _describe_verb(verb: argparse.ArgumentParser) -> Iterator[str]:
    formatter = argparse.HelpFormatter(verb.prog, width=HELP_WIDTH)
    formatter.add_usage(verb.usage, verb._actions, verb._mutually_exclusive_groups)
    usage = formatter.format_help().strip()
    yield from format_help(verb.description or "")
    yield from ("", "```none", usage, "```", "")
    for group in verb._action_groups:
        actions = [action for action in group._group_actions if action.help is not argparse.SUPPRESS]
        if not actions:
            continue
        yield from (f"**{(group.title or '').capitalize()}**", "")
        for action in actions:
            invocation = formatter._format_action_invocation(action)
            text = formatter._expand_help(action) if action.help else " "
            yield from (f"`{invocation}`", f":   {escape_markdown(text)}", "")
    yield from format_help(verb.epilog or "")


def format_help(text: str) -> Iterator[str]:
    """Return the description of a verb as Markdown: options are code, indented paragraphs are blocks of code."""
    for paragraph in re.split(r"\n\s*\n", text.strip("\n")):
        if paragraph.startswith("  "):
            yield from ("```none", paragraph, "```", "")
        else:
            yield from (escape_markdown(paragraph), "")


class MdhKeysDirective(MarkdownDirective):
    """`mdh-keys FILE`: the keys of MDH tables, from their schema, and from a file with defaults, units and meanings."""

    required_arguments = 1

    def sources(self) -> Iterable[Path]:
        """The schema, and the file."""
        return SCHEMA, Path(self.env.doc2path(self.env.docname)).parent / self.arguments[0]

    def lines(self) -> Iterator[str]:
        """A section with a table for each kind of mapping."""
        schema_path, texts_path = self.sources()
        tables = schema_keys(json.loads(schema_path.read_text(encoding="utf-8")))
        texts = yaml.safe_load(texts_path.read_text(encoding="utf-8"))
        self._compare_names("mapping", tables, texts)
        for mapping, keys in tables.items():
            section = texts.get(mapping, {})
            rows = section.get("keys", {})
            self._compare_names(f"key of {mapping}", keys, rows)
            yield f"(mdh-{mapping.replace('.', '-')})="
            yield from (f"### {section.get('title', mapping)}", "", section.get("text", ""), "")
            yield from ("| key | type | default | unit | meaning |", "| --- | --- | --- | --- | --- |")
            for key, kind in keys.items():
                default, unit, meaning = (str(cell) for cell in rows.get(key, ("", "", "")))
                yield f"| `{key}` | {kind} | {default} | {unit} | {meaning} |"
            yield ""

    def _compare_names(self, kind: str, expected: Mapping[str, object], present: Mapping[str, object]) -> None:
        for name in {*expected} ^ {*present}:
            where = "has no text in" if name in expected else "is not in the schema, but in"
            logger.warning("%s %r %s %s", kind, name, where, self.arguments[0], location=self.get_location())


def schema_keys(schema: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Return the type of each key, by the mapping that has the key: {mapping: {key: type}}."""
    definitions = schema["definitions"]
    tables: dict[str, dict[str, str]] = {}

    def add(mapping: str, definition: Mapping[str, Any]) -> None:
        if "properties" not in definition or mapping in tables:
            return
        tables[mapping] = {}
        for key, value in definition["properties"].items():
            tables[mapping][key] = describe_type(value, f"{mapping}.{key}")
        for key, value in definition["properties"].items():
            for name, nested in _nested_mappings(value, f"{mapping}.{key}"):
                add(name, nested)

    def _nested_mappings(value: Mapping[str, Any], name: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
        if "$ref" in value:
            target = value["$ref"].rpartition("/")[2]
            yield from _nested_mappings(definitions[target], target)
        elif "allOf" in value:
            yield from _nested_mappings(value["allOf"][0], name)
        elif "properties" in value:
            yield name, value
        elif "items" in value:
            yield from _nested_mappings(value["items"], name)
        elif isinstance(value.get("additionalProperties"), dict):
            yield from _nested_mappings(value["additionalProperties"], name)

    def describe_type(value: Mapping[str, Any], name: str) -> str:
        if "$ref" in value:
            target = value["$ref"].rpartition("/")[2]
            simple = {"number": "number", "name": "name", "mass": "number", "position": "number", "vector": "3 numbers"}
            return simple.get(target) or describe_type(definitions[target], target)
        if "allOf" in value:
            return describe_type(value["allOf"][0], name)
        if "enum" in value:
            return ", ".join(f"`{choice}`" for choice in value["enum"])
        if "properties" in value:
            return f"[{name.rpartition('.')[2]}](#mdh-{name.replace('.', '-')})"
        if value.get("type") == "array":
            count = f"{value['minItems']} " if value.get("minItems") == value.get("maxItems") is not None else ""
            item = describe_type(value["items"], name)
            return f"list of {count}{'names' if item == 'name' else item}"
        if value.get("type") == "object":
            item = value.get("additionalProperties") or next(iter(value.get("patternProperties", {}).values()))
            return f"{describe_type(item, name).replace('number', 'numbers')}, by name"
        return {"string": "text", "boolean": "`true`, `false`", "integer": "integer"}[value["type"]]

    add("table", definitions["table"])
    add("urdf_document", definitions["urdf_document"])
    return tables


class RobotNotesDirective(MarkdownDirective):
    """`robot-notes`: what the files of the robots that ship say of their figures."""

    def sources(self) -> Iterable[Path]:
        """The files."""
        from robot_dynamics import shipped_robots

        return sorted(shipped_robots().values())

    def lines(self) -> Iterator[str]:
        """A section for each robot."""
        for path in self.sources():
            yield from (f"### {path.stem}", "", f"File `{path.name}`.", "")
            comment = header_comment(path)
            if path.suffix == ".urdf":  # lists and references in columns
                yield from ("```none", comment, "```", "")
            else:
                yield from (*format_prose(comment), "")


def format_prose(text: str) -> Iterator[str]:
    """Return a comment as paragraphs of Markdown: a line that ends with a full stop ends a paragraph."""
    lines = text.splitlines()
    for line, next_line in zip(lines, [*lines[1:], ""], strict=True):
        yield from format_comment([line])
        if line.endswith(".") and next_line[:1].isupper():
            yield ""


def header_comment(path: Path) -> str:
    """Return the comment at the top of a description."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".urdf":
        match = re.search(r"<!--\n?(.*?)-->", text, re.DOTALL)
        lines = match[1].rstrip().splitlines() if match else []
        margin = min((len(line) - len(line.lstrip()) for line in lines if line.strip()), default=0)
        return "\n".join(line[margin:] for line in lines)
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        lines.append(line)
    return "\n".join(strip_hashes(lines))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("service", ServiceDirective)
    app.add_directive("node-parameters", NodeParametersDirective)
    app.add_directive("command-line", CommandLineDirective)
    app.add_directive("mdh-keys", MdhKeysDirective)
    app.add_directive("robot-notes", RobotNotesDirective)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
