"""Run the node dynamics_server: `python -m robot_dynamics.nodes.dynamics_server`."""

from robot_dynamics.nodes.dynamics_server.node import main

if __name__ == "__main__":
    main()
