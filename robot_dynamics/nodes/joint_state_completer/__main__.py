"""Run the node joint_state_completer: `python -m robot_dynamics.nodes.joint_state_completer`."""

from robot_dynamics.nodes.joint_state_completer.node import main

if __name__ == "__main__":
    main()
