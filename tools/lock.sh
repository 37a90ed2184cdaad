#!/bin/sh
# Writes requirements/constraints.txt and requirements/apt_jazzy.txt: the versions of everything that
# requirements/*.in lead to. Run by `make lock`.

set -eu
cd "$(dirname "$0")/.."

if ! uv --version >/dev/null 2>&1; then
    echo "lock: uv is not on PATH; install it (pip install uv)" >&2
    exit 1
fi

versions=$(mktemp)
overrides=$(mktemp)
trap 'rm -f "$versions" "$overrides"' EXIT

# compile <file to write> <options and files of uv...>: the file has the header from stdin.
# Versions already there are kept where they still fit; to take newer ones delete the file first.
compile() {
    written=$1
    shift
    : >"$versions"
    if [ -f "$written" ]; then
        cp "$written" "$versions"
    fi
    uv pip compile --quiet --no-header --no-emit-index-url --no-emit-find-links "$@" --output-file "$versions"
    sed -i "/#   --override /d" "$versions"  # the name of a temporary file
    cat - "$versions" >"$written"
}

compile requirements/constraints.txt --universal --python-version 3.10 \
    --extra all pyproject.toml requirements/demo.in requirements/test.in requirements/docs.in requirements/colcon.in <<'HEADER'
# Versions of everything that pyproject.toml and requirements/*.in lead to, for Python 3.10 to 3.13.
# Written by `make lock` (uv pip compile --universal); do not edit.
HEADER

# Wheels built for NumPy 2 run with 1.26 too, whatever they ask for. lark-parser is an older lark under another name.
cat >"$overrides" <<'OVERRIDES'
numpy==1.26.4
lark-parser ; sys_platform == "never"
OVERRIDES
compile requirements/apt_jazzy.txt --python-version 3.12 --override "$overrides" requirements/apt_jazzy.in <<'HEADER'
# Everything that requirements/apt_jazzy.in leads to, to be installed without looking for more (pip --no-deps).
# Written by `make lock` (uv pip compile); do not edit.
HEADER
