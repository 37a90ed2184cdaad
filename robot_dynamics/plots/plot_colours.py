"""Colours of pictures and pages."""

COLOURS = ("#0072b2", "#e69f00", "#000000", "#56b4e9", "#d55e00", "#cc79a7")
"""Of curves: colours of Okabe and Ito, in an order in which neighbours differ in brightness too."""
MEASURED = COLOURS[0]
PREDICTED = "#d55e00"
RESIDUAL = "#57606a"
FAILED = "#d1242f"
CONDITION_COLOURS = "viridis_r"
"""Of condition numbers: bright where the motors hold the platform well."""
EFFORT_COLOURS = "cividis"
