"""The recursive estimator: one step for each time of measurements."""

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

EVALUATIONS, ITERATIONS = 7, 50  # shapes evaluated for a message, and iterations of the solver
_FIRST = 3  # factor on these for the first message, and when the estimate begins anew
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
    """Return the estimate at ``time`` [s] after the ``last`` one; if that is None, from the prior.

    The search begins at the state of an estimate ``near``, or of the last one. It takes no more
    than ``work``; a step from the prior takes up to three times as much.

    Raises:
        SolveError: if the arm has no trustworthy shape, or standard deviations differ too much.
        MeasurementError: if a measurement does not fit the arm.
    """
    work = work or Work(EVALUATIONS, ITERATIONS)
    try:
        with np.errstate(all='ignore'):  # an overflow makes the estimate not finite, see below
            estimate = _Step(model, last, time, rules, work).estimate(measurements, near)
        for part in (estimate.mean, estimate.root, estimate.log_likelihood):
            if not np.isfinite(part).all():
                raise np.linalg.LinAlgError('the estimate is not finite')
    except np.linalg.LinAlgError as error:
        noise = ', '.join(
            f'{one.name} to {math.sqrt(one.covariance.diagonal().min()):.3g}'
            for one in measurements
        )
        raise SolveError(
            f'the estimate is not finite: standard deviations of what is measured ({noise}) and '
            'of what was known before differ by more than numbers resolve'
        ) from error
    return estimate


class _Step:
    """The step from the last estimate to one time."""

    def __init__(
        self, model: ArmModel, last: Estimate | None, time: float, rules: Rules, work: Work
    ) -> None:
        self._model, self._last, self._time, self._rules = model, last, time, rules
        is_lost = last is not None and last.is_lost(time, rules.recover_after)
        # An estimate that begins anew is a first one, but for its patience and common fault.
        self._earlier = None if is_lost else last
        if self._earlier is None:
            work = Work(_FIRST * work.evaluations, _FIRST * work.iterations, work)
        self._work, self._filter = work, BankFilter(model, rules, work)

    def estimate(self, measurements: tuple[Measurement, ...], near: Estimate | None) -> Estimate:
        """Return the estimate after ``measurements``; begin the search at ``near``, if any."""
        time, last, earlier = self._time, self._last, self._earlier
        bank, prediction, parts = self._updated(measurements, near)
        leader, since = bank.leader, None
        if bank.contradiction[leader] >= CONTRADICTED:
            before = None if earlier is None else earlier.contradicted_since
            since = time if before is None else before
        used = [np.flatnonzero(update.is_used[leader]) for _, update in parts]
        square = sum(float(update.square[leader]) for _, update in parts)
        innovations = _innovations(parts, leader, prediction)
        unused = [item for item in innovations if not item.is_accepted]
        # Twice the logarithm of the denominator of the density of all numbers. Those that are not
        # used have one too: else their units would decide between places of contact.
        blocks = [
            update.expected[leader][np.ix_(rows, rows)] for (_, update), rows in zip(parts, used)
        ] + [item.covariance for item in unused]
        volume = sum(float(np.linalg.slogdet(2.0 * np.pi * block)[1]) for block in blocks)
        volume += sum(chi_square_limit(self._rules.gate, item.value.size) for item in unused)
        judged, bank = bank, self._filter.without_contradicted(bank)
        known, fault = self._filter.mixture(bank), CommonFault()
        if last is not None and self._rules.doubts_any:
            elapsed = time - last.time
            expected = self._model.state.later(last.bank.leading, elapsed)
            names = {name for rows, _ in parts for name in rows.channels(prediction)}
            heard = frozenset(name for name in names if not name.startswith(LOAD_CELL))
            fault = last.common_fault.after(
                elapsed,
                expected,
                prediction,
                known.mean - expected.mean,
                heard,
                frozenset(item.name for item in unused),
            )
        is_common = fault.earlier is not None
        doubted, suspects = self._filter.doubted_and_suspects(judged, is_common=is_common)
        uncertain = judged.doubts[leader] - doubted
        return Estimate(
            time,
            time if earlier is None else earlier.first,
            measurements,
            bank,
            fault.mixture(known),
            prediction,
            tuple(item for item in innovations if item.is_accepted or item.name not in uncertain),
            tuple(rows.subset(index) for (rows, _), index in zip(parts, used) if len(index)),
            (square, sum(map(len, used))),
            -0.5 * (square + volume),
            doubted,
            suspects,
            since,
            # The time until it begins anew doubles each time.
            1 if last is None else (1 + (earlier is None)) * last.patience,
            fault,
            earlier is not last,
        )

    def _updated(
        self, measurements: Sequence[Measurement], near: Estimate | None
    ) -> tuple[Bank, Prediction, _Parts]:
        """Return the updated hypotheses, a prediction of the leader, and all partial updates."""
        model, earlier, bank_filter = self._model, self._earlier, self._filter
        # If no work is left, the shape is the one that was solved for a state nearby.
        start = earlier if self._work.is_left else near or earlier
        bank = new_bank(model)
        if earlier is not None:
            bank = earlier.bank.after(model, self._time - earlier.time)
        mean = bank.mean[bank.leader]
        guess = Prediction(model, mean, None) if start is None else start.prediction
        prediction = Prediction(model, mean, guess.shape)
        linear, nonlinear = (
            [entry for entry in measurements if entry.is_linear is is_linear]
            for is_linear in (True, False)
        )
        parts: _Parts = []
        if linear:
            rows = Rows(linear)
            bank, update = bank_filter.with_linear(bank, rows, prediction)
            parts.append((rows, update))
        if not nonlinear:
            return *bank_filter.with_leader(bank, guess), parts
        rows = Rows(nonlinear)
        bank, sources = bank_filter.with_suspected_sensors(bank, rows.channels(prediction))
        parts = [(entry, update.of(sources)) for entry, update in parts]
        if start is None:  # readings of slack tendons may be negative, but tensions are not
            guess = Prediction(model, nearest_possible(model, bank.leading), None)
        bank, update, prediction = bank_filter.with_shapes(bank, rows, guess, is_new=start is None)
        return bank, prediction, [*parts, (rows, update)]


def _innovations(parts: _Parts, leader: int, prediction: Prediction) -> list[Innovation]:
    """Return an innovation for every measurement, and one for every load cell not used."""
    measured, cells = [], []
    for rows, update in parts:
        names, used, start = np.array(rows.channels(prediction)), update.is_used[leader], 0
        for measurement in rows.measurements:
            indices = np.arange(start, start + measurement.value.size)
            start += indices.size
            is_alone = (names[indices] != measurement.name) & ~used[indices]
            if not is_alone.all():
                measured.append(_innovation(measurement.name, indices[~is_alone], update, leader))
            for number in indices[is_alone]:
                cells.append(_innovation(str(names[number]), np.array([number]), update, leader))
    return measured + cells


def _innovation(name: str, numbers: IntArray, update: BankUpdate, leader: int) -> Innovation:
    """Return the innovation of the ``numbers`` of a sensor or measurement with a ``name``."""
    value = update.innovation[leader][numbers]
    covariance = update.expected[leader][np.ix_(numbers, numbers)]
    square = float(value @ np.linalg.solve(covariance, value))
    is_accepted = bool(update.is_used[leader][numbers].all())
    return Innovation(name, value, covariance, square, is_accepted)
