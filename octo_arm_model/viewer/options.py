"""What programs share that serve a page: their options, and the server where viser is there."""

from __future__ import annotations

import argparse
import contextlib
from typing import TYPE_CHECKING

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.terminal import missing

if TYPE_CHECKING:
    import viser

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


def add_optional_page(parser: argparse.ArgumentParser) -> None:
    """Add the options of a program that can do without its page."""
    parser.add_argument('--no-viewer', action='store_true', help='numbers only')
    add_address(parser)


def open_page(
    options: argparse.Namespace, stack: contextlib.ExitStack, title: str
) -> viser.ViserServer | None:
    """Server of a page until ``stack`` is closed; None with --no-viewer or without viser.

    ``title`` is that of the browser's tab.

    Raises:
        AddressError: if the page cannot be served where ``options`` say.
        ConfigError: if they say it with --no-viewer.
    """
    if options.no_viewer:
        if given := sorted({'host', 'port', 'allow_origin'} & set(getattr(options, 'given', ()))):
            option = given[0].replace('_', '-')
            raise ConfigError(f'--{option} has no effect with --no-viewer')
        return None
    try:
        from octo_arm_model.viewer.address import serving
    except ModuleNotFoundError as error:
        print(f'no viewer: {missing(error)}')
        return None
    page = serving(options.host, options.port, options.allow_origin, title=title)
    return stack.enter_context(page)
