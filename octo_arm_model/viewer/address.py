"""Serve a page on a host and the first free port."""

from __future__ import annotations

import contextlib
import errno
import io
import socket
from collections.abc import Iterator, Sequence

import viser

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.viewer.access import Access
from octo_arm_model.viewer.document import Document
from octo_arm_model.viewer.guard import Guard
from octo_arm_model.viewer.options import LOOPBACK, TITLE

_TRIED = 100


class AddressError(OctoArmError, ValueError):
    """The host or port is invalid, or no port is free."""


@contextlib.contextmanager
def serving(
    host: str, port: int, origins: Sequence[str] = (), *, title: str = TITLE
) -> Iterator[viser.ViserServer]:
    """Serve a page on ``host``, at the first free port from ``port`` on, and print its URL.

    ``title`` is that of the browser's tab.

    Only that page may command, and pages of ``origins`` such as http://arm.lab:8080, whose host is
    then a name of this page as well.

    Raises:
        AddressError: if ``host`` is no address of this machine, ``port`` is no port, or all are in
            use.
        ConfigError: if one of ``origins`` is none.
        GuardError: if requests to the installed viser cannot be checked.
    """
    guard = Guard(Access(host, origins), Document(title))
    free = free_port(host, port)
    # Without the banner of viser; one line is printed below.
    with guard.installed(), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host, free, verbose=False)
    guard.requests.watch(server)
    try:
        in_use = f'port {port} is in use; ' if server.get_port() != port else ''
        print(f'viewer: {in_use}open {url(host, server.get_port())}', flush=True)
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def free_port(host: str, port: int) -> int:
    """The first free port of ``host`` from ``port`` on.

    Raises:
        AddressError: if ``host`` is no address of this machine, ``port`` is no port, or all are in
            use.
    """
    if not 1 <= port <= 65535:
        raise AddressError(f'port is {port}, expected 1 to 65535')
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise AddressError(f'host {host!r}: {error.strerror}') from error
    last = min(port + _TRIED, 65536)
    for candidate in range(port, last):
        with socket.socket(family, socket.SOCK_STREAM) as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                tried.bind((address[0], candidate, *address[2:]))
            except OSError as error:
                # Ports below 1024 may be reserved.
                if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                    raise AddressError(f'host {host!r}: {error.strerror}') from error
            else:
                return candidate
    raise AddressError(f'ports {port} to {last - 1} of {host} are all in use')


def url(host: str, port: int) -> str:
    """URL to open in a browser."""
    if host in (LOOPBACK, '::1', '0.0.0.0', '::'):
        host = 'localhost'
    return f'http://{host}:{port}'
