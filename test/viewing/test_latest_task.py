"""The newest task runs, older ones that wait are skipped, and a failure ends nothing."""

import logging
import threading

from robot_dynamics.viewing.latest_task import LatestTask


def test_tasks_that_wait_are_replaced_by_the_newest():
    began, go_on, done = threading.Event(), threading.Event(), []
    tasks = LatestTask(lambda: done.append("idle"))

    def first():
        began.set()
        assert go_on.wait(10)
        done.append("first")

    tasks.submit(first)
    assert began.wait(10)
    for name in ("second", "third", "fourth"):
        tasks.submit(lambda name=name: done.append(name))
    go_on.set()
    assert tasks.wait(10)
    tasks.close()
    assert done == ["first", "fourth", "idle"]


def test_failure_is_logged_and_the_next_task_runs(caplog):
    done = []
    tasks = LatestTask(lambda: None)
    with caplog.at_level(logging.ERROR):
        tasks.submit(lambda: 1 / 0)
        assert tasks.wait(10)
    tasks.submit(lambda: done.append(1))
    assert tasks.wait(10)
    tasks.close()
    assert done == [1] and "ZeroDivisionError" in caplog.text
    assert not any(thread.name == "viewer" for thread in threading.enumerate())


def test_idle_callback_waits_its_interval_and_lets_tasks_run_meanwhile():
    done = []
    tasks = LatestTask(lambda: done.append("idle"), interval=1.0)
    for name in ("first", "second", "third"):
        ran = threading.Event()
        tasks.submit(lambda name=name, ran=ran: (done.append(name), ran.set()))
        assert ran.wait(10)
    assert tasks.wait(10)
    tasks.close()
    assert [name for name in done if name != "idle"] == ["first", "second", "third"]
    assert done[-1] == "idle" and done.count("idle") <= 2
