"""The text of a description: read, decoded, neither empty nor endless."""

from robot_dynamics.errors import DescriptionError

UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")


def decode_text(text, source, expected, max_length, encoding="utf-8-sig"):
    """The str of a description given as str, or as bytes as read from a file.

    source: what to call it in errors; need: what it should be, for errors; largest: characters it may have; encoding:
    of bytes without a UTF-16 byte order mark. Raises DescriptionError.
    """
    if len(text) > max_length:
        raise DescriptionError(
            f"{source} has {len(text)} characters: more than {max_length} are not read for {expected}"
        )
    if isinstance(text, bytes):
        if text[:2] in UTF16_MARKS:
            encoding = "utf-16"
        try:
            text = text.decode(encoding)
        except (UnicodeError, LookupError) as error:
            raise DescriptionError(f"{source} cannot be decoded: {error}. Save it as UTF-8") from None
    text = text.removeprefix("\ufeff")
    if not text.strip():
        raise DescriptionError(f"{source} is empty: {expected} is needed")
    return text


def read_file_bytes(path, max_length):
    """The content (bytes) of the file at a Path. Raises DescriptionError where there is none, or a larger one."""
    told = repr(str(path)[:200])
    try:
        if path.exists() and not path.is_file():
            raise DescriptionError(f"{told} is no file")
        with path.open("rb") as file:
            content = file.read(max_length + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DescriptionError(f"{told} cannot be read as a file ({reason})") from None
    if len(content) > max_length:
        raise DescriptionError(f"{told} is larger than a description may be: {max_length} bytes at most")
    return content
