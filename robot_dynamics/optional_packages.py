"""Import of packages that only some tasks need; where one is missing, the error has the command that installs it."""

from importlib import import_module
from types import ModuleType

from robot_dynamics.errors import MissingPackageError

# {module: (name for pip, package of Ubuntu 24.04 with a suitable version or None, extra of robot_dynamics or None)}
INSTALL_SOURCES: dict[str, tuple[str, str | None, str | None]] = {
    "PIL": ("pillow", "python3-pil", "view"),
    "backports": ("backports.zstd", None, "bags"),
    "clarabel": ("clarabel", None, "identify"),
    "collada": ("pycollada", "python3-collada", "view"),
    "distributed": ("dask[distributed]", None, "fleet"),
    "jsonschema": ("jsonschema", "python3-jsonschema", None),
    "lark": ("lark", "python3-lark", None),
    "llvmlite": ("llvmlite", None, "compiled"),
    "lxml": ("lxml", "python3-lxml", None),
    "matplotlib": ("matplotlib", "python3-matplotlib", "plots"),
    "lz4": ("lz4", "python3-lz4", "bags"),
    "mcap": ("mcap", None, "bags"),
    "mujoco": ("mujoco", None, "mjcf"),
    "numpy": ("numpy", "python3-numpy", None),
    "plotly": ("plotly", None, "view"),  # the package of Debian and Ubuntu lacks the script that pages need
    "rich": ("rich", "python3-rich", "view"),
    "rosbags": ("rosbags", None, "bags"),
    "scipy": ("scipy", "python3-scipy", None),
    "tabulate": ("tabulate", "python3-tabulate", None),
    "tqdm": ("tqdm", "python3-tqdm", None),
    "trimesh": ("trimesh", None, "view"),
    "viser": ("viser", None, "view"),
    "xacro": ("xacro", None, "xacro"),
    "yaml": ("pyyaml", "python3-yaml", None),
    "yourdfpy": ("yourdfpy", None, None),
}


def import_optional(module: str, task: str) -> ModuleType:
    """Import a module of a package that only some tasks need.

    Parameters
    ----------
    module : str
        Name of the module, such as ``"rosbags.rosbag2"``.
    task : str
        The task that needs it, such as ``"reading a bag"``: the beginning of the error message.

    Returns
    -------
    ModuleType
        The imported module.

    Raises
    ------
    MissingPackageError
        If the package, or one of its own dependencies, is not installed or cannot be imported.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise missing_package_error(error, task, module.partition(".")[0]) from error


def missing_package_error(error: ImportError, task: str, package: str | None = None) -> MissingPackageError:
    """Return the error with the installation command for an ImportError.

    Parameters
    ----------
    error : ImportError
        The error of the import.
    task : str
        The task that needs the package: the beginning of the message.
    package : str, optional
        The package that was imported. None: the task needs several, and the message names the missing one.
    """
    if not isinstance(error, ModuleNotFoundError) or error.name is None:
        return MissingPackageError(f"{task} needs {package or 'a package'} that cannot be imported: {error}")
    missing = error.name.partition(".")[0]
    if missing == "robot_dynamics":
        raise error  # a defect of this package
    needs = missing if package in (None, missing) else f"{package}, and that {missing}"
    return MissingPackageError(f"{task} needs {needs}, which is not installed: {install_hint(missing)}", name=missing)


def install_hint(package: str) -> str:
    """Return the commands that install the package of a module: by pip, and by apt where Ubuntu has it."""
    pip_name, apt_name, extra = INSTALL_SOURCES.get(package, (package, None, None))
    hint = f"pip install '{pip_name}'" if "[" in pip_name else f"pip install {pip_name}"
    if extra is not None:
        hint += f", part of the extra robot_dynamics[{extra}]"
    return hint if apt_name is None else f"{hint}, or sudo apt install {apt_name}"
