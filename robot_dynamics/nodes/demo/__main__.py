"""Run the demo: `python -m robot_dynamics.nodes.demo`."""

import sys

from robot_dynamics.nodes.demo.demo import main

if __name__ == "__main__":
    sys.exit(main())
