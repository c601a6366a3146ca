"""The replay of a bag of tensions or displacements: the node's answers, and a report."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from rosbags.interfaces import Connection

from octo_arm_model.arm.errors import BagError, SolveError
from octo_arm_model.bags.answers import Answer, Answers
from octo_arm_model.bags.reader import BagReader, Record
from octo_arm_model.bags.topics import ANSWERS, DESCRIPTION, RecordedArm
from octo_arm_model.bags.writer import BagWriter, Message
from octo_arm_model.config.config import Config
from octo_arm_model.config.files import STATION_COLUMNS, CsvFiles, station_rows, tension_columns
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.wire.messages import Refusals

_LISTED = 100  # messages left out that are listed for each topic; all are counted


@dataclass
class TopicReport:
    """The answers to the messages of one topic of tensions or displacements.

    Attributes:
        model: name of the model that answered.
        answered: number of messages with an answer.
        refused: number of messages that hold nothing that drives this arm.
        failed: number of messages for which the model had no trustworthy answer.
        unsorted: number of messages with a stamp before that of the last one.
        skips: stamps [ns] of the first messages that were refused or failed, and the reasons.
        reasons: number of missing answers, or poses of the tip, by example of the reason.
    """

    model: str
    answered: int = 0
    refused: int = 0
    failed: int = 0
    unsorted: int = 0
    skips: list[tuple[int, str]] = field(default_factory=list)
    reasons: dict[str, int] = field(default_factory=dict)
    refusals: Refusals = field(default_factory=Refusals)

    def count(self, stamp_ns: int, answer: Answer) -> None:
        """Count an ``answer`` to a message with a stamp [ns]."""
        if answer.messages:
            self.answered += 1
            if answer.reason:
                self.refusals.count('', answer.reason)
            return
        if answer.is_failure:
            self.failed += 1
        else:
            self.refused += 1
        self.refusals.count('', answer.reason)
        if len(self.skips) < _LISTED:
            self.skips.append((stamp_ns, answer.reason))


@dataclass
class Report:
    """The result of a replay.

    Attributes:
        topics: report of each topic of tensions or displacements.
        copied: number of messages that were copied.
        not_copied: topics that could not be copied, and the reasons.
        notes: further remarks.
    """

    topics: dict[str, TopicReport]
    copied: int = 0
    not_copied: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def _check_answered(path: Path, report: Report) -> None:
    """Raise SolveError or BagError if there is no answer, as the model failed or otherwise."""
    if any(topic.answered for topic in report.topics.values()):
        return
    for name, topic in report.topics.items():
        if topic.skips:
            number = topic.refused + topic.failed
            problem = f'{path}: none of {number} messages on {name} could be answered, '
            reason, count = next(iter(topic.reasons.items()))
            problem += f'{count} as {reason}'
            raise SolveError(problem) if topic.failed else BagError(problem)
    raise BagError(f'{path}: no messages on {", ".join(report.topics)}')


MOVING = 'the moving arm'
STATIONS = ('topic', 'stamp [ns]', 'time [s]', *STATION_COLUMNS)


class CsvAnswers(CsvFiles):
    """Writes stations.csv, with a row for each station of each answer, and tensions by topic.

    `octo-arm play` reads the files of tensions. Times count from the first answer.
    """

    def __init__(self, folder: Path, topics: Sequence[str]) -> None:
        """Write into ``folder`` the answers to tensions on ``topics``.

        Raises:
            OSError: if a file cannot be written.
        """
        super().__init__()
        self._stations = self.open(folder / 'stations.csv')
        self._stations.writerow(STATIONS)
        names = (
            ['tensions.csv']
            if len(topics) == 1
            else [f'tensions{re.sub("[^A-Za-z0-9_]", "_", topic)}.csv' for topic in topics]
        )
        self._tensions = {topic: self.open(folder / name) for topic, name in zip(topics, names)}
        self._started: set[str] = set()
        self._origin: int | None = None

    def write(self, topic: str, stamp_ns: int, shape: Backbone, tendons: Sequence[str]) -> None:
        """Write the ``shape`` that answers a message; OSError if it cannot be written."""
        if self._origin is None:
            self._origin = stamp_ns
        time = round(1e-9 * (stamp_ns - self._origin), 9)
        if topic not in self._started:
            self._started.add(topic)
            self._tensions[topic].writerow(tension_columns(tendons))
        self._tensions[topic].writerow([time, *shape.tensions.ravel().tolist()])
        self._stations.writerows([topic, stamp_ns, time, *row] for row in station_rows(shape))


_WRENCH = 'tip_wrench'
_BATCH = 128  # most messages of tensions in a batch
_LARGEST = 8 * 2**20  # bytes of messages at which a batch ends


def replay(  # noqa: PLR0913 - options by keyword
    reader: BagReader,
    writer: BagWriter,
    arms: Sequence[RecordedArm],
    *,
    copy: bool = True,
    lengths: bool = False,
    step: float | None = None,
    table: CsvAnswers | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Report:
    """Write the answers to all tensions and displacements, with their stamps and receipt times.

    Args:
        reader: the bag to read.
        writer: the bag to write.
        arms: the arms and their topics, from `find_arms`.
        copy: whether to copy the other messages of the bag.
        lengths: whether to answer with the lengths of the tendons too.
        step: step of the motion [s]; None for equilibria, as the node answers.
        table: CSV files that answers are written to as well.
        progress: called with the numbers of messages done and of all.

    Raises:
        BagError: if a bag is damaged or cannot be written, or none of the messages fits the arm.
        ConfigError: if a model does not cover the arm or its loads.
        SolveError: if the model has an answer to none of the messages.
    """
    outputs = [_Output(reader, writer, arm, lengths, step) for arm in arms]
    of_topic = {topic: output for output in outputs for topic in output.topics}
    report = Report({topic: TopicReport(str(output.model)) for topic, output in of_topic.items()})
    for arm in arms:
        if reader.topics.get(arm.prefix + _WRENCH) and reader.count([arm.prefix + _WRENCH]):
            report.notes.append(f'{arm.prefix}{_WRENCH} is not applied, which the node would')
    written = {topic for output in outputs for topic in output.written}
    copies, report.not_copied = open_copies(reader, writer, written) if copy else ({}, {})
    topics = sorted({*of_topic, *(topic for topic, _ in copies)})
    done, total = 0, reader.count(topics)
    progress(done, total)
    for records in _batches(reader.messages(topics), of_topic):
        answers: dict[int, Answer] = {}
        for output in outputs:
            answers.update(output.answer(records, report, table))
        messages: list[Message] = []
        for number, record in enumerate(records):
            received = record.received_ns
            if copied := copies.get((record.topic, record.type_name)):
                messages.append((copied, received, record.data))
                report.copied += 1
            if number in answers:
                answered = zip(of_topic[record.topic].connections, answers[number].messages)
                messages += [
                    (topic, received, data) for topic, data in answered if data is not None
                ]
        writer.write(messages)
        done += len(records)
        progress(done, total)
    for summary in report.topics.values():
        summary.reasons = summary.refusals.of('')
        report.notes += [hint for hint in summary.refusals.hints if hint not in report.notes]
    _check_answered(reader.path, report)
    report.notes += [note for output in outputs for note in output.answers.notes()]
    report.notes += reader.notes
    return report


class _Output:
    """Writes the answers of one arm into a bag.

    Attributes:
        topics: topics of its tensions and displacements.
        written: topics that are written for it.
        model: name of the model.
        connections: connections of the answers.
        answers: the source of the answers.
    """

    def __init__(
        self,
        reader: BagReader,
        writer: BagWriter,
        arm: RecordedArm,
        lengths: bool,
        step: float | None,
    ) -> None:
        config = Config.from_parameters(arm.parameters)
        self.topics = [source.topic for source in arm.sources]
        self.model = config.model if step is None else MOVING
        self._tendons = config.arm.tendon_names
        self._inputs = {one.topic: partial(one.read, reader, config) for one in arm.sources}
        self._newest: dict[str, int] = {}
        is_driven = any(source.is_displacements for source in arm.sources)
        self.answers = Answers(config, lengths, is_driven, step)
        description = arm.prefix + DESCRIPTION
        writer.add_text(description, parameters_as_yaml(arm.parameters), reader.start_ns)
        self.connections = [
            writer.add(arm.prefix + topic, ANSWERS[topic]) for topic in self.answers.topics
        ]
        self.written = [description, *(connection.topic for connection in self.connections)]

    def answer(
        self, records: Sequence[Record], report: Report, table: CsvAnswers | None
    ) -> dict[int, Answer]:
        """Return the answers to the ``records`` of this arm, by their indices."""
        readings = {
            place: self._inputs[record.topic](record)
            for place, record in enumerate(records)
            if record.topic in self._inputs
        }
        answers = self.answers.answer(list(readings.values()))
        for place, answer in zip(readings, answers):
            topic, stamp = records[place].topic, readings[place].stamp_ns
            report.topics[topic].count(stamp, answer)
            if table is not None and answer.backbone is not None:
                table.write(topic, stamp, answer.backbone, self._tendons)
            report.topics[topic].unsorted += stamp < self._newest.get(topic, stamp)
            self._newest[topic] = stamp
        return dict(zip(readings, answers))


def open_copies(
    reader: BagReader, writer: BagWriter, written: Iterable[str]
) -> tuple[dict[tuple[str, str], Connection], dict[str, str]]:
    """Return connections for copies by topic and type, and topics not copied, with the reasons.

    Topics that are ``written`` anew are not copied.
    """
    copies: dict[tuple[str, str], Connection] = {}
    left_out: dict[str, str] = {}
    for source in reader.connections():
        key = source.topic, source.msgtype
        if source.topic in written:
            left_out[source.topic] = 'written anew'
        elif key not in copies:
            copy = writer.add_copy(reader, source)
            if copy is None:
                left_out[source.topic] = f'nothing says what {source.msgtype} is'
            else:
                copies[key] = copy
    return copies, left_out


def _batches(records: Iterator[Record], topics: Mapping[str, object]) -> Iterator[list[Record]]:
    """Iterate over batches of messages that hold some of ``topics`` and fit into memory."""
    batch: list[Record] = []
    count = size = 0
    for record in records:
        batch.append(record)
        count += record.topic in topics
        size += len(record.data)
        if count >= _BATCH or size >= _LARGEST:
            yield batch
            batch, count, size = [], 0, 0
    if batch:
        yield batch
