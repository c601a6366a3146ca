"""Readers of tensions, encoder readings and measured points in CSV files."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, TensionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.csv_table import FORCE, KINDS, CsvTable, read_csv
from octo_arm_model.experiment.recording import (
    LENGTH_UNITS,
    MarkerSources,
    MeasuredPoints,
    StampedRows,
)
from octo_arm_model.wire.messages import Refusals
from octo_arm_model.wire.tensions import NONE

DISPLACEMENT = 'displacement_'  # prefix of a tendon's name in the column of its encoder
NO_READING = 'no encoder reading'
_POINT = re.compile(r'^x_?[0-9]{1,6}$')


@dataclass(frozen=True)
class CsvSources:
    """CSV files that replace topics of a bag."""

    tensions: Path | None = None  #: file of the tensions; None for those in the bag
    midlines: Path | None = None  #: file of the measured points; None for those in the bag
    #: file of encoder readings; None for those in the bag, if it has any
    displacements: Path | None = None
    #: column of each quantity, as for `read_csv`; a prefix of `KINDS`, as in midline:time,
    #: restricts an entry to one file
    columns: Mapping[str, str] = field(default_factory=dict)
    #: whether one file has tensions or encoder readings together with midlines: each row is a
    #: static pose, with or without a time
    is_poses: bool = False

    def columns_of(self, kind: str) -> dict[str, str]:
        """Return the columns of the file of this ``kind``, one of `KINDS`."""
        split = [(key.partition(':'), column) for key, column in self.columns.items()]
        shared = {k: v for k, v in self.columns.items() if k.partition(':')[0] not in KINDS}
        return shared | {name: v for (prefix, _, name), v in split if prefix == kind and name}

    def read(self) -> dict[str, CsvTable]:
        """Return the tables in the files, by `KINDS`; MeasurementError as `read_csv`."""
        paths = self.tensions, self.midlines, self.displacements
        return {
            kind: read_csv(path, self.columns_of(kind), has_time=not self.is_poses)
            for kind, path in zip(KINDS, paths, strict=True)
            if path is not None
        }


def csv_readings(table: CsvTable, config: Config) -> tuple[list[int], FloatArray]:
    """Return the stamps [ns] of the rows of a table, and readings of load cells (n, tendons).

    Raises:
        MeasurementError: if a column is missing or a cell does not hold a number.
    """
    cells, stamps = config.load_cells, table.times()
    is_scaled = bool(cells.scale)
    columns = [
        np.zeros(len(stamps)) if name == NONE else table.numbers(name, FORCE, 'N', is_scaled)
        for name in cells.names or config.arm.tendon_names
    ]
    return stamps, np.stack(columns, axis=1)


def csv_tensions(table: CsvTable, config: Config, refusals: Refusals) -> StampedRows:
    """Return the tensions in the rows of a table; ``refusals`` count the rows left out.

    Raises:
        MeasurementError: if a column is missing or a cell does not hold a number.
    """
    arm, stamped = config.arm, StampedRows(str(table.path))
    for stamp, row in zip(*csv_readings(table, config), strict=True):
        try:
            tensions = config.load_cells.tensions(arm, row.reshape(arm.tension_shape))
            stamped.add(stamp, tensions.ravel())
        except TensionError as error:
            refusals.count(stamped.source, str(error))
    return stamped


def has_tensions(table: CsvTable, config: Config) -> bool:
    """Whether a table has a column with the tension of a tendon."""
    names = config.load_cells.names or config.arm.tendon_names
    return any(name != NONE and table.has(name) for name in names)


def has_displacements(table: CsvTable, config: Config) -> bool:
    """Whether a table has a column with the encoder reading of a tendon."""
    return any(name != NONE and table.has(name) for name in _encoder_names(config))


def _encoder_names(config: Config) -> tuple[str, ...]:
    default_names = tuple(f'{DISPLACEMENT}{tendon}' for tendon in config.arm.tendon_names)
    return tuple(config.encoders.names) or default_names


def csv_displacements(table: CsvTable, config: Config, refusals: Refusals) -> StampedRows:
    """Return the encoder readings in the rows of a table, NaN for tendons without an encoder.

    ``refusals`` count the rows without a reading.

    Raises:
        MeasurementError: if no tendon has a column, or a cell does not hold a number.
    """
    encoders, names = config.encoders, _encoder_names(config)
    if not has_displacements(table, config):
        raise MeasurementError(
            f'{table.path}: no column {names[0]}, nor that of another tendon; {table.listing}; '
            f'say --columns {names[0]}=COLUMN'
        )
    stamps = table.times()
    rows = np.full((len(stamps), len(names)), np.nan)
    for column, name in zip(rows.T, names):
        if name != NONE and table.has(name):
            column[:] = table.numbers(name, LENGTH_UNITS, 'm', bool(encoders.scale))
    rows = encoders.scale_and_offset(rows)
    kept = np.flatnonzero(np.isfinite(rows).any(axis=1)).tolist()
    for _ in range(len(rows) - len(kept)):
        refusals.count(str(table.path), NO_READING)
    return StampedRows(str(table.path), [stamps[row] for row in kept], list(rows[kept]))


def csv_frames(
    table: CsvTable, measured: MarkerSources, points: MeasuredPoints, refusals: Refusals
) -> StampedRows:
    """Return the frames of a table: a row is a frame, or a point, with those of its time.

    A row for each frame has columns x1, y1, z1, x2 ... or x_1 ...; a row for each point x, y, z.

    Raises:
        MeasurementError: if a column is missing or a cell does not hold a number.
    """
    stamps = table.times()
    # A column that --columns names is used even if the file has another: x_1 instead of x1.
    present = dict.fromkeys((*(column.name for column in table.columns), *table.given))
    wide = {name: int(name.strip('x_')) for name in present if _POINT.match(name)}
    given = {wide[name] for name in table.given if name in wide}
    used = [name for name in wide if name in table.given or wide[name] not in given]
    used.sort(key=wide.__getitem__)
    if not given and table.has('x'):
        used = []
    elif not used and measured.marker_s:  # the error below then names these columns
        used = [f'x{number + 1}' for number in range(len(measured.marker_s))]
    names = [[f'{axis}{name[1:]}' for axis in 'xyz'] for name in used or ['x']]
    if measured.marker_names:
        used = list(measured.marker_names)
        names = [[f'{name}_{axis}' for axis in 'xyz'] for name in used]
    columns = [table.find(name) for point in names for name in point]
    units = [column.unit for column in columns if column is not None and column.text]
    if measured.unit != MarkerSources.unit and all(units) and {*units} - {measured.unit}:
        said = ' and '.join(sorted({*units}))
        raise MeasurementError(f'--length-unit has no effect on {table.path}: it has {said}')
    places = np.stack([_point(table, name, measured.unit) for name in names], axis=1)
    grouped = list(zip(stamps, places))
    if not used:
        order = np.argsort(stamps, kind='stable')
        parts = np.split(order, np.flatnonzero(np.diff(np.take(stamps, order))) + 1)
        grouped = [(stamps[part[0]], places[part, 0]) for part in parts]
        alone = sum(len(part) == 1 for part in parts)
        if not measured.marker_s and len(parts) > 2 * (len(parts) - alone) > 0:
            raise MeasurementError(
                f'{table.path}: {len(parts) - alone} of {len(parts)} times have several rows, '
                'expected one row for each tip, at a time of its own, or all points of a midline'
            )
    is_midline = max(len(frame) for _, frame in grouped) > 1
    frames = StampedRows(str(table.path))
    for stamp, place in grouped:
        try:
            frames.add(stamp, points.check(place, is_midline))
        except MeasurementError as error:
            refusals.count(frames.source, str(error))
    return frames


def has_points(table: CsvTable, measured: MarkerSources) -> bool:
    """Whether a table has columns with measured points."""
    names = [column.name for column in table.columns]
    wide = any(map(_POINT.match, (*names, *table.given)))
    return bool(measured.marker_names) or wide or table.has('x')


def _point(table: CsvTable, names: list[str], unit: str) -> FloatArray:
    """Return a point of each row (rows, 3) in ``unit``, which the header may override."""
    columns = []
    for name in names:
        if 'z' in (name[0], name[-1]) and not table.has(name):
            raise MeasurementError(
                f'{table.path}: no column {name}; {table.listing}; of a picture without depth say '
                f'--columns {name}=0'
            )
        columns.append(table.numbers(name, LENGTH_UNITS, unit) / LENGTH_UNITS[unit])
    return np.stack(columns, axis=1)
