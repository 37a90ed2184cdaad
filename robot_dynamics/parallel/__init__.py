"""Parallel robots: geometry, kinematics and dynamics in coordinates of the platform, springs in legs, pose maps."""
