"""Arguments, signals and child processes of programs that are nodes; needs no ROS."""

import contextlib
import json
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from octo_arm_model.terminal import make_parser

_DESCRIPTION = 'A node of ROS 2, until Ctrl-C. Its arguments are those of ROS, after --ros-args.'
_EPILOG = """\
example:
  {} --ros-args --params-file config/renda2012_table4.yaml
"""


def split_arguments(arguments: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """Split ``arguments``, by default of the command line, at --ros-args: own, and of ROS."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    own = given.index('--ros-args') if '--ros-args' in given else len(given)
    return given[:own], given[own:]


def arguments_of_ros(name: str, arguments: Sequence[str] | None = None) -> list[str]:
    """Arguments of the node ``name`` from --ros-args on; of others --help alone is taken."""
    own, of_ros = split_arguments(arguments)
    make_parser(name, _DESCRIPTION, _EPILOG.format(name)).parse_args(own)
    return of_ros


_END_TIMEOUT = 10.0  # [s] from SIGTERM to SIGKILL
# Where the system has it a command begins with this, which ends it with its parent: SIGKILL gives
# that no time to.
_END_WITH_PARENT = ('setpriv', '--pdeathsig', 'TERM')


def stop_signals() -> Callable[[], bool]:
    """Handle SIGINT, SIGTERM and SIGHUP; returns a function that says if one came.

    SIGHUP stays ignored where it is, so that a program outlives its terminal under `nohup`.
    """
    is_over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        # `nohup` ignores SIGHUP on purpose. SIGINT is ignored by any shell's background job.
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda number, frame: is_over.set())
    return is_over.is_set


def parameter_arguments(values: Mapping[str, Any]) -> list[str]:
    """Arguments of a ROS program, after --ros-args, that set parameters to ``values``."""
    return [
        word for name, value in values.items() for word in ('-p', f'{name}:={json.dumps(value)}')
    ]


@contextlib.contextmanager
def children(commands: Sequence[Sequence[str]]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Run Python modules, each with its arguments, until the block ends."""
    started: list[subprocess.Popen[bytes]] = []
    before = _END_WITH_PARENT if shutil.which(_END_WITH_PARENT[0]) else ()
    try:
        for command in commands:
            # A session of its own: the terminal's Ctrl-C reaches this process alone.
            started.append(
                subprocess.Popen([*before, sys.executable, '-m', *command], start_new_session=True)
            )
        yield started
    finally:
        for child in started:
            # Not SIGINT, which prints a traceback while Python is still importing.
            child.terminate()
        for child in started:
            try:
                child.wait(_END_TIMEOUT)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()


def ended(started: Sequence[subprocess.Popen[bytes]]) -> str:
    """A sentence about the first child that has ended by itself; empty while all run."""
    for child in started:
        if (status := child.poll()) is not None:
            assert isinstance(child.args, list)  # as `children` starts it
            module = child.args[child.args.index('-m') + 1]
            return f'{module} ended by itself with status {status}'
    return ''
