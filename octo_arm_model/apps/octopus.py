"""The program `octo_arm_octopus`: eight arms around a body, playing a movement out of phase.

The nodes are those of `launch/octopus.launch.py`, in namespaces arm_1 to arm_8. They share a few
processes, as the interpreter takes most of the memory and start-up time of each.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from octo_arm_model.analysis.drawing import ARMS, base_pose
from octo_arm_model.apps import demo
from octo_arm_model.config.config import Config, load_config
from octo_arm_model.config.parameter_files import find_path
from octo_arm_model.ros.processes import children, ended, parameter_arguments, stop_signals
from octo_arm_model.simulation.movements import TOPIC as COMMANDS
from octo_arm_model.simulation.movements import check_profile, find_profile, tendon_limits
from octo_arm_model.simulation.simulator import in_water
from octo_arm_model.terminal import StatusLine, fail, make_parser, status_of
from octo_arm_model.viewer.address import page_title

if TYPE_CHECKING:
    from rclpy.node import Node

    from octo_arm_model.ros.client.client import ArmClient

RATE = 30.0  # rate of the tensions of each arm [Hz]
PROCESSES = 2
FRAME = 'octopus'
_TENSIONS = 'tendon_tensions'
_PROG = 'octo_arm_octopus'
_EPILOG = """\
examples:
  octo_arm_octopus
  octo_arm_octopus --moving                      # with inertia, in water
  octo_arm_octopus renda2012_table2 --movement rotating --processes 8
"""


def crawling(node: Node, config: Config, movement: str, topic: str) -> Callable[[], None]:
    """Return a function that publishes tensions for the present time, each on a topic by ``node``.

    Each of the eight arms of ``config`` is an eighth of a period ahead of the previous one in the
    ``movement``; the ``topic`` is in the namespace of the arm.

    Raises:
        ProfileError: if there is no such ``movement`` for this arm, or it is beyond the limit of a
            tendon.
    """
    from octo_arm_model.ros.client.commands import CommandPublisher

    profile, began = find_profile(movement, config.arm), time.monotonic()
    check_profile(profile, config.arm, tendon_limits(config))
    names = [f'arm_{number}/{topic}' for number in range(1, ARMS + 1)]
    publishers = [CommandPublisher(node, name, config) for name in names]

    def publish() -> None:
        elapsed, stamp = time.monotonic() - began, node.get_clock().now().to_msg()
        for number, publisher in enumerate(publishers):
            ahead = profile.duration * number / ARMS
            publisher.publish(profile.at(elapsed + ahead, loop=True), stamp, FRAME)

    return publish


def describe(clients: Sequence[ArmClient]) -> str:
    """Return rates of all arms and of the slowest, and the largest latency, as a line of text."""
    seen = [client for client in clients if client.shape is not None]
    if len(seen) < len(clients):
        return f'{len(seen)} of {len(clients)} arms are there ...'
    rates = [client.rate() for client in clients]
    latency = max(client.latency for client in clients)
    if np.isnan(rates).any():
        return next(
            client.problem for client, rate in zip(clients, rates, strict=True) if np.isnan(rate)
        )
    return (
        f'{sum(rates):5.0f} shapes/s of {len(clients)} arms, the slowest {min(rates):4.1f} of '
        f'{RATE:.0f} Hz; {1e3 * latency:5.1f} ms behind'
    )


def host(config_file: str, numbers: Sequence[int], is_moving: bool) -> None:
    """Run the nodes, and simulators if they move, of the arms ``numbers`` until a signal comes."""
    import rclpy

    from octo_arm_model.ros.node.main import OctoArmNode, make_executor
    from octo_arm_model.ros.simulator.main import SimulatorNode
    from octo_arm_model.ros.start import start_ros

    is_over = stop_signals()
    # All nodes log the same lines, so only errors are logged.
    start_ros(['--ros-args', '--log-level', 'error'])
    executor = make_executor()
    nodes: list[Node] = []
    water = in_water(load_config(config_file)) if is_moving else {}
    simulated = {'rate': RATE, 'dynamics': water.pop('dynamics', False)}
    shown, hidden = demo.TRUE_SHAPE
    hidden = [*hidden, '-r', f'{_TENSIONS}:=at_rest/{_TENSIONS}']  # the node need not solve
    for number in numbers:
        position, quaternion = base_pose(number)
        settings = {
            'base_frame': FRAME,
            'base.position': position,
            'base.quaternion': quaternion,
            'frame_prefix': f'arm_{number}_',
            **water,
        }
        arguments = ['--ros-args', '--params-file', config_file, *parameter_arguments(settings)]
        of_all: dict[str, Any] = {'namespace': f'arm_{number}', 'use_global_arguments': False}
        if is_moving:
            of_simulator = [*arguments, *parameter_arguments(simulated), *shown]
            nodes.append(SimulatorNode(cli_args=of_simulator, **of_all))
            arguments += hidden
        nodes.append(OctoArmNode(cli_args=arguments, **of_all))
    for node in nodes:
        executor.add_node(node)
    while not is_over():
        executor.spin_once(timeout_sec=0.1)
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until a signal comes or a child process ends; returns the exit status."""
    parser = make_parser(_PROG, 'Eight arms around a body, crawling, until Ctrl-C.', _EPILOG)
    parser.add_argument(
        'config',
        metavar='CONFIG',
        nargs='?',
        default='renda2012_table4',
        help='ROS parameter file of every arm, or the name of a preset (default: %(default)s)',
    )
    parser.add_argument(
        '--movement', metavar='PROFILE', help='what each arm plays; `octo-arm play --list` lists'
    )
    parser.add_argument(
        '--processes',
        type=int,
        choices=range(1, ARMS + 1),
        metavar='N',
        default=PROCESSES,
        help=f'processes that the nodes share, 1 to {ARMS} (default: %(default)s)',
    )
    parser.add_argument(
        '--moving', action='store_true', help='the arms move with their inertia, in water'
    )
    parser.add_argument('--host-arms', type=int, nargs='+', help=argparse.SUPPRESS)
    demo.add_optional_page(parser)
    options = parser.parse_args(arguments)
    return status_of(_PROG, lambda: _show(options))


def _show(options: argparse.Namespace) -> int:
    # These need ROS, --help does not.
    from octo_arm_model.ros.client.client import DETAILS, POSES, ArmClient
    from octo_arm_model.ros.start import client_node

    path = str(find_path(options.config))
    if options.host_arms:
        host(path, options.host_arms, options.moving)
        return 0
    config = load_config(path)
    is_over = stop_signals()
    moving, topic = (['--moving'], COMMANDS) if options.moving else ([], _TENSIONS)
    groups = np.array_split(np.arange(1, ARMS + 1), options.processes)
    commands = [
        ('octo_arm_model.apps.octopus', path, *moving, '--host-arms', *map(str, group))
        for group in groups
    ]
    with contextlib.ExitStack() as stack:
        stack.enter_context(demo.own_domain(_PROG, '/arm_1'))
        node = stack.enter_context(client_node(_PROG))
        movement = options.movement or demo.movement_of(config.arm)
        crawl = crawling(node, config, movement, topic)
        clients = [ArmClient(node, f'arm_{number}') for number in range(1, ARMS + 1)]
        for client in clients:
            client.listen({**POSES, 'strains': DETAILS['strains']})
        title = page_title('an octopus')
        server = demo.open_page(options, stack, title)
        if server is not None:
            from octo_arm_model.viewer.octopus_page import OctopusPage  # needs viser

            page = OctopusPage(server, clients, lambda: describe(clients), title)
        started = stack.enter_context(children(commands))
        line = stack.enter_context(StatusLine(sys.stdout, demo.LINE_PERIOD))
        due = time.monotonic()
        while not is_over() and not ended(started):
            crawl()
            for client in clients:
                client.poll()
            if server is not None:
                page.draw()
            line.show(lambda: describe(clients))
            now = time.monotonic()
            # After a delay the missed tensions are skipped.
            due = max(due + 1.0 / RATE, now)
            time.sleep(due - now)
        return 0 if is_over() else fail(_PROG, ended(started), 1)


if __name__ == '__main__':
    sys.exit(main())
