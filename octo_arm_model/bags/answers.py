"""The node's answers to messages in a bag: shapes and their messages, solved in batches."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.analysis.driven_arm import Answer as DrivenShape
from octo_arm_model.analysis.driven_arm import DrivenArm
from octo_arm_model.analysis.worker_pool import solve_parts
from octo_arm_model.arm.errors import ConfigError, OctoArmError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.bags.topics import ANSWERS, Reading
from octo_arm_model.config.config import Config
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.simulation.moving_arm import LONGEST_GAP, DrivenMotion
from octo_arm_model.wire.backbone import (
    TENDON_LENGTHS,
    TENSION_ESTIMATES,
    TIP_POSE,
    BackboneWriter,
)

_KNOWN = np.zeros((6, 6))  # covariance of the tip of an arm without uncertainty
# The fields that are written and that differ between the shapes of a batch.
_OF_EACH = ('tensions', 'position', 'quaternion', 'tau', 'xi', 'k', 'q')


class Answer(NamedTuple):
    """The answer to one message of tensions or displacements.

    Attributes:
        messages: bytes of the message on each of the topics, in order; `TENSION_ESTIMATES`, the
            last, only if tendons are driven by length. None replaces a message that cannot be
            written. It is empty if there is no trustworthy answer.
        reason: reason why one or all messages are missing, or ''.
        is_failure: whether the model had no answer, as opposed to a message that was refused.
        backbone: the shape; None if there is no trustworthy answer.
    """

    messages: Sequence[bytes | None]
    reason: str = ''
    is_failure: bool = False
    backbone: Backbone | None = None


class Answers:
    """Answers the messages that drive one arm, in order, as the node does but for rounding.

    Attributes:
        topics: the topics of `ANSWERS` that have answers.
        is_quick: whether sets are solved in batches, which is many times quicker.
    """

    def __init__(
        self,
        config: Config,
        lengths: bool = False,
        displacements: bool = False,
        step: float | None = None,
    ) -> None:
        """Answer for the arm of ``config``.

        ``lengths`` adds lengths of tendons to answers; ``displacements`` says whether there will
        be any to answer. With a ``step`` [s] the arm moves, and its shapes are not equilibria.

        Raises:
            ConfigError: if the model does not cover the arm or its loads.
            ArmDefinitionError: if an arm that is to move has no density.
        """
        self._config = config
        self._motion = None if step is None else DrivenMotion(config.dynamics(), step)
        self._solver = config.solver() if self._motion is None else self._motion.dynamics.solver
        is_used = {TENDON_LENGTHS: lengths, TENSION_ESTIMATES: displacements}
        self.topics = tuple(topic for topic in ANSWERS if is_used.get(topic, True))
        self._winding = DrivenArm()
        grid = self._solver.grid
        self._writer = BackboneWriter(
            config.base_frame, self._solver.model, grid.s, grid.section, config.arm.tendon_names
        )
        self.is_quick = not (
            config.loads.any
            or config.arm.friction
            or config.uncertainty.is_any
            or lengths
            or displacements
            or self._motion
        )

    def answer(self, readings: Sequence[Reading]) -> list[Answer]:
        """Return an answer to each of ``readings``."""
        readable = [reading for reading in readings if not reading.is_refused]
        alone = map(self._answer_alone, readable)
        answers = iter(self._answer_together(readable)) if self.is_quick else alone
        return [
            Answer((), reading.reason) if reading.is_refused else next(answers)
            for reading in readings
        ]

    def _answer_alone(self, reading: Reading) -> Answer:
        arguments = reading.stamp_ns, reading.tensions, reading.displacements
        has_lengths, motion = TENDON_LENGTHS in self.topics, self._motion
        lengths: FloatArray | None = None
        try:
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
        except OctoArmError as error:
            # Displacements may be of tendons that the arm does not have.
            return Answer((), str(error), is_failure=isinstance(error, SolveError))
        backbone, covariance, unknown_reason = answer
        writer, stamp = self._writer, reading.stamp
        tip_covariance = _KNOWN if covariance is None else covariance
        messages: list[bytes | None] = [*writer.all(backbone, tip_covariance, *stamp)]
        if covariance is None:
            messages[self.topics.index(TIP_POSE)] = None
        if lengths is not None:
            messages.append(writer.tendon_lengths(lengths, backbone.tensions, *stamp))
        if are_wound:
            messages.append(writer.tensions(backbone.tensions, *stamp))
        reason = '' if unknown_reason is None else f'{TIP_POSE} unknown: {unknown_reason}'
        return Answer(messages, reason, backbone=backbone)

    def notes(self) -> list[str]:
        """Return remarks on the answers for the report."""
        if self._motion is None or self._motion.starts < 2:
            return []
        return [
            f'the arm began to move from rest {self._motion.starts} times, as stamps went back or '
            f'were more than {LONGEST_GAP:g} s apart'
        ]

    def _answer_together(self, readings: Sequence[Reading]) -> list[Answer]:
        if not readings:
            return []
        sets = [np.asarray(reading.tensions) for reading in readings]
        tensions = np.concatenate(sets).reshape(-1, *sets[0].shape)
        answers: list[Answer] = []
        for part, solved in solve_parts(self._solver, tensions):
            if isinstance(solved, SolveError):
                answers.append(Answer((), str(solved), is_failure=True))
                continue
            for number, reading in enumerate(readings[part]):
                shape = dataclasses.replace(
                    solved, **{name: getattr(solved, name)[number] for name in _OF_EACH}
                )
                messages = [*self._writer.all(shape, _KNOWN, *reading.stamp)]
                answers.append(Answer(messages, backbone=shape))
        return answers
