"""The estimate of an arm at one time, the external wrench in it, and the next estimate."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.bank import CONTRADICTED, Bank, BankFilter, BankUpdate, new_bank
from octo_arm_model.estimation.common_fault import CommonFault
from octo_arm_model.estimation.gaussian import Gaussian
from octo_arm_model.estimation.measurement import Measurement, Rows
from octo_arm_model.estimation.measurements import LOAD_CELL
from octo_arm_model.estimation.model import ArmModel, Prediction, Work
from octo_arm_model.estimation.posterior import nearest_possible
from octo_arm_model.estimation.rules import Doubts, Innovation, Rules
from octo_arm_model.estimation.unknowns import State, facing_area
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.sensitivity import chi_square_limit

EVALUATIONS, ITERATIONS = 7, 50  # shapes evaluated for a message, and iterations of the solver
_FIRST = 3  # factor on these for the first message, and when the estimate begins anew
_Parts = list[tuple[Rows, BankUpdate]]


@dataclass(frozen=True)
class Estimate:
    """The normal distribution of the state and of the shape at one time."""

    time: float  #: time of the estimate [s]
    first: float  #: time of the first estimate since it began, or began anew [s]
    measurements: tuple[Measurement, ...]  #: measurements at this time
    bank: Bank  #: all hypotheses after them
    known: Gaussian  #: mean of the leader, with a covariance that contains the other hypotheses
    prediction: Prediction  #: a prediction near this mean
    #: innovations of every measurement, linear ones first, then of every refused load cell; none
    #: of sensors that the leader does not use but that may be right
    innovations: tuple[Innovation, ...]
    accepted: tuple[Rows, ...]  #: measurements that were used, linear ones first
    #: normalised square of all numbers that were used, and their number
    normalised_square: tuple[float, int]
    #: ln of the likelihood of all measurements; unused ones count as at the gate
    log_likelihood: float
    doubted: Doubts  #: names of the sensors that are wrong with a probability of over a half
    #: if none is doubted, names of the smallest set of sensors of which one is probably wrong
    suspects: tuple[str, ...]
    #: time since which even the leader is contradicted [s]; None if it isn't
    contradicted_since: float | None
    patience: int  #: factor on the time until a contradicted estimate begins anew
    common_fault: CommonFault  #: the possibility of a fault that several sensors have in common
    begins_anew: bool  #: whether the one before was contradicted, so that it began from the prior

    def is_lost(self, time: float, recover_after: float) -> bool:
        """Return whether it is contradicted for so long at ``time`` [s] that it begins anew."""
        since = self.contradicted_since
        if since is None or not recover_after:
            return False
        return time - since >= self.patience * recover_after

    def innovations_after(self, previous: Estimate | None) -> tuple[Innovation, ...]:
        """Return the innovations that a ``previous`` estimate, if of the same time, does not have.

        A measurement that was accepted there and is refused here, or the opposite, is new too.
        """
        before = previous.innovations if previous and previous.time == self.time else ()
        earlier = Counter((one.name, one.is_accepted) for one in before)
        new = []
        for entry in self.innovations:
            if earlier[entry.name, entry.is_accepted] <= 0:
                new.append(entry)
            earlier[entry.name, entry.is_accepted] -= 1
        return tuple(new)

    @property
    def state(self) -> State:
        """The layout of the state vector."""
        return self.prediction.model.state

    @property
    def mean(self) -> FloatArray:
        """Mean of the state, (n,)."""
        return self.known.mean

    @property
    def root(self) -> FloatArray:
        """Lower triangular square root of the covariance of the state, (n, n)."""
        return self.known.root

    @property
    def elapsed(self) -> float:
        """Time since `first` [s]."""
        return self.time - self.first

    @functools.cached_property
    def prior_stddev(self) -> FloatArray:
        """Standard deviation of the state without any measurement, (n,)."""
        return self.state.prior_stddev(self.elapsed)

    @functools.cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the state, (n, n)."""
        return self.root @ self.root.T

    @functools.cached_property
    def backbone(self) -> Backbone:
        """Shape in the mean state, with the estimated tensions and wrench on the tip.

        It is the shape of `prediction`, moved to the mean to first order.
        """
        return self.prediction.backbone_at(self.mean)

    @functools.cached_property
    def pose_covariance(self) -> FloatArray:
        """Covariance of position [m] and rotation [rad] of every station, (stations, 6, 6)."""
        pose = self.prediction.change.pose
        # One large product is faster than many small ones.
        root = (pose.reshape(-1, pose.shape[-1]) @ self.root).reshape(pose.shape)
        return root @ root.transpose(0, 2, 1)

    @property
    def refused(self) -> tuple[str, ...]:
        """Names of the measurements of this time that are refused, as they contradict the rest."""
        return tuple(entry.name for entry in self.innovations if not entry.is_accepted)

    @property
    def heard(self) -> frozenset[str]:
        """Names of the measurements of this time, and of their sensors."""
        names = {name for new in self.measurements for name in new.channels(self.prediction)}
        return frozenset(names | {entry.name for entry in self.innovations})

    @property
    def tensions(self) -> FloatArray:
        """True tensions [N], (tendons,)."""
        return self.mean[self.state.tension]

    @property
    def tension_bias(self) -> FloatArray:
        """Constant errors of the load cells [N], (tendons,); empty if not estimated."""
        return self.mean[self.state.tension_bias]

    @property
    def tip_wrench(self) -> FloatArray:
        """Force and moment on the tip, known ones included, in base_frame, (6,) [N, N m]."""
        return self.backbone.tip_wrench

    @property
    def tip_wrench_covariance(self) -> FloatArray:
        """Covariance of `tip_wrench`, (6, 6); zero for components that are not estimated."""
        by_state = self.state.tip_wrench
        return np.asarray(by_state @ self.covariance @ by_state.T)

    @property
    def point_forces(self) -> FloatArray:
        """Forces at the cross sections of `Unknowns.point_forces`, (forces, 3) [N]."""
        return self.mean[self.state.point_forces].reshape(-1, 3)

    @functools.cached_property
    def unobserved(self) -> tuple[str, ...]:
        """Directions of the state that no measurement has determined so far, in words."""
        ratio = self.root / self.prior_stddev[:, np.newaxis]
        _, ratios, axes = np.linalg.svd(ratio.T, full_matrices=False)
        return tuple(_in_words(axis, self.state.names) for axis in axes[ratios >= _UNOBSERVED])


_UNOBSERVED = 0.99  # ratio of posterior to prior deviation from which a direction is unobserved
_LEAST = 0.1  # least component of a direction in its words, over the largest one


def _in_words(axis: FloatArray, names: Sequence[str]) -> str:
    """Return the words for a direction ``axis`` (n,) in standard deviations of the prior."""
    parts = axis / axis[np.abs(axis).argmax()]
    words = [f'{part:+.2g} {name}' for name, part in zip(names, parts) if abs(part) >= _LEAST]
    if len(words) == 1:
        return f'{words[0].split(" ", 1)[1]} keeps its prior'
    return f'changed together, {", ".join(words)} keep their prior'


class Contact(NamedTuple):
    """An estimated external wrench in base_frame."""

    s: float  #: arc coordinate of the contact [m]; NaN for a current, which acts on the whole arm
    wrench: FloatArray  #: force and moment, (6,) [N, N m]
    covariance: FloatArray  #: covariance of the wrench, (6, 6); zero for components not estimated
    is_at_tip: bool = False  #: whether it is that of `Unknowns.tip_force` or `tip_moment`


NO_CONTACT = Contact(math.nan, np.zeros(6), np.zeros((6, 6)))


def contact_of(estimate: Estimate, arm: Arm) -> Contact | None:
    """Return the wrench on the tip of ``arm``, the first point force, or the current's resultant.

    It is the first one that is estimated, else None. A wrench on the tip includes known loads.
    """
    state, unknowns = estimate.state, estimate.state.unknowns
    if unknowns.tip_force or unknowns.tip_moment:
        wrench, covariance = estimate.tip_wrench, estimate.tip_wrench_covariance
        return Contact(arm.length, wrench, covariance, is_at_tip=True)
    s, scale = math.nan, 1.0
    if unknowns.point_forces:
        s, components = unknowns.point_forces[0].s, state.point_forces
    elif unknowns.current:
        components, scale = state.current, facing_area(arm)
    else:
        return None
    force = slice(components.start, components.start + 3)
    wrench, covariance = np.zeros(6), np.zeros((6, 6))
    wrench[:3] = scale * estimate.mean[force]
    covariance[:3, :3] = scale**2 * estimate.covariance[force, force]
    return Contact(s, wrench, covariance)


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
            estimate = _next(model, last, time, measurements, rules, near, work)
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


def _next(
    model: ArmModel,
    last: Estimate | None,
    time: float,
    measurements: tuple[Measurement, ...],
    rules: Rules,
    near: Estimate | None,
    work: Work,
) -> Estimate:
    """Return the next estimate, without a check that its numbers are finite."""
    bank_filter, bank = BankFilter(model, rules), new_bank(model)
    prior = Prediction(model, model.state.prior.mean, None)
    heard = frozenset(name for entry in measurements for name in entry.channels(prior))
    is_lost = last is not None and last.is_lost(time, rules.recover_after)
    # What other sensors say about tensions is linearised about a state that load cells may show to
    # be far from the true one. So the first reading of load cells is used with the prior.
    has_none = last is not None and bank_filter.cells.isdisjoint(last.bank.heard)
    has_first_cells = has_none and not bank_filter.cells.isdisjoint(heard)
    earlier = None if is_lost or has_first_cells else last
    if earlier is None:
        work.evaluations, work.iterations = _FIRST * work.evaluations, _FIRST * work.iterations
    else:
        bank = earlier.bank.after(model, time - earlier.time)
    # If no work is left, the shape is the one that was solved for a state nearby.
    start = earlier if work.is_left() else near or earlier
    bank = bank_filter.with_suspected_sensors(bank, heard)
    bank, prediction, parts = _updated(bank_filter, bank, start, measurements, work)
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
    expected = [2.0 * np.pi * update.expected[leader] for _, update in parts]
    volume = sum(float(np.linalg.slogdet(covariance)[1]) for covariance in expected)
    volume += sum(chi_square_limit(rules.gate, item.value.size) for item in unused)
    judged, bank = bank, bank_filter.without_contradicted(bank)
    known, fault = bank_filter.mixture(bank), CommonFault()
    if last is not None and not has_first_cells and rules.doubts_any:
        elapsed = time - last.time
        before_it = model.state.later(last.bank.leading, elapsed)
        fault = last.common_fault.after(
            elapsed,
            before_it,
            prediction,
            known.mean - before_it.mean,
            heard - bank_filter.cells,
            frozenset(item.name for item in unused),
        )
    is_common = fault.earlier is not None
    doubted, suspects = bank_filter.doubted_and_suspects(judged, is_common=is_common)
    uncertain = judged.doubts[leader] - doubted
    return Estimate(
        time,
        time if last is None or is_lost else last.first,
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
        1 if last is None else (1 + is_lost) * last.patience,
        fault,
        is_lost,
    )


def _updated(
    bank_filter: BankFilter,
    bank: Bank,
    start: Estimate | None,
    measurements: Sequence[Measurement],
    work: Work,
) -> tuple[Bank, Prediction, _Parts]:
    """Return the updated hypotheses, a prediction of the leader, and all partial updates.

    The search begins at the state of the estimate ``start``, or at the mean if that is None.
    """
    model, mean = bank_filter.model, bank.leading.mean
    guess = Prediction(model, mean, None) if start is None else start.prediction
    guess.work = work  # the budget of this message, not of an earlier one
    prediction = Prediction(model, mean, guess.shape, work)
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
    if start is None:  # readings of slack tendons may be negative, but tensions are not
        guess = Prediction(model, nearest_possible(model, bank.leading), None, work)
    bank, update, prediction = bank_filter.with_shapes(bank, rows, guess, is_new=start is None)
    return bank, prediction, [*parts, (rows, update)]


def _innovations(parts: _Parts, leader: int, prediction: Prediction) -> list[Innovation]:
    """Return an innovation for every measurement, and then one for every load cell not used."""
    innovations = []
    for rows, update in parts:
        sensors, used, start = rows.channels(prediction), update.is_used[leader], 0
        for measurement in rows.measurements:
            numbers = np.arange(start, start + measurement.value.size)
            start += numbers.size
            names = np.array([measurement.name if used[n] else sensors[n] for n in numbers])
            for name in dict.fromkeys(names.tolist()):
                some = numbers[names == name]
                value = update.innovation[leader][some]
                covariance = update.expected[leader][np.ix_(some, some)]
                square = float(value @ np.linalg.solve(covariance, value))
                entry = Innovation(name, value, covariance, square, bool(used[some].all()))
                innovations.append(entry)
    return sorted(innovations, key=lambda entry: entry.name.startswith(LOAD_CELL))
