"""What verbs write: files, their endings and folders, the protection of input files, and a closed standard output."""

import os
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from robot_dynamics.errors import InvalidInputError, RobotDynamicsError
from robot_dynamics.file_output import replaced_file
from robot_dynamics.model.loading import shipped_robots

# Arguments of all verbs that name input and output files.
INPUT_ARGUMENTS = (
    *("recordings", "validate", "empty", "robot", "values", "drives", "tolerances", "golden", "baseline", "motion"),
)
OUTPUT_ARGUMENTS = ("target", "output", "output_drives", "json", "junit", "report", "csv", "write_golden")
RECORDING_SUFFIXES = (".mcap", ".db3", ".csv", ".yaml")  # endings of the files in the folder of a recording
YAML_ENDINGS = (".yaml", ".yml")
YAML_HINT = "The verb convert converts a robot in YAML to a URDF or a .par"


def check_ending(path: str | Path, endings: Iterable[str], option: str = "", hint: str = "") -> str:
    """Check that an output path has one of the allowed endings, and return its ending in lower case.

    option: option that gives the path, empty for a positional argument; hint: sentence for the end of the message.
    Raises InvalidInputError.
    """
    ending = Path(path).suffix.lower()
    if ending not in endings:
        *others, last = endings
        allowed = f"{', '.join(others)} or {last}" if others else last
        label = f"{option} {path}".strip()
        message = f"{label}: the path of the output file must end with {allowed}"
        raise InvalidInputError(f"{message}. {hint}" if hint else message)
    return ending


@contextmanager
def output_file(path: str | Path) -> Iterator[Path]:
    """Yield the path of a file to write in the block, which then takes the place of the file; creates its folder.

    Raises RobotDynamicsError if the folder or the file cannot be written; the file that was there has not changed.
    """
    with _refused_if_unwritable(path):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        with replaced_file(path) as file:
            yield file


@contextmanager
def _refused_if_unwritable(path: str | Path) -> Iterator[None]:
    """Raise RobotDynamicsError if the block cannot write a path."""
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: the name contains a null character
        reason = getattr(error, "strerror", None) or error
        raise RobotDynamicsError(f"{str(path)[:200]} cannot be written: {reason}") from None


def write_text(path: str | Path, text: str) -> None:
    """Write a text to a file. Raises RobotDynamicsError."""
    with output_file(path) as file:
        file.write_text(text, encoding="utf-8")


def check_writable(path: str | Path) -> None:
    """Check before a long computation that its result can be written to a file. Raises RobotDynamicsError."""
    file = Path(path)
    with _refused_if_unwritable(path):
        file.parent.mkdir(parents=True, exist_ok=True)
        existed = file.exists()
        if existed and not file.is_file() and not file.is_dir():
            return  # a pipe or a device: opening it would be seen at its other end
        with file.open("ab"):
            pass
        if not existed:
            file.unlink()


def check_writable_folder(path: str | Path) -> None:
    """Create a folder, and check that files can be written to it. Raises RobotDynamicsError."""
    folder = Path(path)
    with _refused_if_unwritable(path):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass


@contextmanager
def allow_closed_stdout() -> Iterator[None]:
    """Print in the block, also where the reader of stdout, such as a pager or `head`, has closed the pipe."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        discard_stdout()


def discard_stdout() -> None:
    """Redirect stdout to the null device, so that flushing it at exit does not fail."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def refuse_overwriting(arguments: Namespace) -> None:
    """Raise RobotDynamicsError if the verb would overwrite one of its input files."""
    shipped = shipped_robots()
    inputs = [Path(shipped.get(str(name), name)) for name in _argument_paths(arguments, INPUT_ARGUMENTS)]
    files = [file for path in inputs for file in _input_files(path)]
    for output in map(Path, _argument_paths(arguments, OUTPUT_ARGUMENTS)):
        try:
            overwrites = output.exists() and any(output.samefile(file) for file in files)
        except (OSError, ValueError):  # an invalid name: writing the file reports it
            continue
        if overwrites:
            raise RobotDynamicsError(f"{output} is an input file of this command: choose another output path")


def _argument_paths(arguments: Namespace, names: Iterable[str]) -> Iterator[str | Path]:
    """Yield the paths of those arguments that the verb has and the user has set."""
    for name in names:
        value = getattr(arguments, name, None) or ()
        yield from (value,) if isinstance(value, str | Path) else value


def _input_files(path: Path) -> Iterator[Path]:
    """Yield the files that are read from an input path: the file, or the files in the folder of a recording."""
    try:
        if path.is_dir():
            yield from (file for file in path.iterdir() if file.suffix in RECORDING_SUFFIXES)
        elif path.exists():
            yield path
    except (OSError, ValueError):  # reading the file reports the error
        return
