"""Fixtures of the tests of compiled programs."""

import threading

import pytest

from robot_dynamics.codegen.jit.background import THREAD_NAME


@pytest.fixture
def no_background_work():
    """Wait for compilations of earlier tests, which would be counted, or write to the cache folder of this test."""
    for thread in threading.enumerate():
        if thread.name == THREAD_NAME:
            thread.join(120)
            assert not thread.is_alive()


class Forgetful(dict):
    """A dict that stays empty."""

    def __setitem__(self, key, value):
        pass


@pytest.fixture
def no_code_in_memory(monkeypatch):
    """Object code is read from the cache folder, as in another process."""
    engine = pytest.importorskip("robot_dynamics.codegen.jit.engine", reason="llvmlite is not installed")
    monkeypatch.setattr(engine, "shared_object_code", Forgetful())
