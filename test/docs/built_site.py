"""The documentation as HTML, built once for all tests and processes of a run, without running its notebooks."""

from __future__ import annotations

import fcntl
import subprocess
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from lxml import html

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@dataclass(frozen=True)
class Site:
    """A folder of HTML pages, and what Sphinx warned of."""

    folder: Path
    warnings: str

    @cached_property
    def pages(self) -> dict[str, html.HtmlElement]:
        """Parsed pages of the documents by name, such as `reference/nodes`; pages that Sphinx adds are left out."""
        names = sorted(path.relative_to(DOCS).with_suffix("") for path in DOCS.rglob("*.md"))
        return {str(name): self.parse(self.folder / f"{name}.html") for name in names}

    @staticmethod
    def parse(path: Path) -> html.HtmlElement:
        """Return a page as a tree."""
        return html.fromstring(path.read_bytes())

    def article(self, page: str) -> html.HtmlElement:
        """Return the content of a page, without navigation."""
        (content,) = self.pages[page].xpath("//article[@role='main']")
        return content

    def codes(self, page: str, path: str = ".//code") -> set[str]:
        """Return the texts in the typeface of code on a page, by default all of them."""
        return {element.text_content() for element in self.article(page).xpath(path)}

    @cached_property
    def object_names(self) -> set[str]:
        """Names of all documented Python objects."""
        from sphinx.util.inventory import InventoryFile

        with (self.folder / "objects.inv").open("rb") as stream:
            inventory = InventoryFile.load(stream, "", lambda base, path: path)
        return {name for kind, names in inventory.items() if kind.startswith("py:") for name in names}


def build_site(folder: Path) -> Site:
    """Build the documentation in a folder, unless another process has, and return it."""
    folder.mkdir(parents=True, exist_ok=True)
    output = folder / "html"
    log = folder / "warnings.txt"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (output / "objects.inv").exists():
            command = [sys.executable, "-m", "sphinx", "-q", "-n", "-b", "html", "-D", "nb_execution_mode=off"]
            options = ["-d", str(folder / "doctrees"), "-w", str(log)]
            done = subprocess.run(
                [*command, *options, str(DOCS), str(output)], capture_output=True, text=True, timeout=280, cwd=folder
            )
            assert done.returncode == 0, done.stderr[-4000:]
    return Site(output, log.read_text(encoding="utf-8"))
