"""Structure of the package as docs/explanation/structure.md states it: words, types, names, imports, and files."""

import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXPLANATION = ROOT / "docs" / "explanation"
MOST_PUBLIC_NAMES = 45
LONGEST_CHAIN = 12  # modules of which each imports the next one

specification = importlib.util.spec_from_file_location("structure", ROOT / "tools" / "structure.py")
structure = importlib.util.module_from_spec(specification)
specification.loader.exec_module(structure)


@pytest.fixture(scope="module")
def package():
    return structure.Package(ROOT)


@pytest.mark.slow
def test_identifiers_are_terms_of_the_field(package):
    assert package.vague_identifiers() == []


def test_public_functions_have_types(package):
    assert package.unannotated_functions() == []


def test_public_names_are_few_and_exist(package):
    import robot_dynamics

    names = package.public_names()
    assert len(names) <= MOST_PUBLIC_NAMES and names == sorted(set(names))
    for name in names:
        assert getattr(robot_dynamics, name).__doc__, f"{name} has no docstring"


def test_import_chain_is_short(package):
    chain = package.longest_import_chain()
    assert len(chain) <= LONGEST_CHAIN, " -> ".join(chain)


def test_file_names_are_unique_but_for_those_that_their_folder_explains(package):
    assert package.repeated_file_names() == {}


def test_layers_import_downwards(package):
    """Packages in the order of architecture.md: none imports one before it; `nodes` alone imports ROS."""
    layers = re.findall(r"^\| `(\w+)` \|", (EXPLANATION / "architecture.md").read_text(), re.MULTILINE)
    assert set(layers) == {module.split(".")[1] for module in package.trees if "." in module}
    for module in package.trees:
        for target in package.imports(module):
            layer, imported = (name.split(".")[1] if "." in name else None for name in (module, target))
            if layer and imported and layer != imported:
                assert layers.index(layer) < layers.index(imported), f"{module} imports {target}"


def test_table_of_the_documentation_is_measured(package):
    """The column `after` of structure.md has the present figures."""
    rows = re.findall(r"^\| (.+) \| (.+) \| (.+) \|$", (EXPLANATION / "structure.md").read_text(), re.MULTILINE)
    documented = {name: after for name, _, after in rows}
    measured = re.findall(r"^\| (.+) \| (.+) \|$", structure.table(package), re.MULTILINE)
    assert len(measured) == 5
    for name, value in measured:
        assert documented[name] == value, name
