"""Recordings checked against the model: comparison, faults, live check, report.

Public: `check`, `CheckResult` and `Verdict` (check), `Comparison` and `JointComparison` (comparison), `load_tolerances`
and `Tolerances` (tolerances), `Evidence` (faults), `Fault` (fault_search), `LiveCheck` (live_check).
"""
