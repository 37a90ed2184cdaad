"""Runs the code blocks of the documentation as tests: the rules are in docs/page_fixtures.py and in test/README.md."""
