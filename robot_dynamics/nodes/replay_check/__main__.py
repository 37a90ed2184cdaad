"""Run the node replay_check: `python -m robot_dynamics.nodes.replay_check`."""

from robot_dynamics.nodes.replay_check.node import main

if __name__ == "__main__":
    main()
