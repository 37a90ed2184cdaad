"""Colours that the report and the figures of a check have in common."""

MEASURED = "#1f6fb4"
PREDICTED = "#e07b00"
RESIDUAL = "#57606a"
FAILED = "#d1242f"
