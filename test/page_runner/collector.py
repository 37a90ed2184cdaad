"""The Sybil that collects the pages of the documentation."""

from pathlib import Path

from sybil import Sybil

from page_runner.blocks import BlockParser, DirectiveParser, ReasonedSkipParser
from page_runner.evaluation import evaluate_block, evaluate_end, evaluate_set_up, set_up, tear_down

ROOT = Path(__file__).parents[2]
FOLDERS = ("how_to", "explanation", "reference")


class PageSybil(Sybil):
    """Collects README.md and the pages of docs/; or all Markdown files of another folder."""

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        super().__init__(
            parsers=[
                BlockParser(evaluate_block),
                DirectiveParser("setup", evaluate_set_up),
                DirectiveParser("end", evaluate_end),
                ReasonedSkipParser(),
            ],
            setup=set_up,
            teardown=tear_down,
        )

    def should_parse(self, path: Path) -> bool:
        """Whether a file is a page."""
        if path.suffix != ".md":
            return False
        if self._folder is not None:
            return self._folder in path.parents
        folders = [ROOT / "docs" / name for name in FOLDERS]
        return path in (ROOT / "README.md", ROOT / "docs" / "index.md") or any(
            folder in path.parents for folder in folders
        )
