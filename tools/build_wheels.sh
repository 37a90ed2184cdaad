#!/bin/sh
# Builds the wheel of robot_dynamics, and one wheel of robot_dynamics_interfaces for each Python that is named, into
# dist/. Without arguments it takes the Python that `make venv` would take. Run by `make wheels`.

set -eu
cd "$(dirname "$0")/.."

if [ $# = 0 ]; then
    set -- "$(sh tools/find_python.sh)"
fi
tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT

PIP_DISABLE_PIP_VERSION_CHECK=1
export PIP_DISABLE_PIP_VERSION_CHECK

for python; do
    rm -rf "$tools/venv"
    "$python" -m venv "$tools/venv"
    for list in setuptools build; do
        "$python" tools/hashed_packages.py "$tools/venv/bin/python" "requirements/$list.txt"
    done
    if [ ! -e "$tools/built" ]; then
        # the wheel from the source distribution: files left in build/ by earlier builds do not get into it
        rm -f dist/robot_dynamics-*
        "$tools/venv/bin/python" -m build --no-isolation --outdir dist .
        touch "$tools/built"
    fi
    PATH="$tools/venv/bin:$PATH" "$tools/venv/bin/python" -m build --no-isolation --wheel --outdir dist robot_dynamics_interfaces
done
ls -l dist
