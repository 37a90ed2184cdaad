"""The code blocks of a page, as regions of Sybil.

A block of Python or bash is run. A block of `text` directly behind it is its output. A block whose first line is a
comment with only a file name is written to that file.
"""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import PurePosixPath

from sybil import Document, Example, Region
from sybil.parsers.abstract.lexers import LexerCollection
from sybil.parsers.markdown.lexers import DirectiveInHTMLCommentLexer, FencedCodeBlockLexer
from sybil.parsers.myst import SkipParser
from sybil.parsers.myst.lexers import DirectiveInPercentCommentLexer

NAMED_FILE = re.compile(r"\s*(?:#|//|%|;|<!--|/\*)\s*(?P<name>[\w.-]+(?:/[\w.-]+)*)\s*(?:-->|\*/)?\s*")
PLAIN_FILE_NAMES = {"Makefile", "Dockerfile"}  # a file name without an ending is a word, but for these
RUN = {"python", "bash"}
ALIASES = {"py": "python", "python3": "python", "sh": "bash", "shell": "bash", "console": "bash", "ipython": "python"}


class PageError(AssertionError):
    """A page breaks the rules of code blocks."""


@dataclass(frozen=True)
class Block:
    """A code block of a page.

    Attributes
    ----------
    language : `python`, `bash`, `yaml`, ...
    source : text between the fences.
    file : name of the file that the block is; None: it is no file.
    output : text of the `text` block behind it; None: there is none.
    """

    language: str
    source: str
    file: str | None = None
    output: str | None = None


class BlockParser:
    """A parser of Sybil: one region for each block that is run, written or checked."""

    def __init__(self, evaluate: Callable[[Example], None]) -> None:
        self._evaluate = evaluate
        self._lexer = FencedCodeBlockLexer(language=r".+")

    def __call__(self, document: Document) -> Iterable[Region]:
        fences = sorted(self._lexer(document), key=lambda region: region.start)
        fences = [fence for fence in fences if not _is_shown_as_text(fence, fences)]
        fences = [fence for fence in fences if not _is_directive(fence)]
        regions: list[Region] = []
        for fence in fences:
            language, source = fence.lexemes["language"].split()[0], str(fence.lexemes["source"])
            previous = regions[-1] if regions else None
            if language == "text" and previous and _is_directly_behind(fence, previous, document):
                previous.parsed = Block(previous.parsed.language, previous.parsed.source, output=source)
                continue
            regions.append(Region(fence.start, fence.end, Block(language, source, named_file(source)), self._evaluate))
        return regions


class DirectiveParser:
    """A parser of Sybil for comments such as `% setup: run` or `<!-- setup: run -->`."""

    def __init__(self, directive: str, evaluate: Callable[[Example], None]) -> None:
        self._evaluate = evaluate
        self._lexers = LexerCollection(
            [DirectiveInPercentCommentLexer(directive), DirectiveInHTMLCommentLexer(directive)]
        )

    def __call__(self, document: Document) -> Iterable[Region]:
        for lexed in self._lexers(document):
            yield Region(lexed.start, lexed.end, (lexed.lexemes["arguments"] or "").split(), self._evaluate)


class ReasonedSkipParser(SkipParser):
    """`% skip: next "reason"`: a block is left out for a stated reason only."""

    def __call__(self, document: Document) -> Iterable[Region]:
        for region in super().__call__(document):
            action, reason = region.parsed
            if action == "next" and not re.fullmatch(r"""(["']).{10,}\1""", (reason or "").strip()):
                raise PageError(f'{document.path}, {document.line_column(region.start)}: skip: next "the reason"')
            yield region


def named_file(source: str) -> str | None:
    """The file name that is all of the first line's comment, or None."""
    match = NAMED_FILE.fullmatch(source.split("\n", 1)[0])
    if match is None:
        return None
    path = PurePosixPath(match["name"])
    is_file = path.suffix[1:].isalnum() or path.name in PLAIN_FILE_NAMES or path.name.startswith(".")
    return str(path) if is_file and ".." not in path.parts else None


def _is_directive(fence: Region) -> bool:
    language = fence.lexemes["language"]
    if re.match(r"\{(code|code-block|sourcecode)\}", language):
        raise PageError(f"write ```python in the place of ```{language}: a block in a directive is not run")
    return language.startswith("{")


def _is_shown_as_text(fence: Region, fences: list[Region]) -> bool:
    """Whether a fence is inside another block that is no directive: an example of Markdown."""
    around = [other for other in fences if other.start < fence.start and fence.end <= other.end]
    return any(not other.lexemes["language"].startswith("{") for other in around)


def _is_directly_behind(fence: Region, previous: Region, document: Document) -> bool:
    block = previous.parsed
    is_run = block.language in RUN and block.file is None and block.output is None
    return is_run and not document.text[previous.end : fence.start].strip()
