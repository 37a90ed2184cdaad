"""CPU time and memory of another process, by the files of Linux in /proc."""

from __future__ import annotations

import os
from pathlib import Path

TICK = 1 / os.sysconf("SC_CLK_TCK")  # [s]
PAGE_SIZE = os.sysconf("SC_PAGE_SIZE")  # [bytes]


def cpu_time(number: int) -> float:
    """CPU time [s] of a process by its number, of all of its threads, in the system too."""
    status = Path(f"/proc/{number}/stat").read_text()
    fields = status[status.rindex(")") + 2 :].split()  # the name before may have any characters
    return TICK * (int(fields[11]) + int(fields[12]))


def resident_memory(number: int) -> int:
    """Memory [bytes] of a process by its number, its libraries included."""
    return PAGE_SIZE * int(Path(f"/proc/{number}/statm").read_text().split()[1])
