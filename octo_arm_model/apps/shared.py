"""What the programs here share: a ROS domain of their own, and a page that they can do without."""

from __future__ import annotations

import argparse
import contextlib
import os
import socket
from collections.abc import Iterator
from typing import TYPE_CHECKING

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.terminal import missing
from octo_arm_model.viewer.options import add_address
from octo_arm_model.wire.backbone import BACKBONE_TOPICS

if TYPE_CHECKING:
    import viser

# Arguments after --ros-args of a simulator whose arm moves and of a node of the same arm: the true
# shape is in the place of that at rest under its tensions.
TRUE_SHAPE = tuple(
    [word for name in BACKBONE_TOPICS for word in ('-r', f'{before}{name}:={after}{name}')]
    for before, after in (('ground_truth/', ''), ('', 'at_rest/'))
)
DOMAINS = 102  # beyond these the ports of DDS are among those that Linux hands out
_VARIABLE = 'ROS_DOMAIN_ID'


@contextlib.contextmanager
def own_domain(prog: str, namespace: str = '') -> Iterator[None]:
    """Run the block and its children in a domain with no other such block of ``namespace``.

    The domains are tried from the present one on. Another one is told, as of the program ``prog``,
    and set in the environment.

    Raises:
        ConfigError: if the present domain is no number, or all are taken.
    """
    text = os.environ.get(_VARIABLE) or '0'
    if not text.isdecimal():
        raise ConfigError(f'{_VARIABLE} is {text!r}, expected a number')
    first = int(text)
    for domain in (first, *((first + more) % DOMAINS for more in range(1, DOMAINS))):
        # A name without a file, which the kernel frees with the process, however that ends.
        with socket.socket(socket.AF_UNIX) as mark:
            try:
                mark.bind(f'\0octo_arm_model{namespace}/domain_{domain}')
            except OSError:
                continue
            if domain != first:
                print(
                    f'{prog}: there is an arm in ROS domain {first} already; this one is in '
                    f'domain {domain}: commands for it begin with {_VARIABLE}={domain}',
                    flush=True,
                )
                os.environ[_VARIABLE] = str(domain)
            yield
            return
    raise ConfigError('there is an arm in every ROS domain already')


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
        from octo_arm_model.viewer.server import serving
    except ModuleNotFoundError as error:
        print(f'no viewer: {missing(error)}')
        return None
    page = serving(options.host, options.port, options.allow_origin, title=title)
    return stack.enter_context(page)
