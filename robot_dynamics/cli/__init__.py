"""The command robot-dynamics, with one file for each verb."""
