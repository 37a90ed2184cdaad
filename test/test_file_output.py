"""Files that replace others: whatever interrupts the writing, the file that was there stays."""

import os
import signal
import subprocess
import sys

import pytest

from robot_dynamics import DescriptionError, load_robot, write_mdh_yaml
from robot_dynamics.file_output import replaced_file
from robot_dynamics.model.formats.par.writer import write_par


def test_file_is_replaced_as_a_whole(tmp_path):
    path = tmp_path / "file.txt"
    for text in ("first", "second"):
        with replaced_file(path) as file:
            file.write_text(text)
            assert file != path and file.suffix == ".txt"
        assert path.read_text() == text
    with pytest.raises(ZeroDivisionError), replaced_file(path) as file:
        file.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "second" and list(tmp_path.iterdir()) == [path]
    long = tmp_path / ("a." + "b" * 240)
    with replaced_file(long) as file:
        file.write_text("long name")
    assert long.read_text() == "long name"


def test_links_modes_and_pipes_stay_what_they_are(tmp_path):
    target, link, null = tmp_path / "target", tmp_path / "link", os.devnull
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to(target)
    with replaced_file(link) as file:
        file.write_text("new")
    assert link.is_symlink() and target.read_text() == "new" and target.stat().st_mode & 0o777 == 0o640
    with replaced_file(tmp_path / "created") as file:
        file.write_text("")
    umask = os.umask(0)
    os.umask(umask)
    assert (tmp_path / "created").stat().st_mode & 0o777 == 0o666 & ~umask
    with replaced_file(null) as file:
        file.write_text("gone")
    assert not os.path.isfile(null)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everything")
def test_write_protected_file_is_refused(tmp_path):
    path = tmp_path / "file"
    path.write_text("kept")
    path.chmod(0o444)
    with pytest.raises(PermissionError), replaced_file(path) as file:
        file.write_text("new")
    assert path.read_text() == "kept"


def test_killed_process_leaves_the_file(tmp_path):
    path = tmp_path / "file"
    path.write_text("kept")
    script = (
        "import sys, time\nfrom robot_dynamics.file_output import replaced_file\n"
        "with replaced_file(sys.argv[1]) as file:\n    file.write_text('half')\n    print('written', flush=True)\n"
        "    time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", script, path], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"written\n"
        process.send_signal(signal.SIGKILL)
        process.wait(timeout=30)
    assert path.read_text() == "kept"


VERBS = {
    "convert": (["convert", "ur5e", "out.yaml"], "out.yaml"),
    "map": (["map", "gough_stewart", "--over", "x:0:0.1:2,y:0:0.1:2", "--output", "out.png"], "out.png"),
    "frequencies": (["frequencies", "navaro", "--mode", "1", "--output", "out.html"], "out.html"),
}


@pytest.mark.parametrize("verb", VERBS)
def test_failed_write_of_a_verb_leaves_the_file(verb, tmp_path):
    """The file-size limit is that of a full disk: 2048 bytes are written, then an error."""
    if verb == "frequencies":
        pytest.importorskip("plotly")
    arguments, name = VERBS[verb]
    (tmp_path / name).write_text("kept")
    script = (
        "import resource, sys\nresource.setrlimit(resource.RLIMIT_FSIZE, (2048, 2048))\n"
        "from robot_dynamics.cli.main import main\nsys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", script, *arguments]
    environment = {**os.environ, "ROBOT_DYNAMICS_CACHE": "", "MPLCONFIGDIR": str(tmp_path / "config")}
    result = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False, env=environment
    )
    assert result.returncode == 1 and f"{name} cannot be written: File too large" in result.stderr, result.stderr
    assert (tmp_path / name).read_text() == "kept"
    assert {path.name for path in tmp_path.iterdir()} <= {name, "config"}


@pytest.mark.parametrize("write", [write_mdh_yaml, write_par])
def test_description_that_breaks_off_is_refused(write):
    text = write(load_robot("rx90")).rstrip()
    assert load_robot(text).joints
    for end in range(1, len(text), 5):
        with pytest.raises(DescriptionError):
            load_robot(text[:end].encode())
