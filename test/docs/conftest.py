"""Fixture: the documentation, built once."""

import pytest
from docs.built_site import build_site


@pytest.fixture(scope="session")
def site(tmp_path_factory, worker_id):
    """The built documentation."""
    base = tmp_path_factory.getbasetemp()
    return build_site((base if worker_id == "master" else base.parent) / "site")
