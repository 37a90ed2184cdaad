"""Messages of a subscription as they were serialized, taken in a thread of their own, without the lock of Python.

rclpy holds the lock while it copies a message, and while it makes an object of each point of a trajectory: 1 to 3 s for
100 000 points, in which no other thread of the process runs.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node

if TYPE_CHECKING:
    from robot_dynamics.array_types import ByteArray

WAIT = 100_000_000  # [ns] after which the thread looks whether it shall end
TAKEN = 0  # RCL_RET_OK


class _Allocator(ctypes.Structure):
    """rcutils_allocator_t."""

    _fields_ = [
        ("allocate", ctypes.c_void_p),
        ("deallocate", ctypes.c_void_p),
        ("reallocate", ctypes.c_void_p),
        ("zero_allocate", ctypes.c_void_p),
        ("state", ctypes.c_void_p),
    ]


class _SerializedMessage(ctypes.Structure):
    """rcutils_uint8_array_t."""

    _fields_ = [
        ("buffer", ctypes.c_void_p),
        ("buffer_length", ctypes.c_size_t),
        ("buffer_capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    ]


class SerializedSubscription:
    """Calls back with each message of a topic, from a thread of its own.

    Parameters
    ----------
    kind : type of the message.
    callback : takes the message, whose memory is valid until it returns.
    depth : of the queue, reliable.
    """

    def __init__(self, node: Node, kind: type, topic: str, callback: Callable[[ByteArray], None], depth: int) -> None:
        self._node = node
        self._callback = callback
        self._subscription = node.create_subscription(kind, topic, lambda _: None, depth, raw=True)
        node._subscriptions.remove(self._subscription)  # the executor must not take its messages
        self._rcl = ctypes.CDLL("librcl.so")  # is loaded already
        self._rcutils = ctypes.CDLL("librcutils.so")
        self._rcutils.rcutils_get_default_allocator.restype = _Allocator
        self._rcl.rcl_take_serialized_message.argtypes = [ctypes.c_void_p] * 4
        self._rcutils.rcutils_uint8_array_fini.argtypes = [ctypes.c_void_p]
        self._is_closed = threading.Event()
        self._thread = threading.Thread(target=self._receive, name=f"serialized {topic}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and the subscription."""
        self._is_closed.set()
        self._thread.join()
        self._subscription.destroy()

    def _receive(self) -> None:
        handle = self._subscription.handle
        wait_set = _rclpy.WaitSet(1, 0, 0, 0, 0, 0, self._node.context.handle)
        with handle:
            while not self._is_closed.is_set() and self._node.context.ok():
                wait_set.clear_entities()
                wait_set.add_subscription(handle)
                wait_set.wait(WAIT)
                if wait_set.get_ready_entities("subscription"):
                    self._take(handle.pointer)

    def _take(self, pointer: int) -> None:
        """Take a message if there is one, and call back with it. pointer: of the rcl_subscription_t."""
        message = _SerializedMessage(allocator=self._rcutils.rcutils_get_default_allocator())
        try:
            if self._rcl.rcl_take_serialized_message(pointer, ctypes.byref(message), None, None) == TAKEN:
                memory = (ctypes.c_uint8 * message.buffer_length).from_address(message.buffer)
                self._callback(np.frombuffer(memory, dtype=np.uint8))
        finally:
            self._rcutils.rcutils_uint8_array_fini(ctypes.byref(message))
