"""The ROS 2 nodes: messages in, arrays through the door, messages out."""
