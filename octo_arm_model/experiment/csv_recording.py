"""Tensions, encoder readings and measured points out of CSV files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import MeasurementError, TensionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.csv_table import FORCE, CsvTable
from octo_arm_model.experiment.measured_points import LENGTH_UNITS, Frame, Measured, MeasuredPoints
from octo_arm_model.experiment.recording import Stamped
from octo_arm_model.wire.refusals import Refusals
from octo_arm_model.wire.tensions import NONE

DISPLACEMENT = 'displacement_'  # and the name of a tendon: what its encoder reads
NO_READING = 'no encoder reading'
_POINT = re.compile(r'^x_?[0-9]{1,6}$')


@dataclass(frozen=True)
class CsvSources:
    """CSV files in place of topics.

    Attributes:
        tensions: of the tensions; None for those in the bag.
        midlines: of what was measured; None for that in the bag.
        displacements: of encoder readings; None for those in the bag, if it has any.
        columns: which column is what, see `read_csv`.
    """

    tensions: Path | None = None
    midlines: Path | None = None
    displacements: Path | None = None
    columns: Mapping[str, str] = field(default_factory=dict)


def csv_tensions(table: CsvTable, config: Config, refusals: Refusals) -> Stamped:
    """Tensions of the rows of a table; ``refusals`` count those left out.

    Raises:
        MeasurementError: if a column is missing or a cell holds no number.
    """
    arm, stamps = config.arm, table.times()
    columns = [
        np.zeros(len(stamps)) if name == NONE else table.numbers(name, FORCE, 'N')
        for name in config.load_cells.names or arm.tendon_names
    ]
    readings = np.stack(columns, axis=1)
    rows = readings.reshape(-1, *arm.tension_shape)
    try:
        tensions = config.load_cells.tensions(arm, rows).reshape(readings.shape)
        return Stamped(str(table.path), stamps, list(tensions))
    except TensionError:
        pass
    found = Stamped(str(table.path), [], [])
    table.count.expect(len(stamps))
    for stamp, row in zip(stamps, rows):
        table.count.add()
        try:
            found.rows.append(config.load_cells.tensions(arm, row).ravel())
            found.stamps.append(stamp)
        except TensionError as error:
            refusals.count(found.source, str(error))
    return found


def csv_displacements(table: CsvTable, arm: Arm, refusals: Refusals) -> Stamped:
    """Encoder readings of the rows of a table, NaN of tendons without an encoder.

    ``refusals`` count the rows that have none.

    Raises:
        MeasurementError: if there is no column of a tendon, or a cell holds no number.
    """
    names = [f'{DISPLACEMENT}{tendon}' for tendon in arm.tendon_names]
    if all(table.find(name) is None for name in names):
        raise MeasurementError(
            f'{table.path}: no column {names[0]}, nor that of another tendon; {table.listing}; '
            f'say --columns {names[0]}=COLUMN'
        )
    stamps = table.times()
    rows = np.full((len(stamps), len(names)), np.nan)
    for column, name in zip(rows.T, names):
        if table.find(name) is not None:
            column[:] = table.numbers(name, LENGTH_UNITS, 'm')
    reads = np.isfinite(rows).any(axis=1)
    for _ in range(np.count_nonzero(~reads)):
        refusals.count(str(table.path), NO_READING)
    kept = [stamp for stamp, read in zip(stamps, reads) if read]
    return Stamped(str(table.path), kept, list(rows[reads]))


def csv_frames(
    table: CsvTable, measured: Measured, points: MeasuredPoints, refusals: Refusals
) -> list[Frame]:
    """Frames of a table: a row for each, or one for each point, those of one time together.

    A row for each frame has columns x1, y1, z1, x2 ... or x_1 ...; a row for each point x, y, z.

    Raises:
        MeasurementError: if a column is missing or a cell holds no number.
    """
    stamps = table.times()
    # Columns that are named are meant, whatever else the file has.
    there = dict.fromkeys((*(column.name for column in table.columns), *table.given))
    wide = [name for name in there if _POINT.match(name)]
    if not any(map(_POINT.match, table.given)) and table.find('x') is not None:
        wide = []
    elif not wide and measured.marker_s:  # what is then missing
        wide = [f'x{number + 1}' for number in range(len(measured.marker_s))]
    wide.sort(key=lambda name: int(name.strip('x_')))
    names = [[f'{axis}{name[1:]}' for axis in 'xyz'] for name in wide or ['x']]
    _check_unit(table, names, measured.unit)
    places = np.stack([_point(table, name, measured.unit) for name in names], axis=1)
    grouped = list(zip(stamps, places))
    if not wide:
        order = sorted(range(len(stamps)), key=stamps.__getitem__)
        cuts = [i for i in range(1, len(order)) if stamps[order[i]] != stamps[order[i - 1]]]
        parts = np.split(np.array(order), cuts)
        grouped = [(stamps[part[0]], places[part, 0]) for part in parts]
    is_midline = max(len(one) for _, one in grouped) > 1
    frames = []
    table.count.expect(len(grouped))
    for stamp, place in grouped:
        table.count.add()
        try:
            frames.append(Frame(stamp, points.check(place, is_midline)))
        except MeasurementError as error:
            refusals.count(str(table.path), str(error))
    return frames


def _check_unit(table: CsvTable, names: list[list[str]], unit: str) -> None:
    """Check that a ``unit`` that is given counts for one of the columns ``names`` at least."""
    found = [table.find(name) for point in names for name in point]
    own = [table.columns[number].unit for number in found if isinstance(number, int)]
    if unit != Measured.unit and own and all(own):
        raise MeasurementError(
            f'--length-unit has no effect on {table.path}: its header says {" and ".join({*own})}'
        )


def _point(table: CsvTable, names: list[str], unit: str) -> FloatArray:
    """Points (rows, 3) in the ``unit`` of what was measured, which the header may override."""
    columns = []
    for name in names:
        if name[0] == 'z' and table.find(name) is None:
            raise MeasurementError(
                f'{table.path}: no column {name}; {table.listing}; of a picture without depth say '
                f'--columns {name}=0'
            )
        columns.append(table.numbers(name, LENGTH_UNITS, unit) / LENGTH_UNITS[unit])
    return np.stack(columns, axis=1)
