"""Parts that programs share on a terminal: option parser, exit status, status line and logs."""

import argparse
import contextlib
import logging
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, NoReturn, TextIO

from octo_arm_model.arm.errors import OctoArmError

_PERIOD = 0.1  # [s] between two updates of the status line on a terminal
# Extras of setup.py, which bounds their versions, with the modules that they bring.
_EXTRAS = {
    'bags': ('apsw', 'backports', 'lz4', 'rosbags'),
    'cluster': ('cloudpickle', 'dask', 'distributed'),
    'compiled': ('llvmlite', 'numba'),
    'figures': ('matplotlib',),
    'gymnasium': ('gymnasium',),
    'viewer': ('msgspec', 'viser', 'websockets'),
}


class _StoreOnce(argparse.Action):
    """Stores the value of an option and refuses a second one, which would replace the first.

    The attribute ``given`` of the namespace is the set of names of the options that were given.
    """

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        option_string: str | None = None,
    ) -> None:
        given = namespace.__dict__.setdefault('given', set())
        if self.dest in given:
            many = ', with all its values behind it' if self.nargs == '+' else ''
            parser.error(f'{option_string} is given twice, expected once{many}')
        if option_string is not None:
            given.add(self.dest)
        setattr(namespace, self.dest, values)


class _Parser(argparse.ArgumentParser):
    """Reports an error in one line and refers to --help instead of listing all options."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.register('action', None, _StoreOnce)
        self.register('action', 'store', _StoreOnce)

    def parse_known_args(self, *args: Any, **options: Any) -> Any:
        known, rest = super().parse_known_args(*args, **options)
        if rest:  # otherwise the parser of all commands would report an option of one of them
            self.error(f'unrecognized arguments: {" ".join(rest)}')
        return known, rest

    def error(self, message: str) -> NoReturn:
        self.exit(2, f'{self.prog}: error: {message}; see {self.prog} --help\n')


def make_parser(prog: str, description: str, epilog: str) -> argparse.ArgumentParser:
    """Return the parser of a program; its texts are printed without reformatting."""
    return _Parser(
        prog=prog,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def fail(prog: str, problem: object, status: int = 2) -> int:
    """Print ``problem`` as the error of the program ``prog``, and return its exit ``status``."""
    print(f'{prog}: error: {problem}', file=sys.stderr)
    return status


def status_of(prog: str, run: Callable[[], int]) -> int:
    """Call ``run``, the program ``prog``, and return its exit status; an error is printed."""
    try:
        return run()
    except OctoArmError as error:
        return fail(prog, error)
    except BrokenPipeError:
        return pipe_closed()


def pipe_closed() -> int:
    """Return the exit status for a pipe that its reader has closed, as `head` does."""
    # Python would report the closed pipe again at exit.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 141


def missing(error: ModuleNotFoundError, *extras: str) -> str:
    """Say what to install after ``error``; ``extras`` are those that the program may need."""
    module = (error.name or '').partition('.')[0]
    if module == 'octo_arm_model':
        raise error  # a fault of the package
    if missing_extras := {name for name, modules in _EXTRAS.items() if module in modules}:
        names = ','.join(sorted({*missing_extras, *extras}))
        return f"needs {module}; install it with: pip install 'octo_arm_model[{names}]'"
    return (
        f'needs ROS 2 and the package octo_arm_msgs ({module} is missing): source them, or put '
        'tools/with_ros of the checkout in front'
    )


@contextlib.contextmanager
def on_signals(handle: Callable[[int], None], same: float) -> Iterator[None]:
    """Call ``handle`` with the number of each SIGINT, SIGTERM and SIGHUP within the block.

    A signal that the program was started to ignore stays ignored. A signal less than ``same`` [s]
    after a handled one is dropped: shells and `timeout` signal both the program and its group.
    """
    handled_at = -math.inf

    def take(number: int, frame: object) -> None:
        nonlocal handled_at
        if (now := time.monotonic()) >= handled_at + same:
            handled_at = now
            handle(number)

    previous = {
        number: handler
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        if (handler := signal.getsignal(number)) != signal.SIG_IGN
        and threading.current_thread() is threading.main_thread()
    }
    for number in previous:
        signal.signal(number, take)
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


class StatusLine(contextlib.AbstractContextManager['StatusLine']):
    """A line on a terminal that each new text overwrites; elsewhere each text is a new line.

    Attributes:
        is_terminal: whether it is written to a terminal.
    """

    def __init__(self, stream: TextIO, period_elsewhere: float = math.inf) -> None:
        """Write to ``stream``, at most every ``period_elsewhere`` [s] where it is no terminal."""
        self.is_terminal = stream.isatty()
        self._stream = stream
        self._period = _PERIOD if self.is_terminal else period_elsewhere
        self._shown = -math.inf if self.is_terminal else time.monotonic()
        self._is_open = False

    def show(self, describe: Callable[[], str], *, always: bool = False) -> None:
        """Write what ``describe`` returns once the period is over, or at once if ``always``."""
        now = time.monotonic()
        if now - self._shown < self._period and not always:
            return
        self._shown, self._is_open = now, self.is_terminal
        try:
            # Return to the start of the line, and erase the rest of a longer text.
            self._stream.write(f'\r{describe()}\x1b[K' if self.is_terminal else f'{describe()}\n')
            self._stream.flush()
        except BrokenPipeError:
            raise
        except OSError:  # such as a full disk, which must not stop the program
            self._is_open = False

    def __exit__(self, *_: object) -> None:
        self.leave()

    def leave(self) -> None:
        """End the line, so that later output appears below it."""
        if self._is_open:
            self._stream.write('\n')
            self._is_open = False


WARNING_PERIOD = 1.0  # [s] between lines about the same


class RefusalLog:
    """Logs what is refused, at most one line for each ``what`` and period.

    Frequent refusals of one thing do not hide rare ones of another. The logger of ROS looks up the
    line that calls it for that, which takes longer than solving an arm.
    """

    def __init__(self, warn: Callable[[str], object]) -> None:
        """Log by calls of ``warn``."""
        self._warn = warn
        self._logged: dict[str, tuple[float, int]] = {}  # time of the next line, lines left out

    def add(self, what: str, why: str) -> None:
        """Log ``what`` and ``why``, or count it until the next line."""
        now, (due, left_out) = time.monotonic(), self._logged.get(what, (-math.inf, 0))
        if now < due:
            self._logged[what] = due, left_out + 1
            return
        self._logged[what] = now + WARNING_PERIOD, 0
        self._warn(f'{what}: {why}' + (f' (and {left_out} before that)' if left_out else ''))


class _CallbackHandler(logging.Handler):
    """Calls a function with every log record."""

    def __init__(self, show: Callable[[str, bool], object]) -> None:
        super().__init__(logging.INFO)
        self._show = show

    def emit(self, record: logging.LogRecord) -> None:
        self._show(record.getMessage(), record.levelno >= logging.WARNING)


def show_logs(show: Callable[[str, bool], object]) -> None:
    """Call ``show`` with the text of each record, and whether it is a warning or an error."""
    logger = logging.getLogger('octo_arm_model')
    logger.handlers = [_CallbackHandler(show)]
    logger.setLevel(logging.INFO)
    logger.propagate = False
