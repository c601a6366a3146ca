"""A server of a page on a host and the first free port, which checks its connections.

viser has no checks, and no call for the title and the layout of its document. It opens its server
with `websockets.asyncio.server.serve`. While a server starts, this module replaces that function
by one that adds the checks. A version of viser that does not call the function is refused.
"""

import asyncio
import contextlib
import errno
import functools
import gzip
import html
import http
import io
import logging
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import viser
import websockets.asyncio.server as websockets_server
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.terminal import RefusalLog
from octo_arm_model.viewer.access import Access, objection_to
from octo_arm_model.viewer.address import LOOPBACK, TITLE

_TITLE = b'<title>Viser</title>'
_HEAD_END = b'</head>'
# On a narrow screen viser lays its panel over the scene. This layout gives the panel the whole
# width and at most half of the height, and the scene the rest. The limit is that of viser.
_LAYOUT = """
@media (max-width: 36em) {
  div:has(> div canvas):has(> .mantine-Paper-root) { flex-direction: column; }
  div:has(> div canvas):has(> .mantine-Paper-root) > div:has(canvas) {
    height: auto !important; min-height: 0;
  }
  div:has(> div canvas) > .mantine-Paper-root {
    position: static !important; flex: none; width: 100% !important;
    max-height: 50vh !important; max-height: 50dvh !important;
  }
  div:has(> div canvas) > .mantine-Paper-root [style*="width: 20em"] { width: 100% !important; }
}
"""


@functools.lru_cache(2)  # plain and compressed
def _document(source: bytes, is_compressed: bool, title: str) -> bytes:
    """Return the document of viser with the layout above and a ``title`` on the tab."""
    text = gzip.decompress(source) if is_compressed else source
    text = text.replace(_TITLE, f'<title>{html.escape(title)}</title>'.encode(), 1)
    text = text.replace(_HEAD_END, f'<style>{_LAYOUT}</style>'.encode() + _HEAD_END, 1)
    return gzip.compress(text) if is_compressed else text


MOST_PAGES = 32
_MOST_CONNECTIONS = 128  # including those without a request yet
_MOST_BYTES = 1 << 16  # bytes of a message; messages of a page have a few hundred
_MOST_A_SECOND = 500  # messages read from one page per second; further ones wait
_LOG = logging.getLogger('octo_arm_model.viewer')
# Close codes for faults of the peer: protocol, invalid text, size.
_FAULTS = (1002, 1007, 1009)

Process = Callable[[ServerConnection, Request], Response | None]


class GuardError(OctoArmError, RuntimeError):
    """Raised if the checks cannot be added to the installed viser."""


def refusing() -> Callable[[str], None]:
    """Return a function that logs why something is refused, at most one line a second."""
    return functools.partial(RefusalLog(_LOG.warning).add, 'viewer refused')


class Guard:
    """The checks of one server.

    Attributes:
        server: the server, of which controls and points are checked once it is set.
        refuse: logs why something is refused.
        connections: the open connections.
    """

    def __init__(self, access: Access, title: str) -> None:
        """Accept hosts and origins that ``access`` allows; ``title`` is that of the page."""
        self._access, self._title = access, title
        self.server: viser.ViserServer | None = None
        self.refuse = refusing()
        self.connections: set[object] = set()

    @contextlib.contextmanager
    def installed(self) -> Iterator[None]:
        """Add the checks to the server that viser opens within; GuardError if it opens none."""
        original, is_called = websockets_server.serve, False
        # This logger turns the errors of websockets into refusals, without stack traces.
        logger = logging.Logger('octo_arm_model.viewer.websockets', logging.ERROR)
        logger.addFilter(self._log)

        def serve(handler: Any, host: str, port: int, **options: Any) -> Any:
            nonlocal is_called
            is_called = True
            options |= {
                'process_request': functools.partial(self._process, options['process_request']),
                'create_connection': functools.partial(_Connection, self),
                'max_size': _MOST_BYTES,
                'logger': logger,
            }
            return original(handler, host, port, **options)

        websockets_server.serve = serve  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            websockets_server.serve = original  # type: ignore[misc]
        if not is_called:
            raise GuardError(f'viser {viser.__version__} cannot be guarded, expected 1.1 or newer')

    def _log(self, record: logging.LogRecord) -> bool:
        error = record.exc_info[1] if record.exc_info else None
        # A peer left without a whole request, as browsers leave spare connections.
        if isinstance(getattr(error, '__cause__', None), EOFError):
            return False
        why = f': {str(error or type(error).__name__)[:80]!r}' if error else ''
        self.refuse(f'{record.getMessage()}{why}')
        return False

    def _process(
        self, process: Process, connection: ServerConnection, request: Request
    ) -> Response | None:
        """Return the response to a request, or None to accept a WebSocket."""
        hosts, origins = map(request.headers.get_all, ('Host', 'Origin'))
        status, objection = http.HTTPStatus.FORBIDDEN, self._access.objection(hosts, origins)
        is_socket = 'websocket' in map(str.lower, request.headers.get_all('Upgrade'))
        if not objection and is_socket:
            if request.headers.get_all('Sec-WebSocket-Protocol') != [
                f'viser-v{viser.__version__}'
            ]:
                status = http.HTTPStatus.BAD_REQUEST
                objection = f'a page of another version than {viser.__version__}: load it again'
            elif len(connection.server.connections) >= MOST_PAGES:
                status = http.HTTPStatus.SERVICE_UNAVAILABLE
                objection = f'more than {MOST_PAGES} pages'
        if objection:
            self.refuse(objection)
            return connection.respond(status, f'{objection}\n')
        if is_socket:
            return None
        try:
            response = process(connection, request)
        except (OSError, ValueError):  # an invalid file name
            return connection.respond(http.HTTPStatus.NOT_FOUND, 'NOT FOUND')
        if response is not None:
            self._finish(response, hosts[0])
        return response

    def _finish(self, response: Response, host: str) -> None:
        """Set title, layout and headers of a ``response`` of the page served as ``host``."""
        headers = response.headers
        if headers.get('Content-Type', '').startswith('text/html') and response.body:
            is_compressed = headers.get('Content-Encoding') == 'gzip'
            response.body = _document(bytes(response.body), is_compressed, self._title)
            del headers['Content-Length']
            headers['Content-Length'] = str(len(response.body))
        # The page may not connect to other servers, not even to an address in a link, and other
        # pages may not frame it (clickjacking).
        headers['Content-Security-Policy'] = (
            f"connect-src 'self' ws://{host} wss://{host} data: blob:; frame-ancestors 'none'; "
            "object-src 'none'; base-uri 'none'; form-action 'none'"
        )
        headers.update(_HEADERS)


_HEADERS = {
    'X-Frame-Options': 'DENY',
    'X-Content-Type-Options': 'nosniff',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Referrer-Policy': 'no-referrer',
}


class _Connection(ServerConnection):
    """A connection that passes on only allowed messages, at a limited rate."""

    def __init__(self, guard: Guard, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._guard, self._second, self._count = guard, 0.0, 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._guard.connections.add(self)
        if len(self._guard.connections) > _MOST_CONNECTIONS:
            self._guard.refuse(f'more than {_MOST_CONNECTIONS} connections')
            self.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        self._guard.connections.discard(self)
        super().connection_lost(exc)

    async def recv(self, decode: bool | None = None) -> Any:
        while True:
            try:
                data = await super().recv(decode)
            except ConnectionClosed as closed:
                if closed.sent is not None and closed.sent.code in _FAULTS:
                    self._guard.refuse(f'a message: {closed.sent.reason}')
                raise
            objection = objection_to(data, self._guard.server)
            now = time.monotonic()
            if now - self._second >= 1.0:
                self._second, self._count = now, 0
            self._count += 1
            if self._count > _MOST_A_SECOND:
                await asyncio.sleep(self._second + 1.0 - now)
            if not objection:
                return data
            self._guard.refuse(objection)


_MOST_PORTS = 100  # ports tried in order


class AddressError(OctoArmError, ValueError):
    """Raised if the host or port is invalid, or no port is free."""


@contextlib.contextmanager
def serving(
    host: str, port: int, origins: Sequence[str] = (), *, title: str = TITLE
) -> Iterator[viser.ViserServer]:
    """Serve a page on ``host``, at the first free port from ``port`` on, and print its URL.

    ``title`` is that of the browser's tab.

    Only this page and pages of ``origins``, such as http://arm.lab:8080, may command. The host of
    an origin is also accepted as a name of this page.

    Raises:
        AddressError: if ``host`` is not an address of this machine, ``port`` is invalid, or all
            ports are in use.
        ConfigError: if one of ``origins`` is not an origin.
        GuardError: if requests to the installed viser cannot be checked.
    """
    guard = Guard(Access(host, origins), title)
    free = free_port(host, port)
    # The banner of viser is suppressed; one line is printed below.
    with guard.installed(), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host, free, verbose=False)
    guard.server = server
    try:
        in_use = f'port {port} is in use; ' if server.get_port() != port else ''
        print(f'viewer: {in_use}open {url(host, server.get_port())}', flush=True)
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def free_port(host: str, port: int) -> int:
    """Return the first free port of ``host`` from ``port`` on.

    AddressError if one of them is invalid, or all ports are in use.
    """
    if not 1 <= port <= 65535:
        raise AddressError(f'port is {port}, expected 1 to 65535')
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise AddressError(f'host {host!r}: {error.strerror}') from error
    last = min(port + _MOST_PORTS, 65536)
    for candidate in range(port, last):
        with socket.socket(family, socket.SOCK_STREAM) as candidate_socket:
            candidate_socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                candidate_socket.bind((address[0], candidate, *address[2:]))
            except OSError as error:
                # Ports below 1024 may be reserved.
                if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                    raise AddressError(f'host {host!r}: {error.strerror}') from error
            else:
                return candidate
    raise AddressError(f'ports {port} to {last - 1} of {host} are all in use')


def url(host: str, port: int) -> str:
    """Return the URL to open in a browser."""
    if host in (LOOPBACK, '::1', '0.0.0.0', '::'):
        host = 'localhost'
    return f'http://{host}:{port}'
