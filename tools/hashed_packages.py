"""Installs lists of packages of which each file must have a hash that the list names.

`hashed_packages.py <Python of an environment> <list>` does it for shell scripts; tools/bootstrap.py imports this file.
"""

import os
import re
import sys

OPTIONS = (
    "--require-hashes",
    "--no-deps",  # the lists are complete
    # What pip builds, it builds with the setuptools of the environment, which has a hash. All else are wheels.
    "--only-binary=:all:",
    "--no-binary=empy",
    "--no-build-isolation",
    "--use-pep517",
)
# Settings of pip, as a user may have them for other purposes, with which these lists cannot be installed.
FOREIGN_VARIABLES = (
    "PIP_USER",
    "PIP_TARGET",
    "PIP_PREFIX",
    "PIP_REQUIRE_VIRTUALENV",
    "PIP_REQUIRE_HASHES",
    "PIP_CONSTRAINT",
    "PIP_BUILD_CONSTRAINT",
    "PIP_NO_BINARY",
    "PIP_ONLY_BINARY",
)
MISMATCH = re.compile(r"^ +(\S+==\S+)\s.*\n(?:^ +(?:Expected|or).*\n)+?^ +Got +(\w+)", re.MULTILINE)


def install_command(python, requirements):
    """Return the command that installs the list `requirements` into the environment of `python`."""
    return [str(python), "-m", "pip", "install", *OPTIONS, "-r", str(requirements)]


def explain(output, requirements):
    """Return in one line which file has another hash than the list names; None if pip failed for another reason."""
    mismatches = [f"{package} (sha256 {digest})" for package, digest in MISMATCH.findall(output)]
    if not mismatches:
        return None
    return (
        f"not installed: {', '.join(mismatches)} is not a file that {requirements} names by its hash; the package "
        "index or a proxy gave another file than the one that was checked. Look at the index that pip is set up "
        "to use (pip config list), and try again without its cache (PIP_NO_CACHE_DIR=1)"
    )


if __name__ == "__main__":
    environment = {name: value for name, value in os.environ.items() if name not in FOREIGN_VARIABLES}
    command = install_command(*sys.argv[1:])
    os.execve(command[0], [*command, "--quiet"], environment)
