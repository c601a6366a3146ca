"""A long call that its caller does in slices of time."""

from __future__ import annotations

import contextlib
import math
import queue
import threading
import time
from collections.abc import Callable, Generator
from typing import Generic, TypeVar

Result = TypeVar('Result')
SLICE = 0.02  # [s] of a long call between two looks at what else is to be done
LONGEST_WAIT = 0.5  # [s] for a signal that came just before a wait


class _Abandoned(BaseException):
    """Raised in a suspended function whose result is no longer needed."""


class SlicedCall(Generic[Result]):
    """Runs a function that calls ``pause`` now and then; at each of these it may be suspended.

    Searches cannot return in the middle of their work. The function therefore runs on a thread of
    its own, but only while `advance` waits for it: never beside the caller, but after a signal.
    """

    def __init__(self, function: Callable[[Callable[[], None]], Result], seconds: float) -> None:
        """Call ``function(pause)`` in slices of about ``seconds`` [s]."""
        self._function, self._seconds = function, seconds
        self._resume: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._suspended: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._until = 0.0
        self._result: Result | None = None
        self._error: BaseException | None = None
        # As a daemon it does not keep a process that a signal ends.
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def advance(self) -> bool:
        """Do the next slice; whether the function has returned or raised by its end."""
        self._until = time.monotonic() + self._seconds
        self._resume.put(True)
        while True:
            # A signal wakes a thread that waits, not one that is about to: an endless wait would
            # keep its handler from running.
            with contextlib.suppress(queue.Empty):
                return self._suspended.get(timeout=LONGEST_WAIT)

    def result(self) -> Result:
        """What the function returned, once it has.

        Raises:
            BaseException: what the function raised.
        """
        if self._error is not None:
            raise self._error
        assert self._result is not None
        return self._result

    def steps(self) -> Generator[None, None, Result]:
        """Do all slices, yielding between them; returns the result, raises what `result` does.

        Where it is closed, or a signal ends a slice, the function is abandoned.
        """
        try:
            while not self.advance():
                yield
        except BaseException:
            self.abandon()
            raise
        return self.result()

    def abandon(self) -> None:
        """End the function, from its next ``pause``.

        A suspended one has ended when this returns, and what it worked with is free again.
        """
        self._until = -math.inf
        self._resume.put(False)
        self._thread.join(LONGEST_WAIT)  # bounded: in the midst of a slice the pause may be far

    def _run(self) -> None:
        try:
            self._wait()
            self._result = self._function(self._pause)
        except _Abandoned:
            return
        except BaseException as error:
            self._error = error
        self._suspended.put(True)

    def _pause(self) -> None:
        if time.monotonic() >= self._until:
            self._suspended.put(False)
            self._wait()

    def _wait(self) -> None:
        if not self._resume.get():
            raise _Abandoned
