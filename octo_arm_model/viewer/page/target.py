"""A point to drag: tensions that bring the tip there are looked for while the page lives on."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

import numpy as np

from octo_arm_model.analysis.inverse import Inverse, find_tensions
from octo_arm_model.analysis.targets import TipPosition
from octo_arm_model.core.errors import OctoArmError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.solver import Solver

Answer = Inverse | OctoArmError
Wanted = tuple[FloatArray, FloatArray]  # tip [m] and tensions to begin from [N]


class Search:
    """Looks for tensions in a thread of its own; of several targets waiting the newest counts.

    Attributes:
        thread: the thread; it may end with the process, nothing is lost.
    """

    def __init__(
        self, solver: Solver, highest: FloatArray, deliver: Callable[[Answer], None]
    ) -> None:
        """Search with ``solver`` up to ``highest`` [N]; ``deliver`` is called in that thread."""
        self._solver = solver
        self._highest = highest.reshape(solver.arm.tension_shape)
        self._deliver = deliver
        self._last: Wanted | None = None
        self._wanted: queue.SimpleQueue[Wanted | None] = queue.SimpleQueue()
        self.thread = threading.Thread(target=self._work, name='search', daemon=True)
        self.thread.start()

    def look_for(self, tip: FloatArray, start: FloatArray) -> None:
        """Bring the tip to ``tip`` (3,) [m], beginning at ``start`` (tendons,) [N]."""
        self._last = np.array(tip), np.array(start)
        self._wanted.put(self._last)

    def close(self) -> None:
        """End after what was asked for last."""
        self._wanted.put(None)

    def _work(self) -> None:
        while (wanted := self._newest()) is not None:
            tip, start = wanted
            shape = self._solver.arm.tension_shape
            start = np.clip(start.reshape(shape), 0.0, self._highest)
            try:
                answer: Answer = find_tensions(
                    self._solver, TipPosition(tip), self._highest, start=start
                )
            except OctoArmError as error:
                answer = error
            # Of a target that was left behind nobody wants to know.
            if wanted is self._last:
                self._deliver(answer)

    def _newest(self) -> Wanted | None:
        wanted = self._wanted.get()
        while wanted is not None and not self._wanted.empty():
            following = self._wanted.get()
            if following is None:
                self._wanted.put(None)
                break
            wanted = following
        return wanted
