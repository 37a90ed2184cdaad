"""Starts real nodes and hurts them: rounds of each fault, judged from outside, and a table of the figures.

PYTHONPATH=test python -m nodes.faults.harness --rounds 100

All runs in namespaces of Linux, where the kernel permits them: with a network of its own, which can fail, a small disk
for the node, and processes that end with this one.
"""

import argparse
import ctypes
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import numpy as np
import rclpy
from nodes.faults.bench import DAMPED, LED, Bench, NotSettledError, own_memory
from nodes.faults.faults import all_faults
from nodes.faults.invariants import Round, judge, unsettled
from rclpy.signals import SignalHandlerOptions

from robot_dynamics.nodes.client import ServiceClient

ISOLATED = "ROBOT_DYNAMICS_ISOLATED"  # variable of a process in namespaces of its own
NAMESPACES = ["unshare", "--map-root-user", "--net", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc"]
PR_SET_PDEATHSIG = 1  # of linux/prctl.h
REAL_TIME_PRIORITY = 10
DISK_SIZE = "4m"
GROWTH = 2_000_000  # [bytes] of the memory of the node, in the second half of the rounds
HEADER = ("fault", "rounds", "violations", "beyond limit", "oldest state", "to zero", "recovery", "busy", "memory")
UNITS = ("", "", "", "N m", "ms", "ms", "ms", "ms", "kB")


def isolate():
    """Run this program in namespaces of its own, and at real-time priority, if both are permitted, and end with it."""
    if os.environ.get(ISOLATED) or shutil.which("unshare") is None:
        return
    if subprocess.run([*NAMESPACES, "ip", "link", "set", "lo", "up"], capture_output=True).returncode:
        print("no namespaces of Linux: the faults of disk and network are left out", file=sys.stderr)
        return
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(REAL_TIME_PRIORITY))
    command = [*NAMESPACES, sys.executable, "-m", "nodes.faults.harness", *sys.argv[1:]]
    process = subprocess.Popen(command, env={**os.environ, ISOLATED: "1"}, preexec_fn=die_with_parent)
    try:
        sys.exit(process.wait())
    finally:
        process.kill()


def die_with_parent():
    """Let Linux kill this process when its parent ends."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def mount(folder, size):
    """Mount a file system in memory."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], check=True)


class Harness:
    """Rounds of faults, on a bench that successive faults share.

    client : ServiceClient. parameters : of the node, in addition to those of a Bench. seed : of durations and moments.
    """

    def __init__(self, client, parameters=None, seed=0):
        self._client, self._parameters, self._seed = client, parameters or {}, seed
        self._stack = ExitStack()
        self.in_flight = 0  # messages that left when the node went on, in the last rounds
        self._bench = self._conditions = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._bench = None
        self._stack.close()

    def _bench_for(self, fault):
        """The present bench, or a new one if that does not fit a fault, or is not as it was in the beginning."""
        conditions = (fault.simulated, fault.environment)
        if self._bench is None or conditions != self._conditions:
            self._stack.close()
            self._conditions = conditions
            folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory()))
            parameters = {**self._parameters, "use_sim_time": fault.simulated}
            options = ["--clock"] if fault.simulated else []
            self._bench = Bench(self._stack, self._client, folder, parameters, options, fault.environment)
        return self._bench

    def run(self, fault, rounds):
        """A row of the table and the violations of some rounds of a fault."""
        bench = self._bench_for(fault)
        memory, logged = [], bench.log.stat().st_size
        with fault.prepared(bench):
            judgements = list(self._judgements(bench, fault, rounds, memory))
        output = bench.log.read_text(errors="replace")[logged:]
        violations = [text for judgement in judgements for text in judgement.violations]
        grown = np.nan if fault.node == "dies" or not memory else memory[-1] - memory[len(memory) // 2]
        if grown > GROWTH:
            violations.append(f"the memory of the node grows by {grown} bytes")
        if bench.node.poll() is not None:
            violations.append("the node died")
        if re.search("Traceback|internal error", output):
            violations.append(f"the node reports an error: {output[-2000:]}")
        if violations:
            self._bench = None
        self.in_flight = sum(judgement.in_flight for judgement in judgements)
        return self._row(fault, judgements, violations, grown), violations

    def _judgements(self, bench, fault, rounds, memory):
        """Judgements of rounds, which end with one that leaves efforts as they should not be; memory takes bytes."""
        rng = np.random.default_rng(self._seed)
        for number in range(rounds):
            reason = ""
            try:
                judgement = self._round(bench, fault, rng)
            except NotSettledError as error:
                reason = str(error)
                judgement = unsettled(bench.records, reason)
            for violation in judgement.violations:
                print(f"  {fault.name}, round {number}: {violation}", flush=True)
            yield judgement
            if reason:
                return
            memory.append(own_memory(bench.node))

    def _round(self, bench, fault, rng):
        bench.lead()
        with bench.waiting() as recorder:
            time.sleep(rng.uniform(0.1, 0.2))
            began = time.time_ns()
            fault.begin(bench, rng)
            time.sleep(np.exp(rng.uniform(*np.log(fault.durations))))
            ended = time.time_ns()
            fault.end(bench)
            bench.wait_for_states(max(ended, time.time_ns()))
            if fault.latches:
                bench.send_reference()
            is_led = bench.settled(DAMPED, LED) is LED
        return judge(Round(fault, bench.records, began, ended, recorder.waiting(), is_led))

    @staticmethod
    def _row(fault, judgements, violations, grown):
        def largest(name):
            return max((value for j in judgements if np.isfinite(value := getattr(j, name))), default=np.nan)

        figures = [largest(name) for name in ("excess", "oldest", "to_zero", "recovery", "busy")]
        return [fault.name, len(judgements), len(violations), *figures, grown / 1e3]


def formatted(rows):
    """A table of Markdown."""
    lines = [[f"{name} [{unit}]" if unit else name for name, unit in zip(HEADER, UNITS, strict=True)]]
    lines.append(["---"] * len(HEADER))
    for name, rounds, violations, *figures in rows:
        texts = ["" if np.isnan(value) else f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}" for value in figures]
        lines.append([name, str(rounds), str(violations), *texts])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=100, help="of each fault")
    parser.add_argument("--faults", default="", help="pattern of their names")
    parser.add_argument("--seed", type=int, default=0, help="of durations and moments")
    parser.add_argument("--parameters", nargs="*", default=[], help="NAME=NUMBER of the node")
    options = parser.parse_args()
    isolate()
    parameters = {name: float(value) for name, _, value in (text.partition("=") for text in options.parameters)}
    disk = None
    is_isolated = bool(os.environ.get(ISOLATED))
    with ExitStack() as stack:
        if is_isolated:
            subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
            mount("/dev/shm", "256m")  # no shared memory in common with participants outside
            disk = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            mount(disk, DISK_SIZE)
            stack.callback(subprocess.run, ["umount", "--lazy", disk], check=True)
        os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        stack.callback(rclpy.try_shutdown)
        client = ServiceClient("harness")
        stack.callback(client.close)
        harness = stack.enter_context(Harness(client, parameters, options.seed))
        rows, violated = [], False
        for fault in all_faults(disk, is_isolated):
            if not re.search(options.faults, fault.name):
                continue
            began = time.monotonic()
            row, violations = harness.run(fault, options.rounds)
            print(formatted([row]).splitlines()[-1], f"{time.monotonic() - began:.0f} s", flush=True)
            if harness.in_flight:
                print(f"  messages in flight when the node was stopped: {harness.in_flight}", flush=True)
            for name in fault.done[0] if fault.done else ():
                values = [done[name] for done in fault.done]
                print(
                    f"  {name}: {min(values):.3g} to {max(values):.3g}, {np.median(values):.3g} in the median",
                    flush=True,
                )
            rows.append(row)
            violated |= bool(violations)
    print(formatted(rows))
    sys.exit(violated)


if __name__ == "__main__":
    main()
