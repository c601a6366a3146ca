"""A recording read from a bag, from CSV files, or from one of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from octo_arm_model.arm.errors import BagError, ConfigError, MeasurementError
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.experiment.csv_recording import (
    CsvSources,
    csv_displacements,
    csv_frames,
    csv_tensions,
    has_displacements,
    has_tensions,
)
from octo_arm_model.experiment.csv_table import check_columns
from octo_arm_model.experiment.recording import (
    Count,
    MarkerSources,
    MeasuredPoints,
    Recording,
    assemble,
)
from octo_arm_model.wire.messages import Refusals

if TYPE_CHECKING:
    from octo_arm_model.experiment.bag_recording import BagRecording


def read_recording(  # noqa: PLR0913 - options of a command
    path: Path | str | None,
    config: str | None = None,
    tensions: str | None = None,
    measured: MarkerSources = MarkerSources(),
    files: CsvSources = CsvSources(),
    calibration: Mapping[str, Any] = MappingProxyType({}),
    displacements: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Recording:
    """Read the bag at ``path``, or CSV files, or tensions from one and midlines from the other.

    Encoder readings are needed if there are no tensions.

    Args:
        path: the bag; None if everything is in files.
        config: parameter file or preset of the arm; None for the arm_description in the bag.
        tensions: topic of the tensions, or TOPIC:FIELD; None for the only such topic.
        measured: sources of the measured points; without topics, the only topic of points that the
            model does not publish itself.
        files: CSV files that replace topics.
        calibration: parameters of load cells and encoders that replace those of the arm.
        displacements: topic of the encoder readings, or TOPIC:FIELD; None for
            tendon_displacements, if there.
        progress: called with the numbers of messages read and of all known so far.

    Raises:
        BagError: if the bag cannot be read or a topic is missing.
        ConfigError: if there is no arm, or it is impossible.
        MeasurementError: if no message holds a midline in metres, a file cannot be read, or a
            quantity has two sources.
    """
    given = None if config is None else load_parameters(config)
    _check_sources(path, tensions, displacements, measured, files)
    if path is None:
        if given is None:
            raise ConfigError('no arm: without a bag it has to be given by --config')
        return _gather(None, {**given, **calibration}, measured, files)
    # These imports need rosbags.
    from octo_arm_model.bags.reader import BagReader
    from octo_arm_model.bags.topics import sensed_by
    from octo_arm_model.experiment.bag_recording import BagRecording

    with BagReader(path) as reader:
        count = Count(progress)
        bag = BagRecording(reader, tensions, displacements, measured, files, count)
        parameters = bag.described() if given is None else given
        return _gather(bag, sensed_by(reader, parameters, calibration), measured, files)


def _check_sources(
    path: Path | str | None,
    tensions: str | None,
    displacements: str | None,
    measured: MarkerSources,
    files: CsvSources,
) -> None:
    """Check that each quantity has one source; MeasurementError if it has two."""
    has_all = bool(files.tensions and files.midlines)
    is_table = path is not None and Path(path).suffix == '.csv'
    is_driven = files.displacements and files.midlines
    if is_table or (path is None and not (has_all or is_driven)):
        table = f'{path} is a table, ' if is_table else ''
        raise MeasurementError(
            f'{table}expected a bag, or --midline-csv and --tension-csv or --displacement-csv, or '
            '--pose-csv'
        )
    if files.columns and not (files.tensions or files.midlines or files.displacements):
        raise MeasurementError('--columns is given, and no CSV file that it could be of')
    for given, other, file in (
        (
            path and has_all,
            f'a bag, {path},',
            '--pose-csv' if files.is_poses else '--tension-csv and --midline-csv',
        ),
        (tensions is not None and files.tensions, '--tensions', '--tension-csv'),
        (
            displacements is not None and files.displacements,
            '--displacements',
            '--displacement-csv',
        ),
        (measured.sources and files.midlines, '--midlines', '--midline-csv'),
        (measured.marker_frames and files.midlines, '--marker-frames', '--midline-csv'),
    ):
        if given:
            raise MeasurementError(f'{other} and {file} are given, expected one or the other')


def _gather(
    bag: BagRecording | None,
    parameters: dict[str, Any],
    measured: MarkerSources,
    files: CsvSources,
) -> Recording:
    """Read tensions, encoder readings and frames, each from a file or from the ``bag``."""
    refusals, tables = Refusals(), files.read()
    config = Config.from_parameters(parameters)
    points = MeasuredPoints(measured, config.arm.length)
    tensions = encoders = frames = None
    if bag is not None:
        tensions, encoders, frames = bag.read(config, points, refusals)
    if (table := tables.get('tension')) is not None:
        # A table of poses has tensions or encoder readings.
        if files.is_poses and not has_tensions(table, config) and has_displacements(table, config):
            encoders = csv_displacements(table, config, refusals)
        else:
            tensions = csv_tensions(table, config, refusals)
    if (table := tables.get('displacement')) is not None:
        encoders = csv_displacements(table, config, refusals)
    for what, stamped in (('tensions', tensions), ('encoder readings', encoders)):
        if stamped is not None and not stamped.rows:
            raise BagError(f'no {what} for this arm on {stamped.source}{refusals.in_short}')
    if (table := tables.get('midline')) is not None:
        frames = csv_frames(table, measured, points, refusals)
    assert frames is not None
    check_columns(files.columns, tables)
    notes = [] if bag is None else bag.notes
    return assemble(parameters, tensions, encoders, frames, points, refusals, notes)
