"""Serve a page on a host and the first free port, its connections checked.

viser has no checks, and no call for the title and the layout of its document. It opens its server
with `websockets.asyncio.server.serve`, which is replaced by a function that adds the checks while
a server starts. A viser that does not call it is refused.
"""

import asyncio
import contextlib
import errno
import gzip
import html
import http
import io
import logging
import socket
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from typing import Any

import viser
import websockets.asyncio.server as websockets_server
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.viewer.access import Access, Requests
from octo_arm_model.viewer.options import LOOPBACK, TITLE

_TITLE = b'<title>Viser</title>'
_HEAD_END = b'</head>'
# On a narrow screen viser lays its panel over the scene. The scene gets what the panel leaves
# free, half of the height or more; the panel its whole width. The limit is that of viser.
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


class Document:
    """Changes the document of viser as it is served."""

    def __init__(self, title: str) -> None:
        """Show ``title`` on the browser's tab."""
        self._title = f'<title>{html.escape(title)}</title>'.encode()
        self._served: dict[bytes, bytes] = {}  # by what viser serves: plain and compressed

    def change(self, response: Response) -> None:
        """Set title and layout in ``response``, if it is the document."""
        headers = response.headers
        if not headers.get('Content-Type', '').startswith('text/html') or not response.body:
            return
        source = bytes(response.body)
        if source not in self._served:
            is_compressed = headers.get('Content-Encoding') == 'gzip'
            text = self._changed(gzip.decompress(source) if is_compressed else source)
            self._served[source] = gzip.compress(text) if is_compressed else text
        response.body = self._served[source]
        del headers['Content-Length']
        headers['Content-Length'] = str(len(response.body))

    def _changed(self, text: bytes) -> bytes:
        layout = f'<style>{_LAYOUT}</style>'.encode()
        text = text.replace(_TITLE, self._title, 1)
        return text.replace(_HEAD_END, layout + _HEAD_END, 1)


MOST_PAGES = 32
_MOST_CONNECTIONS = 128  # including those without a request yet
_MOST_BYTES = 1 << 16  # of a message; those of a page have a few hundred
_MOST_A_SECOND = 500  # messages read from one page; further ones wait
_PERIOD = 1.0  # [s] between log lines
_LOG = logging.getLogger('octo_arm_model.viewer')
# Close codes for faults of the peer: protocol, invalid text, size.
_FAULTS = (1002, 1007, 1009)

Handler = Callable[[ServerConnection], Awaitable[None]]
Process = Callable[[ServerConnection, Request], Response | None]


class GuardError(OctoArmError, RuntimeError):
    """The checks cannot be added to the installed viser, so it is not served."""


class RefusalLog:
    """Logs refusals, at most one line a second."""

    def __init__(self) -> None:
        """Log the first one at once."""
        self._logged, self._left_out = -_PERIOD, 0

    def add(self, what: str) -> None:
        """Log the refusal ``what``, or count it until the next line."""
        now = time.monotonic()
        if now - self._logged < _PERIOD:
            self._left_out += 1
            return
        more = f' (and {self._left_out} before that)' if self._left_out else ''
        self._logged, self._left_out = now, 0
        _LOG.warning('viewer refused: %s%s', what, more)


class Guard:
    """The checks of one server.

    Attributes:
        requests: the checks of messages; its `watch` must be called with the server.
    """

    def __init__(self, access: Access, document: Document) -> None:
        """Accept the hosts and origins that ``access`` allows, and serve them ``document``."""
        self._document = document
        self.requests = Requests()
        self._access = access
        self._refusals = RefusalLog()
        self._connections: set[object] = set()
        self._is_asked = False

    @contextlib.contextmanager
    def installed(self) -> Iterator[None]:
        """Add the checks to the server that viser opens within the context.

        Raises:
            GuardError: if viser opened none through websockets.
        """
        opened = websockets_server.serve
        websockets_server.serve = self._guarding(opened)  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            websockets_server.serve = opened  # type: ignore[misc]
        if not self._is_asked:
            raise GuardError(f'viser {viser.__version__} cannot be guarded, expected 1.1 or newer')

    def _guarding(self, opened: Callable[..., Any]) -> Callable[..., Any]:
        def serve(handler: Handler, host: str, port: int, **options: Any) -> Any:
            self._is_asked = True
            given = options['process_request']
            options |= {
                'process_request': lambda *request: self._process(given, *request),
                'create_connection': self._make_connection(),
                'max_size': _MOST_BYTES,
                'logger': self._make_logger(),
            }
            return opened(handler, host, port, **options)

        return serve

    def _process(
        self, given: Process, connection: ServerConnection, request: Request
    ) -> Response | None:
        """Answer to a request, or None to go on as a WebSocket."""
        hosts, origins = map(request.headers.get_all, ('Host', 'Origin'))
        objection = self._access.objection(hosts, origins)
        if objection:
            return self._refuse(connection, http.HTTPStatus.FORBIDDEN, objection)
        if any(value.lower() == 'websocket' for value in request.headers.get_all('Upgrade')):
            wanted = f'viser-v{viser.__version__}'
            if request.headers.get_all('Sec-WebSocket-Protocol') != [wanted]:
                objection = f'a page of another version than {viser.__version__}: load it again'
                return self._refuse(connection, http.HTTPStatus.BAD_REQUEST, objection)
            if len(connection.server.connections) >= MOST_PAGES:
                objection = f'more than {MOST_PAGES} pages'
                return self._refuse(connection, http.HTTPStatus.SERVICE_UNAVAILABLE, objection)
            return None
        try:
            response = given(connection, request)
        except (OSError, ValueError):  # an invalid file name
            return connection.respond(http.HTTPStatus.NOT_FOUND, 'NOT FOUND')
        if response is not None:
            self._document.change(response)
            response.headers.update(_page_headers(hosts[0]))
        return response

    def _refuse(self, connection: ServerConnection, status: http.HTTPStatus, why: str) -> Response:
        self._refusals.add(why)
        return connection.respond(status, f'{why}\n')

    def _make_connection(self) -> type[ServerConnection]:  # noqa: C901 - a class of this server
        connections, refusals, requests = self._connections, self._refusals, self.requests

        class Connection(ServerConnection):
            """Passes on only allowed messages, at a limited rate."""

            _second, _count = 0.0, 0

            def connection_made(self, transport: asyncio.BaseTransport) -> None:
                super().connection_made(transport)
                connections.add(self)
                if len(connections) > _MOST_CONNECTIONS:
                    refusals.add(f'more than {_MOST_CONNECTIONS} connections')
                    self.transport.abort()

            def connection_lost(self, exc: Exception | None) -> None:
                connections.discard(self)
                super().connection_lost(exc)

            async def recv(self, decode: bool | None = None) -> Any:
                while True:
                    try:
                        data = await super().recv(decode)
                    except ConnectionClosed as closed:
                        if closed.sent is not None and closed.sent.code in _FAULTS:
                            refusals.add(f'a message: {closed.sent.reason}')
                        raise
                    objection = requests.objection(data)
                    await self._pace()
                    if not objection:
                        return data
                    refusals.add(objection)

            async def _pace(self) -> None:
                now = time.monotonic()
                if now - self._second >= 1.0:
                    self._second, self._count = now, 0
                self._count += 1
                if self._count > _MOST_A_SECOND:
                    await asyncio.sleep(self._second + 1.0 - now)

        return Connection

    def _make_logger(self) -> logging.Logger:
        """Logger of websockets that logs its errors as refusals, without stack traces."""
        logger = logging.Logger('octo_arm_model.viewer.websockets', logging.ERROR)

        def refuse(record: logging.LogRecord) -> bool:
            error = record.exc_info[1] if record.exc_info else None
            why = f': {str(error or type(error).__name__)[:80]!r}' if error else ''
            self._refusals.add(f'{record.getMessage()}{why}')
            return False

        logger.addFilter(refuse)
        return logger


def _page_headers(host: str) -> dict[str, str]:
    """Headers of the page served as ``host``.

    They forbid connections to other servers, also by the address in a link, and frames of other
    pages (clickjacking).
    """
    sources = f"connect-src 'self' ws://{host} wss://{host} data: blob:"
    return {
        'Content-Security-Policy': (
            f"{sources}; frame-ancestors 'none'; object-src 'none'; base-uri 'none'; "
            "form-action 'none'"
        ),
        'X-Frame-Options': 'DENY',
        'X-Content-Type-Options': 'nosniff',
        'Cross-Origin-Resource-Policy': 'same-origin',
        'Referrer-Policy': 'no-referrer',
    }


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
