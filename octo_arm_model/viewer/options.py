"""What programs share that serve a page: their options, and its title. Needs no viser."""

import argparse

LOOPBACK = '127.0.0.1'
PORT = 8080
TITLE = 'octo_arm'


def page_title(name: str) -> str:
    """Title of the page of the arm ``name``; that of any arm if it is empty."""
    return f'{TITLE}: {name}' if name else TITLE


def add_address(parser: argparse.ArgumentParser) -> None:
    """Add host, port and origins."""
    parser.add_argument(
        '--host',
        default=LOOPBACK,
        help='address to serve on; by default this machine alone. Whoever can reach another one '
        'can pull',
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
        help='name that the page is reached by, such as http://arm.lab:8080, or another page that '
        'may command; may be given more than once. By default pages of localhost and of addresses '
        'served on',
    )
