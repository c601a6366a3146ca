"""Arguments, signals and child processes of node programs; this module needs no ROS."""

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

_DESCRIPTION = 'Run a ROS 2 node until Ctrl-C. ROS arguments follow --ros-args.'
_EPILOG = """\
example:
  {} --ros-args --params-file config/renda2012_table4.yaml
"""


def split_arguments(arguments: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """Split ``arguments``, by default the command line, in front of --ros-args."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    index = given.index('--ros-args') if '--ros-args' in given else len(given)
    return given[:index], given[index:]


def arguments_of_ros(name: str, arguments: Sequence[str] | None = None) -> list[str]:
    """Return the arguments of the node ``name`` from --ros-args on; refuse others but --help."""
    before_ros, of_ros = split_arguments(arguments)
    make_parser(name, _DESCRIPTION, _EPILOG.format(name)).parse_args(before_ros)
    return of_ros


_END_TIMEOUT = 10.0  # [s] from SIGTERM to SIGKILL
# If the system has this program, it starts each command and ends it together with its parent: a
# parent that gets SIGKILL has no time to end its children.
_END_WITH_PARENT = ('setpriv', '--pdeathsig', 'TERM')


def stop_signals() -> Callable[[], bool]:
    """Handle SIGINT, SIGTERM and SIGHUP; return a function that says whether one has come.

    An ignored SIGHUP stays ignored, so that a program outlives its terminal under `nohup`.
    """
    is_over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        # `nohup` ignores SIGHUP on purpose; any shell ignores SIGINT for background jobs.
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda number, frame: is_over.set())
    return is_over.is_set


def parameter_arguments(values: Mapping[str, Any]) -> list[str]:
    """Return the arguments after --ros-args that set parameters to ``values``."""
    return [
        word for name, value in values.items() for word in ('-p', f'{name}:={json.dumps(value)}')
    ]


@contextlib.contextmanager
def children(commands: Sequence[Sequence[str]]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Run ``commands``, each a Python module and its arguments, until the block ends."""
    processes: list[subprocess.Popen[bytes]] = []
    prefix = _END_WITH_PARENT if shutil.which(_END_WITH_PARENT[0]) else ()
    try:
        for command in commands:
            # In a session of its own, the child does not receive the terminal's Ctrl-C.
            processes.append(
                subprocess.Popen([*prefix, sys.executable, '-m', *command], start_new_session=True)
            )
        yield processes
    finally:
        for child in processes:
            # SIGINT would print a traceback while Python is still importing.
            child.terminate()
        for child in processes:
            try:
                child.wait(_END_TIMEOUT)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()


def ended(processes: Sequence[subprocess.Popen[bytes]]) -> str:
    """Describe the first child process that has ended by itself; '' while all run."""
    for child in processes:
        if (status := child.poll()) is not None:
            assert isinstance(child.args, list)  # as `children` starts it
            module = child.args[child.args.index('-m') + 1]
            return f'{module} ended by itself with status {status}'
    return ''
