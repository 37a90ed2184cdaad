"""Run the node payload_identifier: `python -m robot_dynamics.nodes.payload_identifier`."""

from robot_dynamics.nodes.payload_identifier.node import main

if __name__ == "__main__":
    main()
