"""What nodes compute, in turns and slices that requests and signals may come between.

A signal ends a callback: the solver may be seconds away from its result. Python runs signal
handlers between its instructions, so an exception raised by the handler ends a solve after the
NumPy call in progress, less than a second at the largest sizes of `arm.limits`. It is raised
within callbacks only, and caught there: executors log what callbacks raise. Where numba compiles,
LLVM calls Python back and loses what that raises: the signal then comes again.
"""

import collections
import contextlib
import functools
import math
import queue
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator
from concurrent import futures
from types import FrameType
from typing import Any, TypeVar

from rclpy.context import Context
from rclpy.node import Node

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


Result = TypeVar('Result')
SLICE = 0.02  # [s] of a long call between two looks at what else is to be done
LONGEST_WAIT = 0.5  # [s] for a signal that came just before a wait


class _Abandoned(BaseException):
    """Raised in a suspended function whose result is no longer needed."""


def sliced(  # noqa: C901 - with what runs on its thread
    function: Callable[[Callable[[], None]], Result], seconds: float
) -> Generator[None, None, Result]:
    """Run ``function(pause)``, which calls ``pause`` now and then, in slices of ``seconds`` [s].

    Searches cannot return in the middle of their work. The function therefore runs on a thread of
    its own, but only while this generator waits for it: never beside the caller, but after a
    signal. The generator yields between slices, and returns or raises what the function does.
    Where it is closed, or a signal ends a slice, the function is ended at its next ``pause``.
    """
    resume: queue.SimpleQueue[bool] = queue.SimpleQueue()
    suspended: queue.SimpleQueue[bool] = queue.SimpleQueue()
    outcome: futures.Future[Result] = futures.Future()
    until = 0.0

    def wait() -> None:
        if not resume.get():
            raise _Abandoned

    def pause() -> None:
        if time.monotonic() >= until:
            suspended.put(False)
            wait()

    def run() -> None:
        try:
            wait()
            outcome.set_result(function(pause))
        except _Abandoned:
            return
        except BaseException as error:
            outcome.set_exception(error)
        suspended.put(True)

    # As a daemon it does not keep a process that a signal ends.
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        while True:
            until = time.monotonic() + seconds
            resume.put(True)
            if _next_of(suspended):
                return outcome.result()
            yield
    except BaseException:
        until = -math.inf
        resume.put(False)
        # So that what it worked with is free again; bounded, as the pause may be far.
        thread.join(LONGEST_WAIT)
        raise


def _next_of(suspended: queue.SimpleQueue[bool]) -> bool:
    """Whether the function has ended, once it has or is suspended."""
    while True:
        # A signal wakes a thread that waits, not one that is about to: an endless wait would keep
        # its handler from running.
        with contextlib.suppress(queue.Empty):
            return suspended.get(timeout=LONGEST_WAIT)


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
        # `send_response` gets the header that identifies the request, the callback does not; nor
        # may that be a coroutine, for which rclpy's events executor does not wait.
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
