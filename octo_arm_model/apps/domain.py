"""A ROS domain of this machine that no other arm with simulator and viewer is started in."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator

from octo_arm_model.arm.errors import ConfigError

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
