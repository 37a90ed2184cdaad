#!/bin/sh
# Writes the lists requirements/*.txt: the versions and hashes of everything that requirements/*.in lead to.
# Run by `make lock`.

set -eu
cd "$(dirname "$0")/.."

if ! uv --version >/dev/null 2>&1; then
    echo "lock: uv is not on PATH; install it (pip install uv)" >&2
    exit 1
fi
python=$(WANTED=3.12 sh tools/find_python.sh)

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# compile <list to write> <options and files of uv...>: the list has the header from stdin.
# Versions already there are kept where they still fit; to take newer ones delete the list first.
compile() {
    written=$1
    shift
    sed -E 's/ \\$//; /^ +--hash=/d' "$written" >"$scratch/versions" 2>/dev/null || : >"$scratch/versions"
    uv pip compile --quiet --no-header --no-emit-index-url --no-emit-find-links "$@" --output-file "$scratch/versions"
    cp "$scratch/versions" "$scratch/exactly"
    uv pip compile --quiet "$@" --constraint "$scratch/exactly" --format pylock.toml --output-file "$scratch/pylock.toml"
    sed -i "/#   --override /d" "$scratch/versions"  # the name of a temporary file
    "$python" tools/lock_hashes.py "$scratch/versions" "$scratch/pylock.toml" >"$scratch/with_hashes"
    cat - "$scratch/with_hashes" >"$scratch/whole"
    cp "$scratch/whole" "$written"
}

# part <name> <what is in it> <options and files of uv...>: a list of some packages of constraints.txt.
part() {
    name=$1
    about=$2
    shift 2
    compile "requirements/$name.txt" --universal --python-version 3.10 --no-annotate \
        --constraint "$scratch/constraints.txt" "$@" <<HEADER
# $about, as in constraints.txt.
# Written by \`make lock\` (uv pip compile --universal); do not edit.
HEADER
}

compile requirements/constraints.txt --universal --python-version 3.10 --extra all pyproject.toml \
    requirements/demo.in requirements/test.in requirements/docs.in requirements/build.in requirements/colcon.in <<'HEADER'
# Versions of everything that pyproject.toml and requirements/*.in lead to, for Python 3.10 to 3.13, and the hashes of
# their files for Linux on x86-64. `make test` installs all of it, the other targets parts, which are lists beside it.
# Written by `make lock` (uv pip compile --universal); do not edit.
HEADER
sed -E 's/ \\$//; /^ +--hash=/d' requirements/constraints.txt >"$scratch/constraints.txt"

part setuptools "What builds packages" requirements/setuptools.in
part build "Everything that building both wheels needs" requirements/build.in
part demo "Everything that 'make demo' needs" --extra compiled --extra bags pyproject.toml requirements/demo.in
part docs "Everything that 'make docs' needs besides 'make demo'" --extra all pyproject.toml requirements/docs.in
part colcon "Everything that 'make colcon' needs besides 'make demo'" requirements/colcon.in

compile requirements/opensees.txt --python-version 3.10 --no-deps requirements/opensees.in <<'HEADER'
# OpenSees for tests of beams. Written by `make lock` (uv pip compile); do not edit.
HEADER

# Wheels built for NumPy 2 run with 1.26 too, whatever they ask for. lark-parser is an older lark under another name.
cat >"$scratch/overrides" <<'OVERRIDES'
numpy==1.26.4
lark-parser ; sys_platform == "never"
OVERRIDES
compile requirements/apt_jazzy.txt --python-version 3.12 --override "$scratch/overrides" requirements/apt_jazzy.in \
    <<'HEADER'
# Everything that requirements/apt_jazzy.in leads to, to be installed without looking for more (pip --no-deps).
# Written by `make lock` (uv pip compile); do not edit.
HEADER
