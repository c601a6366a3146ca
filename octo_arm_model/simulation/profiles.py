"""Command profiles: the tension of every tendon over time, in CSV and YAML files, and drawn.

A picture needs matplotlib.
"""

import csv
import functools
import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ProfileError, listed, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_PROFILE_BYTES, MAX_PROFILE_ROWS, MAX_YAML_BYTES
from octo_arm_model.arm.validation import real_numbers
from octo_arm_model.config.files import NUMBER, load_yaml, read_text, reading, tension_columns
from octo_arm_model.rod.stations import interpolated

INTERPOLATIONS = ('smooth', 'linear', 'steps')


@dataclass(frozen=True, eq=False)
class CommandProfile:
    """The commanded tensions over time.

    Between rows, ``smooth`` is a monotone cubic interpolation with zero rate at both ends (PCHIP,
    Fritsch and Butland 1984), ``linear`` interpolates linearly, and ``steps`` holds each row until
    the next.

    Raises:
        ProfileError: if a value is not as described; the message names the row.
    """

    #: times [s], (n,), increasing, at least two and at most `MAX_PROFILE_ROWS`; the first is set
    #: to 0
    times: FloatArray
    #: tensions [N], (n, tendons), finite, >= 0, in the order of `Arm.tendon_names`
    tensions: FloatArray
    interpolation: str = 'smooth'  #: one of `INTERPOLATIONS`

    def __post_init__(self) -> None:
        """Check the values, and keep read-only copies."""
        if self.interpolation not in INTERPOLATIONS:
            expected = ', '.join(INTERPOLATIONS)
            given = shown(self.interpolation)
            raise ProfileError(f'interpolation is {given}, expected {expected}')
        arrays = real_numbers(self.times), real_numbers(self.tensions)
        for name, numbers in zip(('times', 'tensions'), arrays):
            if numbers is None:
                raise ProfileError(f'{name} are {shown(getattr(self, name))}, expected numbers')
        assert arrays[0] is not None and arrays[1] is not None
        times, tensions = arrays[0].copy(), arrays[1].copy()
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

        They are constant before the first and after the last row, or periodic with ``loop``. For
        another speed use ``profile.at(speed * time)``.
        """
        t = np.asarray(time, dtype=np.float64)
        t = np.mod(t, self.duration) if loop else np.clip(t, 0.0, self.duration)
        if self.interpolation == 'smooth':
            # Rounding may make a cubic between rows of 0 negative.
            return np.maximum(self._smooth(t), 0.0)
        if self.interpolation == 'linear':
            return interpolated(t, self.times, self.tensions)
        return self.tensions[np.searchsorted(self.times, t, side='right') - 1]

    @functools.cached_property
    def _smooth(self) -> PchipInterpolator:
        # Copies of the first row before it and of the last row after it give the ends zero rate.
        times = np.concatenate(([-1.0], self.times, [self.duration + 1.0]))
        rows = np.concatenate((self.tensions[:1], self.tensions, self.tensions[-1:]))
        return PchipInterpolator(times, rows, axis=0)


def transition(start: ArrayLike, stop: ArrayLike, duration: float) -> CommandProfile:
    """Return a smooth profile between tensions [N], each (tendons,) or of `Arm.tension_shape`.

    Raises:
        ProfileError: if a tension is invalid or ``duration`` is not > 0 [s].
    """
    rows = np.array([np.ravel(start), np.ravel(stop)], dtype=np.float64)
    return CommandProfile(np.array([0.0, duration]), rows)


def read_profile(path: str | Path, arm: Arm) -> CommandProfile:
    """Read a profile for ``arm`` from a CSV or YAML file.

    A CSV file has a header with ``time`` and the names of all tendons in any order, with or
    without units (``time [s]``, ``tendon_1_1 [N]``), and rows of numbers; the interpolation is
    smooth. A YAML file has a list ``times``, a list ``tensions`` of as many lists in the order of
    `Arm.tendon_names`, and optionally ``interpolation``.

    Raises:
        ProfileError: if the file cannot be read or is invalid; the message has its name, and the
            line of a CSV file or the row of a YAML file.
    """
    with reading(path, ProfileError):
        try:
            if Path(path).suffix == '.csv':
                return _read_csv(read_text(path, MAX_PROFILE_BYTES), arm)
            return _read_yaml(load_yaml(read_text(path, MAX_YAML_BYTES)), arm)
        except csv.Error as error:
            raise ProfileError(f'{path}: not what its suffix says, {error}') from error
        except ProfileError as error:
            raise ProfileError(f'{path}: {error}') from None


def _read_csv(text: str, arm: Arm) -> CommandProfile:
    reader = csv.reader(io.StringIO(text), skipinitialspace=True)
    names, header = ('time', *arm.tendon_names), list[str]()
    lines, rows = list[int](), list[list[float]]()
    for cells in filter(any, reader):
        line = reader.line_num
        if not header:
            titles = (cell.strip() for cell in cells)
            header = ['time' if t == 'time [s]' else t.removesuffix(' [N]') for t in titles]
            # A tendon may also be called time.
            if sorted(header) != sorted(names) or len(set(names)) < len(names):
                expected = ', '.join(names)
                raise ProfileError(f'line {line}: header is {listed(header)}; expected {expected}')
            continue
        if len(cells) != len(header):
            expected = f'{len(header)} as in the header'
            raise ProfileError(f'line {line}: {len(cells)} values, expected {expected}')
        if len(rows) == MAX_PROFILE_ROWS:
            raise ProfileError(f'line {line}: more than {MAX_PROFILE_ROWS} rows')
        value = dict(zip(header, cells))
        for name in names:
            is_time, is_number = name == 'time', NUMBER.match(value[name])
            if not (is_number and (is_time or float(value[name]) >= 0.0)):
                expected = f'a finite number {"[s]" if is_time else ">= 0 [N]"}'
                raise ProfileError(
                    f'line {line}: {name} is {shown(value[name])}, expected {expected}'
                )
        lines.append(line)
        rows.append([float(value[name]) for name in names])
    numbers = np.array(rows).reshape(-1, len(names))
    try:
        return CommandProfile(numbers[:, 0], numbers[:, 1:])
    except ProfileError as error:
        if error.row is None:
            raise
        raise ProfileError(f'line {lines[error.row]}: {error.problem}') from None


def _read_yaml(given: object, arm: Arm) -> CommandProfile:
    known, count = ('times', 'tensions', 'interpolation'), len(arm.tendons)
    if not isinstance(given, dict) or not {*known[:2]} <= given.keys() <= {*known}:
        content = listed(list(given)) if isinstance(given, dict) else shown(given)
        raise ProfileError(f'{content} found, expected times:, tensions: and maybe interpolation:')
    for name in known[:2]:
        if not isinstance(given[name], list):
            raise ProfileError(f'{name} is {shown(given[name])}, expected a list')
    for number, row in enumerate(given['tensions']):
        numbers = real_numbers(row)
        if numbers is None or numbers.shape != (count,):
            expected = f'{count} numbers: {", ".join(arm.tendon_names)}'
            raise ProfileError(f'tensions are {shown(row)}, expected {expected}', number)
    return CommandProfile(given['times'], given['tensions'], given.get(known[2], 'smooth'))


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

    There is a panel for each section with tensions, as they differ much between sections.

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
    # The file is a PNG for any suffix.
    figure.savefig(path, dpi=120, format='png')
