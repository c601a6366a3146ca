"""A CSV table as a bag: what replay and estimate read of bags they read of tables."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model.arm.errors import BagError, ConfigError, MeasurementError
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.topics import DESCRIPTION, MIDLINE
from octo_arm_model.bags.writer import LEVEL, TENSIONS, BagWriter, SensorMessages
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.estimation.parameters import PREFIX
from octo_arm_model.experiment import csv_recording
from octo_arm_model.experiment.csv_recording import DISPLACEMENT, CsvSources
from octo_arm_model.experiment.csv_table import check_taken, read_csv
from octo_arm_model.experiment.recording import Measured, MeasuredPoints
from octo_arm_model.wire.measurements import MARKERS, TIP_POSE
from octo_arm_model.wire.messages import Refusals
from octo_arm_model.wire.tensions import DISPLACEMENTS


@contextlib.contextmanager
def opened(
    path: Path,
    parameters: Mapping[str, Any] | None,
    calibration: Mapping[str, Any],
    columns: Mapping[str, str],
    marker_names: tuple[str, ...] = (),
) -> Iterator[BagReader]:
    """The bag at ``path``, or one made of the table of that name that ends in .csv.

    Args:
        path: of either. Rows of a table have tensions or encoder readings, and perhaps tips,
            markers or midlines, at times or, without, a second apart.
        parameters: of the arm, which a table needs, and of its estimator.
        calibration: parameters of load cells and encoders in place of these.
        columns: which column is what, of a table.
        marker_names: of the markers at estimator.marker_s, in a table.

    Raises:
        BagError: if there is no such bag, or there are ``columns`` of one.
        ConfigError: if there is no arm for a table.
        MeasurementError: if a table cannot be read, or has neither tensions nor encoder readings.
    """
    if path.suffix != '.csv':
        if columns or marker_names:
            raise BagError(f'{path}: --columns and --marker-names are of tables that end in .csv')
        with BagReader(path) as reader:
            yield reader
        return
    if parameters is None:
        raise ConfigError('no arm: for a table it has to be given by --config')
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / 'table'
        notes = _write(written, path, {**parameters, **calibration}, columns, marker_names)
        with BagReader(written) as reader:
            reader.notes += notes
            yield reader


def as_described(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """The ``parameters`` for the bag of a table: by names of tendons, lengths in metres."""
    calibrated = (
        'tension_names', 'displacement_names', 'displacement_scale', 'displacement_offset',
    )  # fmt: skip
    return {name: value for name, value in parameters.items() if name not in calibrated}


def _write(
    written: Path,
    path: Path,
    parameters: dict[str, Any],
    columns: Mapping[str, str],
    marker_names: tuple[str, ...],
) -> list[str]:
    """Write the bag of a table; returns remarks on rows that were left out."""
    own = {name: value for name, value in parameters.items() if not name.startswith(PREFIX)}
    config, refusals = Config.from_parameters(own), Refusals()
    table = read_csv(path, CsvSources(columns=columns).columns_of(''), has_time=False)
    marker_s = tuple(parameters.get(f'{PREFIX}marker_s', ()))
    measured = Measured(marker_s=marker_s, marker_names=marker_names)
    has_cells, has_encoders = (
        csv_recording.has_tensions(table, config),
        csv_recording.has_displacements(table, config),
    )
    if not (has_cells or has_encoders):
        name = config.arm.tendon_names[0]
        raise MeasurementError(
            f'{path}: no column {name} or {DISPLACEMENT}{name}, nor those of another tendon; '
            f'{table.listing}; say --columns {name}=COLUMN'
        )
    if (first := min(table.times())) < 0:
        raise MeasurementError(f'{path}: time is {1e-9 * first} s, expected none below 0')
    with BagWriter(written) as writer:
        writer.add_text(f'/{DESCRIPTION}', parameters_as_yaml(as_described(own)), first)
        messages = SensorMessages(writer, config)
        if has_cells:
            for stamp, row in zip(*csv_recording.csv_readings(table, config)):
                messages.add(TENSIONS, stamp, row)
        if has_encoders:
            found = csv_recording.csv_displacements(table, config, refusals)
            for stamp, row in zip(found.stamps, found.rows):
                messages.add(DISPLACEMENTS, stamp, row)
        if csv_recording.has_points(table, measured):
            points = MeasuredPoints(measured, config.arm.length)
            frames = csv_recording.csv_frames(table, measured, points, refusals)
            for stamp, seen in zip(frames.stamps, frames.rows):
                if marker_s or len(seen) > 1:
                    messages.add(MARKERS if marker_s else MIDLINE, stamp, seen)
                else:
                    messages.add(TIP_POSE, stamp, seen, LEVEL, np.zeros((6, 6)))
        check_taken([table])
        _check_read(columns, table.wanted, path)
        messages.write()
    return refusals.lines()


def _check_read(columns: Mapping[str, str], wanted: set[str], path: Path) -> None:
    if unread := [name for name in columns if name not in wanted]:
        raise MeasurementError(
            f'{path}: --columns names {", ".join(unread)}, which is not read here; expected names '
            f'of {", ".join(sorted(wanted))}'
        )
