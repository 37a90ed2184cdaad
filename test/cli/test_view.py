"""The verb `view`: writes a page, or serves one until it is ended."""

import re
import signal
import socket
import subprocess
import sys
import urllib.request
from contextlib import suppress

import pytest

from robot_dynamics.cli.main import main

pytest.importorskip("viser")


def test_page_replaces_the_file_as_a_whole(tmp_path, capsys):
    file = tmp_path / "robot.html"
    file.write_text("before")
    assert main(["view", "four_bar", "--output", str(file)]) == 0
    text = file.read_text()
    assert text.lower().startswith("<!doctype html>") and "<title>four_bar</title>" in text
    assert capsys.readouterr().out == f"page: {file}\n"  # no banner of viser


def test_wrong_arguments_are_refused_and_write_nothing(tmp_path, capsys):
    missing = str(tmp_path / "no.csv")
    for arguments, reason in (
        (["--output", "robot.txt"], "must end with .html"),
        (["--port", "0"], "--port 0: a number from 1 to 65535"),
        (["--output", str(tmp_path / "robot.html"), "--motion", missing], "does not exist"),
        (["--output", str(tmp_path / "robot.html"), "--reference", missing], "give the first one with --motion"),
        (["--motion", missing, "--reference-delay", "1"], "--reference-delay: a finite number"),
        (["--motion", missing, "--reference", missing, "--reference-delay", "nan"], "--reference-delay: a finite"),
    ):
        assert main(["view", "four_bar", *arguments]) == 1
        assert reason in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_unknown_option_shows_the_usage_of_the_verb(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["view", "four_bar", "--prot", "80"])
    error = capsys.readouterr().err
    assert (
        "usage: robot-dynamics view" in error and "--port PORT" in error and "unrecognized arguments: --prot" in error
    )


def heed_interruptions():
    """Ctrl-C ends the process, also where these tests run in the background of a shell that ignores it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.slow
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_page_is_served_on_this_machine_until_an_interruption(ending):
    command = [sys.executable, "-m", "robot_dynamics", "view", "four_bar", "--port", "8571"]
    with socket.create_server(("127.0.0.1", 8571)):
        check_service(command, ending)


def check_service(command, ending):
    """Serve a page on the port after a taken one, and end it by a signal."""
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=heed_interruptions
    )
    try:
        line = process.stdout.readline()
        assert line.startswith("port 8571 is taken: four_bar is at")
        url = re.search(r"http://127\.0\.0\.1:\d+", line)[0]
        with urllib.request.urlopen(url, timeout=10) as page:
            assert page.status == 200
        process.send_signal(ending)
        with suppress(subprocess.TimeoutExpired):  # one more while it closes
            process.wait(0.1)
        process.send_signal(ending)
        _, errors = process.communicate(timeout=30)
    finally:
        process.kill()
        process.wait()
    assert (process.returncode, errors) == (0, "")
