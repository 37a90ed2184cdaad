"""The command `robot-dynamics` as `python -m robot_dynamics`."""

import sys

from robot_dynamics.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
