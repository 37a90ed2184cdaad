"""Run the node mobile_base_simulator: `python -m robot_dynamics.nodes.mobile_base_simulator`."""

from robot_dynamics.nodes.mobile_base_simulator.node import main

if __name__ == "__main__":
    main()
