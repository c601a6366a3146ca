"""A CSV table as a bag: what replay and estimate read of bags they read of tables."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Connection

from octo_arm_model.arm.errors import BagError, ConfigError, MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.topics import DESCRIPTION, MIDLINE
from octo_arm_model.bags.types import known_types
from octo_arm_model.bags.writer import BagWriter, Message
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.estimation.parameters import PREFIX
from octo_arm_model.experiment.csv_recording import (
    CsvSources,
    csv_displacements,
    csv_frames,
    csv_readings,
    has_displacements,
    has_points,
    has_tensions,
)
from octo_arm_model.experiment.csv_table import check_taken, read_csv
from octo_arm_model.experiment.measured_points import Measured, MeasuredPoints
from octo_arm_model.experiment.recording import Count
from octo_arm_model.wire.measurements import MARKERS, MEASUREMENT_TOPICS, TIP_POSE
from octo_arm_model.wire.refusals import Refusals
from octo_arm_model.wire.stamp import Stamp
from octo_arm_model.wire.tensions import DISPLACEMENT_TYPE, DISPLACEMENTS, TENDON_TENSIONS

_TENSIONS = 'tendon_tensions'


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
    given = CsvSources(columns=columns, is_poses=True).columns_of('')
    table = read_csv(path, given, Count(), has_time=False)
    marker_s = tuple(parameters.get(f'{PREFIX}marker_s', ()))
    measured = Measured(marker_s=marker_s, marker_names=marker_names)
    rows: list[tuple[int, str, str, dict[str, Any]]] = []
    tendons = list(config.arm.tendon_names)
    if has_tensions(table, config):
        stamps, readings = csv_readings(table, config)
        rows += [
            (stamp, _TENSIONS, TENDON_TENSIONS.type_name, {'name': tendons, 'tension': row})
            for stamp, row in zip(stamps, readings)
        ]
    if has_displacements(table, config):
        found = csv_displacements(table, config, refusals)
        nothing: FloatArray = np.zeros(0)
        for stamp, row in zip(found.stamps, found.rows):
            known = np.isfinite(row)
            names = [name for name, has in zip(tendons, known) if has]
            fields = {'name': names, 'position': row[known], 'velocity': nothing}
            rows.append((stamp, DISPLACEMENTS, DISPLACEMENT_TYPE, {**fields, 'effort': nothing}))
    if not rows:
        raise MeasurementError(
            f'{path}: no column of the tension or displacement of a tendon; {table.listing}'
        )
    if has_points(table, measured):
        points = MeasuredPoints(measured, config.arm.length)
        for frame in csv_frames(table, measured, points, refusals):
            rows.append((frame.stamp_ns, *_measured(frame.points, bool(marker_s))))
    check_taken([table])
    _check_read(columns, table.wanted, path)
    if (first := min(rows)[0] if rows else 0) < 0:
        raise MeasurementError(f'{path}: time is {1e-9 * first} s, expected none below 0')
    described = as_described(own)
    with BagWriter(written) as writer:
        writer.add_text(f'/{DESCRIPTION}', parameters_as_yaml(described), first)
        writer.write(_messages(writer, config.base_frame, sorted(rows, key=lambda row: row[0])))
    return refusals.lines()


def _check_read(columns: Mapping[str, str], wanted: set[str], path: Path) -> None:
    if unread := [name for name in columns if name not in wanted]:
        raise MeasurementError(
            f'{path}: --columns names {", ".join(unread)}, which is not read here; expected names '
            f'of {", ".join(sorted(wanted))}'
        )


def _measured(points: FloatArray, are_markers: bool) -> tuple[str, str, dict[str, Any]]:
    """Topic, type and fields of the message of measured ``points`` (m, 3) [m]."""
    types = known_types().types
    poses = [
        types['geometry_msgs/msg/Pose'](
            position=types['geometry_msgs/msg/Point'](*point),
            orientation=types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
        )
        for point in points.tolist()
    ]
    if are_markers:
        return MARKERS, MEASUREMENT_TOPICS[MARKERS].type_name, {'poses': poses}
    if len(points) > 1:
        return MIDLINE, 'geometry_msgs/msg/PoseArray', {'poses': poses}
    whole = types['geometry_msgs/msg/PoseWithCovariance'](poses[0], np.zeros(36))
    return TIP_POSE, MEASUREMENT_TOPICS[TIP_POSE].type_name, {'pose': whole}


def _messages(
    writer: BagWriter, frame: str, rows: list[tuple[int, str, str, dict[str, Any]]]
) -> Iterator[Message]:
    store = known_types()
    connections: dict[str, Connection] = {}
    for stamp_ns, topic, kind, fields in rows:
        if topic not in connections:
            connections[topic] = writer.add(f'/{topic}', kind)
        stamp = store.types['builtin_interfaces/msg/Time'](*Stamp.from_ns(stamp_ns))
        header = store.types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame)
        data = store.serialize_cdr(store.types[kind](header=header, **fields), kind)
        yield connections[topic], stamp_ns, bytes(data)
