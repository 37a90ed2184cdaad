"""Names in figures of Matplotlib, which takes text between dollar signs for a formula."""


def plain_label(name: str) -> str:
    """Return a name as text for a figure; a formula with an error would end the drawing."""
    return name.replace("$", r"\$")
