"""The version of the installed package."""

from importlib.metadata import PackageNotFoundError, version


def package_version() -> str:
    """Return the version of the installed package, or `unknown` where the package is not installed."""
    try:
        return version("robot_dynamics")
    except PackageNotFoundError:
        return "unknown"
