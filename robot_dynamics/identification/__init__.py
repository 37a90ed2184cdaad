"""Identification of robot parameters from recordings: base parameters, excitation trajectories, fits."""
