"""The recursive estimator: one step for each time that something was measured."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import IntArray
from octo_arm_model.estimation.bank import CONTRADICTED, Bank, BankFilter, BankUpdate, new_bank
from octo_arm_model.estimation.common_fault import CommonFault
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.measurement import Measurement, Rows
from octo_arm_model.estimation.measurements import LOAD_CELL
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.posterior import Work, nearest_possible
from octo_arm_model.estimation.rules import Innovation, Rules
from octo_arm_model.rod.sensitivity import chi_square_limit

EVALUATIONS, ITERATIONS = 7, 50  # of shapes for one message, and of the solver for them
_FIRST = 3  # times as many where it is the first one, or the estimate begins anew
_Parts = list[tuple[Rows, BankUpdate]]


def next_estimate(
    model: ArmModel,
    last: Estimate | None,
    time: float,
    measurements: tuple[Measurement, ...],
    rules: Rules,
    near: Estimate | None = None,
    work: Work | None = None,
) -> Estimate:
    """From the ``last`` one, or from nothing but the prior, to ``time`` [s].

    The state is looked for from that of the last one, or of an estimate ``near``. What is measured
    takes no more than ``work``, or of the first step than three times as much.

    Raises:
        SolveError: if the arm has no trustworthy shape, or numbers do not resolve what is known.
        MeasurementError: if a measurement does not fit the arm.
    """
    work = work or Work(EVALUATIONS, ITERATIONS)
    if last is None:
        work = Work(_FIRST * work.evaluations, _FIRST * work.iterations, work)
    try:
        with np.errstate(all='ignore'):  # what overflows is not finite in the end
            found = _Step(model, last, time, rules, work).estimate(measurements, near or last)
    except np.linalg.LinAlgError as error:
        raise _unresolved(measurements) from error
    is_finite = np.isfinite(found.mean).all() and np.isfinite(found.root).all()
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


class _Step:
    """From the last estimate to one time."""

    def __init__(
        self, model: ArmModel, last: Estimate | None, time: float, rules: Rules, work: Work
    ) -> None:
        self._model, self._last, self._time, self._rules = model, last, time, rules
        self._work, self._filter = work, BankFilter(model, rules, work)
        is_lost = last is not None and last.is_lost(time, rules.recover_after)
        # One that begins anew begins with the prior; its covariance holds what was known before.
        self._earlier = None if is_lost else last

    def estimate(self, measurements: tuple[Measurement, ...], near: Estimate | None) -> Estimate:
        """What comes of ``measurements``, looked for from the last estimate or one ``near``."""
        time, last, earlier = self._time, self._last, self._earlier
        bank, at, parts = self._updated(measurements, near)
        leader, (doubted, suspects) = bank.leader, self._filter.accused(bank)
        since = None
        if bank.contradiction[leader] >= CONTRADICTED:
            before = None if earlier is None else earlier.contradicted_since
            since = time if before is None else before
        used = [np.flatnonzero(update.is_used[leader]) for _, update in parts]
        square = sum(float(update.square[leader]) for _, update in parts)
        # Twice the logarithm of the denominator of the density of all that is used.
        volume = sum(
            float(np.linalg.slogdet(2.0 * np.pi * update.expected[leader][np.ix_(some, some)])[1])
            for (_, update), some in zip(parts, used)
        )
        every = _innovations(parts, leader, at)
        unused = [one for one in every if not one.is_accepted]
        volume += sum(chi_square_limit(self._rules.gate, one.value.size) for one in unused)
        unsure = bank.doubts[leader] - doubted
        bank = self._filter.without_lost(bank)
        known, fault = self._filter.mixture(bank), CommonFault()
        if last is not None and self._rules.doubts_any:
            elapsed = time - last.time
            expected = self._model.state.later(last.bank.leading, elapsed)
            names = {name for rows, _ in parts for name in rows.channels(at)}
            heard = frozenset(name for name in names if not name.startswith(LOAD_CELL))
            fault = last.common_fault.after(
                elapsed,
                expected,
                at,
                known.mean - expected.mean,
                heard,
                frozenset(one.name for one in unused),
            )
        return Estimate(
            time,
            time if last is None else last.first,
            measurements,
            bank,
            fault.held(known),
            at,
            tuple(one for one in every if one.is_accepted or one.name not in unsure),
            tuple(rows.only(some) for (rows, _), some in zip(parts, used) if len(some)),
            (square, sum(map(len, used))),
            -0.5 * (square + volume),
            doubted,
            suspects,
            since,
            # Each time that it begins anew in vain it takes twice as long to the next.
            1 if last is None else (1 + (earlier is None)) * last.patience,
            fault,
            earlier is not last,
        )

    def _updated(
        self, measurements: Sequence[Measurement], near: Estimate | None
    ) -> tuple[Bank, Prediction, _Parts]:
        """The hypotheses after them, a prediction of the leader, and what each part did."""
        model, earlier, bank_filter = self._model, self._earlier, self._filter
        # Where no work is left the shape is the one that was found nearby before.
        start = earlier or near if self._work.is_left else near or earlier
        bank = new_bank(model)
        if earlier is not None:
            bank = earlier.bank.after(model, self._time - earlier.time)
        mean = bank.mean[bank.leader]
        start_at = Prediction(model, mean, None) if start is None else start.at
        at = Prediction(model, mean, start_at.shape)
        linear, shapes = (
            [one for one in measurements if one.is_linear is is_linear]
            for is_linear in (True, False)
        )
        parts: _Parts = []
        if linear:
            rows = Rows(linear)
            bank, update = bank_filter.with_linear(bank, rows, at)
            parts.append((rows, update))
        if not shapes:
            return *bank_filter.with_leader(bank, start_at), parts
        rows = Rows(shapes)
        bank, sources = bank_filter.with_suspects(bank, rows.channels(at))
        parts = [(one, update.of(sources)) for one, update in parts]
        if start is None:  # readings of slack tendons may be negative, tensions are not
            start_at = Prediction(model, nearest_possible(model, bank.leading), None)
        bank, update, at = bank_filter.with_shapes(bank, rows, start_at, is_new=start is None)
        return bank, at, [*parts, (rows, update)]


def _innovations(parts: _Parts, leader: int, at: Prediction) -> list[Innovation]:
    """Of every measurement, and by itself of every load cell that was not used."""
    whole, cells = [], []
    for rows, update in parts:
        names, used, first = np.array(rows.channels(at)), update.is_used[leader], 0
        for one in rows.measurements:
            own = np.arange(first, first + one.value.size)
            first += own.size
            is_alone = (names[own] != one.name) & ~used[own]
            if not is_alone.all():
                whole.append(_innovation(one.name, own[~is_alone], update, leader))
            for number in own[is_alone]:
                cells.append(_innovation(str(names[number]), np.array([number]), update, leader))
    return whole + cells


def _innovation(name: str, numbers: IntArray, update: BankUpdate, leader: int) -> Innovation:
    """Of some ``numbers`` that are measured by what has a ``name``."""
    value = update.innovation[leader][numbers]
    covariance = update.expected[leader][np.ix_(numbers, numbers)]
    square = float(value @ np.linalg.solve(covariance, value))
    is_accepted = bool(update.is_used[leader][numbers].all())
    return Innovation(name, value, covariance, square, is_accepted)
