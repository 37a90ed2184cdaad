"""The commands of a bash block."""

import re
import shlex

ASSIGNMENT = re.compile(r"[A-Za-z_]\w*=.*", re.DOTALL)
HERE_DOCUMENT = re.compile(r"<<-?\s*(['\"]?)(\w+)\1")


def split_commands(block: str) -> list[str]:
    """The commands of a bash block: lines, joined where a quote, a backslash or a here-document goes on."""
    commands, pending = [], ""
    for line in block.splitlines():
        pending = f"{pending}\n{line}" if pending else line
        if _is_complete(pending):
            if words(pending):
                commands.append(pending.strip())
            pending = ""
    if pending.strip():
        raise ValueError(f"a command does not end: {pending}")
    return commands


def words(command: str) -> list[str]:
    """The words of a command, without comments."""
    return shlex.split(command, comments=True)


def program_words(command: str) -> list[str]:
    """The words from the program on: assignments of variables in front of it are left out."""
    command_words = words(command)
    while command_words and ASSIGNMENT.fullmatch(command_words[0]):
        del command_words[0]
    return command_words


def _is_complete(text: str) -> bool:
    here_document = HERE_DOCUMENT.search(text)
    if here_document:
        return text.splitlines()[-1].strip() == here_document[2]
    if text.endswith("\\"):
        return False
    try:
        words(text)
    except ValueError:  # an open quote
        return False
    return True
