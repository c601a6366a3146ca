"""Command profiles in CSV and YAML files; errors name the line."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np
import yaml

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ProfileError, listed, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_PROFILE_BYTES, MAX_PROFILE_ROWS, MAX_YAML_BYTES
from octo_arm_model.config.files import NUMBER, compose_yaml, read_text, reading, tension_columns
from octo_arm_model.simulation.profiles.profile import CommandProfile


class _Row(NamedTuple):
    """The texts of one row, and their line numbers."""

    time_line: int
    time: str
    line: int
    tensions: Sequence[str]


class _LineError(Exception):
    """An error in a line of the file."""

    def __init__(self, line: int, problem: str) -> None:
        super().__init__(f'line {line}: {problem}')


def read_profile(path: str | Path, arm: Arm) -> CommandProfile:
    """Read a profile for ``arm``.

    A CSV file has a header, ``time`` and the names of all tendons in any order, with or without
    their units (``time [s]``, ``tendon_1_1 [N]``), and below it rows of numbers; its
    interpolation is smooth. A YAML file has ``times``, a list, ``tensions``, a list of as many
    lists in the order of `Arm.tendon_names`, and optionally ``interpolation``.

    Raises:
        ProfileError: if the file cannot be read or is invalid; the message has its name and line.
    """
    with reading(path, ProfileError):
        return _read(path, arm)


def _read(path: str | Path, arm: Arm) -> CommandProfile:
    is_csv = Path(path).suffix == '.csv'
    text = read_text(path, MAX_PROFILE_BYTES if is_csv else MAX_YAML_BYTES)
    rows: list[_Row] = []
    try:
        rows, interpolation = _read_csv(text, arm) if is_csv else _read_yaml(text, arm)
        if not rows:
            raise ProfileError('no rows, expected at least two')
        numbers = np.array([_numbers(row, arm) for row in rows])
        return CommandProfile(numbers[:, 0], numbers[:, 1:], interpolation)
    except csv.Error as error:
        raise ProfileError(f'{path}: not what its suffix says, {error}') from error
    except _LineError as error:
        raise ProfileError(f'{path}, {error}') from None
    except ProfileError as error:
        # Tensions were checked before, so the error of a row is in its time.
        where = '' if error.row is None else f', line {rows[error.row].time_line}'
        raise ProfileError(f'{path}{where}: {error}') from None


def _numbers(row: _Row, arm: Arm) -> list[float]:
    """Time and tensions of a row."""
    time = _number(row.time_line, 'time', row.time, -math.inf, 'a finite number [s]')
    tensions = (
        _number(row.line, name, text, 0.0, 'a finite number >= 0 [N]')
        for name, text in zip(arm.tendon_names, row.tensions, strict=True)
    )
    return [time, *tensions]


def _number(line: int, name: str, text: str, least: float, expected: str) -> float:
    number = float(text) if NUMBER.match(text) else math.nan
    if not (math.isfinite(number) and number >= least):
        raise _LineError(line, f'{name} is {shown(text)}, expected {expected}')
    return number


def _read_csv(text: str, arm: Arm) -> tuple[list[_Row], str]:
    reader = csv.reader(io.StringIO(text), skipinitialspace=True)
    header: list[str] | None = None
    rows: list[_Row] = []
    for cells in reader:
        if not any(cells):
            continue
        line = reader.line_num
        if header is None:
            header = [_without_unit(cell.strip()) for cell in cells]
            names = ('time', *arm.tendon_names)
            # A tendon may be called time as well.
            if sorted(header) != sorted(names) or len(set(names)) < len(names):
                expected = ', '.join(names)
                raise _LineError(line, f'header is {listed(header)}; expected {expected}')
            continue
        if len(cells) != len(header):
            raise _LineError(line, f'{len(cells)} values, expected {len(header)} as in the header')
        _check_rows(len(rows) + 1, line)
        value = dict(zip(header, cells))
        rows.append(_Row(line, value['time'], line, [value[name] for name in arm.tendon_names]))
    return rows, 'smooth'


def _without_unit(name: str) -> str:
    """The ``name`` of a column without its unit, s of the time and N of tensions."""
    return 'time' if name == 'time [s]' else name.removesuffix(' [N]')


def _read_yaml(text: str, arm: Arm) -> tuple[list[_Row], str]:
    # Nodes instead of values, as they have line numbers.
    document = compose_yaml(text)
    if not isinstance(document, yaml.MappingNode):
        raise _LineError(1, 'expected times: and tensions:')
    found: dict[str, yaml.Node] = {}
    for key, node in document.value:
        if key.value not in ('times', 'tensions', 'interpolation') or key.value in found:
            raise _LineError(
                key.start_mark.line + 1,
                f'{shown(key.value)} is unknown or given twice, expected times, tensions and '
                'maybe interpolation',
            )
        found[key.value] = node
    times = _items(found.get('times'), 'times')
    tensions = _items(found.get('tensions'), 'tensions')
    _check_rows(len(times), 1)
    if len(times) != len(tensions):
        raise _LineError(
            found['tensions'].start_mark.line + 1,
            f'{len(tensions)} rows of tensions, expected {len(times)}, one for each of times',
        )
    rows = []
    for time, row in zip(times, tensions):
        line, cells = row.start_mark.line + 1, _items(row, 'a row of tensions')
        if len(cells) != len(arm.tendons):
            names = ', '.join(arm.tendon_names)
            raise _LineError(line, f'{len(cells)} values, expected {len(arm.tendons)}: {names}')
        time_line = time.start_mark.line + 1
        rows.append(_Row(time_line, _scalar(time), line, [_scalar(cell) for cell in cells]))
    interpolation = found.get('interpolation')
    return rows, 'smooth' if interpolation is None else _scalar(interpolation)


def _check_rows(count: int, line: int) -> None:
    if count > MAX_PROFILE_ROWS:
        raise _LineError(line, f'more than {MAX_PROFILE_ROWS} rows')


def _items(node: yaml.Node | None, name: str) -> list[yaml.Node]:
    if not isinstance(node, yaml.SequenceNode):
        line = 1 if node is None else node.start_mark.line + 1
        raise _LineError(line, f'{name} is no list')
    return node.value


def _scalar(node: yaml.Node) -> str:
    if not isinstance(node, yaml.ScalarNode):
        raise _LineError(node.start_mark.line + 1, 'a list where one value was expected')
    return node.value


def write_csv(file: TextIO, times: FloatArray, tensions: FloatArray, arm: Arm) -> None:
    """Write ``times`` (n,) [s] and ``tensions`` (n, tendons) [N] as `read_profile` reads them."""
    writer = csv.writer(file, lineterminator='\n')
    writer.writerow(tension_columns(arm.tendon_names))
    for time, row in zip(times.tolist(), tensions.tolist(), strict=True):
        writer.writerow([repr(round(time, 9)), *map(repr, row)])
