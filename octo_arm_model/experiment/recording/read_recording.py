"""A recording read from a bag, from CSV files, or from one of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.config.presets import find_path
from octo_arm_model.core.errors import ConfigError, MeasurementError
from octo_arm_model.experiment.recording.count import Count
from octo_arm_model.experiment.recording.csv_recording import CsvSources, csv_frames
from octo_arm_model.experiment.recording.csv_table import read_csv
from octo_arm_model.experiment.recording.measured_points import Measured, MeasuredPoints
from octo_arm_model.experiment.recording.measured_topics import MeasuredTopics
from octo_arm_model.experiment.recording.recording import Recording, assemble
from octo_arm_model.experiment.recording.tendon_readings import pick_topics, read_tendons
from octo_arm_model.wire.refusals import Refusals

if TYPE_CHECKING:
    from octo_arm_model.bags.reader import BagReader


def read_recording(
    path: Path | str | None,
    config: str | None = None,
    tensions: str | None = None,
    measured: Measured = Measured(),
    files: CsvSources = CsvSources(),
    tendons: Sequence[str] = (),
    displacements: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Recording:
    """Read the bag at ``path``, or CSV files, or tensions from one and midlines from the other.

    Where there are no tensions, there have to be encoder readings.

    Args:
        path: the bag; None where all is in files.
        config: parameter file or preset of the arm; None for the arm_description in the bag.
        tensions: topic of the tensions, or TOPIC:FIELD; None for the only one there is.
        measured: what was measured; of no topics the only one that the model itself does not
            publish.
        files: CSV files in place of topics.
        tendons: what the tendons are called there, in place of tension_names.
        displacements: topic of the encoder readings; None for tendon_displacements, if there.
        progress: called with the numbers of messages, rows and values read and of all known of.

    Raises:
        BagError: if the bag cannot be read or a topic is missing.
        ConfigError: if there is no arm, or it cannot be.
        MeasurementError: if no message holds a midline in metres, a file cannot be read, or
            something is to come from two places.
    """
    given = None if config is None else load_parameters(find_path(config))
    _check_sources(path, tensions, displacements, measured, files)
    count = Count(progress)
    topics = tensions, displacements
    if path is None:
        if given is None:
            raise ConfigError('no arm: without a bag it has to be given by --config')
        return _gather(None, given, topics, measured, files, tendons, count)
    from octo_arm_model.bags.reader import BagReader

    with BagReader(path) as reader:
        return _gather(reader, given, topics, measured, files, tendons, count)


def _check_sources(
    path: Path | str | None,
    tensions: str | None,
    displacements: str | None,
    measured: Measured,
    files: CsvSources,
) -> None:
    """Have each thing come from one place.

    Raises:
        MeasurementError: if it comes from none, or from two, or columns are those of no file.
    """
    has_all = files.tensions is not None and files.midlines is not None
    driven = files.displacements is not None and files.midlines is not None
    if path is None and not (has_all or driven):
        raise MeasurementError(
            'expected a bag, or --midline-csv and --tension-csv or --displacement-csv'
        )
    if files.columns and not (files.tensions or files.midlines or files.displacements):
        raise MeasurementError('--columns is given, and no CSV file that it could be of')
    for given, other, file in (
        (path is not None and has_all, f'a bag, {path}', '--tension-csv and --midline-csv'),
        (tensions is not None and files.tensions is not None, '--tensions', '--tension-csv'),
        (displacements is not None and files.displacements is not None, '--displacements',
         '--displacement-csv'),
        (measured.sources and files.midlines is not None, '--midlines', '--midline-csv'),
        (measured.marker_frames and files.midlines is not None, '--marker-frames',
         '--midline-csv'),
    ):  # fmt: skip
        if given:
            raise MeasurementError(f'{other} and {file} are given, expected one or the other')


def _gather(
    reader: BagReader | None,
    given: dict[str, Any] | None,
    topics: tuple[str | None, str | None],
    measured: Measured,
    files: CsvSources,
    tendons: Sequence[str],
    count: Count,
) -> Recording:
    """Readings and frames, each from a file or from the bag of ``reader``.

    ``topics`` are those of tensions and of displacements, as far as they were named.
    """
    refusals, notes = Refusals(), list[str]()
    picked: tuple[str, str] | None = None
    encoders: str | None = None
    if reader is not None:
        from octo_arm_model.bags.arms import describe, find_arms

        if any('synthetic' in text for text in reader.metadata.values()):
            notes.append('the bag says that it is synthetic')
        notes += reader.notes
        picked, encoders = pick_topics(reader, topics, files)
        if picked is not None or encoders is not None:
            wanted = ':'.join(part for part in picked or (encoders,) if part)
            given = dict(find_arms(reader, [wanted], given)[0].parameters)
        elif given is None:
            given = describe(reader)
    assert given is not None
    if tendons:
        given['tension_names'] = list(tendons)
    config = Config.from_parameters(given)
    points = MeasuredPoints(measured, config.arm.length)
    seen = None
    if files.midlines is None:
        assert reader is not None
        seen = MeasuredTopics(reader, measured, points, config.base_frame)
        count.expect(reader.count(list(dict.fromkeys(seen.topics))))
    readings = read_tendons(reader, picked, encoders, files, config, refusals, count)
    if seen is not None:
        source, found = ', '.join(seen.topics), list(seen.read(refusals, count))
    else:
        assert files.midlines is not None
        source = str(files.midlines)
        table = read_csv(files.midlines, files.columns, count)
        found = csv_frames(table, measured, points, refusals)
    count.add(count.total - count.done)  # columns that nothing asked for
    return assemble(given, *readings, found, source, measured, points, refusals, notes)
