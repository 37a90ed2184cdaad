"""Text in figures of Matplotlib, which takes text between dollar signs for a formula."""

MAX_LENGTH = 60


def plain_label(name: str) -> str:
    """Return a name as text for a figure, in one line; a formula with an error would end the drawing."""
    text = "".join(character if character.isprintable() else " " for character in name)
    text = text if len(text) <= MAX_LENGTH else text[: MAX_LENGTH - 1] + "…"
    return text.replace("$", r"\$")
