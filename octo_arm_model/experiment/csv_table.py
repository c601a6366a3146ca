"""CSV files of laboratories: columns by name, units in headers, errors that name the line."""

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, listed, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_CSV_BYTES, MAX_CSV_COLUMNS, MAX_CSV_ROWS
from octo_arm_model.config.files import NUMBER, read_text, reading

KINDS = ('tension', 'midline', 'displacement')  # of tables
TIME = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}
FORCE = {
    'N': 1.0,
    'mN': 1e-3,
    'kN': 1e3,
    'g': 9.80665e-3,
    'gf': 9.80665e-3,
    'kg': 9.80665,
    'kgf': 9.80665,
    'lbf': 4.4482216152605,
    'lb': 4.4482216152605,
}
# 'time [ms]' or 'time (ms)'.
_HEADER = re.compile(r'^(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*$')
_FIRST = re.compile(r'^.*[^\s,;].*$', re.MULTILINE)  # line with more than separators
_MISSING = ('', 'nan', 'NaN', 'NAN')
_EXPECTED = (
    'expected lines of headers, or none, and only rows of as many numbers below them: leave out '
    'lines of other things'
)
_ISO = re.compile(
    r'^(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)(?:[.,](\d{1,9}))?\s*(Z|[+-]\d\d:?\d\d)?$'
)
_UNITS = frozenset({*TIME, *FORCE, 'm', 'cm', 'mm', 'rad', 'deg', 'counts', 'ticks', '-'})
# Units in words, as Motive has them.
_IN_WORDS = {
    'Seconds': 's',
    'seconds': 's',
    'sec': 's',
    'Meters': 'm',
    'Centimeters': 'cm',
    'Millimeters': 'mm',
}
_MOST_HEADERS = 20  # lines


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
        given: name of the column of each quantity where it has another, or #N for the N-th
            column, or a number instead.
        has_time: whether rows have a time; without, they are poses a second apart.
        wanted: names of all quantities that were looked for.
        taken: those of them that were found as ``given``.
    """

    path: Path
    columns: tuple[_Column, ...]
    rows: tuple[Sequence[str], ...]
    lines: tuple[int, ...]
    given: Mapping[str, str]
    has_time: bool = True
    wanted: set[str] = field(default_factory=set)
    taken: set[str] = field(default_factory=set)

    def find(self, name: str) -> int | float | None:
        """Number of the column for ``name``, or the value in place of one; None if neither.

        A column that was given for it may be that of another file, see `check_columns`.

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

    def has(self, name: str) -> bool:
        """Whether there is a column for ``name``, or a value in place of one, see `find`."""
        return self.find(name) is not None

    def lacking(self, name: str) -> MeasurementError:
        """The error that the column that was given for ``name`` is not here."""
        wanted = shown(self.given[name].strip())
        return MeasurementError(f'{self.path}: no column {wanted} for {name}; {self.listing}')

    def _number(self, wanted: str) -> int | None:
        if wanted[:1] == '#' and wanted[1:].isdecimal() and len(wanted) < 9:
            if not 1 <= int(wanted[1:]) <= len(self.columns):
                raise MeasurementError(
                    f'{self.path}: no column {wanted}, expected #1 to #{len(self.columns)}'
                )
            return int(wanted[1:]) - 1
        for texts in ([one.text for one in self.columns], [one.name for one in self.columns]):
            if (count := texts.count(wanted)) > 1 and wanted:
                raise MeasurementError(
                    f'{self.path}: {count} columns {shown(wanted)}; say which by its number, as '
                    f'#{texts.index(wanted) + 1}'
                )
            if count:
                return texts.index(wanted)
        whole = [f'{one.name} [{one.unit}]' for one in self.columns]
        return whole.index(wanted) if wanted in whole else None

    @property
    def listing(self) -> str:
        """The names of the columns, of many not all, and whether they look like a header."""
        names = [one.name or f'#{number + 1}' for number, one in enumerate(self.columns)]
        doubt = f'; {_EXPECTED}' if any(map(NUMBER.match, names)) else ''
        return f'it has {listed(names)}{doubt}'

    def numbers(
        self, name: str, units: Mapping[str, float], default: str, is_scaled: bool = False
    ) -> FloatArray:
        """Values of the column for ``name`` in the first of ``units``, NaN where there is none.

        ``default`` is the unit where the header has none; what a calibration is given for
        ``is_scaled`` by that, and may be in others, as counts and radians are.

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
        unit = _IN_WORDS.get(unit, unit)
        if unit not in units and not is_scaled:
            raise MeasurementError(
                f'{self.path}: {name} is in {shown(unit)}, expected {" or ".join(units)}'
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
        return units.get(unit, 1.0) * values

    def times(self) -> list[int]:
        """The column time [ns].

        Raises:
            MeasurementError: if there is none, or a value is missing or none of a clock.
        """
        number = self.find('time')
        if number is None and not self.has_time:
            return [row * 10**9 for row in range(len(self.rows))]
        if isinstance(number, int) and _ISO.match(self.rows[0][number].strip()):
            texts = [row[number].strip() for row in self.rows]
            return [self._stamp(*one) for one in zip(texts, self.lines, strict=True)]
        seconds = self.numbers('time', TIME, 's')
        fine = np.abs(seconds) < 2.0**31
        if not fine.all():
            place = int(np.argmin(fine))
            raise MeasurementError(
                f'{self.path}, line {self.lines[place]}: time is {float(seconds[place])!r} s, '
                'expected a time below 2147483648 s'
            )
        return [round(second * 1e9) for second in seconds.tolist()]

    def _stamp(self, text: str, line: int) -> int:
        """A time of ISO 8601 [ns], of UTC where it says nothing else."""
        try:
            day, clock, fraction, zone = _ISO.match(text).groups()  # type: ignore[union-attr]
            zone = '+00:00' if zone in (None, 'Z') else f'{zone[:3]}:{zone[-2:]}'
            whole = datetime.fromisoformat(f'{day}T{clock}{zone}')
        except (AttributeError, ValueError):
            raise MeasurementError(
                f'{self.path}, line {line}: time is {shown(text)}, expected one of ISO 8601 such '
                'as 2024-05-02T10:11:12.5Z'
            ) from None
        return int(whole.timestamp()) * 10**9 + int((fraction or '0').ljust(9, '0'))


def read_csv(path: Path, given: Mapping[str, str], has_time: bool = True) -> CsvTable:
    """Read a file of headers and rows of numbers; ``given`` says which column is what.

    Fields are separated by commas, semicolons or tabs, whichever the header has. There may be no
    header, or several lines of it: names above each other are one, and the last line may be of
    units. Files of Motive and Vicon are known by their first line: their columns are
    <marker>_x, <marker>_y and <marker>_z, and time.

    Raises:
        MeasurementError: if it cannot be read, is too large, or a row is too short or long.
    """
    with reading(path, MeasurementError):
        text = read_text(path, MAX_CSV_BYTES)
    head = _FIRST.search(text)
    separator = max((',', ';', '\t'), key=head[0].count) if head else ','
    rows: list[list[str]] = []
    lines: list[int] = []
    reader = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    try:
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            if len(cells) > MAX_CSV_COLUMNS:
                raise MeasurementError(
                    f'{path}, line {reader.line_num}: {len(cells)} columns, expected at most '
                    f'{MAX_CSV_COLUMNS}'
                )
            if len(rows) > MAX_CSV_ROWS + _MOST_HEADERS:
                break
            rows.append(cells)
            lines.append(reader.line_num)
    except csv.Error as error:
        raise MeasurementError(f'{path}, line {reader.line_num}: no CSV: {error}') from error
    columns, first = _headers(rows) if rows else ((), 0)
    rows, lines = rows[first:], lines[first:]
    if not rows:
        raise MeasurementError(f'{path}: no rows, expected a header and rows below it')
    if len(rows) > MAX_CSV_ROWS:
        raise MeasurementError(f'{path}, line {lines[-1]}: more than {MAX_CSV_ROWS} rows')
    for cells, line in zip(rows, lines, strict=True):
        if len(cells) != len(columns):
            doubt = f'; {_EXPECTED}' if line == lines[0] else ''
            raise MeasurementError(
                f'{path}, line {line}: {len(cells)} values, expected {len(columns)} as in the '
                f'header{doubt}'
            )
    return CsvTable(path, columns, tuple(rows), tuple(lines), given, has_time)


def check_columns(columns: Iterable[str], tables: Mapping[str, CsvTable]) -> None:
    """Check that ``columns`` are looked for, and are in one of ``tables`` by their `KINDS`.

    Other tables may have their own name for one. The only table of all is of no kind, ''.

    Raises:
        MeasurementError: if one is in none of them, or not looked for.
    """
    taken = {name for table in tables.values() for name in table.taken}
    for table in tables.values():
        for name in table.given:
            if name in table.wanted and name not in taken:
                raise table.lacking(name)
    wanted = {name for table in tables.values() for name in table.wanted}
    of_one = {f'{kind}:{name}' for kind, table in tables.items() for name in table.wanted if kind}
    if unread := [name for name in columns if name not in wanted | of_one]:
        more = f', of one file as {", ".join(f"{kind}:NAME" for kind in KINDS)}' if of_one else ''
        where = f'{tables[""].path}: ' if '' in tables else ''
        raise MeasurementError(
            f'{where}--columns names {listed(unread)}, which is not read here; expected names of '
            f'{listed(sorted(wanted))}{more}'
        )


def _headers(rows: list[list[str]]) -> tuple[tuple[_Column, ...], int]:
    """The columns of a file, and which of its ``rows`` is the first of numbers."""
    first = rows[0][0].strip() if rows else ''
    named = next((n for n, row in enumerate(rows[:_MOST_HEADERS]) if row[0] == 'Frame'), 0)
    if first == 'Format Version' and named:
        return _of_motive(rows[:named], rows[named]), named + 1
    if first == 'Trajectories' and 1 < named < len(rows) - 1:
        return _of_vicon(rows, named), named + 2
    count = len(rows)
    for number, row in enumerate(rows[:_MOST_HEADERS]):
        cells = [cell.strip() for cell in row]
        numbers = [bool(NUMBER.match(one) or _ISO.match(one)) for one in cells]
        missing = [one in _MISSING for one in cells]
        # Of numbers; the first row is if it has nothing else.
        if any(numbers) or all(missing) if number else all(map(max, numbers, missing)):
            count = number
            break
    if not count:
        return tuple(_Column('', '', '') for _ in rows[0]), 0
    headers = [[cell.strip() for cell in row] for row in rows[:count]]
    headers = [row for row in headers if len(row) == len(headers[0])]
    units = headers.pop() if count > 1 and {*headers[-1]} <= {*_UNITS, ''} else []
    columns = []
    for number, texts in enumerate(zip(*headers)):
        text = ' '.join(filter(None, texts))
        match = _HEADER.match(text)
        name, unit = match.groups() if match else (text, '')
        columns.append(_Column(name, units[number] if units else unit, text))
    return tuple(columns), count


def _of_motive(rows: Sequence[Sequence[str]], axes: Sequence[str]) -> tuple[_Column, ...]:
    """Columns of an export of Motive: names, kinds and ``axes`` are in lines of their own."""
    about = dict(zip(rows[0][::2], rows[0][1::2]))
    unit = about.get('Length Units', '')
    names: Sequence[str] = next((row for row in rows if row[1:2] == ['Name']), axes)
    kinds: Sequence[str] = next((row for row in rows if 'Position' in row), axes)
    columns = []
    for name, kind, axis in zip(names, kinds, axes):
        if axis.startswith('Time'):
            columns.append(_Column('time', 's', axis))
        elif kind == 'Position':
            columns.append(_Column(f'{name}_{axis.lower()}', unit, f'{name}_{axis.lower()}'))
        else:
            whole = ' '.join(part for part in (name, kind, axis) if part)
            columns.append(_Column(whole, '', whole))
    return tuple(columns)


def _of_vicon(rows: list[list[str]], named: int) -> tuple[_Column, ...]:
    """Columns of trajectories of Vicon; frames over their rate become the column time."""
    rate, width = rows[1][0].strip(), len(rows[named])
    columns, name = [], ''
    for number, axis in enumerate(rows[named]):
        above = rows[named - 1][number : number + 1]
        name = above[0].strip().rpartition(':')[2] if above and above[0].strip() else name
        unit = rows[named + 1][number].strip() if number < len(rows[named + 1]) else ''
        text = f'{name}_{axis.lower()}' if name else axis
        columns.append(_Column(text, unit, text))
    for row in rows[named + 2 :]:
        row += [''] * (width - len(row))
        is_known = NUMBER.match(row[0]) and NUMBER.match(rate) and float(rate) > 0.0
        row.append(repr(float(row[0]) / float(rate)) if is_known else '')
    return (*columns, _Column('time', 's', 'time'))
