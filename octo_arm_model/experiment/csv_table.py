"""CSV files of laboratories: columns by name, units in headers, errors that name the line."""

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, listed, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_CSV_BYTES, MAX_CSV_COLUMNS, MAX_CSV_ROWS
from octo_arm_model.config.files import NUMBER, read_text, reading

KINDS = ('tension', 'midline', 'displacement')  # kinds of tables
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
# A header with a unit, such as 'time [ms]', 'time (ms)' or 'time_ms'. Single letters may be names.
_HEADER = re.compile(
    r'^(.*?)(?:\s*[\[(]([^\[\]()]*)[\])]|[_ ]'
    r'(ms|us|\u00b5s|\u03bcs|ns|mN|kN|gf|kgf|kg|lbf|mm|cm|mA|deg|rad))$'
)
_COMMENT = re.compile(r'#(?=\s*[^\W\d])')  # before the first name
_FIRST = re.compile(r'^.*[^\s,;].*$', re.MULTILINE)  # a line with more than separators
_DECIMAL_COMMA = re.compile(r'\d,\d')
_MISSING = ('', 'nan', 'NaN', 'NAN')
_EXPECTED = (
    'expected lines of headers, or none, and below them only rows of as many numbers: remove all '
    'other lines'
)
_ISO = re.compile(
    r'^(\d{4}[-/]\d\d[-/]\d\d)[T ](\d\d:\d\d:\d\d)(?:[.,](\d{1,9}))?\s*(Z|[+-]\d\d:?\d\d)?$'
)
_UNITS = frozenset({*TIME, *FORCE, 'm', 'cm', 'mm', 'rad', 'deg', 'counts', 'ticks', '-'})
# Units as other programs write them.
_IN_WORDS = {
    '\u00b5s': 'us',
    '\u03bcs': 'us',
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
    text: str  # the header with name and unit
    cells: Sequence[str] = ()


@dataclass(frozen=True)
class CsvTable:
    """The columns of a CSV file, as texts."""

    path: Path  #: path of the file
    #: name and unit of each column, '' if the header has none, and its cells
    columns: tuple[_Column, ...]
    lines: tuple[int, ...]  #: line number of each row
    #: for quantities in a column of another name: that name, #N for the N-th column, or a constant
    given: Mapping[str, str]
    has_time: bool = True  #: whether rows have a time; otherwise they are poses a second apart
    wanted: set[str] = field(default_factory=set)  #: names of all quantities that were looked up
    #: the quantities among them that were found as ``given``
    taken: set[str] = field(default_factory=set)

    def find(self, name: str) -> _Column | None:
        """Return the column for ``name``, or None; that of a constant has no unit and no header.

        The column given for ``name`` may be in another file, which `check_columns` finds out.

        Raises:
            MeasurementError: if a column was given for it, and there is none of either name.
        """
        self.wanted.add(name)
        if name not in self.given:
            return self._column(name)
        header = self.given[name].strip()
        column = self._column(header)
        if column is not None:
            unit = _split(header)[1]
            column = column._replace(unit=column.unit or _IN_WORDS.get(unit, unit))
        elif NUMBER.match(header):
            column = _Column('', '', '', [header] * len(self.lines))
        if column is not None:
            self.taken.add(name)
            return column
        column = self._column(name)
        if column is None:
            raise self.lacking(name)
        return column

    def has(self, name: str) -> bool:
        """Whether there is a column or a constant for ``name``."""
        return self.find(name) is not None

    def lacking(self, name: str) -> MeasurementError:
        """Return the error that the column given for ``name`` is not in this file."""
        header = shown(self.given[name].strip())
        return MeasurementError(f'{self.path}: no column {header} for {name}; {self.listing}')

    def _column(self, header: str) -> _Column | None:
        if header[:1] == '#' and header[1:].isdecimal() and len(header) < 9:
            if not 1 <= int(header[1:]) <= len(self.columns):
                raise MeasurementError(
                    f'{self.path}: no column {header}, expected #1 to #{len(self.columns)}'
                )
            return self.columns[int(header[1:]) - 1]
        for texts in (
            [column.text for column in self.columns],
            [column.name for column in self.columns],
            [f'{column.name} [{column.unit}]' for column in self.columns],
        ):
            if (count := texts.count(header)) > 1 and header:
                raise MeasurementError(
                    f'{self.path}: {count} columns {shown(header)}; say which by its number, as '
                    f'#{texts.index(header) + 1}'
                )
            if count:
                return self.columns[texts.index(header)]
        name, unit = _split(header)
        # Names of columns in other files may end as 'time_ms' does: only brackets say a unit.
        column = self._column(name) if unit and header.endswith((']', ')')) else None
        return column if column is None or column.unit in ('', unit) else None

    @property
    def listing(self) -> str:
        """The names of the columns, shortened, with a doubt if they look like numbers."""
        names = [column.name or f'#{index + 1}' for index, column in enumerate(self.columns)]
        doubt = f'; {_EXPECTED}' if any(map(NUMBER.match, names)) else ''
        return f'it has {listed(names)}{doubt}'

    def numbers(
        self, name: str, units: Mapping[str, float], default: str, is_scaled: bool = False
    ) -> FloatArray:
        """Return the values for ``name`` in the first of ``units``, NaN for missing ones.

        ``default`` is the unit if the header has none. Readings with a calibration, ``is_scaled``,
        may also be in any other unit, such as counts or radians.

        Raises:
            MeasurementError: if there is no such column, it has another unit, or a cell does not
                hold a number.
        """
        column = self.find(name)
        if column is None:
            raise MeasurementError(
                f'{self.path}: no column {name}; {self.listing}; say --columns {name}=COLUMN'
            )
        unit = column.unit or default
        if unit not in units and not is_scaled:
            raise MeasurementError(
                f'{self.path}: {name} is in {shown(unit)}, expected {" or ".join(units)}'
            )
        values = np.empty(len(self.lines))
        for n, text in enumerate(column.cells):
            if NUMBER.match(text) and math.isfinite(value := float(text)):
                values[n] = value
            elif text in _MISSING:
                values[n] = math.nan
            else:
                hint = ' with a decimal point' * (',' in text)
                more = ' or a time such as 2024-05-02T10:11:12.5Z' if name == 'time' else ''
                raise MeasurementError(
                    f'{self.path}, line {self.lines[n]}: {name} is {shown(text)}, expected a '
                    f'finite number{hint} [{unit}]{more}, or nothing'
                )
        return units.get(unit, 1.0) * values

    def times(self) -> list[int]:
        """Return the column time [ns].

        Raises:
            MeasurementError: if there is no such column, or a value is missing or not a time.
        """
        column = self.find('time')
        if column is None and not self.has_time:
            return [row * 10**9 for row in range(len(self.lines))]
        if column is not None and _ISO.match(column.cells[0]):
            return [self._stamp(*line) for line in zip(column.cells, self.lines, strict=True)]
        seconds = self.numbers('time', TIME, 's')
        assert column is not None  # or `numbers` has raised
        fine = np.abs(seconds) < 2.0**31
        if not fine.all():
            n = int(np.argmin(fine))
            second, hint = float(seconds[n]), ''
            unit = next((one for one, factor in TIME.items() if abs(second) * factor < 2**31), '')
            header = self.given['time'].strip() if 'time' in self.taken else 'time'
            if unit and not column.unit and not NUMBER.match(header):
                hint = f'; in {unit}? then say --columns "time={header} [{unit}]"'
            raise MeasurementError(
                f'{self.path}, line {self.lines[n]}: time is {second!r} s, '
                f'expected a time below 2147483648 s{hint}'
            )
        # As floats, nanoseconds since 1970 would be rounded to a quarter of a microsecond.
        scale = round(1e9 * TIME[column.unit or 's'])
        return [round(scale * Decimal(text)) for text in column.cells]

    def _stamp(self, text: str, line: int) -> int:
        """Return a time in ISO 8601 as a stamp [ns]; without a zone it is UTC."""
        try:
            day, clock, fraction, zone = _ISO.match(text).groups()  # type: ignore[union-attr]
            zone = '+00:00' if zone in (None, 'Z') else f'{zone[:3]}:{zone[-2:]}'
            whole = datetime.fromisoformat(f'{day.replace("/", "-")}T{clock}{zone}')
        except (AttributeError, ValueError):
            raise MeasurementError(
                f'{self.path}, line {line}: time is {shown(text)}, expected one of ISO 8601 such '
                'as 2024-05-02T10:11:12.5Z'
            ) from None
        return int(whole.timestamp()) * 10**9 + int((fraction or '0').ljust(9, '0'))


def read_csv(path: Path, given: Mapping[str, str], has_time: bool = True) -> CsvTable:
    """Read a file of headers and rows of numbers; ``given`` has the column of each quantity.

    Fields are separated by commas, semicolons or tabs, whichever is in the header, or by blanks
    in a file without these. There may be no header, or one of several lines: names above each
    other are joined, and the last line may have units; # before the first name is left out.
    Exports of Motive and Vicon are recognised by their first line; their columns become
    <marker>_x, <marker>_y and <marker>_z, and time.

    Raises:
        MeasurementError: if it cannot be read, is too large, or a row is too short or long.
    """
    with reading(path, MeasurementError):
        text = read_text(path, MAX_CSV_BYTES)
    text = text[1:] if _COMMENT.match(text) else text
    head = _FIRST.search(text)
    separators = [one for one in ',;\t' if one in text]
    separator = max(separators or ' ', key=head[0].count) if head else ','
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
        point = ' with a decimal point' if separator != ',' and _DECIMAL_COMMA.search(text) else ''
        raise MeasurementError(f'{path}: no row of numbers{point}, expected some below a header')
    if len(rows) > MAX_CSV_ROWS:
        raise MeasurementError(f'{path}, line {lines[-1]}: more than {MAX_CSV_ROWS} rows')
    for cells, line in zip(rows, lines, strict=True):
        if len(cells) < len(columns) or ''.join(cells[len(columns) :]).strip():
            raise MeasurementError(
                f'{path}, line {line}: {len(cells)} values, expected {len(columns)} as in the '
                f'header; {_EXPECTED}'
            )
        del cells[len(columns) :]  # empty, of separators at the end of the line
    by_column = ([cell.strip() for cell in cells] for cells in zip(*rows))
    columns = tuple(
        column._replace(unit=_IN_WORDS.get(column.unit, column.unit), cells=cells)
        for column, cells in zip(columns, by_column, strict=True)
    )
    return CsvTable(path, columns, tuple(lines), given, has_time)


def check_columns(columns: Iterable[str], tables: Mapping[str, CsvTable]) -> None:
    """Check that each of ``columns`` is used, and is in one of ``tables`` by their `KINDS`.

    Other tables may have the quantity under its own name. A single table has the kind ''.

    Raises:
        MeasurementError: if a column is in none of the tables, or is not used.
    """
    taken = {name for table in tables.values() for name in table.taken}
    for table in tables.values():
        for name in table.given:
            if name in table.wanted and name not in taken:
                raise table.lacking(name)
    used = {name for table in tables.values() for name in table.wanted}
    of_one = {f'{kind}:{name}' for kind, table in tables.items() for name in table.wanted if kind}
    if unread := [name for name in columns if name not in used | of_one]:
        more = f', of one file as {", ".join(f"{kind}:NAME" for kind in KINDS)}' if of_one else ''
        where = f'{tables[""].path}: ' if '' in tables else ''
        raise MeasurementError(
            f'{where}--columns names {listed(unread)}, which is not read here; expected names of '
            f'{listed(sorted(used))}{more}'
        )


def _headers(rows: list[list[str]]) -> tuple[tuple[_Column, ...], int]:
    """Return the columns of a file, and the index of the first of its ``rows`` with numbers."""
    first = rows[0][0].strip() if rows else ''
    named = next((n for n, row in enumerate(rows[:_MOST_HEADERS]) if row[0] == 'Frame'), 0)
    if first == 'Format Version' and named:
        return _motive_columns(rows[:named], rows[named]), named + 1
    if first in ('Trajectories', 'Segments') and 1 < named < len(rows) - 1:
        return _vicon_columns(rows, named), named + 2
    count = len(rows)
    for number, row in enumerate(rows[:_MOST_HEADERS]):
        cells = [cell.strip() for cell in row]
        numbers = [bool(NUMBER.match(cell) or _ISO.match(cell)) for cell in cells]
        missing = [cell in _MISSING for cell in cells]
        # A row with a number has data, but the first row only if it has nothing else.
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
        name, unit = _split(text)
        columns.append(_Column(name, units[number] if units else unit, text))
    return tuple(columns), count


def _split(header: str) -> tuple[str, str]:
    """Return the name and the unit of a ``header``, '' without one."""
    match = _HEADER.match(header.strip())
    return (match[1], match[2] or match[3] or '') if match else (header, '')


def _motive_columns(rows: Sequence[Sequence[str]], axes: Sequence[str]) -> tuple[_Column, ...]:
    """Return the columns of an export of Motive: names, kinds and ``axes`` are on own lines."""
    properties = dict(zip(rows[0][::2], rows[0][1::2]))
    unit = properties.get('Length Units', '')
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


def _vicon_columns(rows: list[list[str]], named: int) -> tuple[_Column, ...]:
    """Return the columns of an export of Vicon; frames over their rate become the time."""
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
