"""Tests of the documentation. Where only the packages of Ubuntu are installed, there is no Sybil to run pages with."""

from importlib.util import find_spec

collect_ignore = [] if find_spec("sybil") else ["test_page_runner.py"]
