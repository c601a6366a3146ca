"""Options of all programs that serve a page."""

from __future__ import annotations

import argparse

LOOPBACK = '127.0.0.1'
PORT = 8080


def add_address(parser: argparse.ArgumentParser) -> None:
    """Add host and port."""
    parser.add_argument(
        '--host', default=LOOPBACK, help='address to serve on; by default this machine alone'
    )
    parser.add_argument(
        '--port',
        type=int,
        default=PORT,
        help='first port to try, the next free one is taken (default: %(default)s)',
    )
