"""Makes .venv: ROS 2 Jazzy from wheels, the project, and what the targets of the Makefile need.

The Makefile runs it with any Python 3.10 to 3.13; it needs nothing but the standard library. Without options .venv has
what nodes and the demo need; --tests, --docs and --colcon add the packages of these targets. With --apt-jazzy it makes
.venv_apt_jazzy instead, from Python 3.12: the versions that Ubuntu has beside ROS 2 Jazzy.

Each file that is downloaded must have a hash that a list in requirements/ names; what is built here is built by such
packages.

The work is a list of steps. The files that a step depends on are summed up in a fingerprint, which .venv/.complete
keeps when the step is done. A step runs again when its fingerprint has changed, or when it was interrupted. When all
fingerprints agree there is nothing to do.
"""

import argparse
import fcntl
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(CHECKOUT / "tools"), str(CHECKOUT / "robot_dynamics_interfaces")]
import hashed_packages  # noqa: E402
from ros_wheels import correct_include_directories, find_missing_build_tool  # noqa: E402

APT_JAZZY = "--apt-jazzy" in sys.argv[1:]
VENV = CHECKOUT / (".venv_apt_jazzy" if APT_JAZZY else ".venv")
PYTHON = VENV / "bin" / "python"
COMPLETE = VENV / ".complete"
LOG = VENV / "bootstrap.log"
LOCK = CHECKOUT / f"{VENV.name}.lock"
INTERFACES = CHECKOUT / "robot_dynamics_interfaces"
REQUIREMENTS = CHECKOUT / "requirements"

# What these wheels of ROS were built for.
PYTHON_VERSIONS = ((3, 12), (3, 12)) if APT_JAZZY else ((3, 10), (3, 13))
MACHINES = ("x86_64",)
GLIBC = (2, 28)

# Variables by which a sourced ROS or another environment would lend its files to this one.
FOREIGN_VARIABLES = (
    "AMENT_PREFIX_PATH",
    "CMAKE_PREFIX_PATH",
    "COLCON_PREFIX_PATH",
    "LD_LIBRARY_PATH",
    "PKG_CONFIG_PATH",
    "PYTHONHOME",
    "PYTHONPATH",
    "ROS_DISTRO",
    "ROS_VERSION",
    "ROS_PYTHON_VERSION",
    "RMW_IMPLEMENTATION",
    "VIRTUAL_ENV",
    "_ROS_WHEELS_BOOTSTRAP_COMPLETE",  # set by the ROS wheels of whichever environment started this process
    *hashed_packages.FOREIGN_VARIABLES,
)


class BootstrapError(Exception):
    """What is wrong and what would put it right, in one line."""


# --- What the machine must have -------------------------------------------------------------------------------------


def check_machine():
    """Refuse early, and in words, what would fail late and in riddles."""
    check_platform()
    check_python()
    check_build_tools()


def check_platform():
    if sys.platform != "linux" or platform.machine() not in MACHINES:
        raise BootstrapError(
            f"the ROS wheels exist for Linux on {' and '.join(MACHINES)}, this is {sys.platform} on "
            f"{platform.machine()}; install ROS 2 Jazzy itself there and build with colcon"
        )
    library, version = platform.libc_ver()
    if library != "glibc" or tuple(map(int, version.split(".")[:2])) < GLIBC:
        raise BootstrapError(
            f"the ROS wheels need glibc {GLIBC[0]}.{GLIBC[1]} or newer, this is {library or 'another C library'} "
            f"{version}; use a newer distribution (Ubuntu 20.04, Debian 10 and later)"
        )


def check_python():
    name = "python{}.{}".format(*sys.version_info[:2])
    oldest, newest = PYTHON_VERSIONS
    if not oldest <= sys.version_info[:2] <= newest:
        raise BootstrapError(
            f"the packages exist for Python {oldest[0]}.{oldest[1]} to {newest[0]}.{newest[1]}, this is {name}; "
            "name another: PYTHON=/path/to/python3.12 make ..."
        )
    try:
        import ensurepip  # noqa: F401
        import venv  # noqa: F401
    except ImportError:
        raise BootstrapError(f"{name} cannot make virtual environments; install {name}-venv") from None


def check_build_tools():
    missing = find_missing_build_tool()
    if missing is not None:
        raise BootstrapError(missing)


# --- Running other programs -----------------------------------------------------------------------------------------


def clean_environment():
    """The environment of this process with .venv in front and no other ROS in it."""
    foreign_prefixes = [
        os.path.realpath(prefix)
        for variable in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH")
        for prefix in os.environ.get(variable, "").split(os.pathsep)
        if prefix
    ]
    # CMake looks for packages beside every bin folder on PATH, so those of another ROS go as well.
    path = [
        folder
        for folder in os.environ.get("PATH", os.defpath).split(os.pathsep)
        if not any(os.path.realpath(folder).startswith(prefix + os.sep) for prefix in foreign_prefixes)
    ]
    environment = {name: value for name, value in os.environ.items() if name not in FOREIGN_VARIABLES}
    environment["PATH"] = os.pathsep.join([str(VENV / "bin"), *path])
    environment["AMENT_PREFIX_PATH"] = environment["CMAKE_PREFIX_PATH"] = str(VENV)
    environment["PIP_DISABLE_PIP_VERSION_CHECK"] = "1"
    return environment


def run(*command, explain=lambda output: None, **variables):
    """Run a program with more environment variables; its output goes to the log, and is shown only if it fails.

    `explain` may find in the output why it failed.
    """
    command = [str(word) for word in command]
    with LOG.open("a", encoding="utf-8", errors="backslashreplace") as log:
        log.write(f"\n$ {' '.join(command)}\n")
        log.flush()
        start = log.tell()
        # The program inherits the lock, so that it holds it for as long as it writes, should this process be killed.
        status = subprocess.call(
            command,
            cwd=CHECKOUT,
            env={**clean_environment(), **variables},
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            close_fds=False,
        )
    if status == 0:
        return
    with LOG.open(encoding="utf-8", errors="replace") as log:
        log.seek(start)
        lines = [line for line in log if not line.startswith("WARNING: Location ")]
    sys.stderr.writelines(lines[-60:])
    failed = f"`{Path(command[0]).name} {' '.join(command[1:4])} ...` failed; all it said is in {LOG}"
    raise BootstrapError(explain("".join(lines)) or failed)


def output_of_venv_python(program):
    return subprocess.check_output([PYTHON, "-c", program], env=clean_environment(), text=True).strip()


# --- Steps ----------------------------------------------------------------------------------------------------------


def create_environment():
    """A new virtual environment with ROS 2 Jazzy from wheels."""
    COMPLETE.unlink(missing_ok=True)
    if VENV.exists():
        shutil.rmtree(VENV)
    VENV.mkdir()
    # The real interpreter: `sys.executable` may lie in the environment that was just removed.
    run(os.path.realpath(getattr(sys, "_base_executable", sys.executable)), "-m", "venv", VENV)
    install_packages(PYTHON, "setuptools.txt")
    install_packages(PYTHON, "apt_jazzy.txt" if APT_JAZZY else "demo.txt")


def install_packages(python, name, *options):
    """Install a list of requirements/ into the environment of `python`: files with other hashes are refused."""
    requirements = REQUIREMENTS / name
    run(
        *hashed_packages.install_command(python, requirements),
        *options,
        explain=lambda output: hashed_packages.explain(output, f"requirements/{name}"),
    )


def install_interfaces():
    """The service types of robot_dynamics_interfaces, compiled and installed."""
    # The environment that compiles lies elsewhere: ament_cmake fails where its path has a space.
    with tempfile.TemporaryDirectory(prefix="robot_dynamics_build_") as folder:
        environment = Path(folder, "environment")
        python = environment / "bin" / "python"
        run(PYTHON, "-m", "venv", environment)
        install_packages(python, "setuptools.txt", "--no-compile")
        install_packages(python, "build.txt", "--no-compile")
        run(
            *(python, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, INTERFACES),
            PATH=os.pathsep.join([str(python.parent), clean_environment()["PATH"]]),
        )
        run(PYTHON, "-m", "pip", "install", "--no-deps", "--force-reinstall", *Path(folder).glob("*.whl"))


def install_project():
    """robot_dynamics itself, editable: changes of its Python files take effect at once."""
    run(PYTHON, "-m", "pip", "install", "--no-deps", "--no-build-isolation", "-e", CHECKOUT)


def install_tests():
    """All packages; some tests build the documentation, or a package of messages."""
    install_packages(PYTHON, "constraints.txt")
    adapt_cmake_files()


def install_docs():
    """Sphinx, and all extras, which tutorials use."""
    install_packages(PYTHON, "docs.txt")


def install_colcon():
    """colcon, and what it builds robot_dynamics_interfaces with."""
    install_packages(PYTHON, "colcon.txt")
    adapt_cmake_files()


def adapt_cmake_files():
    """Let the CMake files of the ROS wheels name the header files of this Python."""
    program = (
        "import json, numpy, sysconfig; print(json.dumps([sysconfig.get_paths()['include'], numpy.get_include()]))"
    )
    correct_include_directories(VENV, *json.loads(output_of_venv_python(program)))


PACKAGE_FILES = ("pyproject.toml", "setup.py", "setup.cfg")
TOOLS = ("tools/bootstrap.py", "tools/hashed_packages.py")


class Step:
    """Something to do, and the files that what it makes depends on (folders: all files below them)."""

    def __init__(self, name, announcement, do, *sources):
        self.name = name
        self.announcement = announcement
        self.do = do
        self.sources = [CHECKOUT / source for source in (*TOOLS, *sources)]

    def fingerprint(self):
        digest = hashlib.sha256(os.fsencode(VENV))
        for source in self.sources:
            for path in sorted(source.rglob("*")) if source.is_dir() else [source]:
                if path.is_file() and "__pycache__" not in path.parts:
                    digest.update(str(path.relative_to(CHECKOUT)).encode() + b"\0")
                    digest.update(hashlib.sha256(path.read_bytes()).digest())
        return digest.hexdigest()


ENVIRONMENT = Step(
    "environment",
    "installing ROS 2 Jazzy from wheels, and the packages that robot_dynamics needs",
    create_environment,
    *(("requirements/apt_jazzy.txt",) if APT_JAZZY else ("requirements/demo.txt", "requirements/constraints.txt")),
)
INTERFACE_TYPES = Step(
    "interfaces",
    "compiling robot_dynamics_interfaces",
    install_interfaces,
    "robot_dynamics_interfaces",
    "requirements/setuptools.txt",
    "requirements/build.txt",
)
PROJECT = Step("project", "installing robot_dynamics", install_project, *PACKAGE_FILES)
TESTS = Step("tests", "installing what the tests need", install_tests, "requirements/constraints.txt")
DOCS = Step("docs", "installing what the documentation needs", install_docs, "requirements/docs.txt")
COLCON = Step("colcon", "installing colcon", install_colcon, "requirements/colcon.txt")


# --- Order ----------------------------------------------------------------------------------------------------------


def completed_steps(version):
    """Fingerprints of the steps that are done; none if .venv is broken, or of another Python than `version`."""
    try:
        completed = json.loads(COMPLETE.read_text())
        usable = PYTHON.exists() and version in (None, completed["python"])
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    return completed if usable else {}


def make(steps, version):
    """Do the steps that are not done."""
    completed = completed_steps(version)
    # Only another list of ROS packages, or other versions, make the environment anew.
    if completed.get(ENVIRONMENT.name) != ENVIRONMENT.fingerprint():
        completed = {}
    missing = [step for step in steps if completed.get(step.name) != step.fingerprint()]
    if not missing:
        return
    check_machine()
    for step in missing:
        say(f"{step.announcement} ...")
        started = time.monotonic()
        fingerprint = step.fingerprint()
        # Not complete from here on: whatever interrupts the step, it is done again.
        if completed.pop(step.name, None) is not None:
            record(completed)
        step.do()
        completed[step.name] = fingerprint
        completed.setdefault("python", "{}.{}".format(*sys.version_info[:2]))
        record(completed)
        say(f"... took {time.monotonic() - started:.0f} s")


def record(completed):
    """Write .venv/.complete, whole or not at all."""
    unfinished = COMPLETE.with_suffix(".new")
    unfinished.write_text(json.dumps(completed, indent=2) + "\n")
    unfinished.replace(COMPLETE)


def say(text):
    print(f"bootstrap: {text}", flush=True)


def locked():
    """Wait until no other bootstrap is at work in this checkout. The lock ends with its holders, however they end."""
    file = LOCK.open("w")
    os.set_inheritable(file.fileno(), True)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        say("waiting for another bootstrap in this checkout ...")
        fcntl.flock(file, fcntl.LOCK_EX)
    return file


def chosen_steps(options):
    """The steps that the options ask for, in their order."""
    steps = [ENVIRONMENT, INTERFACE_TYPES, PROJECT]
    for step, is_chosen in ((TESTS, options.tests), (DOCS, options.docs), (COLCON, options.colcon)):
        if is_chosen:
            steps.append(step)
    return steps


def main():
    parser = argparse.ArgumentParser(description="Make or bring up to date .venv, the project's environment.")
    parser.add_argument("--tests", action="store_true", help="also install what the tests need")
    parser.add_argument("--docs", action="store_true", help="also install what the documentation needs")
    parser.add_argument("--colcon", action="store_true", help="also install colcon")
    parser.add_argument("--apt-jazzy", action="store_true", help="make .venv_apt_jazzy, as beside ROS 2 Jazzy from apt")
    parser.add_argument("--this-python", action="store_true", help="remake .venv if it is of another Python version")
    options = parser.parse_args()
    version = "{}.{}".format(*sys.version_info[:2]) if options.this_python else None
    try:
        with locked():
            make(chosen_steps(options), version)
    except (BootstrapError, OSError, subprocess.CalledProcessError) as error:
        print(f"bootstrap: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("bootstrap: interrupted; the next run carries on", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
