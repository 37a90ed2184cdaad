"""Packages that only some tasks need: imported when such a task begins. Where one is missing, the error says in a line
what to install."""

from importlib import import_module
from types import ModuleType

from robot_dynamics.errors import MissingPackageError

# {module: (its name for pip, the package of Ubuntu 24.04 that has it in a version that fits, or None)}
INSTALL_SOURCES = {
    "clarabel": ("clarabel", None),
    "distributed": ("dask[distributed]", None),
    "jsonschema": ("jsonschema", "python3-jsonschema"),
    "lark": ("lark", "python3-lark"),
    "llvmlite": ("llvmlite", None),
    "lxml": ("lxml", "python3-lxml"),
    "matplotlib": ("matplotlib", "python3-matplotlib"),
    "mcap": ("mcap", None),
    "numpy": ("numpy", "python3-numpy"),
    "plotly": ("plotly", None),  # that of Debian and Ubuntu lacks the script that pages need
    "rosbags": ("rosbags", None),
    "scipy": ("scipy", "python3-scipy"),
    "tabulate": ("tabulate", "python3-tabulate"),
    "tqdm": ("tqdm", "python3-tqdm"),
    "yaml": ("pyyaml", "python3-yaml"),
    "yourdfpy": ("yourdfpy", None),
}


def import_optional(module: str, task: str) -> ModuleType:
    """Import a module of a package that only some tasks need.

    Parameters
    ----------
    module : name of the module, such as ``"rosbags.rosbag2"``.
    task : what needs it, such as ``"reading a bag"``: the beginning of the error message.

    Raises
    ------
    MissingPackageError
        Where the package, or one that it needs itself, is not installed or cannot be imported.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise missing_package_error(error, task, module.partition(".")[0]) from error


def missing_package_error(error: ImportError, task: str, package: str | None = None) -> MissingPackageError:
    """Make the error that says what to install, of the ImportError that importing a `package` for a task ended in.

    package: None where the task needs several, and whichever is missing is the one to name.
    """
    if not isinstance(error, ModuleNotFoundError) or error.name is None:
        return MissingPackageError(f"{task} needs {package or 'a package'} that cannot be imported: {error}")
    missing = error.name.partition(".")[0]
    if missing == "robot_dynamics":
        raise error  # a mistake in this package
    needs = missing if package in (None, missing) else f"{package}, and that {missing}"
    return MissingPackageError(f"{task} needs {needs}, which is not installed: {install_hint(missing)}", name=missing)


def install_hint(package: str) -> str:
    """Say how to install the package that has a module of this name: by pip, and by apt where Ubuntu has it."""
    by_pip, by_apt = INSTALL_SOURCES.get(package, (package, None))
    by_pip = f"pip install '{by_pip}'" if "[" in by_pip else f"pip install {by_pip}"
    return by_pip if by_apt is None else f"{by_pip}, or sudo apt install {by_apt}"
