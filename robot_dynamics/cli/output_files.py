"""Files that verbs write."""

from contextlib import contextmanager
from pathlib import Path

from robot_dynamics.errors import DescriptionError, RobotDynamicsError
from robot_dynamics.model.loading import shipped_robots

INPUT_ARGUMENTS = (
    "recordings",
    "validate",
    "robot",
    "values",
    "drives",
    "tolerances",
    "golden",
)  # arguments of all verbs
OUTPUT_ARGUMENTS = ("target", "output", "output_drives", "json", "report", "csv", "write_golden")
RECORDING_SUFFIXES = (".mcap", ".db3", ".csv", ".yaml")  # endings of files in the folder of a recording
YAML_SUFFIXES = (".yaml", ".yml")


@contextmanager
def output_file(path):
    """Yields the Path of a file for the block to write, its folder made where it is not there. Raises
    RobotDynamicsError where the system refuses one of the two."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield path
    except (OSError, ValueError) as error:  # the latter of names that no file can have
        reason = getattr(error, "strerror", None) or error
        raise RobotDynamicsError(f"{str(path)[:200]} cannot be written: {reason}") from None


def write_text(path, text):
    """Write a text into the file at a path. Raises RobotDynamicsError."""
    with output_file(path) as file:
        file.write_text(text, encoding="utf-8")


def check_writable(path):
    """Refuse a file that cannot be written before hours are spent on what goes into it. Raises RobotDynamicsError."""
    with output_file(path) as file, file.open("ab"):
        pass
    if not file.stat().st_size:
        file.unlink()


def refuse_overwriting(arguments):
    """Refuse parsed arguments by which a verb would write over what it reads. Raises RobotDynamicsError."""
    shipped = shipped_robots()
    read = [Path(shipped.get(str(name), name)) for name in _paths(arguments, INPUT_ARGUMENTS)]
    for output in map(Path, _paths(arguments, OUTPUT_ARGUMENTS)):
        try:
            if output.exists() and any(output.samefile(file) for path in read for file in _files(path)):
                raise RobotDynamicsError(f"{output} is what was read: write to another file")
        except (OSError, ValueError):  # a name that no file can have: writing says so
            pass


def check_yaml_suffix(option, path):
    """Refuse a path (None: there is none) at which a YAML would be taken for something else. Raises
    DescriptionError."""
    if path is not None and Path(path).suffix not in YAML_SUFFIXES:
        raise DescriptionError(f"{option} {path}: YAML is written: a file that ends with {' or '.join(YAML_SUFFIXES)} is "
                               "needed; `convert` makes a URDF or .par of a robot in YAML")  # fmt: skip


def _paths(arguments, names):
    """Paths, as they were typed, of those arguments that a verb has and that were given."""
    for name in names:
        value = getattr(arguments, name, None) or ()
        yield from (value,) if isinstance(value, str | Path) else value


def _files(path):
    """The files that are read of a path: itself, and those of the folder of a recording."""
    try:
        if path.is_dir():
            yield from (file for file in path.iterdir() if file.suffix in RECORDING_SUFFIXES)
        elif path.exists():
            yield path
    except (OSError, ValueError):  # reading says what is wrong with it
        return
