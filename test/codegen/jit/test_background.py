"""Background work runs one piece at a time, only for objects that exist, and does not delay the end of a program."""

import os
import subprocess
import sys
import threading
import time

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.codegen.jit.background import run_in_background


class Worker:
    def __init__(self):
        self.done, self.running, self.most = [], 0, 0
        self.all_done = threading.Event()

    def work(self, number, last):
        self.running += 1
        self.most = max(self.most, self.running)
        time.sleep(0.002)
        self.running -= 1
        self.done.append((number, threading.current_thread()))
        if number == last:
            self.all_done.set()


def test_background_work_runs_in_order_in_one_thread():
    worker = Worker()
    for number in range(20):
        run_in_background(worker.work, number, 19)
    assert worker.all_done.wait(60)
    assert [number for number, _ in worker.done] == list(range(20))
    assert worker.most == 1
    assert len({thread for _, thread in worker.done}) == 1
    assert threading.current_thread() not in {thread for _, thread in worker.done}


def test_background_work_of_deleted_objects_is_skipped():
    blocker, gate, ran = Worker(), threading.Event(), []

    class Blocked:
        def wait(self):
            gate.wait(60)

    class Deleted:
        def work(self):
            ran.append(True)

    blocked, deleted = Blocked(), Deleted()
    run_in_background(blocked.wait)
    run_in_background(deleted.work)
    del deleted
    gate.set()
    run_in_background(blocker.work, 0, 0)
    assert blocker.all_done.wait(60)
    assert not ran


def test_exiting_program_waits_only_for_running_work():
    code = """
import time
from robot_dynamics.codegen.jit.background import run_in_background

class Slow:
    def work(self, number):
        time.sleep(0.1)
        print(number, flush=True)

slow = Slow()
for number in range(1000):
    run_in_background(slow.work, number)
time.sleep(0.15)
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert 1 <= len(ended.stdout.split()) < 200
    assert not ended.stderr


def test_forked_child_compiles_too():
    dynamics = Dynamics(load_robot("rx90"))
    dynamics.compile("inverse")  # the parent has or had a background thread
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        worker = Worker()
        run_in_background(worker.work, 0, 0)
        os.write(writing, b"1" if worker.all_done.wait(30) else b"0")
        os._exit(0)
    os.waitpid(child, 0)
    assert os.read(reading, 1) == b"1"
