"""CSV files of laboratories: columns by name, units in headers, errors that name the line."""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, listed, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_CSV_BYTES, MAX_CSV_COLUMNS, MAX_CSV_ROWS
from octo_arm_model.config.files import NUMBER, read_text, reading
from octo_arm_model.experiment.recording import Count

TIME = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}
FORCE = {'N': 1.0, 'mN': 1e-3}
# 'time [ms]' or 'time (ms)'.
_HEADER = re.compile(r'^(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*$')
_FIRST = re.compile(r'^.*[^\s,;].*$', re.MULTILINE)  # line with more than separators
_MISSING = ('', 'nan', 'NaN', 'NAN')
_EXPECTED = (
    'expected one line of headers, with another name for each column such as time, x, y, z, and '
    'only rows of numbers below it: leave out lines of other things before it'
)
_TOGETHER = 4096  # rows counted at a time


class _Column(NamedTuple):
    name: str
    unit: str
    text: str  # of the header, name and unit


@dataclass(frozen=True)
class CsvTable:
    """The columns of a CSV file, as texts.

    Attributes:
        path: where it is.
        columns: name and unit of each, '' where the header has none.
        rows: texts of each row.
        lines: line of each row.
        given: name of the column of each quantity where it has another, or a number instead.
        count: progress of the conversion of its columns.
        wanted: names of all quantities that were looked for.
        taken: those of them that were found as ``given``.
    """

    path: Path
    columns: tuple[_Column, ...]
    rows: tuple[Sequence[str], ...]
    lines: tuple[int, ...]
    given: Mapping[str, str]
    count: Count
    wanted: set[str] = field(default_factory=set)
    taken: set[str] = field(default_factory=set)

    def find(self, name: str) -> int | float | None:
        """Number of the column for ``name``, or the value in place of one; None if neither.

        A column that was given for it may be that of another file, see `check_taken`.

        Raises:
            MeasurementError: if a column was given for it, and there is none of either name.
        """
        self.wanted.add(name)
        if name not in self.given:
            return self._number(name)
        wanted = self.given[name].strip()
        number = self._number(wanted)
        if number is not None or NUMBER.match(wanted):
            self.taken.add(name)
            return float(wanted) if number is None else number
        own = self._number(name)
        if own is None:
            raise self.lacking(name)
        return own

    def lacking(self, name: str) -> MeasurementError:
        """The error that the column that was given for ``name`` is not here."""
        wanted = shown(self.given[name].strip())
        return MeasurementError(f'{self.path}: no column {wanted} for {name}; {self.listing}')

    def _number(self, wanted: str) -> int | None:
        for number, column in enumerate(self.columns):
            if wanted in (column.name, column.text, f'{column.name} [{column.unit}]'):
                return number
        return None

    @property
    def listing(self) -> str:
        """The names of the columns, of many not all, and whether they look like a header."""
        names = [column.name for column in self.columns]
        doubt = f'; {_EXPECTED}' if any(map(NUMBER.match, names)) else ''
        return f'it has {listed(names)}{doubt}'

    def numbers(self, name: str, units: Mapping[str, float], default: str) -> FloatArray:
        """Values of the column for ``name`` in the first of ``units``, NaN where there is none.

        ``default`` is the unit where the header has none.

        Raises:
            MeasurementError: if there is no such column, its unit is another, or a cell holds no
                number.
        """
        number = self.find(name)
        if number is None:
            raise MeasurementError(
                f'{self.path}: no column {name}; {self.listing}; say --columns {name}=COLUMN'
            )
        if isinstance(number, float):
            return np.full(len(self.rows), number)
        unit = self.columns[number].unit or default
        if unit not in units:
            raise MeasurementError(
                f'{self.path}, line 1: {name} is in {shown(unit)}, expected {" or ".join(units)}'
            )
        values = np.empty(len(self.rows))
        for place, row in enumerate(self.rows):
            text = row[number].strip()
            if NUMBER.match(text) and math.isfinite(value := float(text)):
                values[place] = value
            elif text in _MISSING:
                values[place] = math.nan
            else:
                raise MeasurementError(
                    f'{self.path}, line {self.lines[place]}: {name} is {shown(text)}, expected a '
                    f'finite number [{unit}], or nothing'
                )
        self.count.add(len(self.rows))
        return units[unit] * values

    def times(self) -> list[int]:
        """The column time [ns].

        Raises:
            MeasurementError: if there is none, or a value is missing or none of a clock.
        """
        seconds = self.numbers('time', TIME, 's')
        fine = np.abs(seconds) < 2.0**31
        if not fine.all():
            place = int(np.argmin(fine))
            raise MeasurementError(
                f'{self.path}, line {self.lines[place]}: time is {float(seconds[place])!r} s, '
                'expected a time below 2147483648 s'
            )
        return [round(second * 1e9) for second in seconds.tolist()]


def read_csv(path: Path, given: Mapping[str, str], count: Count) -> CsvTable:
    """Read a file with one line of headers and rows below; ``given`` says which column is what.

    Fields are separated by commas, semicolons or tabs, whichever the header has. Of the progress
    ``count`` each row and each value is one.

    Raises:
        MeasurementError: if it cannot be read, is too large, or a row is too short or long.
    """
    with reading(path, MeasurementError):
        text = read_text(path, MAX_CSV_BYTES)
    head = _FIRST.search(text)
    separator = max((',', ';', '\t'), key=head[0].count) if head else ','
    rows: list[Sequence[str]] = []
    lines: list[int] = []
    columns: tuple[_Column, ...] = ()
    reader = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    try:
        for cells in reader:
            line = reader.line_num
            if not any(cell.strip() for cell in cells):
                continue
            if not columns:
                columns = _header(cells, path, line)
                expected = min(text.rstrip().count('\n'), MAX_CSV_ROWS)
                count.expect(expected * (1 + len(columns)))
                continue
            if len(cells) != len(columns):
                doubt = f'; {_EXPECTED}' if not rows else ''
                raise MeasurementError(
                    f'{path}, line {line}: {len(cells)} values, expected {len(columns)} as in the '
                    f'header{doubt}'
                )
            if len(rows) == MAX_CSV_ROWS:
                raise MeasurementError(f'{path}, line {line}: more than {MAX_CSV_ROWS} rows')
            rows.append(cells)
            lines.append(line)
            if len(rows) % _TOGETHER == 0:
                count.add(_TOGETHER)
    except csv.Error as error:
        raise MeasurementError(f'{path}, line {reader.line_num}: no CSV: {error}') from error
    if not rows:
        raise MeasurementError(f'{path}: no rows, expected a header and rows below it')
    return CsvTable(path, columns, tuple(rows), tuple(lines), given, count)


def check_taken(tables: Sequence[CsvTable]) -> None:
    """Check that each given column is in one of ``tables``; others may have their own name for it.

    Raises:
        MeasurementError: if one is in none of them.
    """
    taken = {name for table in tables for name in table.taken}
    for table in tables:
        for name in table.given:
            if name in table.wanted and name not in taken:
                raise table.lacking(name)


def _header(cells: Sequence[str], path: str | Path, line: int) -> tuple[_Column, ...]:
    if len(cells) > MAX_CSV_COLUMNS:
        raise MeasurementError(
            f'{path}, line {line}: {len(cells)} columns, expected at most {MAX_CSV_COLUMNS}'
        )
    texts = [cell.strip() for cell in cells]
    if all(NUMBER.match(text) or text in _MISSING for text in texts):
        raise MeasurementError(f'{path}, line {line}: numbers and no header, {_EXPECTED}')
    columns = []
    for text in texts:
        match = _HEADER.match(text)
        name, unit = match.groups() if match else (text, '')
        columns.append(_Column(name, unit, text))
    counts = Counter(column.name for column in columns)
    for name, count in counts.items():
        if count > 1:
            raise MeasurementError(
                f'{path}, line {line}: {count} columns {shown(name)}, {_EXPECTED}'
            )
    return tuple(columns)
