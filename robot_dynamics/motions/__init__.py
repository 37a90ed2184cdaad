"""What motions cost: efforts against limits, energy, scaling of time, and re-timing."""
