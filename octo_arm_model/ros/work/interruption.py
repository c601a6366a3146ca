"""End callbacks of a node at a signal: the solver may be seconds away from its result.

Python runs signal handlers between its instructions, so an exception raised by the handler ends a
solve after the NumPy call in progress, less than a second at the largest sizes of `arm.limits`.
It is raised within callbacks only, and caught there: executors log what callbacks raise. Where
numba compiles, LLVM calls Python back and loses what that raises: the signal then comes again.
"""

from __future__ import annotations

import contextlib
import functools
import signal
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

from rclpy.context import Context

_CALLED_BY_LLVM = ('llvmlite.binding.executionengine', '_raw_object_cache_')  # module, functions
_AGAIN = 0.01  # [s]


class _Interruption(BaseException):
    """A signal came while a callback was running."""


class _State:
    has_come = False
    is_running = False


def install() -> None:
    """Handle SIGINT and SIGTERM in this process; call it before rclpy adds its own handlers.

    SIGALRM is taken for a signal that has to come again.
    """
    _State.has_come = _State.is_running = False
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
        signal.signal(number, _on_signal)


def ignore_signals() -> None:
    """Ignore SIGINT and SIGTERM from now on: they would kill a Python that is ending."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


def _on_signal(number: int, frame: FrameType | None) -> None:
    _State.has_come = True
    if _State.is_running and _is_called_by_llvm(frame):
        signal.setitimer(signal.ITIMER_REAL, _AGAIN)
    elif _State.is_running:
        _State.is_running = False  # raised once: a second signal must not interrupt the clean-up
        raise _Interruption


def _is_called_by_llvm(frame: FrameType | None) -> bool:
    module, functions = _CALLED_BY_LLVM
    while frame is not None:
        is_theirs = frame.f_globals.get('__name__') == module
        if is_theirs and frame.f_code.co_name.startswith(functions):
            return True
        frame = frame.f_back
    return False


def interruptible(callback: Callable[..., Any]) -> Callable[..., Any]:
    """``callback``, ended by a signal and not called after one.

    It then returns its last argument: the response, if it is the callback of a service.
    """

    @functools.wraps(callback)
    def run(*arguments: Any) -> Any:
        if _State.has_come:
            return arguments[-1] if arguments else None
        try:
            _State.is_running = True
            return callback(*arguments)
        except _Interruption:
            return arguments[-1] if arguments else None
        finally:
            _State.is_running = False

    return run


@contextlib.contextmanager
def until_shutdown(context: Context) -> Iterator[None]:
    """Ends quietly where a signal invalidates ``context`` meanwhile: what uses it then fails."""
    try:
        yield
    except RuntimeError:
        if context.ok():
            raise
