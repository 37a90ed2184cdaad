"""The reference is complete: each public name, verb, service, parameter, robot and key has its place in the HTML."""

import argparse
import inspect
import json
import re
import sys

import pytest
from docs.built_site import ROOT

import robot_dynamics
from robot_dynamics.cli.main import build_parser, verb_modules
from robot_dynamics.model.formats.mdh_yaml.reader import SCHEMA

pytestmark = pytest.mark.slow

SERVICE_FILES = sorted((ROOT / "robot_dynamics_interfaces" / "srv").glob("*.srv"))


def test_build_has_no_warnings(site):
    assert not site.warnings


@pytest.mark.parametrize("name", robot_dynamics.__all__)
def test_public_name_and_its_methods_are_documented(site, name):
    assert f"robot_dynamics.{name}" in site.object_names
    public = getattr(robot_dynamics, name)
    for member, value in inspect.getmembers(public) if inspect.isclass(public) else ():
        is_method = inspect.isfunction(value) or inspect.ismethod(value) or isinstance(value, property)
        if is_method and not member.startswith("_") and inspect.getdoc(value):
            assert f"robot_dynamics.{name}.{member}" in site.object_names, member


def test_service_client_and_compiled_programs_are_documented(site):
    names = {"nodes.client.ServiceClient.call", "codegen.jit.compiled_program.CompiledProgram.batch"}
    assert {f"robot_dynamics.{name}" for name in names} <= site.object_names


def test_signatures_name_types_as_the_source_does(site):
    for page in (page for page in site.pages if page.startswith("reference/api/")):
        for signature in site.article(page).xpath(".//dt[contains(@class, 'sig')]"):
            assert not re.search(r"ForwardRef|numpy\._typing|<.* object at", signature.text_content())


def test_every_verb_has_a_section_with_its_options(site):
    parser = build_parser(verb_modules())
    (verbs,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    article = site.article("reference/command_line")
    listed = {link.text_content() for link in article.xpath(".//table//a")}
    assert listed == set(verbs.choices)
    for name, verb in verbs.choices.items():
        (section,) = article.xpath(f".//section[@id='{name}']")
        text = " ".join(section.text_content().split())
        assert " ".join(verb.description.split()[:8]).strip(".") in text
        terms = [" ".join(term.text_content().split()) for term in section.xpath(".//dt")]
        for action in verb._actions:
            label = max(action.option_strings, key=len) if action.option_strings else action.metavar or action.dest
            assert any(label in term for term in terms), (name, label)


@pytest.mark.parametrize("path", SERVICE_FILES, ids=lambda path: path.stem)
def test_service_has_its_fields(site, path):
    (section,) = site.article("reference/services").xpath(f".//section[@id='{path.stem.lower()}']")
    parts = re.split("Response", section.text_content())
    for half, text in zip(path.read_text(encoding="utf-8").split("\n---\n"), parts, strict=True):
        fields = re.findall(r"^([\w/]+(?:\[\])?) (\w+)$", half, re.MULTILINE)
        assert fields
        for kind, name in fields:
            assert f"{name} — {kind}" in text


def test_comments_of_services_are_complete(site):
    text = "".join(site.article("reference/services").text_content().split())
    for path in SERVICE_FILES:
        for line in re.findall(r"^#[ \t]*(.*)$", path.read_text(encoding="utf-8"), re.MULTILINE):
            assert "".join(line.split()) in text, (path.name, line)


def test_every_service_of_the_server_is_listed_with_its_node(site):
    services = {path.stem for path in SERVICE_FILES}
    names = {re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower() for name in services}
    for page in ("reference/services", "reference/nodes"):
        assert {f"~/{name}" for name in names} <= site.codes(page)


def test_every_parameter_is_in_the_table_of_its_node(site):
    tables = pytest.importorskip("robot_dynamics.nodes.parameter_tables", reason="needs rclpy")
    sections = {node: node.replace("_", "-") for node in tables.NODES if node != "all"} | {"all": "all-nodes"}
    for node, anchor in sections.items():
        path = f".//section[@id='{anchor}']//tbody/tr/td[1]//code"
        assert site.codes("reference/parameters", path) == set(tables.NODES[node])


def test_every_robot_that_ships_is_listed_with_its_sources(site):
    shipped = set(robot_dynamics.shipped_robots())
    article = site.article("reference/robots")
    assert site.codes("reference/robots", ".//table//td[1]//code") == shipped
    for name in shipped:
        (section,) = article.xpath(f".//section[section]/section[@id='{name.replace('_', '-')}']")
        assert len(section.text_content().split()) > 50


def test_every_key_of_the_schema_is_in_the_table_of_its_mapping(site):
    schema = json.loads(SCHEMA.read_text(encoding="utf-8")) if hasattr(SCHEMA, "read_text") else SCHEMA
    article = site.article("reference/mdh_table")
    mappings = dict(find_mappings("", schema))
    assert len(mappings) > 20
    tables = [frozenset(cell.text_content() for cell in table.xpath(".//td[1]")) for table in article.xpath(".//table")]
    for name, keys in mappings.items():
        assert keys in tables, name
    for row in article.xpath(".//section[@id='all-keys']//tbody/tr"):
        assert row.xpath("td[5]")[0].text_content().strip(), row.text_content()


def find_mappings(name, schema):
    """Yield the path and the keys of each mapping of a JSON schema."""
    if isinstance(schema, dict):
        if isinstance(schema.get("properties"), dict):
            yield name, frozenset(schema["properties"])
        for key, value in schema.items():
            yield from find_mappings(f"{name}/{key}", value)


def test_conventions_have_every_term(site):
    cells = {cell.text_content() for cell in site.article("reference/conventions").xpath(".//td[1]")}
    assert {"units", "effort", "external wrench", "acceleration of the base", "twist of the base", "reaction"} <= cells


def test_topics_of_nodes_are_listed(site):
    pattern = re.compile(
        r"(?:create_(?:publisher|subscription|service)|_input_subscription|_publisher)\(\s*\w+, \"([^\"]+)\""
    )
    sources = (ROOT / "robot_dynamics" / "nodes").glob("*/*.py")
    topics = {topic for path in sources if path.parent.name != "demo" for topic in pattern.findall(path.read_text())}
    assert len(topics) > 15
    assert topics <= site.codes("reference/nodes")


def test_formulas_are_mathml():
    sys.path.insert(0, str(ROOT / "docs" / "extensions"))
    try:
        import mathml
    finally:
        sys.path.pop(0)
    parts = {r"\dot q_i": "<msub><mover", r"\frac{a}{b}": "<mfrac", r"\sum_i^n x": "<munderover"}
    for latex, tag in parts.items():
        assert tag in "".join(line.strip() for line in mathml.to_mathml(latex, is_block=False).splitlines()), latex
