"""The work of nodes, divided into pieces so that requests and signals are served in between.

A signal ends a callback, because the solver may need seconds to its result. Python runs signal
handlers between its instructions, so an exception raised by the handler ends a solve after the
NumPy call in progress, which takes less than a second at the largest sizes of `arm.limits`. It is
raised and caught within callbacks only, because executors log what callbacks raise. While numba
compiles, LLVM calls Python back and loses an exception raised there: the signal is then repeated.
"""

import collections
import contextlib
import functools
import signal
import threading
import traceback
from collections.abc import Callable, Generator, Iterator
from concurrent import futures
from types import FrameType
from typing import Any, TypeVar

from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.node import Node
from rclpy.timer import Timer

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


def interruptible(callback: Callable[..., Any]) -> Callable[..., Any]:
    """Return a ``callback`` that a signal ends, and that does nothing after a signal.

    It then returns its last argument, which is the response if it is the callback of a service.
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
    """Ignore a RuntimeError within the block if a signal has shut down ``context``."""
    try:
        yield
    except RuntimeError:
        if context.ok():
            raise


def steady_timer(node: Node, period: float, callback: Callable[[], None]) -> Timer:
    """Call ``callback`` every ``period`` [s], even while ROS time stands still or jumps."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


Piece = Callable[[], bool | None]


class WorkQueue:
    """A queue of pieces of work, of which the executor has at most one as its task.

    An executor works in the order of arrival. Parameters, /clock and timers therefore wait for the
    piece in progress and the one that is its task already, but not for the rest of the queue.
    """

    def __init__(self, node: Node) -> None:
        """Do work for ``node`` while an executor spins it."""
        self._node = node
        self._due: collections.deque[Piece] = collections.deque()
        self._is_queued = False
        self._do = interruptible(self._do_next)

    def add(self, piece: Piece) -> None:
        """Queue ``piece``, which is queued again behind all others while it returns True."""
        if piece not in self._due:  # a queued piece keeps its place
            self._due.append(piece)
        self._queue()

    def clear(self) -> None:
        """Drop the pieces that wait."""
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


Result = TypeVar('Result')
SLICE = 0.02  # [s] to wait for a long call before other work is served
LONGEST_WAIT = 0.5  # [s] to wait for the end of an abandoned call


class _Abandoned(BaseException):
    """Raised in a function whose result is no longer needed."""


def sliced(
    function: Callable[[Callable[[], None]], Result], seconds: float
) -> Generator[None, None, Result]:
    """Wait in slices of ``seconds`` [s] for ``function(pause)``, which runs on its own thread.

    The function needs its own solver. The generator yields between slices, and returns or raises
    what the function does. If the generator is closed, or a signal ends a slice, the function ends
    at its next call of ``pause``.
    """
    outcome: futures.Future[Result] = futures.Future()
    is_abandoned = threading.Event()

    def pause() -> None:
        if is_abandoned.is_set():
            raise _Abandoned

    def run() -> None:
        try:
            outcome.set_result(function(pause))
        except BaseException as error:
            outcome.set_exception(error)

    # A daemon thread does not keep the process alive after a signal.
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        while not futures.wait([outcome], seconds).done:
            yield
        return outcome.result()
    finally:
        is_abandoned.set()
        thread.join(LONGEST_WAIT)


MOST_WAITING = 100  # requests of one service besides the one in progress

# A generator that fills in the response to a request and is suspended at every yield.
Steps = Generator[None, None, None]
Answer = Callable[[Any, Any], Steps]


class QueuedService:
    """A service that queues its requests and answers them later, one at a time.

    An executor answers a request before it does anything else: with a hundred of them, a request
    for parameters would wait for a hundred solves.
    """

    def __init__(self, node: Node, kind: Any, name: str, answer: Answer, work: WorkQueue) -> None:
        """Offer the service ``name`` of type ``kind``, whose responses have success and message.

        ``answer`` fills in a response; each of its steps between yields is a piece of ``work``.
        """
        self._node, self._answer, self._work = node, answer, work
        # Each has a request, its response and its header; the first is being answered.
        self._waiting: collections.deque[tuple[Any, Any, Any]] = collections.deque()
        self._steps: Steps | None = None
        self._request: Any = None
        self._service = node.create_service(kind, name, self._keep)
        # Only `send_response` gets the header that identifies the request. The callback cannot be
        # a coroutine, because rclpy's events executor does not wait for one.
        self._send = self._service.send_response
        self._service.send_response = self._add  # type: ignore[method-assign]

    def close(self) -> None:
        """Refuse the requests that wait, and destroy the service."""
        if self._steps is not None:
            self._steps.close()
        for _, response, header in self._waiting:
            self._refuse(response, header, 'the node stops answering')
        self._waiting.clear()
        self._node.destroy_service(self._service)

    def _refuse(self, response: Any, header: Any, reason: str) -> None:
        response.success, response.message = False, reason
        self._send(response, header)

    def _keep(self, request: Any, response: Any) -> Any:
        self._request = request
        return response

    def _add(self, response: Any, header: Any) -> None:
        if len(self._waiting) > MOST_WAITING:
            reason = f'{MOST_WAITING} requests are waiting, expected fewer at a time'
            self._refuse(response, header, reason)
            return
        self._waiting.append((self._request, response, header))
        if self._steps is None:
            steps = self._steps = self._answer_all()
            self._work.add(lambda: next(steps, self) is None)

    def _answer_all(self) -> Steps:
        while self._waiting:
            request, response, header = self._waiting[0]
            yield from self._answer(request, response)
            self._waiting.popleft()
            self._send(response, header)
            yield
        self._steps = None
