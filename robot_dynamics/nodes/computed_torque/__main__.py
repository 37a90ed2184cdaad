"""Run the node computed_torque: `python -m robot_dynamics.nodes.computed_torque`."""

from robot_dynamics.nodes.computed_torque.node import main

if __name__ == "__main__":
    main()
