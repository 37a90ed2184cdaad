"""Errors of procedures, found while they are staged."""


class ProcedureError(TypeError):
    """A procedure breaks a rule.

    Parameters
    ----------
    reason : str
    location : str
        Function, file and line.
    """

    def __init__(self, reason: str, location: str) -> None:
        super().__init__(f"{reason} ({location})" if location else reason)


class LanesError(TypeError):
    """A procedure does what has no form for several samples at once."""
