"""The replay of a bag of tensions or displacements: the node's answers, and a report."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Connection

from octo_arm_model.analysis.driven_arm import Answer as DrivenShape
from octo_arm_model.analysis.driven_arm import DrivenArm
from octo_arm_model.arm.errors import BagError, ConfigError, OctoArmError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.bags.reader import BagReader, Record
from octo_arm_model.bags.topics import ANSWERS, DESCRIPTION, Reading, RecordedArm
from octo_arm_model.bags.writer import BagWriter, Message
from octo_arm_model.config.config import Config
from octo_arm_model.config.files import STATION_COLUMNS, CsvFiles, station_rows, tension_columns
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.simulation.moving_arm import LONGEST_GAP, DrivenMotion
from octo_arm_model.wire.backbone import (
    TENDON_LENGTHS,
    TENSION_ESTIMATES,
    TIP_POSE,
    BackboneWriter,
)
from octo_arm_model.wire.messages import Refusals

_LISTED = 100  # messages left out that are listed for each topic; all are counted
_KNOWN = np.zeros((6, 6))  # covariance of the tip of an arm without uncertainty


@dataclass
class TopicReport:
    """The answers to the messages of one topic of tensions or displacements."""

    model: str  #: name of the model that answered
    answered: int = 0  #: number of messages with an answer
    refused: int = 0  #: number of messages that hold nothing that drives this arm
    failed: int = 0  #: number of messages for which the model had no trustworthy answer
    unsorted: int = 0  #: number of messages with a stamp before that of the last one
    #: stamps [ns] of the first messages that were refused or failed, and the reasons
    skips: list[tuple[int, str]] = field(default_factory=list)


@dataclass
class Report:
    """The result of a replay."""

    topics: dict[str, TopicReport]  #: report of each topic of tensions or displacements
    #: counts of missing answers, or poses of the tip, by topic and reason
    refusals: Refusals = field(default_factory=Refusals)
    copied: int = 0  #: number of messages that were copied
    #: topics that could not be copied, and the reasons
    not_copied: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)  #: further remarks

    def leave_out(self, topic: str, stamp_ns: int, reason: str, is_failure: bool = False) -> None:
        """Count a message on ``topic`` with a stamp [ns] as refused, or as failed."""
        counts = self.topics[topic]
        counts.failed += is_failure
        counts.refused += not is_failure
        self.refusals.count(topic, reason)
        if len(counts.skips) < _LISTED:
            counts.skips.append((stamp_ns, reason))


def _check_answered(path: Path, report: Report) -> None:
    """Raise SolveError or BagError if there is no answer, as the model failed or otherwise."""
    if any(topic.answered for topic in report.topics.values()):
        return
    for name, topic in report.topics.items():
        if topic.skips:
            number = topic.refused + topic.failed
            problem = f'{path}: none of {number} messages on {name} could be answered, '
            reason, count = next(iter(report.refusals.of(name).items()))
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
        self._folder, self._topics = folder, topics
        self._stations = self.open(folder / 'stations.csv')
        self._stations.writerow(STATIONS)
        self._tensions: dict[str, Any] = {}
        self._origin: int | None = None

    def write(self, topic: str, stamp_ns: int, shape: Backbone, tendons: Sequence[str]) -> None:
        """Write the ``shape`` that answers a message; OSError if it cannot be written."""
        if self._origin is None:
            self._origin = stamp_ns
        time = round(1e-9 * (stamp_ns - self._origin), 9)
        if topic not in self._tensions:
            of = re.sub('[^A-Za-z0-9_]', '_', topic) if len(self._topics) > 1 else ''
            self._tensions[topic] = self.open(self._folder / f'tensions{of}.csv')
            self._tensions[topic].writerow(tension_columns(tendons))
        self._tensions[topic].writerow([time, *shape.tensions.ravel().tolist()])
        self._stations.writerows([topic, stamp_ns, time, *row] for row in station_rows(shape))


_WRENCH = 'tip_wrench'


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
    outputs = [_Answers(reader, writer, arm, lengths, step) for arm in arms]
    of_topic = {topic: output for output in outputs for topic in output.topics}
    report = Report({topic: TopicReport(str(output.model)) for topic, output in of_topic.items()})
    for arm in arms:
        if reader.topics.get(arm.prefix + _WRENCH) and reader.count([arm.prefix + _WRENCH]):
            report.notes.append(f'{arm.prefix}{_WRENCH} is not applied, which the node would')
    written = {topic for output in outputs for topic in output.written}
    copies, report.not_copied = open_copies(reader, writer, written) if copy else ({}, {})
    topics = sorted({*of_topic, *(topic for topic, _ in copies)})
    total = reader.count(topics)
    progress(0, total)
    for done, record in enumerate(reader.messages(topics), start=1):
        messages: list[Message] = []
        if copied := copies.get((record.topic, record.type_name)):
            messages.append((copied, record.received_ns, record.data))
            report.copied += 1
        if output := of_topic.get(record.topic):
            messages += output.answer(record, report, table)
        writer.write(messages)
        progress(done, total)
    report.notes += report.refusals.hints
    _check_answered(reader.path, report)
    report.notes += [note for output in outputs for note in output.notes()]
    report.notes += reader.notes
    return report


class _Answers:
    """Answers the messages that drive one arm, in order, as the node does but for rounding.

    Attributes:
        topics: topics of its tensions and displacements.
        written: topics that are written for it.
        model: name of the model.
    """

    def __init__(
        self,
        reader: BagReader,
        writer: BagWriter,
        arm: RecordedArm,
        lengths: bool,
        step: float | None,
    ) -> None:
        self._config = config = Config.from_parameters(arm.parameters)
        self.topics = [source.topic for source in arm.sources]
        self.model = config.model if step is None else MOVING
        self._tendons = config.arm.tendon_names
        self._inputs = {one.topic: partial(one.read, reader, config) for one in arm.sources}
        self._newest: dict[str, int] = {}
        self._motion = None if step is None else DrivenMotion(config.dynamics(), step)
        self._solver = config.solver() if self._motion is None else self._motion.dynamics.solver
        self._winding = DrivenArm()
        self._writer = BackboneWriter.of(config.base_frame, self._solver)
        is_driven = any(source.is_displacements for source in arm.sources)
        is_used = {TENDON_LENGTHS: lengths, TENSION_ESTIMATES: is_driven}
        description = arm.prefix + DESCRIPTION
        writer.add_text(description, parameters_as_yaml(arm.parameters), reader.start_ns)
        self._connections = {
            topic: writer.add(arm.prefix + topic, kind)
            for topic, kind in ANSWERS.items()
            if is_used.get(topic, True)
        }
        self.written = [description, *(one.topic for one in self._connections.values())]

    def answer(self, record: Record, report: Report, table: CsvAnswers | None) -> list[Message]:
        """Return the messages that answer a ``record`` of this arm; none without a shape."""
        topic, reading = record.topic, self._inputs[record.topic](record)
        stamp, counts = reading.stamp.ns, report.topics[topic]
        counts.unsorted += stamp < self._newest.get(topic, stamp)
        self._newest[topic] = stamp
        if reading.reason:
            report.leave_out(topic, stamp, reading.reason)
            return []
        try:
            answer, messages = self._answer(reading)
        except OctoArmError as error:
            # Displacements may be of tendons that the arm does not have.
            report.leave_out(topic, stamp, str(error), isinstance(error, SolveError))
            return []
        counts.answered += 1
        if answer.unknown is not None:
            report.refusals.count(topic, f'{TIP_POSE} unknown: {answer.unknown}')
        if table is not None:
            table.write(topic, stamp, answer.backbone, self._tendons)
        received_ns = record.received_ns
        return [(self._connections[one], received_ns, data) for one, data in messages.items()]

    def _answer(self, reading: Reading) -> tuple[DrivenShape, dict[str, bytes]]:
        """Return the shape for a ``reading``, and the messages by topic.

        `TENSION_ESTIMATES` are there only if tendons are driven by length, and the pose of the tip
        only if its covariance is known.
        """
        arguments = reading.stamp.ns, reading.tensions, reading.displacements
        has_lengths, motion = TENDON_LENGTHS in self._connections, self._motion
        lengths: FloatArray | None = None
        if motion is None:
            answer = self._winding.answer(self._solver, self._config, None, *arguments)
            lengths = self._solver.tendon_lengths(answer.backbone) if has_lengths else None
            are_wound = bool(self._winding.displacements)
        else:
            motion.read(*arguments)
            state, are_wound = motion.state, motion.is_wound
            answer = DrivenShape(motion.dynamics.backbone(state), _KNOWN)
            if self._config.uncertainty.is_any:
                unknown = ConfigError('the covariance of an arm that moves is not known')
                answer = answer._replace(covariance=None, unknown=unknown)
            lengths = motion.dynamics.tendon_lengths(state) if has_lengths else None
        writer, stamp, backbone = self._writer, reading.stamp, answer.backbone
        messages = writer.all(backbone, answer.covariance, *stamp)
        if lengths is not None:
            messages[TENDON_LENGTHS] = writer.tendon_lengths(lengths, backbone.tensions, *stamp)
        if are_wound:
            messages[TENSION_ESTIMATES] = writer.tensions(backbone.tensions, *stamp)
        return answer, messages

    def notes(self) -> list[str]:
        """Return remarks on the answers for the report."""
        if self._motion is None or self._motion.starts < 2:
            return []
        return [
            f'the arm began to move from rest {self._motion.starts} times, as stamps went back or '
            f'were more than {LONGEST_GAP:g} s apart'
        ]


def open_copies(
    reader: BagReader, writer: BagWriter, written: Iterable[str]
) -> tuple[dict[tuple[str, str], Connection], dict[str, str]]:
    """Return connections for copies by topic and type, and topics not copied, with the reasons.

    Topics that are ``written`` anew are not copied.
    """
    copies: dict[tuple[str, str], Connection] = {}
    left_out: dict[str, str] = {}
    for source in reader.connections():
        if source.topic in written:
            left_out[source.topic] = 'written anew'
        elif (copy := writer.add_copy(reader, source)) is None:
            left_out[source.topic] = f'nothing says what {source.msgtype} is'
        else:
            copies[source.topic, source.msgtype] = copy
    return copies, left_out
