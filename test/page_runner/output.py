"""The output of a block compared with the `text` block behind it, as doctest compares."""

from doctest import ELLIPSIS, NORMALIZE_WHITESPACE, REPORT_NDIFF, OutputChecker
from doctest import Example as DocExample

OPTIONS = ELLIPSIS | NORMALIZE_WHITESPACE


def difference(expected: str, output: str) -> str:
    """What differs, for a reader; empty if the output is as expected. `...` stands for any text."""
    checker = OutputChecker()
    if checker.check_output(expected, output, OPTIONS):
        return ""
    shown = checker.output_difference(DocExample("", expected), output, OPTIONS | REPORT_NDIFF)
    return f"the output is not that of the page\n{shown}\nThe whole output:\n{output}"
