"""Run the node contact_monitor: `python -m robot_dynamics.nodes.contact_monitor`."""

from robot_dynamics.nodes.contact_monitor.node import main

if __name__ == "__main__":
    main()
