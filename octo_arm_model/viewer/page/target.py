"""The search of tensions for a dragged target of the tip, in its own thread."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

import numpy as np

from octo_arm_model.analysis.inverse import Inverse, find_tensions
from octo_arm_model.analysis.targets import TipPosition
from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.solver import Solver

Answer = Inverse | OctoArmError
Request = tuple[FloatArray, FloatArray]  # tip [m] and tensions to begin from [N]


class TargetSearch:
    """Finds tensions for the newest of the requested targets; older ones are dropped.

    Attributes:
        thread: the thread of the search, a daemon.
    """

    def __init__(
        self, solver: Solver, highest: FloatArray, deliver: Callable[[Answer], None]
    ) -> None:
        """Search with ``solver`` up to ``highest`` [N]; ``deliver`` is called in that thread."""
        self._solver = solver
        self._highest = highest.reshape(solver.arm.tension_shape)
        self._deliver = deliver
        self._last: Request | None = None
        self._requests: queue.SimpleQueue[Request | None] = queue.SimpleQueue()
        self.thread = threading.Thread(target=self._work, name='search', daemon=True)
        self.thread.start()

    def request(self, tip: FloatArray, start: FloatArray) -> None:
        """Search tensions for the tip at ``tip`` (3,) [m], from ``start`` (tendons,) [N]."""
        self._last = np.array(tip), np.array(start)
        self._requests.put(self._last)

    def close(self) -> None:
        """End the thread after the last request."""
        self._requests.put(None)

    def _work(self) -> None:
        while (request := self._newest()) is not None:
            tip, start = request
            shape = self._solver.arm.tension_shape
            start = np.clip(start.reshape(shape), 0.0, self._highest)
            try:
                answer: Answer = find_tensions(
                    self._solver, TipPosition(tip), self._highest, start=start
                )
            except OctoArmError as error:
                answer = error
            # Drop the result if there is a newer target.
            if request is self._last:
                self._deliver(answer)

    def _newest(self) -> Request | None:
        request = self._requests.get()
        while request is not None and not self._requests.empty():
            following = self._requests.get()
            if following is None:
                self._requests.put(None)
                break
            request = following
        return request
