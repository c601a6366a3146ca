"""Start and end ROS in a program: one-line errors with a hint, a client's node."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from octo_arm_model.arm.errors import ConfigError, shown
from octo_arm_model.arm.limits import MAX_YAML_BYTES
from octo_arm_model.config.files import dump_numbers, load_yaml, read_text
from octo_arm_model.config.parameter_files import (
    Nodes,
    find_path,
    naming,
    nodes_of,
    text_of_nodes,
    value_of_one_type,
)

# What to do about an error of rcl, by a part of its text.
_HINTS = {
    'ogging': 'logs are written to ROS_LOG_DIR, else below ROS_HOME or HOME: '
    'set one to a folder that can be written',
}


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
    given, read = list(arguments), dict[int, Nodes]()
    for number in range(1, len(given)):
        option, text = given[number - 1 : number + 1]
        if option == '--params-file':
            path = find_path(text)
            with naming(path):
                read[number] = nodes_of(read_text(path, MAX_YAML_BYTES))
        elif option in ('-p', '--param'):
            read[number] = _assignment(text)
    _unify([node for nodes in read.values() for node in nodes])
    with contextlib.ExitStack() as stack:
        for number, nodes in read.items():
            if given[number - 1] == '--params-file':
                given[number] = _file_of(nodes, stack)
            else:
                given[number] = _argument_of(nodes, given[number])
        yield given


def _assignment(text: str) -> Nodes:
    """What ``text``, NAME:=VALUE or NODE:NAME:=VALUE, sets; nothing where it has no value."""
    target, _, value = text.partition(':=')
    node, _, name = target.rpartition(':')
    with naming(text):
        found = load_yaml(value)
        if found is None or isinstance(found, dict):
            return []
        return [(node or '/**', {name: value_of_one_type(name, found)})]


def _argument_of(nodes: Nodes, text: str) -> str:
    """The argument that sets what it did as ``text``, numbers as they are in ``nodes`` now."""
    for _, parameters in nodes:
        for value in parameters.values():
            if isinstance(value, float):
                return f'{text.partition(":=")[0]}:={dump_numbers([value])[1:-1]}'
            if isinstance(value, list) and {*map(type, value)} == {float}:
                return f'{text.partition(":=")[0]}:={dump_numbers(value)}'
    return text


def _unify(nodes: Nodes) -> None:
    """Give the numbers of one parameter one type: of two, rcl takes the integer, which is first.

    Raises:
        ConfigError: if other values of one parameter have several types, of which rcl takes one.
    """
    kinds: dict[tuple[str, str], set[Any]] = {}
    for node, parameters in nodes:
        for name, value in parameters.items():
            kinds.setdefault((node, name), set()).add(_kind_of(value))
    for node, parameters in nodes:
        for name, value in parameters.items():
            found = kinds[node, name] - {(list,)}  # an empty list is of every type
            if len(found) < 2:
                continue
            if found not in ({(int,), (float,)}, {(list, int), (list, float)}):
                raise ConfigError(f'{name} is {shown(value)} and a value of another type as well')
            is_list = isinstance(value, list)
            parameters[name] = [*map(float, value)] if is_list else float(value)


def _kind_of(value: Any) -> tuple[type, ...]:
    """The type of a ``value``, and of the elements of a list."""
    return (list, *{*map(type, value)}) if isinstance(value, list) else (type(value),)


def _file_of(nodes: Nodes, stack: contextlib.ExitStack) -> str:
    """Path of a file from which rcl reads ``nodes``, until the ``stack`` ends."""
    try:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        path = Path(folder) / 'parameters.yaml'
        path.write_text(text_of_nodes(nodes), encoding='utf-8')
    except OSError as error:
        raise ConfigError(f'parameters cannot be handed to ROS: {error}') from error
    return str(path)


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
