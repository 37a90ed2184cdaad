"""The version of the installed package."""

from importlib.metadata import PackageNotFoundError, version


def package_version() -> str:
    """The version that setup.py states, as it was installed; `unknown` where the package is not installed."""
    try:
        return version("robot_dynamics")
    except PackageNotFoundError:
        return "unknown"
