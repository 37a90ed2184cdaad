"""An action server whose requests are served in a thread of its own, beside the executor of the node."""

from __future__ import annotations

import threading
from collections.abc import Callable, Coroutine
from typing import Any

from rclpy.action.server import ActionServer, GoalResponse, ServerGoalHandle
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node

from robot_dynamics.nodes.guarded_callbacks import failure_reason

RETRY_PERIOD = 0.05  # [s] after a request that failed


class ThreadedActionServer(ActionServer):
    """An ActionServer that its own thread waits for: the executor of the node never takes its requests.

    Parameters
    ----------
    kind : type of the action.
    goal_callback, accepted_callback, cancel_callback : as those of ActionServer, called in the thread. None of them is
        a coroutine.
    wake_callback : called in the thread after each `wake`.

    Notes
    -----
    A goal that is accepted is executing at once, and ends with `finish`, which only the thread may call.
    """

    def __init__(
        self,
        node: Node,
        kind: Any,
        name: str,
        *,
        goal_callback: Callable[[Any], GoalResponse],
        accepted_callback: Callable[[ServerGoalHandle], None],
        cancel_callback: Callable[[ServerGoalHandle], Any],
        wake_callback: Callable[[], None],
    ) -> None:
        def accept(goal_handle: ServerGoalHandle) -> None:
            goal_handle.execute()
            accepted_callback(goal_handle)

        super().__init__(
            node,
            kind,
            name,
            execute_callback=lambda goal_handle: None,
            goal_callback=goal_callback,
            handle_accepted_callback=accept,
            cancel_callback=cancel_callback,
        )
        node.remove_waitable(self)  # the executor must not take its requests
        self._wake_callback = wake_callback
        self._guard = _rclpy.GuardCondition(node.context.handle)
        self._is_closed = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=f"action {name}", daemon=True)

    def start(self) -> None:
        """Start to serve requests."""
        self._thread.start()

    def wake(self) -> None:
        """Let the thread call `wake_callback`. Any thread may call this."""
        self._guard.trigger_guard_condition()

    def close(self) -> None:
        """End the thread and the server."""
        self._is_closed.set()
        self.wake()
        self._thread.join()
        self._wake_callback()  # for results that came in the meantime
        self._node.add_waitable(self)  # `destroy` removes it
        self.destroy()

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        """Start nothing: the goal is executed elsewhere, until `finish`."""

    def finish(self, goal_handle: ServerGoalHandle, end: Callable[[], None], result: Any) -> None:
        """End a goal and send its result to all who ask for it.

        end : sets the terminal state: `goal_handle.succeed`, `abort` or `canceled`.
        """

        def execute(_: ServerGoalHandle) -> Any:
            end()
            return result

        _run(self._execute_goal(execute, goal_handle))

    def _serve(self) -> None:
        while not self._is_closed.is_set() and self._node.context.ok():
            try:
                self._serve_once()
            except Exception as error:
                if self._node.context.ok():
                    reason = failure_reason(self._logger, error)
                    self._logger.error(f"request failed: {reason}", throttle_duration_sec=1.0)
                self._is_closed.wait(RETRY_PERIOD)

    def _serve_once(self) -> None:
        count = self.get_num_entities()
        with self, self._guard:
            wait_set = _rclpy.WaitSet(
                count.num_subscriptions,
                count.num_guard_conditions + 1,
                count.num_timers,
                count.num_clients,
                count.num_services,
                0,
                self._node.context.handle,
            )
            wait_set.clear_entities()
            self.add_to_wait_set(wait_set)
            wait_set.add_guard_condition(self._guard)
            wait_set.wait(-1)
            if self.is_ready(wait_set):
                _run(self.execute(self.take_data()))
        self._wake_callback()


def _run(coroutine: Coroutine[Any, Any, Any]) -> None:
    """Run a coroutine that awaits nothing."""
    try:
        coroutine.send(None)
    except StopIteration:
        return
    raise RuntimeError("a callback of an action is a coroutine that waits")
