"""What a node computes, a piece at a time, so that requests for parameters come in between."""

from __future__ import annotations

import collections
from collections.abc import Callable

from rclpy.node import Node

from octo_arm_model.ros.work.interruption import interruptible, until_shutdown

Piece = Callable[[], bool]


class WorkQueue:
    """Pieces of work in turns, each a task of the executor.

    An executor answers in the order of arrival. Only one piece is a task at a time: parameters,
    /clock and timers wait for the piece that is being done and for the one that is queued already,
    however many others are due.
    """

    def __init__(self, node: Node) -> None:
        """Work for ``node``, while an executor spins it."""
        self._node = node
        self._due: collections.deque[Piece] = collections.deque()
        self._is_queued = False
        self._do = interruptible(self._do_next)

    def add(self, piece: Piece) -> None:
        """Do ``piece`` in its turn, and again behind all others as long as it returns True."""
        self._due.append(piece)
        self._queue()

    def add_first(self, piece: Piece) -> None:
        """Do ``piece`` before all others that are due: they need what it ends."""
        self._due.appendleft(piece)
        self._queue()

    def clear(self) -> None:
        """Drop what is not done yet."""
        self._due.clear()

    def _queue(self) -> None:
        executor = self._node.executor
        if self._due and not self._is_queued and executor is not None:
            self._is_queued = True
            executor.create_task(self._do)

    def _do_next(self) -> None:
        self._is_queued = False
        if not self._due:
            return
        piece = self._due.popleft()
        try:
            with until_shutdown(self._node.context):
                if piece():
                    self._due.append(piece)
        finally:
            self._queue()
