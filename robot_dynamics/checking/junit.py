"""Results of checks as JUnit XML, which GitLab, Jenkins and actions of GitHub show.

One test suite for each recording, one test case for each joint. A joint that is not judged is skipped. What concerns
the whole recording is the test case `recording`: a refused recording is an error there.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree

NAME = "robot-dynamics replay-check"
NO_XML_CHARACTERS = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit_xml(results: Sequence[Mapping[str, Any]]) -> str:
    """The text of the XML file, of results of recordings in the form of the JSON file."""
    suites = ElementTree.Element("testsuites", name=NAME)
    for result in results:
        suite = ElementTree.SubElement(suites, "testsuite", name=_clean(result["recording"]))
        _add_cases(suite, result)
        _count(suite)
    _count(suites)
    ElementTree.indent(suites)
    return ElementTree.tostring(suites, encoding="unicode", xml_declaration=True) + "\n"


def _add_cases(suite: ElementTree.Element, result: Mapping[str, Any]) -> None:
    whole = _add_case(suite, result["recording"], "recording")
    if "joints" not in result:
        _add_outcome(whole, "error", [result["refused"]])
        return
    fault = [f"fault: {result['fault']['sentence']}"] if result.get("fault") else []
    failures = [*result["objections"], *fault, *result.get("golden", [])]
    if failures:
        _add_outcome(whole, "error" if result["passed"] is None else "failure", failures)
    worse = {change["joint"]: change["reasons"] for change in result.get("baseline", [])}
    for joint in result["joints"]:
        case = _add_case(suite, result["recording"], joint["joint"])
        reasons = [f"worse than the baseline: {reason}" for reason in worse.get(joint["joint"], [])]
        if joint["verdict"] == "failed" or reasons:
            objections = joint["objections"] if joint["verdict"] == "failed" else []
            _add_outcome(case, "failure", [*objections, *reasons])
        elif joint["verdict"] == "not judged":
            _add_outcome(case, "skipped", [f"not judged: {'; '.join(joint['objections'])}"])


def _add_case(suite: ElementTree.Element, recording: str, name: str) -> ElementTree.Element:
    return ElementTree.SubElement(suite, "testcase", classname=_clean(recording), name=_clean(name))


def _add_outcome(case: ElementTree.Element, kind: str, sentences: Sequence[str]) -> None:
    outcome = ElementTree.SubElement(case, kind, message=_clean(sentences[0]))
    if kind != "skipped":
        outcome.set("type", kind)
        outcome.text = _clean("\n".join(sentences))


def _count(element: ElementTree.Element) -> None:
    """Set the numbers of test cases of an element, by outcome."""
    element.set("tests", str(sum(1 for _ in element.iter("testcase"))))
    for attribute, kind in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        element.set(attribute, str(sum(1 for _ in element.iter(kind))))


def _clean(text: str) -> str:
    """A text without the characters that XML does not allow."""
    return NO_XML_CHARACTERS.sub("?", text)
