"""Reserve ROS domains on this machine for a process.

No process of another worker, run or checkout uses a reserved domain. Each domain has an abstract
Unix socket; the process that has bound its name owns the domain, at most until it ends. These
names are visible in the same network namespace as the ports of DDS.
"""

import errno
import itertools
import os
import socket

_NAME = '\0octo_arm_model ROS domain {}'  # the leading 0 makes an abstract name on Linux
_LARGEST = 100  # larger domains have ports in the ephemeral range of Linux
# Counts on, so that a released domain is not the next one to be reserved.
_turn = itertools.count(7 * os.getpid())
_of_this_file: list[socket.socket] = []


def reserve() -> tuple[int, socket.socket]:
    """Reserve a free domain; return it with the socket that releases it when closed.

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


def new_domain() -> int:
    """Reserve a ROS domain until the end of the test file, or of this process."""
    domain, mark = reserve()
    _of_this_file.append(mark)
    return domain


def release() -> None:
    """Release the domains of `new_domain`, at the end of a test file."""
    while _of_this_file:
        _of_this_file.pop().close()
