"""ROS domains, each reserved on this machine by the process that asks for it.

No process of another worker, run or checkout is in a reserved domain. A socket without a file
stands for each domain: whoever has bound its name has the domain, at most until it ends. Such
names are seen from where the ports of DDS are seen, which differ by domain.
"""

import contextlib
import errno
import itertools
import os
import socket
from collections.abc import Iterator

_NAME = '\0octo_arm_model ROS domain {}'  # on Linux a name that begins so is that of no file
_LARGEST = 100  # beyond it the ports of DDS are among those that Linux hands out
# A domain that was released is not the next to be reserved.
_turn = itertools.count(7 * os.getpid())
_of_this_file: list[socket.socket] = []


def _reserve() -> tuple[int, socket.socket]:
    """A domain that nobody has, and what has to be closed to release it.

    Raises:
        RuntimeError: if all are reserved.
    """
    for _ in range(_LARGEST):
        domain = 1 + next(_turn) % _LARGEST
        mark = socket.socket(socket.AF_UNIX)
        try:
            mark.bind(_NAME.format(domain))
        except OSError as error:
            mark.close()
            if error.errno != errno.EADDRINUSE:
                raise
        else:
            return domain, mark
    raise RuntimeError(f'all {_LARGEST} ROS domains are reserved by tests that run')


@contextlib.contextmanager
def reserved_domain() -> Iterator[int]:
    """A ROS domain that is reserved within the context."""
    domain, mark = _reserve()
    with mark:
        yield domain


def new_domain() -> int:
    """A ROS domain that is reserved to the end of the test file, or of this process."""
    domain, mark = _reserve()
    _of_this_file.append(mark)
    return domain


def release() -> None:
    """Give back what `new_domain` has reserved, at the end of a test file."""
    while _of_this_file:
        _of_this_file.pop().close()
