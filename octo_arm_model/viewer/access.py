"""The rules for the headers Host and Origin of requests to the viewer.

A browser sends the origin of the page with every WebSocket that the page opens; other origins are
refused. A page whose name resolves to this machine (DNS rebinding) has the origin of the viewer,
but its own name in Host, which is checked too.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Sequence
from urllib.parse import SplitResult, urlsplit

from octo_arm_model.arm.errors import ConfigError, shown

_DEFAULT_PORTS = {'http': 80, 'https': 443}
_THIS_MACHINE = ('localhost', '127.0.0.1', '::1')


class Access:
    """The allowed hosts and origins of a page served on one host."""

    def __init__(self, host: str, origins: Sequence[str]) -> None:
        """Allow the page itself on ``host``, and pages of ``origins``, as http://arm.lab:8080.

        Raises:
            ConfigError: if one of ``origins`` is none.
        """
        self._origins = {_origin_of(origin) for origin in origins}
        self._names = {*_THIS_MACHINE, host.lower(), *(name for _, name, _ in self._origins)}
        # Addresses cannot be rebound. A loopback host needs no other address.
        self._takes_addresses = not _is_loopback(host)

    def objection(self, hosts: Sequence[str], origins: Sequence[str]) -> str:
        """Why a request with these headers Host and Origin is refused; empty if it is not."""
        host = _split(f'//{hosts[0]}') if len(hosts) == 1 else None
        if host is None or not self._is_ours(host.hostname or ''):
            return f'host {shown(", ".join(hosts))} is not one that this page is served as'
        if not origins:
            return ''  # no browser, which would always send one
        page = _split(origins[0]) if len(origins) == 1 else None
        if page is None or page.scheme not in _DEFAULT_PORTS or page.path:
            return f'origin {shown(", ".join(origins))} is none'
        default = _DEFAULT_PORTS[page.scheme]
        is_same = (page.hostname, page.port or default) == (host.hostname, host.port or default)
        if is_same or (page.scheme, page.hostname, page.port or default) in self._origins:
            return ''
        return f'origin {shown(", ".join(origins))} is not allowed'

    def _is_ours(self, name: str) -> bool:
        return name in self._names or (self._takes_addresses and _is_address(name))


def _origin_of(text: str) -> tuple[str, str, int]:
    """Scheme, host and port of an origin; ConfigError if it is none."""
    parts = _split(text)
    if parts is None or parts.scheme not in _DEFAULT_PORTS or parts.path or not parts.hostname:
        raise ConfigError(f'origin is {text!r}, expected one such as http://arm.lab:8080')
    return parts.scheme, parts.hostname, parts.port or _DEFAULT_PORTS[parts.scheme]


def _split(text: str) -> SplitResult | None:
    """Parts of a URL of scheme, host and port; None if it has further parts or is invalid."""
    try:
        parts = urlsplit(text)
        parts.port  # noqa: B018 - raises if it is no port
    except ValueError:
        return None
    has_more = parts.query or parts.fragment or '@' in parts.netloc or not parts.netloc
    return None if has_more or text != text.strip() else parts


def _is_loopback(host: str) -> bool:
    return host == 'localhost' or (_is_address(host) and ipaddress.ip_address(host).is_loopback)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
