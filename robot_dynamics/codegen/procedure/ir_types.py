"""Types of LLVM IR."""


def ir_type(element: str, lanes: int) -> str:
    """The type of a value, or of a vector with a value for each of several lanes."""
    return element if lanes == 1 else f"<{lanes} x {element}>"
