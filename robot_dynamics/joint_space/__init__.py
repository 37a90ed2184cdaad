"""Dynamic models in joint space: the base classes of Dynamics, one idea a file."""
