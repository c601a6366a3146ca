"""A service whose requests are answered in their turn of a `WorkQueue`."""

from __future__ import annotations

import collections
from collections.abc import Callable, Generator
from typing import Any

from rclpy.node import Node

from octo_arm_model.ros.work.work_queue import WorkQueue

MOST_WAITING = 100  # requests of one service

# Fills in the response to a request; suspended at every yield.
Steps = Generator[None, None, None]
Answer = Callable[[Any, Any], Steps]


class QueuedService:
    """Takes requests as they come and answers them later, one at a time.

    An executor answers a request before it turns to anything else: a hundred of them would keep a
    request for parameters waiting for a hundred solves.
    """

    def __init__(self, node: Node, kind: Any, name: str, answer: Answer, work: WorkQueue) -> None:
        """Offer the service ``name`` of type ``kind``, whose responses have success and message.

        ``answer`` fills in a response, in pieces of ``work`` that end where it yields.
        """
        self._node, self._answer, self._work = node, answer, work
        self._waiting: collections.deque[tuple[Any, Any, Any]] = collections.deque()
        self._under_way: tuple[Steps, Any, Any] | None = None
        self._request: Any = None
        self._service = node.create_service(kind, name, self._keep)
        # `send_response` gets the header that identifies the request, the callback does not.
        self._send = self._service.send_response
        self._service.send_response = self._add  # type: ignore[method-assign]

    def close(self) -> None:
        """Destroy the service; what waits is answered with that."""
        waiting = [(response, header) for _, response, header in self._waiting]
        self._waiting.clear()
        if self._under_way is not None:
            steps, response, header = self._under_way
            steps.close()
            self._under_way = None
            waiting.insert(0, (response, header))
        for response, header in waiting:
            self._refuse(response, header, 'the node stops answering')
        self._node.destroy_service(self._service)

    def _refuse(self, response: Any, header: Any, reason: str) -> None:
        response.success, response.message = False, reason
        self._send(response, header)

    def _keep(self, request: Any, response: Any) -> Any:
        self._request = request
        return response

    def _add(self, response: Any, header: Any) -> None:
        if len(self._waiting) >= MOST_WAITING:
            reason = f'{MOST_WAITING} requests are waiting, expected fewer at a time'
            self._refuse(response, header, reason)
            return
        self._waiting.append((self._request, response, header))
        if self._under_way is None and len(self._waiting) == 1:
            self._work.add(self._go_on)

    def _go_on(self) -> bool:
        """Advance the oldest request by one step; returns whether any is unanswered."""
        if self._under_way is None:
            if not self._waiting:
                return False
            request, response, header = self._waiting.popleft()
            self._under_way = self._answer(request, response), response, header
        steps, response, header = self._under_way
        try:
            next(steps)
        except StopIteration:
            self._under_way = None
            self._send(response, header)
        return self._under_way is not None or bool(self._waiting)
