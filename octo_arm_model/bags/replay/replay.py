"""A bag of tensions or displacements replayed: the answers of the node added to it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial

from rosbags.interfaces import Connection

from octo_arm_model.bags.arms import RecordedArm
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.replay.answers import Answer, Answers
from octo_arm_model.bags.replay.csv_output import CsvAnswers
from octo_arm_model.bags.replay.report import Report, TopicReport, check_answered
from octo_arm_model.bags.store.records import Record
from octo_arm_model.bags.tensions import Reading, TensionTopic, read_lengths
from octo_arm_model.bags.topics import ANSWERS, DESCRIPTION
from octo_arm_model.bags.writer import BagWriter, Message
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml

_WRENCH = 'tip_wrench'
_TOGETHER = 128  # messages of tensions at a time, and less where others come between
_LARGEST = 8 * 2**20  # messages at a time [bytes]


def replay(
    reader: BagReader,
    writer: BagWriter,
    arms: Sequence[RecordedArm],
    *,
    copy: bool = True,
    lengths: bool = False,
    table: CsvAnswers | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Report:
    """Write the answers to what drives the arms, with its stamps and received when it was.

    Args:
        reader: the bag to read.
        writer: the bag to write.
        arms: whose tensions and displacements they are, see `find_arms`.
        copy: whether to copy what is in the bag already.
        lengths: whether to answer with the lengths of the tendons too.
        table: where answers go besides.
        progress: called with the numbers of messages done and of all.

    Raises:
        BagError: if a bag is damaged or cannot be written, or none of the messages fits the arm.
        ConfigError: if a model does not cover the arm or its loads.
        SolveError: if the model has an answer to none of the messages.
    """
    outputs = [_Output(reader, writer, arm, lengths) for arm in arms]
    of_topic = {topic: output for output in outputs for topic in output.topics}
    report = Report({topic: TopicReport(str(output.model)) for topic, output in of_topic.items()})
    for arm in arms:
        if reader.topics.get(arm.prefix + _WRENCH) and reader.count([arm.prefix + _WRENCH]):
            report.notes.append(f'{arm.prefix}{_WRENCH} is not applied, which the node would')
    written = {topic for output in outputs for topic in output.written}
    copies, report.not_copied = open_copies(reader, writer, written) if copy else ({}, {})
    wanted = sorted({*of_topic, *(topic for topic, _ in copies)})
    done, total = 0, reader.count(wanted)
    progress(done, total)
    for records in _together(reader.messages(wanted), of_topic):
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
                messages += [(one, received, data) for one, data in answered if data is not None]
        writer.write(messages)
        done += len(records)
        progress(done, total)
    for one in report.topics.values():
        one.reasons = one.refusals.of('')
        report.notes += [hint for hint in one.refusals.hints if hint not in report.notes]
    check_answered(reader.path, report)
    report.notes += reader.notes
    return report


class _Output:
    """Writes the answers of one arm into a bag.

    Attributes:
        topics: those of its tensions and displacements.
        written: those written for it.
        model: what answers.
        connections: where the answers go.
    """

    def __init__(
        self, reader: BagReader, writer: BagWriter, arm: RecordedArm, lengths: bool
    ) -> None:
        config = Config.from_parameters(arm.parameters)
        self.topics, self.model = arm.topics, config.model
        self._tendons = config.arm.tendon_names
        self._inputs = {
            topic: partial(read_lengths, reader, config.arm)
            if topic in arm.displacements
            else TensionTopic(reader, config, arm.fields.get(topic, '')).read
            for topic in arm.topics
        }
        self._newest: dict[str, int] = {}
        self._answers = Answers(config, lengths, bool(arm.displacements))
        description = arm.prefix + DESCRIPTION
        writer.add_text(description, parameters_as_yaml(arm.parameters), reader.start_ns)
        self.connections = [
            writer.add(arm.prefix + topic, ANSWERS[topic]) for topic in self._answers.topics
        ]
        self.written = [description, *(connection.topic for connection in self.connections)]

    def answer(
        self, records: Sequence[Record], report: Report, table: CsvAnswers | None
    ) -> dict[int, Answer]:
        """Answers to those of ``records`` that are of this arm, by their places."""
        readings: dict[int, Reading] = {}
        for topic, read in self._inputs.items():
            places = [i for i, record in enumerate(records) if record.topic == topic]
            readings.update(zip(places, read([records[i] for i in places])))
        places = sorted(readings)
        answers = self._answers.answer([readings[place] for place in places])
        for place, answer in zip(places, answers):
            topic, stamp = records[place].topic, readings[place].stamp_ns
            report.topics[topic].count(stamp, answer)
            if table is not None:
                names = self._answers.topics
                table.write(topic, readings[place], answer, names, self._tendons)
            report.topics[topic].unsorted += stamp < self._newest.get(topic, stamp)
            self._newest[topic] = stamp
        return dict(zip(places, answers))


def open_copies(
    reader: BagReader, writer: BagWriter, written: Iterable[str]
) -> tuple[dict[tuple[str, str], Connection], dict[str, str]]:
    """Where to copy messages to, by topic and type, and which topics are not copied, and why.

    Those ``written`` anew are not.
    """
    copies: dict[tuple[str, str], Connection] = {}
    left_out: dict[str, str] = {}
    for source in reader.connections():
        key = source.topic, source.msgtype
        if source.topic in written:
            left_out[source.topic] = 'written anew'
        elif key not in copies:
            copied = writer.add_copy(reader, source)
            if copied is None:
                left_out[source.topic] = f'nothing says what {source.msgtype} is'
            else:
                copies[key] = copied
    return copies, left_out


def _together(records: Iterator[Record], topics: Mapping[str, object]) -> Iterator[list[Record]]:
    """Messages in batches that hold some of ``topics`` and fit into memory."""
    some: list[Record] = []
    count = size = 0
    for record in records:
        some.append(record)
        count += record.topic in topics
        size += len(record.data)
        if count >= _TOGETHER or size >= _LARGEST:
            yield some
            some, count, size = [], 0, 0
    if some:
        yield some
