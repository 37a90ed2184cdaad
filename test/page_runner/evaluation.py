"""Evaluates the blocks and comments of a page."""

import contextlib
import importlib.util
import io
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import yaml
from sybil import Example

from page_runner import elsewhere
from page_runner.background import READY, background_program
from page_runner.blocks import ALIASES, Block, PageError
from page_runner.command_lines import program_words, split_commands
from page_runner.output import difference
from page_runner.page import Page

ROOT = Path(__file__).parents[2]
PAGE = "__page__"  # of the namespace of a page
PROGRAMS = {
    *("robot-dynamics", "python", "python3", "cc", "gcc", "c++", "g++", "cmake", "bash", "sh", "octave"),
    *("cat", "ls", "head", "tail", "wc", "grep", "diff", "echo", "mkdir", "cp", "mv", "rm", "export", "test"),
}


def set_up(namespace: dict[str, object]) -> None:
    """Begin a page."""
    namespace[PAGE] = Page()
    namespace["__name__"] = "__main__"


def tear_down(namespace: dict[str, object]) -> None:
    """End a page and all that it started."""
    page = namespace.pop(PAGE)
    assert isinstance(page, Page)
    page.close()


def evaluate_block(example: Example) -> None:
    """Run, write or check a block. Raises AssertionError if it fails."""
    block: Block = example.parsed
    page: Page = example.namespace[PAGE]
    with page.active():
        if block.file is not None:
            file = Path(block.file)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(block.source, encoding="utf-8")
        elif block.language in ("python", "bash"):
            run = run_python if block.language == "python" else run_bash
            output = run(example)
            if block.output is not None:
                text = difference(block.output, output)
                assert not text, text
        else:
            _check_snippet(block)


def _check_snippet(block: Block) -> None:
    """What holds for blocks that are neither run nor written."""
    if block.language == "text":
        raise PageError("a block of text is an output: put it directly behind its block, or give it no language")
    if block.language in ALIASES:
        raise PageError(f"write ```{ALIASES[block.language]} in the place of ```{block.language}, which is not run")
    if block.language in ("yaml", "yml"):
        list(yaml.safe_load_all(block.source))


def run_python(example: Example) -> str:
    """Execute a block of Python in the namespace of its page and return what it prints."""
    code = compile("\n" * example.line + example.parsed.source, example.path, "exec", dont_inherit=True)
    with contextlib.redirect_stdout(io.StringIO()) as stream:
        exec(code, example.namespace)
    return stream.getvalue()


def run_bash(example: Example) -> str:
    """Run the commands of a block and return what they print."""
    page: Page = example.namespace[PAGE]
    return "".join(run_one(page, command, example.parsed.output) for command in split_commands(example.parsed.source))


def run_one(page: Page, command: str, expected_output: str | None) -> str:
    """Run one command; a refusal by a node is a failure unless the page shows an output."""
    if elsewhere.entry_for(command) is not None:
        return ""
    program, *arguments = program_words(command)
    if background_program([program, *arguments]) is not None:
        return page.nodes.start(command)
    if program == "ros2":
        from page_runner.ros_commands import RefusalError

        try:
            return page.ros.carry_out(arguments)
        except RefusalError as refusal:
            if expected_output is None:
                raise
            return refusal.output
    known = program in PROGRAMS or program in READY or program.startswith("./")
    assert known, (
        f"the runner of pages does not know the program {program!r}: add it to PROGRAMS in "
        "test/page_runner/evaluation.py if it can run, or to test/page_runner/elsewhere.py"
    )
    return page.run_command(command)


def evaluate_set_up(example: Example) -> None:
    """Make the files of named set-ups: `% setup: run run_loaded`."""
    page: Page = example.namespace[PAGE]
    fixtures = page_fixtures()
    for name in example.parsed:
        make: Callable[[Path], None] | None = getattr(fixtures, name, None)
        if make is None:
            raise PageError(f"docs/page_fixtures.py has no function {name}")
        with page.active():
            make(page.folder)


def evaluate_end(example: Example) -> None:
    """`% end: nodes`: end all nodes and publications that the page has started."""
    if example.parsed != ["nodes"]:
        raise PageError("write `% end: nodes`")
    example.namespace[PAGE].end_nodes()


def page_fixtures() -> ModuleType:
    """The module docs/page_fixtures.py."""
    specification = importlib.util.spec_from_file_location("page_fixtures", ROOT / "docs" / "page_fixtures.py")
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module
