#!/bin/sh
# Prints the path of a Python that `make venv` can use: $PYTHON if it is set, else the one that .venv was made
# with, else the first on PATH that fits. With WANTED=3.12 it is of that version, and one of pyenv will do too.
# Each is run, because a name on PATH may be a shim that leads nowhere.

cd "$(dirname "$0")/.." || exit 1

report() {
    "$1" -c 'import os, sys
wanted = os.environ.get("WANTED")
version = sys.version_info[:2]
if "{}.{}".format(*version) == wanted if wanted else (3, 10) <= version <= (3, 13):
    # the Python behind a virtual environment: the environment may be the one that is to be remade
    print(os.path.realpath(getattr(sys, "_base_executable", sys.executable)))' 2>/dev/null
}

range=${WANTED:-3.10 to 3.13}

if [ -n "${PYTHON:-}" ]; then
    found=$(report "$PYTHON")
    if [ -z "$found" ]; then
        echo "find_python: PYTHON=$PYTHON is not a Python $range that runs; name one that is" >&2
        exit 1
    fi
    echo "$found"
    exit 0
fi

# 3.12 is the Python of ROS 2 Jazzy.
for candidate in "$(readlink -f .venv/bin/python)" python3.12 python3.13 python3.11 python3.10 python3 python \
    ${WANTED:+"$HOME"/.pyenv/versions/"$WANTED".*/bin/python}; do
    [ -n "$candidate" ] || continue
    found=$(report "$candidate")
    if [ -n "$found" ]; then
        echo "$found"
        exit 0
    fi
done
echo "find_python: no Python $range that runs on PATH; install one (apt install python3-dev python3-venv)" \
    "or name it: PYTHON=/path/to/python${WANTED:-3.12} make ..." >&2
exit 1
