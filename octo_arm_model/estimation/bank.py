"""Sensors that may lie, believed or doubted by a bank of hypotheses.

Each hypothesis is a normal distribution of the state, and a set of sensors of which it uses
nothing: none of them, one load cell, one other sensor, or all load cells (multiple-model adaptive
estimation for failures of sensors, Maybeck 1999). How far one is contradicted is the sum of the
normalised squares of its innovations beyond what is expected, forgotten in half a second;
determinants of covariances are left out, as usual there, so that a hypothesis is not the worse for
predicting less. What nothing contradicts stays as probable as before, and the covariance is that
of the mixture: where other sensors cannot tell whether a load cell is right, it holds what would
be if it is not.

All hypotheses are updated about shapes that are known already. The most probable one then has its
own shape solved, which may make it less so; then the next one has, and so on while `Work` is left.

Where a load cell is doubted whose tension nothing has told yet, as at the start, the arm may be
far from all shapes that are known, where a linear update tells neither for nor against. Such a
hypothesis is open: it keeps its prior, which the covariance holds, until its shape was looked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.estimation.gaussian import Gaussian, square_of
from octo_arm_model.estimation.measurement import Rows
from octo_arm_model.estimation.measurements import LOAD_CELL
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.posterior import (
    Agreement,
    Fit,
    Work,
    agree,
    nearest_possible,
    reached,
)
from octo_arm_model.estimation.rules import Doubts, Rules, channels_of

_MEMORY = 0.5  # [s] in which contradictions are forgotten
_EXPECTED = 2.0  # normalised square of a number, beyond which it contradicts
_MOST = 16.0  # contradiction of a hypothesis [nat]: it is forgotten in three times _MEMORY
CONTRADICTED = 8.0  # from which on a hypothesis is no longer followed by itself
_STAYS = 1.0  # by which another hypothesis has to be more probable than the present one [nat]
_SHARE = 4  # evaluations for one hypothesis among several
_FAR = 0.02  # of the length, by which a station moves, to linearise others anew
_LOOKED_FROM = 0.1, 0.3, 0.7  # of the prior's deviation, tensions that nothing tells
_SEARCH = 5  # evaluations that a search from there takes at least
_BETTER = 0.01  # nat for a normalised square
_UNSURE = 2.0  # times the gate, for a square that is not exact
_HALFWAY = 0.25  # part of the squares of noise and change, that is left where it led somewhere
_RESOLVED = 1e-14  # part of a standard deviation before, that one of a measurement may be
_NOBODY: Doubts = frozenset()


class Bank(NamedTuple):
    """Hypotheses.

    Attributes:
        doubts: sensors of which each uses nothing.
        mean: of the state by each, (hypotheses, n).
        covariance: of it, (hypotheses, n, n).
        contradiction: of each [nat], (hypotheses,).
        leader: number of the most probable one, which is published.
        heard: sensors other than load cells that were heard so far.
        agreement: of the leader.
        is_open: which doubt a load cell, and have not been judged near their own shape yet.
    """

    doubts: tuple[Doubts, ...]
    mean: FloatArray
    covariance: FloatArray
    contradiction: FloatArray
    leader: int
    heard: Doubts
    agreement: Agreement
    is_open: NDArray[np.bool_]

    @property
    def leading(self) -> Gaussian:
        """What the leader knows."""
        return self.one(self.leader)

    def one(self, number: int) -> Gaussian:
        """What one hypothesis knows."""
        return Gaussian.of(self.mean[number], self.covariance[number])

    def after(self, model: ArmModel, elapsed: float) -> Bank:
        """All of them ``elapsed`` [s] later."""
        decay, growth = model.state.decay(elapsed), model.state.growth(elapsed)
        covariance = np.outer(decay, decay) * self.covariance + np.diag(growth**2)
        contradiction = math.exp(-elapsed / _MEMORY) * self.contradiction
        return self._replace(
            mean=decay * self.mean, covariance=covariance, contradiction=contradiction
        )


def new_bank(model: ArmModel) -> Bank:
    """Of one hypothesis, that believes everything and knows the prior of ``model``."""
    mean, root = model.state.prior
    none = np.zeros(1, dtype=bool)
    covariance = (root**2)[np.newaxis]
    return Bank(
        (_NOBODY,), mean[np.newaxis], covariance, np.zeros(1), 0, _NOBODY, Agreement(), none
    )


class BankUpdate(NamedTuple):
    """What measurements make of every hypothesis, the first axis.

    Attributes:
        mean: of the state after them, (hypotheses, n).
        covariance: of it, (hypotheses, n, n).
        is_used: which numbers each used, (hypotheses, m).
        cost: by how much they contradict each [nat], (hypotheses,).
        innovation: measured less predicted before, (hypotheses, m).
        expected: covariance of that, (hypotheses, m, m).
        square: normalised square of what each used together, (hypotheses,).
    """

    mean: FloatArray
    covariance: FloatArray
    is_used: NDArray[np.bool_]
    cost: FloatArray
    innovation: FloatArray
    expected: FloatArray
    square: FloatArray

    def improve(self, others: BankUpdate) -> None:
        """Write ``others`` where they contradict less, linearised about another shape."""
        # Where neither does the one that explains more of it.
        better = others.cost + _BETTER * others.square < self.cost + _BETTER * self.square
        self.put(np.flatnonzero(better), others.of(np.flatnonzero(better)))

    def of(self, numbers: IntArray | list[int]) -> BankUpdate:
        """Some hypotheses alone, in this order."""
        return BankUpdate._make(one[numbers] for one in self)

    def put(self, numbers: IntArray | list[int], others: BankUpdate) -> None:
        """Write ``others`` in the place of some."""
        for whole, part in zip(self, others, strict=True):
            whole[numbers] = part


class BankFilter:
    """Updates the hypotheses of one arm with what was measured at one time."""

    def __init__(self, model: ArmModel, rules: Rules, work: Work) -> None:
        """Of ``model``, by ``rules``, with no more ``work`` than that."""
        self._model, self._rules, self._work = model, rules, work
        names = model.arm.tendon_names
        # Where the tension of each load cell is in the state.
        self._tension = {f'{LOAD_CELL} {name}': at for at, name in enumerate(names)}
        self._cells = frozenset(self._tension)
        self._prior = model.state.prior_stddev()

    def with_linear(self, bank: Bank, rows: Rows, at: Prediction) -> tuple[Bank, BankUpdate]:
        """All hypotheses after ``rows`` that depend on no shape; ``at`` is of any state."""
        update = self._linearised(bank, rows, at)
        expected = update.expected[bank.leader].diagonal()
        if (rows.noise.diagonal() < _RESOLVED**2 * expected).any():
            raise np.linalg.LinAlgError('what is measured is far more exact than what was known')
        return _updated(bank, update), update

    def with_leader(self, bank: Bank, at: Prediction) -> tuple[Bank, Prediction]:
        """The most probable hypothesis leads, with possible tensions; and its shape."""
        total = bank.contradiction + self._improbability(bank)
        total[bank.is_open] = np.inf  # their means were not looked for
        total[bank.leader] -= _STAYS
        leader = int(total.argmin())
        means = bank.mean.copy()
        means[leader] = mean = nearest_possible(self._model, bank.one(leader))
        # Where no work is left the shape nearby is moved to the mean to first order.
        if self._work.is_left or at.shape is None:
            at = reached(at, mean, self._work)
        return bank._replace(mean=means, leader=leader), at

    def with_shapes(
        self, bank: Bank, rows: Rows, at: Prediction, *, is_new: bool
    ) -> tuple[Bank, BankUpdate, Prediction]:
        """All hypotheses after ``rows``, the most probable one about its own shape.

        Where it ``is_new`` nothing leads to this shape but the prior.

        Raises:
            SolveError: if there is none.
        """
        exact: dict[int, tuple[Fit, BankUpdate]] = {}
        shape, stays = at, self._improbability(bank)
        stays[bank.leader] -= _STAYS
        # The leader comes first, and no sensor is doubted before its shape is known: far from what
        # was expected, as after a sudden touch, a linear guess of it is much too bad.
        best, update = bank.leader, None
        # Where it is contradicted, and others were not looked for yet, most work is left for them.
        is_lost = bank.contradiction[best] >= CONTRADICTED and bool(bank.is_open.any())
        spare = _SEARCH + 1 if is_lost else 1
        while best not in exact:
            try:
                exact[best] = self._fit(bank, best, rows, at, spare, is_new=is_new)
            except SolveError:
                stays[best] = np.inf
                if not np.isfinite(stays).any() or not (exact or self._work.is_left):
                    raise
            else:
                found = exact[best][0].at
                if len(bank.doubts) == 1:
                    update = exact[best][1]
                elif shape.distance(found.x) > _FAR * self._model.arm.length:
                    update = update or self._linearised(bank, rows, shape)
                    update.improve(self._linearised(bank, rows, found))
                shape = found
            update = update or self._linearised(bank, rows, shape)
            for number, (_, one) in exact.items():
                update.put([number], one)
            best = int((bank.contradiction + update.cost + stays).argmin())
            if exact and (is_lost or not self._work.is_left):
                break
        assert update is not None
        is_open = self._search(bank, update, rows, shape, exact)
        total = bank.contradiction + update.cost + stays
        best = min(exact, key=lambda number: float(total[number]))
        fit = exact[best][0]
        bank = _updated(bank, update)._replace(
            leader=best, agreement=fit.agreement, is_open=is_open
        )
        return bank, update, fit.at

    def _search(
        self,
        bank: Bank,
        update: BankUpdate,
        rows: Rows,
        at: Prediction,
        exact: dict[int, tuple[Fit, BankUpdate]],
    ) -> NDArray[np.bool_]:
        """Look for the shapes of open hypotheses that ``at`` is far from, into ``exact``.

        Those that no work is left for stay open, as they were, so that the covariance holds them.
        """
        if not bank.is_open.any():
            return bank.is_open
        moved = (update.mean - at.x) @ at.change.tip[:3].T
        is_far = np.linalg.norm(moved, axis=1) > _FAR * self._model.arm.length
        is_open = bank.is_open & (is_far | (update.cost >= CONTRADICTED))
        is_open[list(exact)] = False
        waiting = np.flatnonzero(is_open).tolist()
        for number in waiting:
            if self._work.evaluations < _SEARCH:
                break
            is_open[number] = False
            try:
                start = self._nearest(bank, number, rows, at)
                exact[number] = self._fit(bank, number, rows, start, 0, is_new=False)
            except SolveError:
                continue
            fit, one = exact[number]
            if one.cost[0] < CONTRADICTED:
                update.improve(self._linearised(bank, rows, fit.at))
        for number, (_, one) in exact.items():
            update.put([number], one)
        left = [number for number in waiting if number not in exact]
        update.mean[left], update.covariance[left] = bank.mean[left], bank.covariance[left]
        update.is_used[left], update.cost[left] = False, 0.0
        return is_open

    def _nearest(self, bank: Bank, number: int, rows: Rows, at: Prediction) -> Prediction:
        """What explains ``rows`` best, of ``at`` and some tensions that one doubts."""
        doubted = [self._tension[name] for name in bank.doubts[number] & self._cells]
        x = nearest_possible(self._model, bank.one(number))
        best, least = at, square_of(rows.left(at), rows.noise_root)
        for part in _LOOKED_FROM:
            x = x.copy()
            x[doubted] = part * self._prior[doubted]
            try:
                at = reached(at, x, self._work)
                square = square_of(rows.left(at), rows.noise_root)
            except SolveError:
                break
            if square < least:
                best, least = at, square
        return best

    def _linearised(
        self, bank: Bank, rows: Rows, at: Prediction, is_used: NDArray[np.bool_] | None = None
    ) -> BankUpdate:
        """All hypotheses after ``rows``, linearised about ``at``; by the gate what ``is_used``."""
        jacobian, channels = rows.jacobian(at), channels_of(rows.channels(at))
        innovation = rows.left(at) + (at.x - bank.mean) @ jacobian.T
        across = jacobian @ bank.covariance
        expected = across @ jacobian.T + rows.noise
        squares, limits = channels.squares(innovation, expected), channels.limits(self._rules.gate)
        is_doubted = np.array([channels.is_in(doubts) for doubts in bank.doubts])
        if is_used is None:
            is_used = ~is_doubted & (squares <= limits)
        # Numbers that are not used are of noise alone.
        some = is_used[..., np.newaxis]
        noise = ~some * np.diag(rows.noise.diagonal())
        across, left = some * across, (is_used * innovation)[..., np.newaxis]
        used = some * expected * is_used[:, np.newaxis] + noise
        solved = np.linalg.solve(used, np.concatenate([across, left], axis=-1))
        gain, square = solved[..., :-1], (solved[..., -1:] * left).sum(axis=(1, 2))
        mean = bank.mean + (gain * left).sum(axis=1)
        # Joseph's form, exact too where measurements are far more exact than what was known.
        covariance = bank.covariance - gain.swapaxes(-1, -2) @ across
        told = jacobian @ covariance * some
        covariance += (rows.noise @ gain - told).swapaxes(-1, -2) @ gain
        covariance = 0.5 * (covariance + covariance.swapaxes(-1, -2))
        cost = np.maximum(0.0, 0.5 * (square - _EXPECTED * is_used.sum(axis=-1)))
        # What is refused counts by itself, as at the gate at least.
        refused = np.minimum(0.5 * np.maximum(squares, limits), _MOST) / channels.counts
        cost += np.where(~is_used & ~is_doubted, refused, 0.0).sum(axis=-1)
        return BankUpdate(mean, covariance, is_used, cost, innovation, expected, square)

    def _fit(
        self, bank: Bank, number: int, rows: Rows, at: Prediction, spare: int, *, is_new: bool
    ) -> tuple[Fit, BankUpdate]:
        """One hypothesis after ``rows``, about the shape that it agrees with them on."""
        before, channels = bank.one(number), channels_of(rows.channels(at))
        alone = bank._replace(
            doubts=bank.doubts[number : number + 1],
            mean=bank.mean[[number]],
            covariance=bank.covariance[[number]],
        )
        is_used, limits = ~channels.is_in(bank.doubts[number]), channels.limits(self._rules.gate)
        first, share = at, self._work
        while True:
            if len(bank.doubts) > 1:  # something is left for the others
                share = self._work.share(min(_SHARE, max(self._work.evaluations - spare, 1)))
            some = rows.only(np.flatnonzero(is_used))
            fit = agree(before, some, bank.agreement, at, share, is_new=is_new)
            at, is_new = fit.at, False
            update = self._linearised(alone, rows, at, is_used[np.newaxis])
            squares = channels.squares(update.innovation, update.expected)[0]
            is_refused = is_used & (squares > limits)
            if not fit.is_converged:
                # Squares are not exact then; what led nowhere is refused.
                now, then = (
                    square_of(some.left(one), some.noise_root)
                    + np.array([0.0, square_of(one.x - before.mean, before.root)])
                    for one in (at, first)
                )
                is_hopeless = now[0] > limits.max() and now[1] > _HALFWAY * then[1]
                is_refused = is_used & ((squares > _UNSURE * limits) | is_hopeless)
            if not is_refused.any():
                break
            is_used = is_used & ~is_refused
        covariance = (fit.known.root @ fit.known.root.T)[np.newaxis]
        return fit, update._replace(mean=fit.known.mean[np.newaxis], covariance=covariance)

    def with_suspects(self, bank: Bank, heard: Sequence[str]) -> tuple[Bank, list[int]]:
        """With a hypothesis for each sensor that may lie, and from which each of them is.

        Load cells may once another sensor is ``heard``, which can tell.
        """
        known = bank.heard | frozenset(heard)
        if not self._rules.doubts_any or known == bank.heard:
            return bank, list(range(len(bank.doubts)))
        return self._about(bank._replace(heard=known), bank.doubts[bank.leader])

    def without_lost(self, bank: Bank) -> Bank:
        """Hypotheses that are contradicted go on from what the leader knows."""
        if len(bank.doubts) == 1:
            return bank
        doubts, cells = bank.doubts[bank.leader], self._cells
        is_single = len(doubts & cells) == len(doubts) == 1
        is_lost = bank.contradiction >= CONTRADICTED
        if is_lost[bank.leader] and is_single and not bank.is_open.any():
            # One load cell that lies does not explain what is measured: two of them may.
            bank, _ = self._about(bank, doubts)
            is_lost = bank.contradiction >= CONTRADICTED
        is_lost |= np.array([one == cells for one in bank.doubts])
        is_lost[bank.leader] = False
        if not is_lost.any():
            return bank
        mean, covariance, leader = bank.mean.copy(), bank.covariance.copy(), bank.leader
        mean[is_lost], covariance[is_lost] = mean[leader], covariance[leader]
        return self._widened(bank._replace(mean=mean, covariance=covariance), is_lost)

    def accused(self, bank: Bank) -> tuple[Doubts, tuple[str, ...]]:
        """Sensors that the leader doubts and that lie more probably than not, by all hypotheses.

        Where there are none though it doubts some: also the fewest of which one does, if any lies.
        """
        doubted = bank.doubts[bank.leader]
        if not doubted:
            return _NOBODY, ()
        weight, suspects = self._weight(bank), []
        names = sorted(frozenset().union(*bank.doubts))
        lies = {name: np.array([name in one for one in bank.doubts]) for name in names}
        refused = frozenset(name for name in doubted if weight[lies[name]].sum() > 0.5)
        left = weight * [bool(one) for one in bank.doubts]
        most = 0.5 * left.sum()
        while not refused and left.sum() >= most:
            suspects.append(max(names, key=lambda name: float(left[lies[name]].sum())))
            left[lies[suspects[-1]]] = 0.0
        return refused, tuple(suspects)

    def mixture(self, bank: Bank) -> Gaussian:
        """The mean of the leader, and a covariance that holds what others think possible."""
        if len(bank.doubts) == 1:
            return bank.leading
        weight, mean = self._weight(bank), bank.mean[bank.leader]
        away = bank.mean - mean
        covariance = np.tensordot(weight, bank.covariance, axes=1) + (weight * away.T) @ away
        return Gaussian.of(mean, covariance)

    def _improbability(self, bank: Bank) -> FloatArray:
        """Of every hypothesis before anything is measured [nat]."""
        return np.array([self._rules.improbability(one, self._cells) for one in bank.doubts])

    def _weight(self, bank: Bank) -> FloatArray:
        """Probability of every hypothesis, (hypotheses,)."""
        total = bank.contradiction + self._improbability(bank)
        weight = np.exp(total.min() - total)
        return np.asarray(weight / weight.sum())

    def _about(self, bank: Bank, root: Doubts) -> tuple[Bank, list[int]]:
        """Hypotheses of one doubt more or less than ``root``, and from which each of them is.

        Those that are new know what the leader does, but for what the doubted sensor told.
        """
        rules, leading = self._rules, bank.doubts[bank.leader]
        suspects = sorted(self._cells) if rules.cell_fault else []
        if rules.sensor_fault and not root:
            # All others may not be doubted at once: then it is the arm that is lost.
            suspects += sorted(bank.heard)
        wanted = [root, leading, _NOBODY, *(root - {name} for name in sorted(root))]
        wanted += [root | {name} for name in suspects]
        wanted += [self._cells] if rules.cell_fault else []
        doubts = tuple(dict.fromkeys(wanted))
        known = {one: number for number, one in enumerate(bank.doubts)}
        sources = [known.get(one, bank.leader) for one in doubts]
        is_new = np.array([one not in known for one in doubts])
        is_cell = np.array([len(one) == len(one & self._cells) == 1 for one in doubts])
        made = bank._replace(
            doubts=doubts,
            mean=bank.mean[sources],
            covariance=bank.covariance[sources],
            contradiction=bank.contradiction[sources],
            leader=doubts.index(leading),
            is_open=np.where(is_new, is_cell & (not root), bank.is_open[sources]),
        )
        return self._widened(made, is_new), sources

    def _widened(self, bank: Bank, is_new: NDArray[np.bool_]) -> Bank:
        """``bank`` whose new hypotheses know no more of what a doubted sensor told."""
        believed, state = bank.doubts[bank.leader], self._model.state
        is_told = np.zeros(bank.mean.shape, dtype=bool)
        for number in np.flatnonzero(is_new):
            doubts = bank.doubts[number]
            for name in () if doubts == self._cells else doubts - believed:
                # What follows from this sensor before all others.
                is_told[number, state.tip_force.start : state.current.stop] = True
                if name in self._cells:
                    is_told[number, self._tension[name]] = True
            if believed == self._cells != doubts:
                # Nothing tells the leader of tensions, and load cells that are right again do.
                is_told[number, state.tension] = True
        wide = (is_told * self._prior**2)[..., np.newaxis] * np.eye(state.size)
        return bank._replace(covariance=bank.covariance + wide)


def _updated(bank: Bank, update: BankUpdate) -> Bank:
    """``bank`` after an ``update``."""
    contradiction = np.minimum(bank.contradiction + update.cost, _MOST)
    return bank._replace(
        mean=update.mean, covariance=update.covariance, contradiction=contradiction
    )
