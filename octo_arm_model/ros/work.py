"""Callbacks that end at a signal, long calls on threads, and services with queues.

A signal ends a callback, because the solver may need seconds to its result. Python runs signal
handlers between its instructions, so an exception raised by the handler ends a solve after the
NumPy call in progress, which takes less than a second at the largest sizes of `arm.limits`. It is
raised and caught within callbacks only, because executors log what callbacks raise. While numba
compiles, LLVM calls Python back and loses an exception raised there: the signal is then repeated.
"""

import collections
import functools
import signal
import threading
import traceback
from collections.abc import Callable
from concurrent import futures
from functools import partial
from types import FrameType
from typing import Any, TypeVar

from rclpy.clock import Clock, ClockType, JumpHandle, JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.timer import Timer

from octo_arm_model.arm.errors import in_short
from octo_arm_model.terminal import RefusalLog

_CALLED_BY_LLVM = ('llvmlite.binding.executionengine', '_raw_object_cache_')  # module, functions
_REPEAT_AFTER = 0.01  # [s] until a signal is repeated


class _Interruption(BaseException):
    """A signal came while a callback was running."""


class _State:
    has_come = False
    is_running = False


def install() -> None:
    """Handle SIGINT and SIGTERM in this process; call it before rclpy adds its own handlers.

    SIGALRM is used to repeat a signal.
    """
    _State.has_come = _State.is_running = False
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
        signal.signal(number, _on_signal)


def ignore_signals() -> None:
    """Ignore SIGINT and SIGTERM from now on: they would kill a Python process that is ending."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


def _on_signal(number: int, frame: FrameType | None) -> None:
    _State.has_come = True
    if not _State.is_running:
        return
    module, functions = _CALLED_BY_LLVM
    for call, _ in traceback.walk_stack(frame):
        if call.f_globals.get('__name__') == module and call.f_code.co_name.startswith(functions):
            signal.setitimer(signal.ITIMER_REAL, _REPEAT_AFTER)
            return
    _State.is_running = False  # a second signal must not interrupt the clean-up
    raise _Interruption


def end_if_interrupted() -> None:
    """End the callback if a signal came; for where rclpy loses the exception of the handler."""
    if _State.has_come:
        raise _Interruption


def interruptible(callback: Callable[..., Any]) -> Callable[..., Any]:
    """Return a ``callback`` that a signal ends, and that does nothing after a signal.

    It then returns its last argument, which is the response if it is the callback of a service.
    """

    @functools.wraps(callback)
    def run(*arguments: Any) -> Any:
        if _State.has_come:
            return arguments[-1] if arguments else None  # of a service its response, as it is
        try:
            _State.is_running = True
            return callback(*arguments)
        except _Interruption:
            return arguments[-1] if arguments else None  # of a service its response, as it is
        finally:
            _State.is_running = False

    return run


def guarded(node: Node, callback: Callable[..., Any]) -> Callable[..., Any]:
    """Return a ``callback`` of ``node`` that a signal ends, and that raises nothing.

    By an exception of a callback rclpy's executor would crash. A fault of this package is logged.
    """
    log = RefusalLog(node.get_logger().error)

    def run(*arguments: Any) -> Any:
        try:
            return callback(*arguments)
        except Exception:
            end_if_interrupted()
            if node.context.ok():  # else it was shut down amid the callback
                log.add('unexpected fault', traceback.format_exc())
            return arguments[-1] if arguments else None  # of a service its response, as it is

    return interruptible(run)


def steady_timer(node: Node, period: float, callback: Callable[[], None]) -> Timer:
    """Call ``callback`` every ``period`` [s], even while ROS time stands still or jumps."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def on_jump_back(node: Node, callback: Callable[[], None]) -> JumpHandle:
    """Call ``callback`` whenever simulated time jumps back, while the result is kept."""
    back = JumpThreshold(
        min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False
    )
    return node.get_clock().create_jump_callback(back, post_callback=lambda _: callback())


Result = TypeVar('Result')
LONGEST_WAIT = 0.5  # [s] to wait for the end of an abandoned call


class _Abandoned(BaseException):
    """Raised in a function whose result is no longer needed."""


class LongCall(futures.Future[Result]):
    """The result of ``function(pause)``, which runs on a thread and needs its own solver."""

    def __init__(self, function: Callable[[Callable[[], None]], Result]) -> None:
        """Start the function, which ends at its next call of ``pause`` once it is abandoned."""
        super().__init__()
        self._function, self._is_abandoned = function, threading.Event()
        # A daemon thread does not keep the process alive after a signal.
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def abandon(self) -> None:
        """End the call, whose result is no longer needed, and wait for its end a short time."""
        self._is_abandoned.set()
        self._thread.join(LONGEST_WAIT)

    def _run(self) -> None:
        try:
            self.set_result(self._function(self._pause))
        except BaseException as error:
            self.set_exception(error)

    def _pause(self) -> None:
        if self._is_abandoned.is_set():
            raise _Abandoned


MOST_WAITING = 100  # requests of one service besides the one in progress

# Called on a thread with a request, its response and a function to be called now and then. It
# fills in the response; all else is done in the thread of the executor.
Answer = Callable[[Any, Any, Callable[[], None]], None]


class QueuedService:
    """A service that queues its requests and answers them one at a time, on a thread of its own.

    An executor answers a request before it does anything else: with a hundred of them, a request
    for parameters would wait for a hundred solves.
    """

    def __init__(self, node: Node, kind: Any, name: str, answer: Answer) -> None:
        """Offer the service ``name`` of type ``kind``, whose responses have success and message.

        ``answer`` fills in a response; it needs its own solver.
        """
        self._node, self._response, self._answer = node, kind.Response, answer
        # Each has a request, its response and its header; the first is being answered.
        self._waiting: collections.deque[tuple[Any, Any, Any]] = collections.deque()
        self._log = RefusalLog(node.get_logger().error)
        self._call: LongCall[None] | None = None
        self._request: Any = None
        self._is_open = True
        self._service = node.create_service(kind, name, self._keep)
        # Only `send_response` gets the header that identifies the request. The callback cannot be
        # a coroutine, because rclpy's events executor does not wait for one.
        self._send = self._service.send_response
        self._service.send_response = self._add  # type: ignore[method-assign]

    def close(self) -> None:
        """Refuse the requests that wait, and destroy the service."""
        self._is_open = False
        if self._call is not None:
            self._call.abandon()
        for _, _, header in self._waiting:
            self._refuse(header, 'the node stops answering')
        self._node.destroy_service(self._service)

    def _refuse(self, header: Any, reason: str) -> None:
        self._send(self._response(success=False, message=reason), header)

    def _keep(self, request: Any, response: Any) -> Any:
        self._request = request
        return response

    def _add(self, response: Any, header: Any) -> None:
        if not self._is_open:
            return  # the executor knew of it before; rclpy can answer it no more
        if len(self._waiting) > MOST_WAITING:
            self._refuse(header, f'{MOST_WAITING} requests are waiting, expected fewer at a time')
            return
        self._waiting.append((self._request, response, header))
        if len(self._waiting) == 1:
            self._begin()

    def _begin(self) -> None:
        request, response, _ = self._waiting[0]
        self._call = LongCall(partial(self._answer, request, response))
        self._call.add_done_callback(self._on_end)

    def _on_end(self, call: futures.Future[None]) -> None:
        if executor := self._node.executor:
            executor.create_task(guarded(self._node, partial(self._end, call)))

    def _end(self, call: futures.Future[None]) -> None:
        if not self._is_open:
            return
        _, response, header = self._waiting.popleft()
        try:
            call.result()
        except Exception as error:  # a fault of this package: the next are answered still
            response.success = False
            response.message = f'unexpected {type(error).__name__}: {in_short(error)}'
            self._log.add('unexpected fault', traceback.format_exc())
        self._send(response, header)
        if self._waiting:
            self._begin()
