"""What measurements tell of a robot: base parameters, and later the values that fit."""
