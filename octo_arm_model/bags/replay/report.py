"""Numbers of messages that a replay answered and left out."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from octo_arm_model.arm.errors import BagError, SolveError
from octo_arm_model.bags.replay.answers import Answer
from octo_arm_model.wire.refusals import Refusals

_LISTED = 100  # of the messages left out of each topic; all are counted


class Skip(NamedTuple):
    """A message that was left out: its stamp [ns] and why."""

    stamp_ns: int
    reason: str


@dataclass
class TopicReport:
    """How the messages of one topic of tensions or displacements were answered.

    Attributes:
        model: what answered them.
        answered: how many have an answer.
        refused: how many hold nothing that drives this arm.
        failed: how many the model had no trustworthy answer to.
        unsorted: how many have a stamp before that of the last one.
        skips: the first of those refused and failed.
        reasons: how many answers, or poses of the tip, are missing for each reason, by an
            example of it.
    """

    model: str
    answered: int = 0
    refused: int = 0
    failed: int = 0
    unsorted: int = 0
    skips: list[Skip] = field(default_factory=list)
    reasons: dict[str, int] = field(default_factory=dict)
    refusals: Refusals = field(default_factory=Refusals)

    def count(self, stamp_ns: int, answer: Answer) -> None:
        """Count an ``answer``."""
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
            self.skips.append(Skip(stamp_ns, answer.reason))


@dataclass
class Report:
    """The result of a replay.

    Attributes:
        topics: how the messages of each topic of tensions or displacements were answered.
        copied: how many messages were copied.
        not_copied: topics that were to be and were not, and why.
        notes: what else there is to know.
    """

    topics: dict[str, TopicReport]
    copied: int = 0
    not_copied: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def check_answered(path: Path, report: Report) -> None:
    """Refuse a replay of the bag at ``path`` without a single answer.

    Raises:
        SolveError: if the model had none.
        BagError: if no message fits the arm.
    """
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
