"""Adds hashes to a list of pinned packages: `lock_hashes.py <list> <pylock.toml of the same packages>`, for lock.sh.

Prints the list with the SHA-256 of each file that may be installed: wheels for the Pythons and the machines that
tools/bootstrap.py accepts, and the source of packages that have no wheel. Needs Python 3.11.
"""

import re
import sys
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlparse

import tomllib

PINNED = re.compile(r"^(?P<name>[\w.-]+)==(?P<version>\S+)(?P<marker> ;.*)?$")
PYTHON_TAGS = {"cp310", "cp311", "cp312", "cp313"}
# Packages without wheels. tools/hashed_packages.py lets pip build these, and no others.
BUILT_PACKAGES = ("empy",)


def fits(wheel: str) -> bool:
    """Return whether a wheel of this name runs on CPython 3.10 to 3.13 of Linux on x86-64 with glibc."""
    pythons, abis, platforms = (tags.split(".") for tags in wheel.removesuffix(".whl").split("-")[-3:])
    if platforms != ["any"] and not any(re.fullmatch(r"(many)?linux.*_x86_64", platform) for platform in platforms):
        return False
    if "abi3" in abis:
        return any(re.fullmatch(r"cp3\d?|cp31[0-3]", python) for python in pythons)
    return any((python, abi) == ("py3", "none") for python in pythons for abi in abis) or any(
        python in PYTHON_TAGS and abi in (python, "none") for python in pythons for abi in abis
    )


def file_name(file: dict) -> str:
    return unquote(PurePosixPath(urlparse(file["url"]).path).name)


def hashes_of_packages(lock: dict) -> dict[tuple[str, str], list[str]]:
    """Return {(name, version): SHA-256 of the files that fit}."""
    hashes = {}
    for package in lock["packages"]:
        files = [file for file in package.get("wheels", []) if fits(file_name(file))]
        if package["name"] in BUILT_PACKAGES:
            files.append(package["sdist"])
        hashes[package["name"], package["version"]] = sorted(file["hashes"]["sha256"] for file in files)
    return hashes


def with_hashes(text: str, hashes: dict[tuple[str, str], list[str]]) -> str:
    """Return the list with the hashes below each package; raise ValueError where there are none."""
    lines = []
    for line in text.splitlines():
        pinned = PINNED.match(line)
        if pinned is None:
            lines.append(line)
            continue
        package = (pinned["name"], pinned["version"])
        if not hashes.get(package) and "sys_platform ==" not in (pinned["marker"] or ""):
            raise ValueError(f"{'=='.join(package)} has no wheel for Linux on x86-64")
        files = [f"    --hash=sha256:{digest}" for digest in hashes.get(package, [])]
        lines.extend(" \\\n".join([line, *files]).split("\n"))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    listed, locked = map(Path, sys.argv[1:])
    sys.stdout.write(with_hashes(listed.read_text(), hashes_of_packages(tomllib.loads(locked.read_text()))))
