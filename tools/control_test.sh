#!/bin/sh
# Builds robot_dynamics_control with the compiler of this machine, without ROS, tests it, and measures updates. Run by
# `make control`.

set -eu
cd "$(dirname "$0")/.."

export PATH="$PWD/.venv/bin:$PATH" OMP_NUM_THREADS=1
folder=build/control

cmake -S robot_dynamics_control -B "$folder" -G Ninja -DCMAKE_DISABLE_FIND_PACKAGE_ament_cmake=ON \
    -DPython3_EXECUTABLE="$PWD/.venv/bin/python" -DROBOT_DYNAMICS_EXECUTABLE="$PWD/.venv/bin/robot-dynamics"
cmake --build "$folder" --parallel 2
ctest --test-dir "$folder" --output-on-failure --no-tests=error -j 2
"$folder/test/update_times"
