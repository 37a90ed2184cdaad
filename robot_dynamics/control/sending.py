"""Sending of efforts in time: efforts for a stale state are not the last that are sent."""

from __future__ import annotations

import math
from collections.abc import Callable
from time import perf_counter
from typing import TYPE_CHECKING, TypeAlias

from robot_dynamics.array_types import Array

if TYPE_CHECKING:
    from robot_dynamics.control.controller import Controller

SendEfforts: TypeAlias = Callable[[Array, object, float], bool]
"""Sends efforts (joints,) with a stamp until a time [s]; returns whether they are sent by then."""


def send_in_time(
    controller: Controller,
    send: SendEfforts,
    now: Callable[[], float],
    efforts: Array,
    stamp: object = None,
    until: float = math.inf,
    clock: Callable[[], float] = perf_counter,
) -> None:
    """Send efforts, or decaying ones where they become stale before they are sent, or zeros where these do as well.

    A sender that is always too slow is called three times, and its last call sends zeros at any time.

    Parameters
    ----------
    controller : Controller
    send : callable
        Sends efforts (joints,) with a stamp until a time of `clock` [s]; returns whether all are sent by then.
    now : callable
        The time of the controller [s].
    efforts : ndarray, shape (joints,)
        Efforts of the controller for a state [N m or N].
    stamp : object
        Stamp of that state.
    until : float
        Time of `clock` at which the efforts are stale [s].
    clock : callable
        Clock of the deadline [s].
    """
    if send(efforts, stamp, until):
        return
    timeout = controller.settings.state_timeout
    until = clock() + timeout
    if send(controller.handle_overdue_efforts(now()), None, until):
        return
    zeros = controller.halt(f"it takes longer than state_timeout, {timeout * 1e3:g} ms, to send efforts")
    send(zeros, None, math.inf)
