"""The command robot-dynamics: one verb, one file."""
