#!/bin/sh
# Builds the three packages with colcon on top of the ROS wheels in .venv, as a ROS workspace would. Run by `make colcon`.

set -eu
cd "$(dirname "$0")/.."

case $PWD in
*[[:space:]\(\)\&\;\'\"]*)
    echo "colcon: ament_cmake cannot build in a folder whose path has spaces, quotes or brackets in it: $PWD" >&2
    exit 1
    ;;
esac

# What `source /opt/ros/jazzy/setup.sh` does for a ROS that is installed the usual way.
export PATH="$PWD/.venv/bin:$PATH"
export AMENT_PREFIX_PATH="$PWD/.venv"
export CMAKE_PREFIX_PATH="$PWD/.venv"

# colcon does not look for packages inside a package, so the nested ones are named. That .venv holds two of them
# already, installed by `make venv`, is meant: what is built here goes before it.
exec .venv/bin/colcon build --base-paths . robot_dynamics_interfaces robot_dynamics_control \
    --allow-overriding robot_dynamics robot_dynamics_interfaces \
    --cmake-args -G Ninja "-DPython3_EXECUTABLE=$PWD/.venv/bin/python" -DBUILD_TESTING=OFF
