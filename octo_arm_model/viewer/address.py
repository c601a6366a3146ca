"""The address and the title of a page, and the options for them; this module needs no viser."""

import argparse

LOOPBACK = '127.0.0.1'
PORT = 8080
TITLE = 'octo_arm'


def page_title(name: str) -> str:
    """Return the title of the page of the arm ``name``, which may be empty."""
    return f'{TITLE}: {name}' if name else TITLE


def add_address(parser: argparse.ArgumentParser) -> None:
    """Add the options for host, port and allowed origins to a ``parser``."""
    parser.add_argument(
        '--host',
        default=LOOPBACK,
        help='address to serve on; by default only this machine can open the page. Whoever can '
        'open it can pull tendons',
    )
    parser.add_argument(
        '--port',
        type=int,
        default=PORT,
        help='first port to try, the next free one is taken (default: %(default)s)',
    )
    parser.add_argument(
        '--allow-origin',
        metavar='ORIGIN',
        action='append',
        default=[],
        help='another name of this page, such as http://arm.lab:8080, or another page that may '
        'command; may be given more than once. By default the page may be opened as localhost and '
        'by the addresses that it is served on',
    )
