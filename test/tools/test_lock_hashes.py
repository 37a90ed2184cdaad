"""Hashes of the files that fit are added to a list of packages, and of no others."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytest.importorskip("tomllib", reason="tools/lock_hashes.py needs Python 3.11")


@pytest.fixture
def lock_hashes(monkeypatch):
    """Return tools/lock_hashes.py."""
    monkeypatch.setattr(sys, "path", [str(Path(__file__).parents[2] / "tools"), *sys.path])
    import lock_hashes

    return lock_hashes


def locked(name, *files, sdist="0"):
    """Return a package of a pylock.toml; the hash of each of its files is its name."""
    wheels = [{"url": f"https://host/ab/{file}", "hashes": {"sha256": file}} for file in files]
    return {"name": name, "version": "1.0", "wheels": wheels, "sdist": {"hashes": {"sha256": sdist}}}


@pytest.mark.parametrize(
    ("wheel", "is_fit"),
    [
        ("a-1.0-py3-none-any.whl", True),
        ("a-1.0-py2.py3-none-any.whl", True),
        ("a-1.0-py2-none-any.whl", False),
        ("a-1.0-1-cp312-cp312-manylinux2014_x86_64.manylinux_2_17_x86_64.whl", True),
        ("a-1.0-cp310-cp310-linux_x86_64.whl", True),
        ("a-1.0-py3-none-manylinux_2_28_x86_64.whl", True),
        ("a-1.0-cp39-abi3-manylinux_2_28_x86_64.whl", True),
        ("a-1.0-cp314-abi3-manylinux_2_28_x86_64.whl", False),
        ("a-1.0-cp313-cp313t-manylinux_2_28_x86_64.whl", False),
        ("a-1.0-cp39-cp39-manylinux_2_28_x86_64.whl", False),
        ("a-1.0-cp312-cp312-musllinux_1_2_x86_64.whl", False),
        ("a-1.0-cp312-cp312-manylinux_2_28_aarch64.whl", False),
        ("a-1.0-cp312-cp312-macosx_11_0_x86_64.whl", False),
        ("a-1.0-cp312-cp312-win_amd64.whl", False),
    ],
)
def test_wheels_fit_the_supported_machines(lock_hashes, wheel, is_fit):
    assert lock_hashes.fits(wheel) is is_fit


def test_hashes_stand_below_their_packages(lock_hashes):
    lock = {
        "packages": [
            locked("first", "first-1.0-py3-none-any.whl", "first-1.0-cp312-cp312-win_amd64.whl"),
            locked("empy", sdist="source"),
            locked("other-system"),
        ]
    }
    text = "# head\nempy==1.0\n    # via first\nfirst==1.0 ; python_full_version < '3.12'\n"
    listed = "other-system==1.0 ; sys_platform == 'win32'\n"
    assert lock_hashes.with_hashes(text + listed, lock_hashes.hashes_of_packages(lock)) == (
        "# head\nempy==1.0 \\\n    --hash=sha256:source\n    # via first\n"
        "first==1.0 ; python_full_version < '3.12' \\\n    --hash=sha256:first-1.0-py3-none-any.whl\n" + listed
    )


def test_package_without_a_wheel_is_refused(lock_hashes):
    hashes = lock_hashes.hashes_of_packages({"packages": [locked("only-source")]})
    with pytest.raises(ValueError, match=r"only-source==1\.0 has no wheel"):
        lock_hashes.with_hashes("only-source==1.0\n", hashes)
