"""The name of the root element of a text that begins as XML does, which determines its format."""

from __future__ import annotations

import re

from robot_dynamics.model.formats.decoding import UTF16_MARKS

BEFORE_ROOT = re.compile(r"\s*(<\?|<!--)")
ROOT = re.compile(r"\s*<([\w:.-]+)[\s/>]")


def root_name(text: str | bytes) -> str:
    """Return the name of the root element, after declarations and comments; empty where there is none."""
    if isinstance(text, bytes):
        text = text.decode("utf-16" if text[:2] in UTF16_MARKS else "latin-1", "ignore")
        text = text.removeprefix("ï»¿")
    position = 0
    text = text.removeprefix("\ufeff")
    while match := BEFORE_ROOT.match(text, position):
        ending = "?>" if match.group(1) == "<?" else "-->"
        end = text.find(ending, match.end())
        if end < 0:
            return ""
        position = end + len(ending)
    root = ROOT.match(text, position)
    return root.group(1) if root is not None else ""
