"""Responses that a service sends later than its callback returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rclpy.service import Service


@dataclass(eq=False, kw_only=True)
class DeferredResponse:
    """What a callback returns in place of a response that is not complete.

    Attributes
    ----------
    send : sends the response; None until the executor has handed over the header of the request.
    """

    send: Callable[[Any], None] | None = field(default=None, init=False)


def defer_responses(service: Service, on_deferred: Callable[[Any], None] = lambda _: None) -> None:
    """Let a service send a DeferredResponse later, by its attribute `send`.

    Parameters
    ----------
    on_deferred : called with each DeferredResponse once `send` is set.
    """
    send_now = service.send_response

    def send_or_keep(response: Any, header: Any) -> None:
        if isinstance(response, DeferredResponse):
            response.send = lambda completed: send_now(completed, header)
            on_deferred(response)
        else:
            send_now(response, header)

    # executors send what the callback returns by this method
    service.send_response = send_or_keep  # type: ignore[method-assign]
