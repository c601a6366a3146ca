"""A recording read from a bag, from CSV files, or from one of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from octo_arm_model.config.config import Config, load_parameters
from octo_arm_model.config.presets import find_path
from octo_arm_model.core.errors import BagError, ConfigError, MeasurementError
from octo_arm_model.experiment.recording.count import Count
from octo_arm_model.experiment.recording.csv_recording import csv_frames, csv_tensions
from octo_arm_model.experiment.recording.csv_table import read_csv
from octo_arm_model.experiment.recording.measured_points import Measured, MeasuredPoints
from octo_arm_model.experiment.recording.measured_topics import MeasuredTopics
from octo_arm_model.experiment.recording.recording import (
    Recording,
    Skips,
    Stamped,
    assemble,
    in_short,
)

if TYPE_CHECKING:
    from octo_arm_model.bags.reader import BagReader


@dataclass(frozen=True)
class CsvSources:
    """CSV files in place of topics.

    Attributes:
        tensions: of the tensions; None for those in the bag.
        midlines: of what was measured; None for that in the bag.
        columns: which column is what, see `read_csv`.
    """

    tensions: Path | None = None
    midlines: Path | None = None
    columns: Mapping[str, str] = field(default_factory=dict)


def read_recording(
    path: Path | str | None,
    config: str | None = None,
    tensions: str | None = None,
    measured: Measured = Measured(),
    files: CsvSources = CsvSources(),
    tendons: Sequence[str] = (),
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Recording:
    """Read the bag at ``path``, or CSV files, or tensions from one and midlines from the other.

    Args:
        path: the bag; None where all is in files.
        config: parameter file or preset of the arm; None for the arm_description in the bag.
        tensions: topic of the tensions, or TOPIC:FIELD; None for the only one there is.
        measured: what was measured; of no topics the only one that the model itself does not
            publish.
        files: CSV files in place of topics.
        tendons: what the tendons are called there, in place of tension_names.
        progress: called with the numbers of messages, rows and values read and of all known of.

    Raises:
        BagError: if the bag cannot be read or a topic is missing.
        ConfigError: if there is no arm, or it cannot be.
        MeasurementError: if no message holds a midline in metres, a file cannot be read, or
            something is to come from two places.
    """
    given = None if config is None else load_parameters(find_path(config))
    _check_sources(path, tensions, measured, files)
    count = Count(progress)
    if path is None:
        if given is None:
            raise ConfigError('no arm: without a bag it has to be given by --config')
        return _gather(None, given, tensions, measured, files, tendons, count)
    from octo_arm_model.bags.reader import BagReader

    with BagReader(path) as reader:
        return _gather(reader, given, tensions, measured, files, tendons, count)


def _check_sources(
    path: Path | str | None, tensions: str | None, measured: Measured, files: CsvSources
) -> None:
    """Have each thing come from one place.

    Raises:
        MeasurementError: if it comes from none, or from two.
    """
    has_both = files.tensions is not None and files.midlines is not None
    if path is None and not has_both:
        raise MeasurementError('expected a bag, or --tension-csv and --midline-csv')
    for given, other, file in (
        (path is not None and has_both, f'a bag, {path}', '--tension-csv and --midline-csv'),
        (tensions is not None and files.tensions is not None, '--tensions', '--tension-csv'),
        (measured.sources and files.midlines is not None, '--midlines', '--midline-csv'),
        (measured.marker_frames and files.midlines is not None, '--marker-frames',
         '--midline-csv'),
    ):  # fmt: skip
        if given:
            raise MeasurementError(f'{other} and {file} are given, expected one or the other')


def _gather(
    reader: BagReader | None,
    given: dict[str, Any] | None,
    tensions: str | None,
    measured: Measured,
    files: CsvSources,
    tendons: Sequence[str],
    count: Count,
) -> Recording:
    """Tensions and frames, each from a file or from the bag of ``reader``."""
    skips, notes = Skips(), list[str]()
    picked: tuple[str, str] | None = None
    if reader is not None:
        from octo_arm_model.bags.arms import describe, find_arms
        from octo_arm_model.bags.tensions import pick_tensions

        if any('synthetic' in text for text in reader.metadata.values()):
            notes.append('the bag says that it is synthetic')
        notes += reader.notes
        if files.tensions is None:
            topic, field = picked = pick_tensions(reader, tensions)
            wanted = f'{topic}:{field}' if field else topic
            given = dict(find_arms(reader, [wanted], given)[0].parameters)
        elif given is None:
            given = describe(reader)
    assert given is not None
    if tendons:
        given['tension_names'] = list(tendons)
    config = Config.from_parameters(given)
    points = MeasuredPoints(measured, config.arm.length)
    topics = None
    if files.midlines is None:
        assert reader is not None
        topics = MeasuredTopics(reader, measured, points, config.base_frame)
        count.expect(reader.count(list(dict.fromkeys(topics.topics))))
    if picked is not None:
        assert reader is not None
        stamped = _tensions_of(reader, *picked, config, skips, count)
    else:
        assert files.tensions is not None
        table = read_csv(files.tensions, files.columns, count)
        stamped = Stamped(str(files.tensions), *csv_tensions(table, config, skips))
    if not stamped.rows:
        where = reader.path if picked and reader is not None else files.tensions
        raise BagError(
            f'{where}: no tensions for this arm on {stamped.source}{in_short(skips.refusals)}'
        )
    if topics is not None:
        source, found = ', '.join(topics.topics), list(topics.read(skips, count))
    else:
        assert files.midlines is not None
        source = str(files.midlines)
        table = read_csv(files.midlines, files.columns, count)
        found = csv_frames(table, measured, points, skips)
    count.add(count.total - count.done)  # columns that nothing asked for
    return assemble(given, stamped, found, source, measured, points, skips, notes)


def _tensions_of(
    reader: BagReader, topic: str, field: str, config: Config, skips: Skips, count: Count
) -> Stamped:
    """Tensions of a topic."""
    from octo_arm_model.bags.tensions import read_tensions

    stamped = Stamped(topic, [], [])
    count.expect(reader.count([topic]))
    for one in read_tensions(reader, topic, config, field):
        count.add()
        if one.tensions is None:
            skips(topic, one.stamp_ns, one.reason)
        else:
            stamped.stamps.append(one.stamp_ns)
            stamped.rows.append(one.tensions.ravel())
    return stamped
