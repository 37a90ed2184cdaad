"""Reading and decoding of description files, with limits on their size."""

import codecs
from pathlib import Path

from robot_dynamics.errors import DescriptionError

MAX_DESCRIPTION_LENGTH = 10 * 1024 * 1024
"""Most characters of a description; the largest real ones have half a million."""

PYTHON_CODECS = ("punycode", "idna", "unicode_escape", "raw_unicode_escape", "undefined")
"""Codecs of Python that are no character sets: no file has them, and decoding may take quadratic time."""

UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")


def decode_text(text: str | bytes, source: object, expected: str, max_length: int, encoding: str = "utf-8-sig") -> str:
    """Return the text of a description.

    Parameters
    ----------
    text : str or bytes
        The description, or the bytes of its file.
    source : object
        Name of the description in error messages.
    expected : str
        What the text should be, for error messages.
    max_length : int
        Maximum number of characters.
    encoding : str
        Encoding of bytes without a UTF-16 byte order mark.

    Raises
    ------
    DescriptionError
        If the text is too long or empty, or cannot be decoded.
    """
    if len(text) > max_length:
        raise DescriptionError(
            f"{source} has {len(text)} characters: more than {max_length} are not read for {expected}"
        )
    if isinstance(text, bytes):
        if text[:2] in UTF16_MARKS:
            encoding = "utf-16"
        try:
            if codecs.lookup(encoding).name.replace("-", "_") in PYTHON_CODECS:
                raise LookupError(f"{encoding} is no character set")
            text = text.decode(encoding)
        except (UnicodeError, LookupError) as error:
            raise DescriptionError(f"{source} cannot be decoded: {error}. Save it as UTF-8") from None
    text = text.removeprefix("\ufeff")
    if not text.strip():
        raise DescriptionError(f"{source} is empty: {expected} is needed")
    return text


def read_file_bytes(path: Path, max_length: int) -> bytes:
    """Return the content of a file. Raises DescriptionError where it cannot be read or is longer than max_length."""
    name = repr(str(path)[:200])
    try:
        if path.exists() and not path.is_file():
            raise DescriptionError(f"{name} is not a file")
        with path.open("rb") as file:
            content = file.read(max_length + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DescriptionError(f"{name} cannot be read as a file ({reason})") from None
    if len(content) > max_length:
        raise DescriptionError(f"{name} is too large: a description has at most {max_length} bytes")
    return content
