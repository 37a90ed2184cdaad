"""The ROS 2 nodes: they convert messages into arrays, compute with `Dynamics`, and convert results into messages."""
