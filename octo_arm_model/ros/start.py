"""Start and end ROS in a program: arguments, one-line errors with a hint, a client's node."""

from __future__ import annotations

import contextlib
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from octo_arm_model.config.parameter_files import as_rcl_reads, naming, value_of_one_type
from octo_arm_model.config.presets import find_path
from octo_arm_model.config.yaml_files import dump_numbers, load_yaml, read_text
from octo_arm_model.core.errors import ConfigError
from octo_arm_model.core.limits import MAX_YAML_BYTES

# What to do about an error of rcl, by a part of its text.
_HINTS = {
    'ogging': 'logs are written to ROS_LOG_DIR, else below ROS_HOME or HOME: '
    'set one to a folder that can be written',
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
    with read_here(arguments) as given:
        try:
            rclpy.init(args=given, signal_handler_options=signals)
        except RuntimeError as error:  # what rcl raises
            reason = str(error).split(', at /')[0]
            hints = [hint for part, hint in _HINTS.items() if part in reason]
            raise ConfigError('; '.join([reason, *hints])) from error


@contextlib.contextmanager
def read_here(arguments: Sequence[str]) -> Iterator[list[str]]:
    """ROS ``arguments`` with the parameters that the command line reads in the same files.

    Files may be presets. They are read by `parameter_files` and written anew for rcl, which must
    read them within the block.

    Raises:
        ConfigError: if a file is no parameter file, or none can be written.
    """
    with contextlib.ExitStack() as stack:
        given = list(arguments)
        for number in range(1, len(given)):
            option, text = given[number - 1 : number + 1]
            if option == '--params-file':
                given[number] = str(_file_for_rcl(find_path(text), stack))
            elif option in ('-p', '--param'):
                given[number] = _assignment_for_rcl(text)
        yield given


def _file_for_rcl(path: Path, stack: contextlib.ExitStack) -> Path:
    """A file that rcl reads as ``path`` is read here, there until the ``stack`` ends."""
    with naming(path):
        text = as_rcl_reads(read_text(path, MAX_YAML_BYTES))
    try:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        written = Path(folder) / 'parameters.yaml'
        written.write_text(text, encoding='utf-8')
    except OSError as error:
        raise ConfigError(f'{path} cannot be handed to ROS: {error}') from error
    return written


def _assignment_for_rcl(text: str) -> str:
    """The ``text`` NAME:=VALUE with a list of integers and other numbers as one of numbers."""
    name, separator, value = text.partition(':=')
    if not value.startswith('['):
        return text
    with naming(text):
        found = value_of_one_type(name, load_yaml(value))
    is_plain = {*map(type, found)} != {float}
    return text if is_plain else f'{name}{separator}{dump_numbers(found)}'


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
