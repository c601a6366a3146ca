"""The program `octo_arm_demo`: node or estimator, simulator and viewer of one arm."""

from __future__ import annotations

import argparse
import contextlib
import os
import socket
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.config.config import load_config
from octo_arm_model.config.parameter_files import find_path
from octo_arm_model.ros.processes import children, ended, parameter_arguments, stop_signals
from octo_arm_model.simulation.movements import find_profile, profile_names
from octo_arm_model.simulation.pushed_arm import touched
from octo_arm_model.simulation.simulator import in_water
from octo_arm_model.terminal import StatusLine, fail, make_parser, missing, status_of
from octo_arm_model.viewer.address import add_address, page_title
from octo_arm_model.wire.backbone import BACKBONE_TOPICS

if TYPE_CHECKING:
    import viser

    from octo_arm_model.ros.client.client import ArmClient


# Arguments after --ros-args of a simulator whose arm moves and of the node of that arm: the true
# shape takes the topics of the shape at rest under the tensions.
TRUE_SHAPE = tuple(
    [word for name in BACKBONE_TOPICS for word in ('-r', f'{before}{name}:={after}{name}')]
    for before, after in (('ground_truth/', ''), ('', 'at_rest/'))
)
DOMAINS = 102  # ports of DDS in higher domains are among those that Linux assigns itself
_VARIABLE = 'ROS_DOMAIN_ID'


@contextlib.contextmanager
def own_domain(prog: str, namespace: str = '') -> Iterator[None]:
    """Run the block and its children in a domain without another such block of ``namespace``.

    The domains are tried from the present one on. The program ``prog`` reports another one, which
    is set in the environment.

    Raises:
        ConfigError: if the present domain is no number, or all are taken.
    """
    text = os.environ.get(_VARIABLE) or '0'
    if not text.isdecimal():
        raise ConfigError(f'{_VARIABLE} is {text!r}, expected a number')
    first = int(text)
    for domain in (first, *((first + more) % DOMAINS for more in range(1, DOMAINS))):
        # A name without a file, which the kernel frees when the process ends in any way.
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
    """Add the options of a program that can run without its page."""
    parser.add_argument('--no-viewer', action='store_true', help='numbers only')
    add_address(parser)


def open_page(
    options: argparse.Namespace, stack: contextlib.ExitStack, title: str
) -> viser.ViserServer | None:
    """Return the server of a page until ``stack`` is closed; None with --no-viewer or no viser.

    ``title`` is the title of the tab in the browser.

    Raises:
        AddressError: if the page cannot be served at the address in ``options``.
        ConfigError: if an address is given with --no-viewer.
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


RATE = 50.0  # rate of the simulated tensions [Hz]
LINE_PERIOD = 1.0  # time between lines of numbers without a terminal [s]
_MOVEMENTS = ('bending', 'fetching', 'rotating', 'ramps')  # in order of preference
_POLL = 1.0 / 30.0  # time between two looks for messages [s]
_WINCHES = 0.2  # largest speed of winches over the length of the arm [1/s]
_PROG = 'octo_arm_demo'
_EPILOG = """\
examples:
  octo_arm_demo config/renda2012_table4.yaml
  octo_arm_demo renda2012_table2 --port 8081
  octo_arm_demo renda2012_prototype --no-viewer
  octo_arm_demo renda2012_table4 --moving        # with inertia, in water
  octo_arm_demo renda2012_prototype --estimate   # it is pushed, and the force is estimated
  octo_arm_demo renda2012_prototype --estimate --moving

The simulator moves the arm until a slider of the page, or `octo-arm play`, takes over.
"""


def movement_of(arm: Arm) -> str:
    """Return the name of the first of the preferred movements that is for ``arm``."""
    names = profile_names(arm)
    return next(name for name in _MOVEMENTS if name in names)


def describe(client: ArmClient) -> str:
    """Return tip, distance to the base, rate and latency of the newest shape as a line of text."""
    if client.shape is None:
        return 'waiting for the node ...'
    base, tip = client.shape.position[[0, -1]] * 1e3
    rate = client.rate()
    rate_text = '' if np.isnan(rate) else f'{rate:5.1f} shapes/s   '
    return (
        f'tip {tip[0]:7.1f} {tip[1]:7.1f} {tip[2]:7.1f} mm   '
        f'to the base {np.linalg.norm(tip - base):6.1f} mm   '
        f'{rate_text}{1e3 * client.latency:5.1f} ms behind'
        f'{client.problem and f"   {client.problem}"}'
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until a signal comes or a child process ends, and return the exit status."""
    parser = make_parser(
        _PROG, 'Start node, simulator and viewer of an arm, until Ctrl-C.', _EPILOG
    )
    parser.add_argument(
        'config', metavar='CONFIG', help='ROS parameter file of the arm, or the name of a preset'
    )
    parser.add_argument(
        '--estimate',
        action='store_true',
        help='push the arm again and again, and run octo_arm_estimator in place of the node: from '
        'tensions, tip and markers with noise it finds the force',
    )
    parser.add_argument(
        '--moving',
        action='store_true',
        help='the arm moves with its inertia, in water, and can be pulled in the page; winches '
        'reel in or out a fifth of its length a second at most (winches.speed_limit); without '
        '--estimate the shape is the true one, with it forces along the arm are found, inertia '
        'and drag among them',
    )
    add_optional_page(parser)
    options = parser.parse_args(arguments)
    return status_of(_PROG, lambda: _show(options))


def _show(options: argparse.Namespace) -> int:
    # These need ROS, --help does not.
    from octo_arm_model.ros.client.client import POSES, ArmClient
    from octo_arm_model.ros.start import client_node

    path = str(find_path(options.config))
    config = load_config(path)
    movement = movement_of(config.arm)
    is_over = stop_signals()
    common = ['--ros-args', '--log-level', 'warn', '--params-file', path]
    playing: dict[str, Any] = {'rate': RATE, 'profile.name': movement, 'profile.loop': True}
    shown, hidden = list[str](), list[str]()
    if options.moving:
        water = in_water(config)
        playing['dynamics'] = water.pop('dynamics')
        playing['winches.speed_limit'] = _WINCHES * config.arm.length
        common += parameter_arguments(water)
        if not options.estimate:
            shown, hidden = TRUE_SHAPE
    commands: list[Sequence[str]] = [('octo_arm_model.ros.node.main', *common, *hidden)]
    if options.estimate:
        profile = find_profile(movement, config.arm)
        pushing, estimating = touched(config, profile, options.moving)
        playing |= pushing
        commands = [
            ('octo_arm_model.ros.estimator.main', *common, *parameter_arguments(estimating))
        ]
    commands.append(
        ('octo_arm_model.ros.simulator.main', *common, *shown, *parameter_arguments(playing))
    )
    with contextlib.ExitStack() as stack:
        stack.enter_context(own_domain(_PROG))
        started = stack.enter_context(children(commands))
        client = ArmClient(stack.enter_context(client_node(_PROG)))
        title = page_title(Path(path).stem)
        server = open_page(options, stack, title)
        viewer = None
        if server is None:
            client.listen(POSES)
        else:
            from octo_arm_model.viewer.page import Viewer  # needs viser

            viewer = Viewer(server, client, always=True, title=title)
        line = stack.enter_context(StatusLine(sys.stdout, LINE_PERIOD))
        while not is_over() and not ended(started):
            if viewer is None:
                client.poll()
                time.sleep(_POLL)
            else:
                viewer.step()
            line.show(lambda: describe(client))
        return 0 if is_over() else fail(_PROG, ended(started), 1)


if __name__ == '__main__':
    sys.exit(main())
