"""The targets of the Makefile: those that the documentation names exist, the CI runs them, and lists are complete."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def test_make_targets_of_the_documentation_exist():
    for page in PAGES:
        for target in set(re.findall(r"(?:^|`)make ([a-z]+)", page.read_text(encoding="utf-8"), re.MULTILINE)):
            assert re.search(rf"^{target}:", MAKEFILE, re.MULTILINE), f"{page.name}: make {target}"


def test_targets_that_users_need_run_in_the_ci():
    ci = "".join((ROOT / ".ci" / name).read_text(encoding="utf-8") for name in ("run", "unusual_setup"))
    for target in ("demo", "test", "lint", "colcon"):
        assert f"make {target}" in ci, target


def test_real_time_tests_are_listed_in_the_makefile():
    """`make test` runs the tests that REAL_TIME lists by themselves."""
    lines = re.findall(r"^REAL_TIME \+?= (.*)$", MAKEFILE, re.MULTILINE)
    listed, folder = " ".join(lines).split(), ROOT / "test" / "nodes"
    assert all((folder / f"test_{name}.py").is_file() for name in listed)
    streaming = {path.stem.removeprefix("test_") for path in folder.glob("test_streaming_*.py")}
    assert len(streaming) >= 3 and streaming <= set(listed)
