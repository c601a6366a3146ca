"""YAML with bounds on size and depth, read with the scalars of ROS, and written; CSV files.

In rcl_yaml_param_parser, and so here, 1e5 is a number, and 1:30, 1_000 and 2026-01-01 are texts;
in YAML 1.1 they are a text, 90, 1000 and a date.
"""

import contextlib
import csv
import errno
import os
import re
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from octo_arm_model.arm.errors import OctoArmError, shown
from octo_arm_model.arm.limits import MAX_YAML_BYTES, MAX_YAML_DEPTH, MAX_YAML_VALUES
from octo_arm_model.rod.backbone import Backbone

_TAG = 'tag:yaml.org,2002:'
_NULL = re.compile(r'^(~|null|Null|NULL|)$')
_BOOL = re.compile(
    r'^(y|Y|yes|Yes|YES|n|N|no|No|NO|true|True|TRUE|false|False|FALSE|on|On|ON|off|Off|OFF)$'
)
_INT = re.compile(r'^[-+]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)$')
_FLOAT = re.compile(
    r'^([-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?'
    r'|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN))$'
)
# C, and so ROS, reads these as numbers; here they are texts.
_C_NUMBER = re.compile(
    r'^[-+]?(inf(inity)?|nan(\(\w*\))?|0x[0-9a-f]*\.?[0-9a-f]*(p[-+]?[0-9]+)?)$', re.IGNORECASE
)


class _TooLargeError(Exception):
    """A file is larger than its bound."""


def read_text(path: str | Path, most: int) -> str:
    """Return the text of a file in UTF-8 of at most ``most`` bytes, for use within `reading`."""
    mode = os.stat(path).st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        # Reading a pipe without a writer would block.
        raise OSError(errno.EINVAL, 'not a regular file')
    with open(path, 'rb') as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise _TooLargeError(f'larger than {most} bytes')
    return data.decode('utf-8-sig').replace('\r\n', '\n').replace('\r', '\n')


def load_yaml(text: str) -> Any:
    """Return the content of a YAML ``text``; mappings have texts as keys. For use in `reading`."""
    if len(text) > MAX_YAML_BYTES:  # the text of a message has not passed `read_text`
        raise _TooLargeError(f'larger than {MAX_YAML_BYTES} bytes')
    return yaml.load(text, _Loader)


def dump_yaml(value: Any) -> str:
    """Return a ``value`` of mappings, lists or tuples, texts, numbers and booleans as YAML.

    Texts that `load_yaml`, ROS or YAML 1.1 would read as another type are quoted.
    """
    text: str = yaml.dump(value, Dumper=_Dumper)
    return text


@contextlib.contextmanager
def reading(path: str | Path, kind: type[OctoArmError]) -> Iterator[None]:
    """Convert every error of a file or its YAML to an error of ``kind`` that names the file.

    Raises:
        OctoArmError: an error of ``kind``, if the file cannot be read.
    """
    try:
        yield
    except OSError as error:
        raise kind(f'{path}: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise kind(f'{path}: not a text file in UTF-8') from error
    except _TooLargeError as error:
        raise kind(f'{path}: {error}') from None
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        where = f', line {mark.line + 1}' if mark else ''
        problem = getattr(error, 'problem', None) or str(error).splitlines()[0]
        raise kind(f'{path}{where}: not valid YAML, {problem}') from error


class _Loader(yaml.SafeLoader):
    """A loader of safe YAML with the scalars of ROS, texts as keys, and bounds on its content."""

    yaml_implicit_resolvers: dict[Any, Any] = {}  # noqa: RUF012  PyYAML declares it so
    bool_values = {**yaml.SafeLoader.bool_values, 'y': True, 'n': False}  # noqa: RUF012

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = 0
        self._count = 0
        self._sizes: dict[int, int] = {}  # values in each node, by its id; the document keeps it

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        before, is_alias = self._count, self.check_event(yaml.AliasEvent)
        mark = self.peek_event().start_mark
        self._depth += 1
        self._count += 0 if is_alias else 1
        self._check_bounds(mark)
        node = super().compose_node(parent, index)
        if is_alias:
            if id(node) not in self._sizes:
                raise _problem('an alias within what it stands for', mark)
            self._count += self._sizes[id(node)]
            self._check_bounds(mark)
        self._sizes[id(node)] = self._count - before
        self._depth -= 1
        return node

    def _check_bounds(self, mark: yaml.Mark) -> None:
        if self._depth > MAX_YAML_DEPTH:
            raise _problem(f'nested more than {MAX_YAML_DEPTH} deep', mark)
        if self._count > MAX_YAML_VALUES:
            raise _problem(f'more than {MAX_YAML_VALUES} values, with aliases written out', mark)

    def construct_mapping(self, node: yaml.Node, deep: bool = False) -> dict[Any, Any]:
        if not isinstance(node, yaml.MappingNode):
            raise _problem('expected names and values', node.start_mark)
        mapping: dict[Any, Any] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _problem('expected a name before the colon', key.start_mark)
            if key.value in mapping:
                raise _problem(f'{shown(key.value)} is given twice', key.start_mark)
            mapping[key.value] = self.construct_object(value, deep=deep)
        return mapping


class _Dumper(yaml.SafeDumper):
    """A writer of safe YAML for ROS, without aliases, which rcl does not read."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _represent_text(dumper: _Dumper, text: str) -> yaml.Node:
    readings = (_NULL, _BOOL, _INT, _FLOAT, _C_NUMBER)
    style = "'" if any(pattern.match(text) for pattern in readings) else None
    return dumper.represent_scalar(_TAG + 'str', text, style=style)


def _represent_list(dumper: _Dumper, values: Sequence[Any]) -> yaml.Node:
    return dumper.represent_sequence(_TAG + 'seq', values, flow_style=True)


_Dumper.add_representer(str, _represent_text)
_Dumper.add_representer(list, _represent_list)
_Dumper.add_representer(tuple, _represent_list)


def _problem(problem: str, mark: yaml.Mark | None) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


def _construct_bool(loader: _Loader, node: yaml.Node) -> bool:
    return bool(loader.bool_values[_scalar(loader, node, _BOOL, 'boolean').lower()])


def _construct_int(loader: _Loader, node: yaml.Node) -> int:
    text = _scalar(loader, node, _INT, 'integer')
    digits = text.lstrip('+-')
    is_octal = len(digits) > 1 and digits.isdigit() and digits[0] == '0'
    try:
        value = int(text, 8 if is_octal else 0)
        str(value)  # Python limits the number of decimal digits, which errors show.
    except ValueError:
        raise _problem(f'{shown(text)} is no integer', node.start_mark) from None
    return value


def _construct_float(loader: _Loader, node: yaml.Node) -> float:
    text = _scalar(loader, node, _FLOAT, 'number')
    return float(text.replace('.', '') if text[-1].isalpha() else text)


def _scalar(loader: _Loader, node: yaml.Node, pattern: re.Pattern[str], what: str) -> str:
    text = loader.construct_scalar(node)
    if not isinstance(text, str) or not pattern.match(text):
        raise _problem(f'{shown(text)} is no {what}', node.start_mark)
    return text


for _name, _pattern in (('null', _NULL), ('bool', _BOOL), ('int', _INT), ('float', _FLOAT)):
    _Loader.add_implicit_resolver(_TAG + _name, _pattern, None)
_Loader.add_constructor(_TAG + 'bool', _construct_bool)
_Loader.add_constructor(_TAG + 'int', _construct_int)
_Loader.add_constructor(_TAG + 'float', _construct_float)
# launch_ros writes lists in its parameter files so, and rcl reads lists.
_Loader.add_constructor(_TAG + 'python/tuple', _Loader.construct_yaml_seq)
# No parameter has a value of these types.
for _name in ('binary', 'timestamp', 'omap', 'pairs', 'set'):
    _Loader.add_constructor(_TAG + _name, yaml.SafeLoader.construct_undefined)


# The numbers of JSON and YAML; Python would also read 1_000 and the digits of other scripts.
NUMBER = re.compile(r'\s*[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?\s*$')
# The columns of a CSV file of a backbone, with a row for each station.
STATION_COLUMNS = ('s [m]', 'x [m]', 'y [m]', 'z [m]', 'tau [1/m]', 'xi [1/m]', 'k [1/m]', 'q [-]')


def station_rows(shape: Backbone) -> list[list[float]]:
    """Return the `STATION_COLUMNS` of each station of a ``shape``."""
    columns = shape.s, shape.position, shape.tau, shape.xi, shape.k, shape.q
    return np.column_stack(columns).tolist()


class CsvFiles(contextlib.ExitStack):
    """CSV files that stay open until the block ends."""

    def open(self, path: Path) -> Any:
        """Return a writer of a new file; raise OSError if it exists or cannot be written."""
        file = self.enter_context(path.open('x', encoding='utf-8', newline=''))
        return csv.writer(file, lineterminator='\n')


def tension_columns(tendons: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a table of tensions over time, as in a command profile."""
    return ('time [s]', *(f'{name} [N]' for name in tendons))
