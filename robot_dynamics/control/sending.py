"""Efforts that leave in time: what answers a state is not sent after it has become stale."""

import math
from collections.abc import Callable
from time import perf_counter

import numpy as np

from robot_dynamics.control.controller import Controller


def send_in_time(
    controller: Controller,
    send: Callable[[np.ndarray, object, float], bool],
    now: Callable[[], float],
    efforts: np.ndarray,
    stamp: object = None,
    until: float = math.inf,
    clock: Callable[[], float] = perf_counter,
) -> None:
    """Send efforts; where they are stale before they have left, those on the way to zero, and where these are as well,
    zeros. A sender that is always too slow thus gets three calls, and the last says zero whenever it leaves.

    Parameters
    ----------
    send : sends efforts (joints,) with a stamp until a time of `clock` [s]; returns whether all has left by then.
    now : the time of the controller [s].
    stamp : of the state that the efforts answer.
    until : when the efforts are stale, by `clock` [s].
    """
    if send(efforts, stamp, until):
        return
    timeout = controller.settings.state_timeout
    until = clock() + timeout
    if send(controller.handle_overdue_efforts(now()), None, until):
        return
    zeros = controller.halt(f"it takes longer than state_timeout, {timeout * 1e3:g} ms, to send efforts")
    send(zeros, None, math.inf)
