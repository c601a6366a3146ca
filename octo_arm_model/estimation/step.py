"""The recursive estimator: one step for each time that something was measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.bank import Bank, BankUpdate, Judge, new_bank
from octo_arm_model.estimation.gaussian import Gaussian
from octo_arm_model.estimation.measurement import Measurement, Rows
from octo_arm_model.estimation.measurements import LOAD_CELL
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.posterior import Work, nearest_possible
from octo_arm_model.estimation.rules import CONTRADICTED, Doubts, Innovation, Rules
from octo_arm_model.rod.sensitivity import chi_square_limit

EVALUATIONS, ITERATIONS = 7, 50  # of shapes for one message, and of the solver for them
_FIRST = 3  # times as many where it is the first one, or the estimate begins anew
_SUDDEN = 4.0  # times the usual difference of two changes, of tensions and of the tip that jump
_STILL = 1e-3  # of the length, by which the tip may always move
_LATELY, _FEWEST = 20, 2  # steps over which that is averaged, and from which on it is known
_WEIGHT = 0.1  # probability of a sensor to lie where a load cell does
_LASTING, _LEAST = 5.0, 0.02  # [s] in which it falls by e, and where it is forgotten


class Together(NamedTuple):
    """What may be so where sensors lie together, which is held for a while.

    A load cell and a camera that are wrong by what goes together cannot be told from an arm that
    moved, by nothing that is measured. So where the motion of the tip changes more than it has
    lately, and that of a tension does too or a sensor begins not to be used, the covariance
    holds for some seconds where the arm was, too.

    Attributes:
        before: what was known before they jumped, without all since; None where they did not.
        weight: its probability.
        expected: of what is known now, from the last step; None before the second.
        moved: change of all tensions [N] and the tip's position [m] in the last step; None before
            the second.
        usual: mean squares of what these changes differ by from those before [N^2, m^2].
        steps: how many.
        unused: sensors that were not used in the last step.
    """

    before: Gaussian | None = None
    weight: float = 0.0
    expected: Gaussian | None = None
    moved: FloatArray | None = None
    usual: FloatArray = np.zeros(1)
    steps: int = 0
    unused: Doubts = frozenset()

    def after(self, model: ArmModel, known: Gaussian, elapsed: float) -> Together:
        """The same ``elapsed`` [s] after a step at which a state was ``known``."""
        decay, growth = model.state.decay(elapsed), model.state.growth(elapsed)
        weight, before = math.exp(-elapsed / _LASTING) * self.weight, None
        if self.before is not None and weight >= _LEAST:
            before = self.before.after(decay, growth)
        return self._replace(before=before, weight=weight, expected=known.after(decay, growth))

    def with_jump(
        self, known: Gaussian, at: Prediction, heard: Doubts, unused: Doubts
    ) -> Together:
        """With what is ``known`` now, ``at`` a prediction of it, and sensors that were ``unused``.

        Others than load cells were ``heard``.
        """
        assert self.expected is not None
        change, state = known.mean - self.expected.mean, at.model.state
        moved = np.concatenate([change[state.tension], at.change.tip[:3] @ change])
        if self.moved is None:
            return self._replace(moved=moved, unused=unused)
        sudden = moved - self.moved
        squares = np.append(sudden[:-3] ** 2, sudden[-3:] @ sudden[-3:])
        steps = min(self.steps + 1, _LATELY)
        usual = self.usual + (squares - self.usual) / steps
        found = self._replace(moved=moved, usual=usual, steps=steps, unused=unused)
        is_sudden = squares > _SUDDEN**2 * self.usual
        is_sudden[-1] &= squares[-1] > (_STILL * at.model.arm.length) ** 2
        is_jump = is_sudden[-1] and (is_sudden[:-1].any() or unused - self.unused)
        if self.before is not None or steps <= _FEWEST or not heard or not is_jump:
            return found
        return found._replace(before=self.expected, weight=_WEIGHT ** max(1, len(heard - unused)))

    def held(self, known: Gaussian) -> Gaussian:
        """What is ``known``, with a covariance that holds what was before."""
        if self.before is None:
            return known
        away = self.before.mean - known.mean
        each = [(1.0 - self.weight, known.root), (self.weight, self.before.root)]
        covariance = sum(weight * root @ root.T for weight, root in each)
        return Gaussian.of(known.mean, covariance + self.weight * np.outer(away, away))


@dataclass(frozen=True)
class Step:
    """One time, what was measured then and what came of it.

    Attributes:
        time: [s].
        measurements: made then.
        bank: all hypotheses after.
        known: the mean of the leader, and a covariance that holds what others think possible.
        at: a prediction nearly of this mean.
        innovations: of every measurement, in their order, then of every load cell refused; none
            of what the leader does not use though it may be right.
        accepted: what was used, linear measurements first.
        normalised_square: of all that was used together, and of how many numbers.
        log_likelihood: of all measurements; of one not used as if it were at the gate.
        doubted: names of the sensors that lie more probably than not.
        suspects: where there are none, names of the fewest of which one more probably lies.
        contradicted_since: since when even the leader is contradicted [s]; None if it is not.
        patience: how many times as long as usual it takes to begin anew.
        together: what may be so where sensors lie together.
        begins_anew: whether it is of the prior and its own measurements alone.
    """

    time: float
    measurements: tuple[Measurement, ...]
    bank: Bank
    known: Gaussian
    at: Prediction
    innovations: tuple[Innovation, ...]
    accepted: tuple[Rows, ...]
    normalised_square: tuple[float, int]
    log_likelihood: float
    doubted: Doubts
    suspects: tuple[str, ...]
    contradicted_since: float | None
    patience: int
    together: Together
    begins_anew: bool = False

    def is_lost(self, time: float, recover_after: float) -> bool:
        """Whether it has been contradicted for so long at ``time`` [s] as to begin anew."""
        since = self.contradicted_since
        if since is None or not recover_after:
            return False
        return time - since >= self.patience * recover_after

    def innovations_after(self, before: Step | None) -> tuple[Innovation, ...]:
        """Those that are new after the step ``before``, which is of the same time.

        What was accepted then and is refused now is new too.
        """
        earlier = () if before is None else before.innovations
        known = {one.name for one in earlier}
        accepted = {one.name for one in earlier if one.is_accepted}
        return tuple(
            one
            for one in self.innovations
            if one.name not in known or (one.name in accepted and not one.is_accepted)
        )


def next_step(
    model: ArmModel,
    last: Step | None,
    time: float,
    measurements: tuple[Measurement, ...],
    rules: Rules,
    near: Step | None = None,
    work: Work | None = None,
) -> Step:
    """From the ``last`` one, or from nothing but the prior, to ``time`` [s].

    The state is looked for from that of the last one, or of a step ``near``. What is measured
    takes no more than ``work``, or of the first step than three times as much.

    Raises:
        SolveError: if the arm has no trustworthy shape, or numbers do not resolve what is known.
        MeasurementError: if a measurement does not fit the arm.
    """
    work = work or Work(EVALUATIONS, ITERATIONS)
    is_anew = last is not None and last.is_lost(time, rules.recover_after)
    if last is None:
        work = Work(_FIRST * work.evaluations, _FIRST * work.iterations, work)
    update = _Update(model, time, measurements, rules, work)
    try:
        with np.errstate(all='ignore'):  # what overflows is not finite in the end
            found = update.step(last, near or last, is_anew=is_anew)
    except np.linalg.LinAlgError as error:
        raise _unresolved(measurements) from error
    is_finite = np.isfinite(found.known.mean).all() and np.isfinite(found.known.root).all()
    if not (is_finite and math.isfinite(found.log_likelihood)):
        raise _unresolved(measurements)
    return found


def _unresolved(measurements: Sequence[Measurement]) -> SolveError:
    noise = ', '.join(
        f'{one.name} to {math.sqrt(one.covariance.diagonal().min()):.3g}' for one in measurements
    )
    return SolveError(
        f'the estimate is not finite: standard deviations of what is measured ({noise}) and of '
        'what was known before differ by more than numbers resolve'
    )


class _Update:
    """Measurements of one time."""

    def __init__(
        self,
        model: ArmModel,
        time: float,
        measurements: tuple[Measurement, ...],
        rules: Rules,
        work: Work,
    ) -> None:
        self._model, self._time, self._rules = model, time, rules
        self._measurements = measurements
        linear = [one for one in measurements if one.is_linear]
        shapes = [one for one in measurements if not one.is_linear]
        self._linear = Rows(linear) if linear else None
        self._shapes = Rows(shapes) if shapes else None
        self._judge, self._work = Judge(model, rules, work), work

    def step(self, last: Step | None, near: Step | None, *, is_anew: bool = False) -> Step:
        """What comes of them after the ``last`` step, looked for from it or from one ``near``.

        One ``is_anew`` begins with the prior; its covariance holds what was known before.
        """
        model, judge = self._model, self._judge
        earlier = None if is_anew else last
        # Where no work is left the shape is the one that was found nearby before.
        start = earlier or near if self._work.is_left else near or earlier
        bank = new_bank(model)
        if earlier is not None:
            bank = earlier.bank.after(model, self._time - earlier.time)
        mean = bank.mean[bank.leader]
        start_at = Prediction(model, mean, None) if start is None else start.at
        at = Prediction(model, mean, start_at.shape)
        parts: list[tuple[Rows, BankUpdate]] = []
        if self._linear is not None:
            bank, judged = judge.linear(bank, self._linear, at)
            parts.append((self._linear, judged))
        if self._shapes is None:
            bank, at = judge.led(bank, start_at)
        else:
            bank, sources = judge.opened(bank, self._shapes.channels(at))
            parts = [(rows, part.of(sources)) for rows, part in parts]
            if start is None:  # readings of slack tendons may be negative, tensions are not
                known = bank.leading
                start_at = Prediction(model, nearest_possible(model, known.root, known.mean), None)
            bank, judged, at = judge.shaped(bank, self._shapes, start_at, is_new=start is None)
            parts.append((self._shapes, judged))
        leader, (doubted, suspects) = bank.leader, judge.accused(bank)
        since = None
        if bank.contradiction[leader] >= CONTRADICTED:
            before = None if earlier is None else earlier.contradicted_since
            since = self._time if before is None else before
        square = sum(float(judged.square[leader]) for _, judged in parts)
        volume = sum(float(judged.volume[leader]) for _, judged in parts)
        accepted = [rows.only(np.flatnonzero(one.is_used[leader])) for rows, one in parts]
        every = self._innovations(parts, leader, at)
        unused = [one for one in every if not one.is_accepted]
        volume += sum(chi_square_limit(self._rules.gate, one.value.size) for one in unused)
        unsure = bank.doubts[leader] - doubted
        innovations = [one for one in every if one.is_accepted or one.name not in unsure]
        bank = judge.followed(bank)
        known, together = judge.mixture(bank), Together()
        if last is not None and self._rules.doubts_any:
            expected = last.together.after(model, last.bank.leading, self._time - last.time)
            heard = frozenset(name for rows, _ in parts for name in rows.channels(at))
            others = frozenset(name for name in heard if not name.startswith(LOAD_CELL))
            of_unused = frozenset(one.name for one in unused)
            together = expected.with_jump(known, at, others, of_unused)
            known = together.held(known)
        return Step(
            self._time,
            self._measurements,
            bank,
            known,
            at,
            tuple(innovations),
            tuple(one for one in accepted if len(one)),
            (square, sum(len(one) for one in accepted)),
            -0.5 * (square + volume),
            doubted,
            suspects,
            since,
            # Each time that it begins anew in vain it takes twice as long to the next.
            (1 + is_anew) * (1 if last is None else last.patience),
            together,
            is_anew,
        )

    def _innovations(
        self, parts: Sequence[tuple[Rows, BankUpdate]], leader: int, at: Prediction
    ) -> list[Innovation]:
        """Of every measurement, and by itself of every load cell that was not used."""
        whole, cells = {}, []
        for rows, judged in parts:
            names, first = rows.channels(at), 0
            used, value = judged.is_used[leader], judged.innovation[leader]
            covariance = judged.expected[leader]
            for one in rows.measurements:
                own = range(first, first + one.value.size)
                first = own.stop
                alone = [n for n in own if names[n] != one.name and not used[n]]
                kept = [n for n in own if n not in alone]
                for some, name in ((kept, one.name), *(([n], names[n]) for n in alone)):
                    if not some:
                        continue
                    block, part = covariance[np.ix_(some, some)], value[some]
                    square = float(part @ np.linalg.solve(block, part))
                    found = Innovation(name, part, block, square, bool(used[some].all()))
                    if some is kept:
                        whole[id(one)] = found
                    else:
                        cells.append(found)
        return [whole[id(one)] for one in self._measurements if id(one) in whole] + cells
