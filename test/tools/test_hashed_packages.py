"""The lists of packages have hashes, and a file with another hash is not installed."""

from __future__ import annotations

import hashlib
import re
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
REQUIREMENTS = ROOT / "requirements"
LISTS = sorted(path.name for path in REQUIREMENTS.glob("*.txt"))
PARTS = ("setuptools.txt", "build.txt", "demo.txt", "docs.txt", "colcon.txt")
BLOCK = re.compile(r"([\w.-]+)==\S+( ; .+)?((?: \\\n    --hash=sha256:[0-9a-f]{64})*)")


def blocks(name: str) -> list[str]:
    """Return each package of a list, with its hashes."""
    text = re.sub(r"^ *#.*\n", "", (REQUIREMENTS / name).read_text(), flags=re.MULTILINE)
    return re.split(r"\n(?=\S)", text.strip())


def named_packages(name: str) -> set[str]:
    """Return the packages that requirements/<name>.in names, also by another file."""
    names = set()
    for line in (REQUIREMENTS / f"{name}.in").read_text().splitlines():
        if line.startswith("-r "):
            names |= named_packages(Path(line[3:]).stem)
        elif line and not line.startswith("#"):
            names.add(re.match(r"[\w.-]+", line)[0].lower())
    return names


def write_wheel(folder: Path) -> str:
    """Write a wheel with one module, and return its SHA-256."""
    wheel = folder / "small_package-1.0-py3-none-any.whl"
    information = "small_package-1.0.dist-info"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("small_package.py", "")
        archive.writestr(f"{information}/METADATA", "Metadata-Version: 2.1\nName: small-package\nVersion: 1.0\n")
        archive.writestr(f"{information}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        archive.writestr(
            f"{information}/RECORD",
            f"small_package.py,,\n{information}/METADATA,,\n{information}/WHEEL,,\n{information}/RECORD,,\n",
        )
    return hashlib.sha256(wheel.read_bytes()).hexdigest()


@pytest.fixture
def bootstrap(monkeypatch, tmp_path):
    """Return tools/bootstrap.py, which installs into a folder of the test instead of .venv."""
    monkeypatch.setattr(sys, "argv", ["bootstrap.py"])
    monkeypatch.setattr(sys, "path", [str(ROOT / "tools"), *sys.path])
    monkeypatch.delitem(sys.modules, "bootstrap", raising=False)
    import bootstrap

    environment = tmp_path / "environment"
    for name, value in (("VENV", environment), ("COMPLETE", environment / ".complete"), ("LOG", tmp_path / "log")):
        monkeypatch.setattr(bootstrap, name, value)
    return bootstrap


@pytest.mark.parametrize("name", LISTS)
def test_every_package_has_a_hash(name):
    for block in blocks(name):
        package = BLOCK.fullmatch(block)
        assert package, block
        elsewhere = re.fullmatch(r" ; .*sys_platform == '(darwin|win32)'.*", package[2] or "")
        assert package[3] or elsewhere, f"{name}: no hash of {block}"


@pytest.mark.parametrize("name", PARTS)
def test_parts_agree_with_the_whole_list(name):
    """Versions and hashes do; of fewer packages fewer Pythons may need one."""
    part, whole = ({re.sub(" ; .+(?= )", "", block) for block in blocks(file)} for file in (name, "constraints.txt"))
    assert part <= whole


@pytest.mark.parametrize(
    ("name", "sources"),
    [
        ("setuptools.txt", ["setuptools"]),
        ("build.txt", ["build"]),
        ("demo.txt", ["demo"]),
        ("docs.txt", ["docs"]),
        ("colcon.txt", ["colcon"]),
        ("opensees.txt", ["opensees"]),
        ("apt_jazzy.txt", ["apt_jazzy"]),
        ("constraints.txt", ["setuptools", "build", "demo", "docs", "colcon", "test"]),
    ],
)
def test_lists_have_what_they_are_made_of(name, sources):
    """`make lock` has run since a package was added."""
    pinned = {BLOCK.fullmatch(block)[1] for block in blocks(name)}
    assert set().union(*map(named_packages, sources)) <= pinned


def test_bootstrap_downloads_with_hashes_alone(bootstrap, monkeypatch):
    """Each pip of bootstrap.py has --require-hashes, or installs without dependencies what was built here."""
    commands = []

    def record(*command, **_):
        commands.append([str(word) for word in command])
        if "wheel" in commands[-1]:
            Path(commands[-1][commands[-1].index("--wheel-dir") + 1], "built.whl").touch()

    monkeypatch.setattr(bootstrap, "run", record)
    monkeypatch.setattr(bootstrap, "adapt_cmake_files", lambda: None)
    for step in (
        *(bootstrap.ENVIRONMENT, bootstrap.INTERFACE_TYPES, bootstrap.PROJECT),
        *(bootstrap.TESTS, bootstrap.DOCS, bootstrap.COLCON),
    ):
        step.do()
    by_pip = [command[3:] for command in commands if command[1:3] == ["-m", "pip"]]
    hashed = [command for command in by_pip if "--require-hashes" in command]
    lists = {Path(word).name for command in hashed for word in command if word.endswith(".txt")}
    assert lists == {*PARTS, "constraints.txt"}
    assert all(word in command for command in hashed for word in ("--no-build-isolation", "--only-binary=:all:"))
    for command in by_pip:
        if command not in hashed:
            local = (str(ROOT), str(bootstrap.INTERFACES))
            assert "--no-deps" in command and (command[-1] in local or command[-1].endswith("/built.whl")), command
            assert "--no-build-isolation" in command or command[-1].endswith(".whl"), command


def test_file_with_another_hash_is_refused(bootstrap, monkeypatch, tmp_path, capfd):
    digest = write_wheel(tmp_path)
    monkeypatch.setattr(bootstrap, "PYTHON", sys.executable)
    monkeypatch.setattr(bootstrap, "REQUIREMENTS", tmp_path)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path))
    requirements = tmp_path / "small.txt"
    target = tmp_path / "installed"

    requirements.write_text(f"small-package==1.0 --hash=sha256:{'0' * 64} --hash=sha256:{digest[::-1]}\n")
    with pytest.raises(bootstrap.BootstrapError) as refusal:
        bootstrap.install_packages(sys.executable, "small.txt", "--target", target)
    assert str(refusal.value).startswith(f"not installed: small-package==1.0 (sha256 {digest}) is not a file that ")
    assert "requirements/small.txt names by its hash" in str(refusal.value) and "\n" not in str(refusal.value)

    requirements.write_text("small-package==1.0\n")
    with pytest.raises(bootstrap.BootstrapError, match="failed; all it said is in"):
        bootstrap.install_packages(sys.executable, "small.txt", "--target", target)
    assert not target.exists() and "Hashes are required" in capfd.readouterr().err

    requirements.write_text(f"small-package==1.0 --hash=sha256:{digest}\n")
    bootstrap.install_packages(sys.executable, "small.txt", "--target", target)
    assert (target / "small_package.py").exists()
