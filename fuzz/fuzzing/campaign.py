"""A campaign against one target: worker processes with limits, which mutate inputs and keep those that reach new lines.

The parent process has the summary. An input that kills its worker (a crash, a hang, too much memory) is a find; it
stands in memory that both processes share, and another worker goes on.
"""

from __future__ import annotations

import faulthandler
import json
import multiprocessing
import os
import random
import re
import resource
import signal
import time
import traceback
from collections import Counter
from dataclasses import dataclass, field
from hashlib import sha256
from mmap import mmap
from pathlib import Path
from typing import NamedTuple, Protocol

from fuzzing.line_coverage import LineCoverage

import robot_dynamics

CPU_PER_KILOBYTE = 2.0  # [s] that an input may take for each KB
SMALL_INPUT = 2.0  # [KB]; a smaller input may take as long as one of this size
CPU_FACTOR_TRACED = 6.0  # of an input whose lines are traced
WALL_TIME = 300.0  # [s] after which an input hangs that waits and does not compute
MEMORY = 1 << 30  # [bytes] by which a worker may grow; it begins with that of its parent
ADDRESS_SPACE = 8 << 30  # [bytes] at which an allocation fails, so that the machine survives
TRACED_PART = 8  # each such input is traced where tracing is expensive
SHARED_SIZE = 64 << 20  # [bytes] of the longest input
REPORT_PERIOD = 0.5  # [s]
MAX_SAVED = 50  # finds of one campaign
PACKAGE = str(Path(robot_dynamics.__file__).parent)
VALID_PART = 0.7  # of the mutated inputs that are not refused themselves


class Outcome(NamedTuple):
    """What became of an input.

    Attributes
    ----------
    kind : "refused", "accepted", or "compared" if an independent model agrees.
    detail : of the same text for inputs that are treated in the same way.
    comparisons : number of results that the independent model agrees with.
    """

    kind: str
    detail: str = ""
    comparisons: int = 0


class Target(Protocol):
    """What is fuzzed.

    Attributes
    ----------
    name : of its corpus.
    """

    name: str

    def prepare(self) -> None:
        """Load what takes long and does not depend on inputs."""
        ...

    def mutate(self, data: bytes, rng: random.Random, corpus: list[bytes]) -> bytes:
        """Return a mutation of an input."""
        ...

    def run(self, data: bytes) -> Outcome:
        """Treat an input. Any exception is a find."""
        ...


@dataclass
class Summary:
    """Figures of a campaign; times are CPU times without tracing."""

    target: str
    inputs: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    comparisons: int = 0
    lines: int = 0
    corpus: int = 0
    largest_cpu: float = 0.0  # [s]
    largest_cpu_per_kilobyte: float = 0.0  # [s]
    largest_memory: int = 0  # [bytes]
    seconds: float = 0.0
    finds: list[str] = field(default_factory=list)

    def text(self) -> str:
        """The figures in some lines."""
        kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(self.kinds.items()))
        rate = self.inputs / max(self.seconds, 1e-9)
        return (
            f"{self.target}: {self.inputs} inputs in {self.seconds:.0f} s ({rate:.0f}/s): {kinds}; "
            f"{self.comparisons} results compared; {self.corpus} inputs kept, {self.lines} lines; largest CPU time "
            f"{self.largest_cpu:.2f} s, {self.largest_cpu_per_kilobyte:.2f} s/KB; largest memory "
            f"{self.largest_memory / 1e6:.0f} MB; {len(self.finds)} finds"
        )


def read_corpus(*folders: Path) -> list[bytes]:
    """The contents of the files of folders, in the order of their names."""
    files = [file for folder in folders if folder.is_dir() for file in sorted(folder.iterdir()) if file.is_file()]
    return [file.read_bytes() for file in files]


def cpu_limit(size: int) -> float:
    """CPU time [s] that an input of a size [bytes] may take."""
    return CPU_PER_KILOBYTE * max(SMALL_INPUT, size / 1024)


def run_campaign(
    target: Target,
    seeds: list[bytes],
    folder: Path,
    *,
    inputs: int | None = None,
    seconds: float | None = None,
    seed: int = 0,
) -> Summary:
    """Fuzz a target.

    Parameters
    ----------
    seeds : the first inputs.
    folder : for inputs that are kept, finds and the summary.
    inputs, seconds : at which the campaign ends, whichever comes first.
    seed : of the mutations.
    """
    kept, finds = folder / "kept", folder / "finds"
    for place in (kept, finds):
        place.mkdir(parents=True, exist_ok=True)
    summary = Summary(target.name)
    began = time.monotonic()
    corpus = seeds + read_corpus(kept)
    context = multiprocessing.get_context("fork")
    share = mmap(-1, SHARED_SIZE)
    signatures: set[str] = set()

    def save(what: str, data: bytes) -> None:
        if data in corpus:
            corpus.remove(data)
        lines = what.splitlines()
        signature = re.sub(r"\d+", "0", f"{lines[0]} {lines[-1][:200]}")
        if signature in signatures or len(summary.finds) >= MAX_SAVED:
            return
        signatures.add(signature)
        name = sha256(data).hexdigest()[:16]
        (finds / name).write_bytes(data)
        (finds / f"{name}.txt").write_text(what)
        summary.finds.append(f"{name}: {what.splitlines()[0]}")

    generation = 0
    while True:
        left = None if inputs is None else inputs - summary.inputs
        until = None if seconds is None else began + seconds
        if (left is not None and left <= 0) or (until is not None and time.monotonic() >= until):
            break
        receiver, sender = context.Pipe(duplex=False)
        worker = _Worker(target, sender, share, corpus, seed * 1000 + generation)
        process = context.Process(target=worker.work, args=(left, until), daemon=True)
        process.start()
        sender.close()
        _collect(receiver, summary, corpus, kept, save)
        process.join()
        status = process.exitcode or 0
        if status < 0:
            size = int.from_bytes(share[:8], "little")
            data = share[8 : 8 + size]
            number = signal.Signals(-status)
            reason = {
                signal.SIGPROF: f"hang: more than {cpu_limit(size):.1f} s of CPU time for {size} bytes",
                signal.SIGALRM: f"hang: more than {WALL_TIME:.0f} s",
            }.get(number, f"crash: {number.name}")
            save(f"{reason} ({generation})", data)
        elif status != 0:
            summary.finds.append(f"the worker ended with status {status}")
            break
        generation += 1
        if generation > MAX_SAVED:
            break
    summary.seconds = time.monotonic() - began
    (folder / "summary.json").write_text(json.dumps({**vars(summary), "kinds": dict(summary.kinds)}, indent=1))
    return summary


def _collect(receiver, summary: Summary, corpus: list[bytes], kept: Path, save) -> None:
    """Take the reports of a worker until it ends."""
    while True:
        try:
            kind, content = receiver.recv()
        except (EOFError, OSError):
            return
        if kind == "figures":
            summary.inputs += content["inputs"]
            summary.kinds.update(content["kinds"])
            summary.comparisons += content["comparisons"]
            summary.lines = max(summary.lines, content["lines"])
            for name in ("largest_cpu", "largest_cpu_per_kilobyte", "largest_memory"):
                setattr(summary, name, max(getattr(summary, name), content[name]))
        elif kind == "kept":
            corpus.append(content)
            summary.corpus += 1
            (kept / sha256(content).hexdigest()[:16]).write_bytes(content)
        else:
            save(*content)


class _Worker:
    """Mutates and runs inputs in a process of its own."""

    def __init__(self, target: Target, sender, share: mmap, corpus: list[bytes], seed: int) -> None:
        self._target = target
        self._sender = sender
        self._share = share
        self._first = list(corpus)
        self._corpus = list(corpus)
        self._seed = seed
        self._valid: list[bytes] = []
        self._details: set[str] = set()

    def work(self, count: int | None, until: float | None) -> None:
        """Run inputs until a number of them, or a time."""
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for number in (signal.SIGINT, signal.SIGALRM, signal.SIGPROF):
            signal.signal(number, signal.SIG_DFL)  # timers end the process
        faulthandler.disable()
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)  # libraries write of each invalid input
        self._target.prepare()
        memory_before = _peak_memory()
        rng = random.Random(self._seed)
        self._coverage = LineCoverage([PACKAGE])
        self._clear()
        number = 0
        last_report = time.monotonic()
        while (count is None or number < count) and (until is None or time.monotonic() < until):
            if number < len(self._first):
                data = self._first[number]
            else:
                parents = self._valid if self._valid and rng.random() < VALID_PART else self._corpus
                recent = parents[-max(8, len(parents) // 4) :]
                parent = rng.choice(recent if rng.random() < 0.5 else parents)
                data = self._target.mutate(parent, rng, self._corpus)[: SHARED_SIZE - 8]
            is_traced = self._coverage.is_cheap or number < len(self._first) or number % TRACED_PART == 0
            is_seed = number < len(self._first)
            number += 1
            if not self._execute(data, is_traced, is_seed, memory_before + MEMORY):
                break  # a worker that has used too much memory is replaced
            if time.monotonic() - last_report > REPORT_PERIOD:
                self._report()
                last_report = time.monotonic()
        self._report()
        self._sender.close()
        os._exit(0)

    def _execute(self, data: bytes, is_traced: bool, is_seed: bool, memory_limit: int) -> bool:
        """Run an input; returns whether the worker can go on."""
        self._share[:8] = len(data).to_bytes(8, "little")
        self._share[8 : 8 + len(data)] = data
        lines = self._coverage.count
        slows = is_traced and not self._coverage.is_cheap
        signal.setitimer(signal.ITIMER_PROF, cpu_limit(len(data)) * (CPU_FACTOR_TRACED if slows else 1.0))
        signal.setitimer(signal.ITIMER_REAL, WALL_TIME)
        began = time.process_time()
        problem = ""
        outcome = Outcome("find")
        if is_traced:
            self._coverage.start()
        try:
            outcome = self._target.run(data)
        except Exception as error:
            lines_of_error = traceback.format_exception(error)
            frames = traceback.extract_tb(error.__traceback__)
            problem = f"{type(error).__name__} at {_place(frames)}\n" + "".join(lines_of_error)[-6000:]
        finally:
            if is_traced:
                self._coverage.stop()
        elapsed = time.process_time() - began
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        self._inputs += 1
        self._kinds[outcome.kind] += 1
        self._comparisons += outcome.comparisons
        if not slows:
            self._largest_cpu = max(self._largest_cpu, elapsed)
            self._largest_ratio = max(self._largest_ratio, elapsed / max(1.0, len(data) / 1024))
        memory = _peak_memory()
        grown = memory > memory_limit
        if grown:
            problem = f"memory: {memory / 1e6:.0f} MB"
        if problem:
            self._sender.send(("find", (problem, data)))
        is_new = self._coverage.count > lines or f"{outcome.kind} {outcome.detail}" not in self._details
        self._details.add(f"{outcome.kind} {outcome.detail}")
        if (is_new or is_seed) and not problem and outcome.kind != "refused":
            self._valid.append(data)
        if is_new and not is_seed and not problem:
            self._corpus.append(data)
            self._sender.send(("kept", data))
        self._memory = memory
        return not grown

    def _clear(self) -> None:
        self._inputs = 0
        self._kinds: Counter[str] = Counter()
        self._comparisons = 0
        self._largest_cpu = self._largest_ratio = 0.0
        self._memory = 0

    def _report(self) -> None:
        figures = {
            "inputs": self._inputs,
            "kinds": dict(self._kinds),
            "comparisons": self._comparisons,
            "lines": self._coverage.count,
            "largest_cpu": self._largest_cpu,
            "largest_cpu_per_kilobyte": self._largest_ratio,
            "largest_memory": self._memory,
        }
        self._clear()
        self._sender.send(("figures", figures))


def _peak_memory() -> int:
    """The largest memory [bytes] of this process up to now, its libraries included."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _place(frames: traceback.StackSummary) -> str:
    """The innermost line of this package in a traceback, else the innermost one."""
    own = [frame for frame in frames if frame.filename.startswith(PACKAGE)] or list(frames)
    return f"{Path(own[-1].filename).name}:{own[-1].name}"
