"""Fixture: the documentation, built once. Where only the packages of Ubuntu are installed, less can be tested."""

from importlib.util import find_spec

import pytest

NEEDED = {"test_page_runner.py": "sybil", "test_reference.py": "myst_nb", "test_links.py": "myst_nb"}
collect_ignore = [file for file, package in NEEDED.items() if find_spec(package) is None]


@pytest.fixture(scope="session")
def site(tmp_path_factory, worker_id):
    """The built documentation."""
    from docs.built_site import build_site

    base = tmp_path_factory.getbasetemp()
    return build_site((base if worker_id == "master" else base.parent) / "site")
