#!/bin/sh
# Writes requirements/constraints.txt: the versions of everything that requirements/*.in lead to. Run by `make lock`.

set -eu
cd "$(dirname "$0")/.."

if ! uv --version >/dev/null 2>&1; then
    echo "lock: uv is not on PATH; install it (pip install uv)" >&2
    exit 1
fi

# Versions already there are kept where they still fit; to take newer ones delete the file first.
versions=$(mktemp)
trap 'rm -f "$versions"' EXIT
if [ -f requirements/constraints.txt ]; then
    cp requirements/constraints.txt "$versions"
fi
uv pip compile --universal --python-version 3.10 --quiet --no-header --no-emit-index-url --no-emit-find-links \
    requirements/venv.in requirements/colcon.in --output-file "$versions"

cat - "$versions" >requirements/constraints.txt <<'HEADER'
# Versions of everything that requirements/*.in lead to, for Python 3.10 to 3.13.
# Written by `make lock` (uv pip compile --universal); do not edit.
HEADER
