"""Bags for the commands that answer messages: those of a recorder, and those made of a table."""

import contextlib
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from octo_arm_model.arm.errors import BagError, ConfigError, MeasurementError
from octo_arm_model.arm.pose import Pose
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.topics import DESCRIPTION, MIDLINE, TABLE, as_described
from octo_arm_model.bags.writer import LEVEL, TENSIONS, BagWriter, SensorMessages
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.estimation.settings import PREFIX
from octo_arm_model.experiment import csv_recording
from octo_arm_model.experiment.csv_recording import DISPLACEMENT, CsvSources
from octo_arm_model.experiment.csv_table import check_columns, read_csv
from octo_arm_model.experiment.recording import MarkerSources, MeasuredPoints
from octo_arm_model.experiment.sensor_recording import Sources
from octo_arm_model.wire.measurements import MARKERS, TIP_POSE
from octo_arm_model.wire.messages import Refusals
from octo_arm_model.wire.tensions import DISPLACEMENTS


@contextlib.contextmanager
def opened(
    path: Path, sources: Sources, columns: Mapping[str, str], *, with_points: bool
) -> Iterator[tuple[BagReader, Sources]]:
    """Open the bag at ``path``, or a temporary bag made from the table there, which ends in .csv.

    Rows of a table have tensions or encoder readings, and perhaps tips, markers or midlines, at
    their times or a second apart.

    Args:
        path: path of the bag or the table.
        sources: what is read. A table needs parameters of the arm.
        columns: columns of a table by quantity.
        with_points: whether points of a table are in the bag, in base_frame.

    Yields:
        The bag, and the sources without what has been applied to a table.

    Raises:
        BagError: if there is no such bag, or ``columns`` are given for a bag.
        ConfigError: if there is no arm for a table.
        MeasurementError: if a table cannot be read, or has neither tensions nor encoder readings.
    """
    if path.suffix != '.csv':
        if columns:
            raise BagError(f'{path}: --columns is of tables that end in .csv')
        with BagReader(path) as reader:
            yield reader, sources
        return
    if sources.parameters is None:
        raise ConfigError('no arm: for a table it has to be given by --config')
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / 'table'
        values = {**sources.parameters, **sources.values, **sources.calibration}
        given = replace(sources, parameters=values)
        has_points, notes = _write(written, path, given, columns, with_points)
        own = {name: value for name, value in values.items() if name.startswith(PREFIX)}
        # The bag describes the arm, and its points are in base_frame.
        rest = replace(sources, parameters=None, values=own, calibration={}, marker_names=())
        rest = replace(rest, alignment=None) if has_points else rest
        with BagReader(written, path, notes) as reader:
            yield reader, rest


def _write(
    written: Path, path: Path, sources: Sources, columns: Mapping[str, str], with_points: bool
) -> tuple[bool, list[str]]:
    """Write the bag of a table; return whether it has points, and remarks on what was left out."""
    values = sources.parameters or {}
    arm_values = {name: value for name, value in values.items() if not name.startswith(PREFIX)}
    config, refusals = Config.from_parameters(arm_values), Refusals()
    table = read_csv(path, CsvSources(columns=columns).columns_of(''), has_time=False)
    marker_s = tuple(values.get(f'{PREFIX}marker_s', ()))
    measured = MarkerSources(marker_s=marker_s, marker_names=sources.marker_names)
    has_cells = csv_recording.has_tensions(table, config)
    has_encoders = csv_recording.has_displacements(table, config)
    if not (has_cells or has_encoders):
        name = config.arm.tendon_names[0]
        raise MeasurementError(
            f'{path}: no column {name} or {DISPLACEMENT}{name}, nor those of another tendon; '
            f'{table.listing}; say --columns {name}=COLUMN'
        )
    if (first := min(table.times())) < 0:
        raise MeasurementError(f'{path}: time is {1e-9 * first} s, expected none below 0')
    has_points, notes = csv_recording.has_points(table, measured), []
    if has_points and not with_points:
        notes.append(
            f'the points of {path.name} are left out, as their frame is not known: '
            '`octo-arm compare --pose-csv` fits it'
        )
    elif has_points and sources.alignment is None:
        notes.append('points of a table are in base_frame, or say --align')
    with BagWriter(written, custom={TABLE: path.name}) as writer:
        writer.add_text(f'/{DESCRIPTION}', parameters_as_yaml(as_described(arm_values)), first)
        messages = SensorMessages(writer, config)
        if has_cells:
            messages.add_all(TENSIONS, *csv_recording.csv_readings(table, config))
        if has_encoders:
            lengths = csv_recording.csv_displacements(table, config, refusals)
            messages.add_all(DISPLACEMENTS, lengths.stamps, lengths.rows)
        if has_points and with_points:
            points = MeasuredPoints(measured, config.arm.length)
            frames = csv_recording.csv_frames(table, measured, points, refusals)
            to_base = (sources.alignment or Pose()).to_base
            for stamp, row in zip(frames.stamps, map(to_base, frames.rows)):
                if marker_s or len(row) > 1:
                    messages.add(MARKERS if marker_s else MIDLINE, stamp, row)
                else:
                    messages.add(TIP_POSE, stamp, row, LEVEL, np.zeros((6, 6)))
        check_columns(columns, {'': table})
        messages.write()
    return has_points and with_points, [*refusals.lines(), *notes]
