"""The executor that takes least time for a message."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.executors import Executor, SingleThreadedExecutor

if TYPE_CHECKING:
    from rclpy.context import Context


def make_executor(context: Context | None = None) -> Executor:
    """Return an EventsExecutor, which rclpy has from 7.1.4 on, else a SingleThreadedExecutor.

    Parameters
    ----------
    context : rclpy context; None: the default one.
    """
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)
