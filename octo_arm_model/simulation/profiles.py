"""A command profile: the tension of every tendon over time, in CSV and YAML files, and drawn.

Errors in files name the line; a picture needs matplotlib.
"""

import csv
import functools
import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO, TypeAlias

import numpy as np
import yaml
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ProfileError, listed, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_PROFILE_BYTES, MAX_PROFILE_ROWS, MAX_YAML_BYTES
from octo_arm_model.arm.validation import real_numbers
from octo_arm_model.config.files import NUMBER, compose_yaml, read_text, reading, tension_columns
from octo_arm_model.rod.stations import interpolated

INTERPOLATIONS = ('smooth', 'linear', 'steps')


@dataclass(frozen=True, eq=False)
class CommandProfile:
    """Commanded tensions over time.

    Between rows, ``smooth`` is monotone cubic interpolation of zero rate at both ends (PCHIP,
    Fritsch and Butland 1984), ``linear`` interpolates linearly, and ``steps`` holds each row until
    the next.

    Attributes:
        times: (n,) [s], increasing, at least two and at most `MAX_PROFILE_ROWS`; counted from the
            first.
        tensions: (n, tendons) [N], finite, none negative, in the order of `Arm.tendon_names`.
        interpolation: one of `INTERPOLATIONS`.

    Raises:
        ProfileError: if they are not as described; the message names the row.
    """

    times: FloatArray
    tensions: FloatArray
    interpolation: str = 'smooth'

    def __post_init__(self) -> None:
        """Validate; keep read-only copies."""
        if self.interpolation not in INTERPOLATIONS:
            expected = ', '.join(INTERPOLATIONS)
            raise ProfileError(f'interpolation is {self.interpolation!r}, expected {expected}')
        given = real_numbers(self.times), real_numbers(self.tensions)
        if given[0] is None or given[1] is None:
            raise ProfileError('times and tensions are expected to be numbers')
        times, tensions = given[0].copy(), given[1].copy()
        if times.ndim != 1 or tensions.ndim != 2 or len(times) != len(tensions):
            raise ProfileError(
                f'times are {times.shape} and tensions {tensions.shape}, expected (n,) and '
                '(n, tendons)'
            )
        if len(times) > MAX_PROFILE_ROWS:
            raise ProfileError(f'{len(times)} rows, expected at most {MAX_PROFILE_ROWS}')
        if len(times) < 2:
            raise ProfileError(f'{len(times)} row(s), expected at least two')
        late = ~np.isfinite(times)
        late[1:] |= times[1:] <= times[:-1]
        if late.any():
            row = int(np.argmax(late))
            time, before = float(times[row]), float(times[row - 1])
            expected = f'more than {before}' if math.isfinite(time) else 'a finite number'
            raise ProfileError(f'time is {time}, expected {expected} [s]', row)
        wrong = ~(np.isfinite(tensions) & (tensions >= 0.0))
        if wrong.any():
            row, tendon = np.argwhere(wrong)[0].tolist()
            raise ProfileError(
                f'tension {tendon + 1} is {tensions[row, tendon]}, expected a finite number >= 0 '
                '[N]',
                row,
            )
        times -= times[0]
        for name, array in (('times', times), ('tensions', tensions)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def duration(self) -> float:
        """Time from the first row to the last [s]."""
        return float(self.times[-1])

    def at(self, time: ArrayLike, *, loop: bool = False) -> FloatArray:
        """Tensions (..., tendons) [N] at ``time`` (...) [s].

        Constant before the first and after the last row, or, with ``loop``, periodic. At another
        speed use ``profile.at(speed * time)``.
        """
        t = np.asarray(time, dtype=np.float64)
        t = np.mod(t, self.duration) if loop else np.clip(t, 0.0, self.duration)
        if self.interpolation == 'smooth':
            # A cubic between rows of 0 may be negative by rounding.
            return np.maximum(self._smooth(t), 0.0)
        if self.interpolation == 'linear':
            return interpolated(t, self.times, self.tensions)
        return self.tensions[np.searchsorted(self.times, t, side='right') - 1]

    @functools.cached_property
    def _smooth(self) -> PchipInterpolator:
        # A copy of the first row before and of the last after give the ends zero rate.
        times = np.concatenate(([-1.0], self.times, [self.duration + 1.0]))
        rows = np.concatenate((self.tensions[:1], self.tensions, self.tensions[-1:]))
        return PchipInterpolator(times, rows, axis=0)


def transition(start: ArrayLike, stop: ArrayLike, duration: float) -> CommandProfile:
    """A smooth profile from tensions ``start`` to ``stop`` [N], (tendons,) or `Arm.tension_shape`.

    Raises:
        ProfileError: if a tension is invalid or ``duration`` is not > 0 [s].
    """
    rows = np.array([np.ravel(start), np.ravel(stop)], dtype=np.float64)
    return CommandProfile(np.array([0.0, duration]), rows)


# A number as it is written, and its line; and the time and the tensions of a row.
_Cell: TypeAlias = tuple[int, str]
_Row: TypeAlias = list[_Cell]


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
        names, least = ('time', *arm.tendon_names), (-math.inf, *np.zeros(len(arm.tendons)))
        numbers = np.array([[*map(_number, row, names, least)] for row in rows])
        return CommandProfile(numbers[:, 0], numbers[:, 1:], interpolation)
    except csv.Error as error:
        raise ProfileError(f'{path}: not what its suffix says, {error}') from error
    except _LineError as error:
        raise ProfileError(f'{path}, {error}') from None
    except ProfileError as error:
        # Tensions were checked before, so the error of a row is in its time.
        where = '' if error.row is None else f', line {rows[error.row][0][0]}'
        raise ProfileError(f'{path}{where}: {error}') from None


def _number(cell: _Cell, name: str, least: float) -> float:
    line, text = cell
    number = float(text) if NUMBER.match(text) else math.nan
    if not (math.isfinite(number) and number >= least):
        expected = 'a finite number >= 0 [N]' if least == 0.0 else 'a finite number [s]'
        raise _LineError(line, f'{name} is {shown(text)}, expected {expected}')
    return number


def _read_csv(text: str, arm: Arm) -> tuple[list[_Row], str]:
    reader = csv.reader(io.StringIO(text), skipinitialspace=True)
    names, header, rows = ('time', *arm.tendon_names), list[str](), list[_Row]()
    for cells in filter(any, reader):
        line = reader.line_num
        if not header:
            plain = (cell.strip() for cell in cells)
            header = ['time' if one == 'time [s]' else one.removesuffix(' [N]') for one in plain]
            # A tendon may be called time as well.
            if sorted(header) != sorted(names) or len(set(names)) < len(names):
                expected = ', '.join(names)
                raise _LineError(line, f'header is {listed(header)}; expected {expected}')
            continue
        if len(cells) != len(header):
            raise _LineError(line, f'{len(cells)} values, expected {len(header)} as in the header')
        _check_rows(len(rows) + 1, line)
        value = dict(zip(header, cells))
        rows.append([(line, value[name]) for name in names])
    return rows, 'smooth'


def _read_yaml(text: str, arm: Arm) -> tuple[list[_Row], str]:
    # Nodes instead of values, as they have line numbers.
    document = compose_yaml(text)
    if not isinstance(document, yaml.MappingNode):
        raise _LineError(1, 'expected times: and tensions:')
    found: dict[str, yaml.Node] = {}
    for key, node in document.value:
        if key.value not in ('times', 'tensions', 'interpolation') or key.value in found:
            raise _LineError(
                _line(key),
                f'{shown(key.value)} is unknown or given twice, expected times, tensions and '
                'maybe interpolation',
            )
        found[key.value] = node
    times, tensions = (_items(found.get(name), name) for name in ('times', 'tensions'))
    _check_rows(len(times), 1)
    if len(times) != len(tensions):
        raise _LineError(
            _line(found['tensions']),
            f'{len(tensions)} rows of tensions, expected {len(times)}, one for each of times',
        )
    rows = []
    for time, row in zip(times, tensions):
        cells = _items(row, 'a row of tensions')
        if len(cells) != len(arm.tendons):
            names = ', '.join(arm.tendon_names)
            raise _LineError(
                _line(row), f'{len(cells)} values, expected {len(arm.tendons)}: {names}'
            )
        rows.append([_scalar(time), *((_line(row), _scalar(cell)[1]) for cell in cells)])
    interpolation = found.get('interpolation')
    return rows, 'smooth' if interpolation is None else _scalar(interpolation)[1]


def _check_rows(count: int, line: int) -> None:
    if count > MAX_PROFILE_ROWS:
        raise _LineError(line, f'more than {MAX_PROFILE_ROWS} rows')


def _line(node: yaml.Node | None) -> int:
    return 1 if node is None else int(node.start_mark.line) + 1


def _items(node: yaml.Node | None, name: str) -> list[yaml.Node]:
    if not isinstance(node, yaml.SequenceNode):
        raise _LineError(_line(node), f'{name} is no list')
    return node.value


def _scalar(node: yaml.Node) -> _Cell:
    if not isinstance(node, yaml.ScalarNode):
        raise _LineError(_line(node), 'a list where one value was expected')
    return _line(node), node.value


def write_csv(file: TextIO, times: FloatArray, tensions: FloatArray, arm: Arm) -> None:
    """Write ``times`` (n,) [s] and ``tensions`` (n, tendons) [N] as `read_profile` reads them."""
    writer = csv.writer(file, lineterminator='\n')
    writer.writerow(tension_columns(arm.tendon_names))
    for time, row in zip(times.tolist(), tensions.tolist(), strict=True):
        writer.writerow([repr(round(time, 9)), *map(repr, row)])


def draw_profile(
    times: FloatArray, tensions: FloatArray, arm: Arm, title: str, path: Path
) -> None:
    """Draw ``tensions`` (n, tendons) [N] over ``times`` (n,) [s] into the PNG file ``path``.

    One panel for each section with tensions, which differ much between sections.

    Raises:
        OSError: if the file cannot be written.
    """
    from matplotlib.figure import Figure

    sections = np.unique(arm.tendon_section[tensions.any(axis=0)]).tolist() or [1]
    figure = Figure(figsize=(9.0, 1.2 + 2.2 * len(sections)), layout='constrained')
    figure.suptitle(title)
    panels = figure.subplots(len(sections), 1, sharex=True, squeeze=False)[:, 0]
    for section, axes in zip(sections, panels, strict=True):
        for tendon in np.flatnonzero(arm.tendon_section == section):
            axes.plot(times, tensions[:, tendon], label=arm.tendon_names[tendon])
        axes.set(ylabel='tension [N]')
        axes.margins(x=0.0)
        axes.grid(alpha=0.3)
        axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), frameon=False)
    panels[-1].set(xlabel='time [s]')
    # A PNG for any suffix.
    figure.savefig(path, dpi=120, format='png')
