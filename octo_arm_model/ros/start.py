"""Start and end ROS in a program: arguments, one-line errors with a hint, a client's node."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from octo_arm_model.core.errors import ConfigError

# What to do about an error of rcl, by a part of its text.
_HINTS = {
    'ogging': 'logs are written to ROS_LOG_DIR, else below ROS_HOME or HOME: '
    'set one to a folder that can be written',
    'Error opening YAML file': 'expected a file that exists and can be read, seen from {here}',
    'should be of same type': 'in a ROS parameter file a list of doubles needs 1.0, not 1',
}


def split_arguments(arguments: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """Split ``arguments``, by default of the command line, at --ros-args: own, and of ROS."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    own = given.index('--ros-args') if '--ros-args' in given else len(given)
    return given[:own], given[own:]


def start_ros(
    arguments: Sequence[str], signals: SignalHandlerOptions = SignalHandlerOptions.NO
) -> None:
    """Initialise rclpy with ``arguments``.

    Raises:
        ConfigError: if an argument or a file cannot be parsed, or logs cannot be written.
    """
    try:
        rclpy.init(args=list(arguments), signal_handler_options=signals)
    except RuntimeError as error:  # what rcl raises
        reason = str(error).split(', at /')[0]
        hints = [hint.format(here=Path.cwd()) for part, hint in _HINTS.items() if part in reason]
        raise ConfigError('; '.join([reason, *hints])) from error


@contextlib.contextmanager
def client_node(name: str, arguments: Sequence[str] = ()) -> Iterator[Node]:
    """Initialise rclpy with ``arguments`` and create a node, which is destroyed with the block.

    Raises:
        ConfigError: as `start_ros`.
    """
    start_ros(arguments)
    try:
        node = Node(name)
        try:
            yield node
        finally:
            # Threads of DDS that a forgotten node leaves running crash in a process that ends.
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
