"""Programs that one program starts and ends, and the signals that end it."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence

_PATIENCE = 10.0  # [s] for a program to end by itself


def stop_signals() -> Callable[[], bool]:
    """Take notice of Ctrl-C and its like; returns what tells whether one has come."""
    is_over = threading.Event()
    # A shell ignores SIGINT in what it starts behind itself, which is why it is set as well.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, frame: is_over.set())
    return is_over.is_set


@contextlib.contextmanager
def children(commands: Sequence[Sequence[str]]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Run modules of Python, each with its arguments, for as long as the block takes."""
    started: list[subprocess.Popen[bytes]] = []
    try:
        for command in commands:
            # A session of its own, so that Ctrl-C reaches it once, from here.
            started.append(
                subprocess.Popen([sys.executable, '-m', *command], start_new_session=True)
            )
        yield started
    finally:
        for child in started:
            # SIGTERM ends it quietly even while it is still starting.
            child.terminate()
        for child in started:
            try:
                child.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()


def ended(started: Sequence[subprocess.Popen[bytes]]) -> str:
    """Which child has ended by itself, and how; empty while all run."""
    for child in started:
        if (status := child.poll()) is not None:
            module = str(child.args[2]) if isinstance(child.args, list) else ''
            return f'{module} ended by itself with status {status}'
    return ''
