"""A bank of hypotheses about which sensors are wrong.

Each hypothesis is a normal distribution of the state, and a set of sensors that it does not use:
none, one load cell, one other sensor, or all load cells (multiple-model adaptive estimation for
failures of sensors, Maybeck 1999). Its contradiction is the sum of the normalised squares of its
innovations beyond the expected ones, and decays in half a second. Determinants of covariances are
left out, as usual there, so that a less exact prediction does not make a hypothesis less probable.
A hypothesis that no measurement contradicts stays as probable as before. The published covariance
is that of the mixture: if other sensors cannot decide whether a load cell is right, it contains
the states in which the load cell is wrong.

All hypotheses are updated about shapes that are solved already. Then the shape of the most
probable one is solved, which may make it less so; then that of the next one, while `Work` is left.

If a hypothesis doubts a load cell whose tension no other measurement determined yet, as at the
start, the arm may be far from all solved shapes. There a linear update says nothing about the
hypothesis. It is open: it keeps its prior as its covariance until the search for its shape. So is
the hypothesis that doubts nothing while all load cells are doubted, as tensions drift then.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.gaussian import Gaussian, square_of
from octo_arm_model.estimation.measurement import Rows
from octo_arm_model.estimation.measurements import LOAD_CELL
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.posterior import Fit, agree, nearest_possible
from octo_arm_model.estimation.rules import Doubts, Rules, channels_of

_MEMORY = 0.5  # time constant in which contradictions decay [s]
_EXPECTED = 2.0  # normalised square of a number, beyond which it contradicts
_MOST = 16.0  # largest contradiction of a hypothesis [nat]; it decays in three times _MEMORY
CONTRADICTED = 8.0  # contradiction from which a hypothesis restarts from the leader's state
_LATELY = 1000  # number of updates over which agreements are averaged
_HYSTERESIS = 1.0  # by which another hypothesis has to be more probable than the leader [nat]
_FAR = 0.02  # displacement of the tip from which an open hypothesis is searched, over the length
_START_FRACTIONS = 0.1, 0.3, 0.7  # unknown tensions to search from, over the prior's deviation
_SEARCH_EVALUATIONS = 5  # evaluations that have to be left for a search from there
_UNCONVERGED = 2.0  # factor on the gate for the square of a search that did not converge
_PROGRESS = 0.25  # largest ratio of squares after to before a search that is progress
_RESOLUTION = 1e-14  # least ratio of the deviation of a measurement to the predicted one
_NO_DOUBTS: Doubts = frozenset()


class Bank(NamedTuple):
    """The hypotheses about the sensors of one arm."""

    doubts: tuple[Doubts, ...]  #: sensors that each hypothesis does not use
    mean: FloatArray  #: mean of the state by each, (hypotheses, n)
    covariance: FloatArray  #: covariance of the state by each, (hypotheses, n, n)
    contradiction: FloatArray  #: contradiction of each [nat], (hypotheses,)
    leader: int  #: index of the most probable one, whose state is published
    heard: Doubts  #: sensors that have measured so far
    #: mean ratio of the bias that innovations caused in the mode to the expected one, and the
    #: inverse of its variance; 0 +- 1 before any
    agreement: tuple[float, float]
    #: which are not compared near their own shape yet: they doubt a load cell, or use all of them
    #: again
    is_open: NDArray[np.bool_]

    @property
    def leading(self) -> Gaussian:
        """The distribution of the state by the leader."""
        return self.hypothesis(self.leader)

    @property
    def shift_weight(self) -> float:
        """Weight of the correction from mode to mean, 0 to 1."""
        return min(max(0.0, self.agreement[0]), 1.0)

    def agreement_after(self, ratio: float, information: float) -> tuple[float, float]:
        """Return `agreement` after one more ``ratio`` with this inverse variance."""
        value, known = self.agreement
        if not information:
            return self.agreement
        total = (1.0 - 1.0 / _LATELY) * known + information
        return value + information / total * (ratio - value), total

    def hypothesis(self, number: int) -> Gaussian:
        """Return the distribution of the state by one hypothesis."""
        return Gaussian.of(self.mean[number], self.covariance[number])

    def after(self, model: ArmModel, elapsed: float) -> Bank:
        """Return the hypotheses ``elapsed`` [s] later."""
        decay, growth = model.state.decay(elapsed), model.state.growth(elapsed)
        covariance = np.outer(decay, decay) * self.covariance + np.diag(growth**2)
        contradiction = math.exp(-elapsed / _MEMORY) * self.contradiction
        return self._replace(
            mean=decay * self.mean, covariance=covariance, contradiction=contradiction
        )


def new_bank(model: ArmModel) -> Bank:
    """Return a bank of one hypothesis, which uses all sensors and has the prior of ``model``."""
    mean, root = model.state.prior
    is_open = np.zeros(1, dtype=bool)
    covariance = (root**2)[np.newaxis]
    none, agreement = _NO_DOUBTS, (0.0, 1.0)
    return Bank((none,), mean[np.newaxis], covariance, np.zeros(1), 0, none, agreement, is_open)


class BankUpdate(NamedTuple):
    """The update of every hypothesis by some measurements."""

    mean: FloatArray  #: mean of the state after them, (hypotheses, n)
    covariance: FloatArray  #: covariance of the state after them, (hypotheses, n, n)
    is_used: NDArray[np.bool_]  #: which numbers each hypothesis used, (hypotheses, m)
    cost: FloatArray  #: contradiction of each by the measurements [nat], (hypotheses,)
    innovation: FloatArray  #: measured less predicted before, (hypotheses, m)
    expected: FloatArray  #: expected covariance of the innovation, (hypotheses, m, m)
    square: FloatArray  #: normalised square of all numbers that each used, (hypotheses,)


class BankFilter:
    """The update of the hypotheses of one arm by the measurements of one time.

    Attributes:
        model: the model of the arm.
        cells: names of its load cells.
    """

    def __init__(self, model: ArmModel, rules: Rules) -> None:
        """Prepare the update for a ``model`` by ``rules``."""
        self.model, self._rules = model, rules
        names = model.arm.tendon_names
        # Component of the state with the tension of each load cell.
        self._tension = {f'{LOAD_CELL} {name}': index for index, name in enumerate(names)}
        self.cells = frozenset(self._tension)
        self._prior = model.state.prior_stddev()

    def with_linear(self, bank: Bank, rows: Rows, near: Prediction) -> tuple[Bank, BankUpdate]:
        """Update all hypotheses by ``rows`` that are linear; ``near`` is of any state."""
        update = self._linearised(bank, rows, near)
        expected = update.expected[bank.leader].diagonal()
        if (rows.noise.diagonal() < _RESOLUTION**2 * expected).any():
            raise np.linalg.LinAlgError('a measurement is far more exact than its prediction')
        return _updated(bank, update), update

    def with_leader(self, bank: Bank, prediction: Prediction) -> tuple[Bank, Prediction]:
        """Make the most probable hypothesis the leader, with tensions >= 0, and get its shape."""
        total = bank.contradiction + self._improbability(bank)
        total[bank.is_open] = np.inf  # the search for their means is still to be done
        total[bank.leader] -= _HYSTERESIS
        leader = int(total.argmin())
        means = bank.mean.copy()
        means[leader] = mean = nearest_possible(self.model, bank.hypothesis(leader))
        # If no work is left, the shape nearby is moved to the mean to first order.
        if prediction.work.is_left() or prediction.shape is None:
            prediction = prediction.solved_at(mean)
        return bank._replace(mean=means, leader=leader), prediction

    def with_shapes(
        self, bank: Bank, rows: Rows, prediction: Prediction, *, is_new: bool
    ) -> tuple[Bank, BankUpdate, Prediction]:
        """Update all hypotheses by ``rows``, the most probable one about its own shape.

        If the estimate ``is_new``, this shape is searched from the prior alone.

        Raises:
            SolveError: if there is no trustworthy shape.
        """
        total = bank.contradiction + self._improbability(bank)
        total[bank.leader] -= _HYSTERESIS
        # If the leader is contradicted and others are open, most work is left for them.
        is_lost = bool(bank.contradiction[bank.leader] >= CONTRADICTED and bank.is_open.any())
        # The leader's shape is solved first, and no sensor is doubted before: a linear guess far
        # from the expected shape, as after a sudden touch, is too inaccurate for that.
        best, exact, is_open = bank.leader, dict[int, Fit](), bank.is_open.copy()
        update: BankUpdate | None = None
        share = (prediction.work.evaluations + 1) // 2  # of one hypothesis among several
        while True:
            most = 1 if is_lost and not exact else share
            start = self._nearest(bank, best, rows, prediction) if is_open[best] else prediction
            is_first = is_new and not is_open[best]
            try:
                exact[best], solved = self._fit(bank, best, rows, start, most, is_new=is_first)
            except SolveError:
                total[best], is_open[best] = np.inf, False
                if not np.isfinite(total).any() or not (exact or prediction.work.is_left()):
                    raise
                update = update or self._linearised(bank, rows, prediction)
            else:
                if update is None:
                    is_alone = len(bank.doubts) == 1
                    update = solved if is_alone else self._linearised(bank, rows, prediction)
                for values, own_values in zip(update, solved, strict=True):
                    values[best] = own_values[0]
            # A cost that overflowed is no reason to solve again what has no shape.
            best = int(np.where(np.isinf(total), np.inf, total + update.cost).argmin())
            if best not in exact and not (exact and (is_lost or not prediction.work.is_left())):
                continue
            # Then those of the open ones whose shapes are far from that.
            displacement = (update.mean - prediction.x) @ prediction.change.tip[:3].T
            is_far = np.linalg.norm(displacement, axis=1) > _FAR * self.model.arm.length
            is_open &= is_far | (update.cost >= CONTRADICTED)
            is_open[list(exact)] = False
            if not is_open.any() or prediction.work.evaluations < _SEARCH_EVALUATIONS:
                break
            best = int(is_open.argmax())
        # What is open still, or has no shape that was found, keeps its prior.
        same = is_open | (bank.is_open & np.isinf(total))
        update.mean[same], update.covariance[same] = bank.mean[same], bank.covariance[same]
        update.is_used[same], update.cost[same] = False, 0.0
        total += update.cost
        best = min(exact, key=lambda number: float(total[number]))
        agreement = bank.agreement_after(*exact[best].ratio)
        bank = _updated(bank, update)._replace(leader=best, agreement=agreement, is_open=is_open)
        return bank, update, exact[best].prediction

    def _nearest(self, bank: Bank, number: int, rows: Rows, near: Prediction) -> Prediction:
        """Return the best of ``near`` and states with some values of a doubted tension."""
        doubted = [self._tension[name] for name in bank.doubts[number] & self.cells]
        x = nearest_possible(self.model, bank.hypothesis(number))
        best, least = near, square_of(rows.innovation(near), rows.noise_root)
        for fraction in _START_FRACTIONS[: None if doubted else 1]:
            x = x.copy()
            x[doubted] = fraction * self._prior[doubted]
            try:
                near = near.solved_at(x)
                square = square_of(rows.innovation(near), rows.noise_root)
            except SolveError:
                break
            if square < least:
                best, least = near, square
        return best

    def _linearised(
        self, bank: Bank, rows: Rows, near: Prediction, is_used: NDArray[np.bool_] | None = None
    ) -> BankUpdate:
        """Update all hypotheses, linearised about ``near``, by what ``is_used`` or the gate."""
        jacobian, channels = rows.jacobian(near), channels_of(rows.channels(near))
        innovation = rows.innovation(near) + (near.x - bank.mean) @ jacobian.T
        across = jacobian @ bank.covariance
        expected = across @ jacobian.T + rows.noise
        squares, limits = channels.squares(innovation, expected), channels.limits(self._rules.gate)
        is_doubted = np.array([channels.is_in(doubts) for doubts in bank.doubts])
        if is_used is None:
            is_used = ~is_doubted & (squares <= limits)
        # Numbers that are not used have a covariance of noise alone.
        used_rows = is_used[..., np.newaxis]
        noise = ~used_rows * np.diag(rows.noise.diagonal())
        across, residual = used_rows * across, (is_used * innovation)[..., np.newaxis]
        used = used_rows * expected * is_used[:, np.newaxis] + noise
        solved = np.linalg.solve(used, np.concatenate([across, residual], axis=-1))
        gain, square = solved[..., :-1], (solved[..., -1:] * residual).sum(axis=(1, 2))
        mean = bank.mean + (gain * residual).sum(axis=1)
        # Joseph's form is accurate even if measurements are far more exact than the prior.
        covariance = bank.covariance - gain.swapaxes(-1, -2) @ across
        gained = jacobian @ covariance * used_rows
        covariance += (rows.noise @ gain - gained).swapaxes(-1, -2) @ gain
        covariance = 0.5 * (covariance + covariance.swapaxes(-1, -2))
        cost = np.maximum(0.0, 0.5 * (square - _EXPECTED * is_used.sum(axis=-1)))
        # Each refused sensor adds its own square, at least that of the gate.
        refused = np.minimum(0.5 * np.maximum(squares, limits), _MOST) / channels.counts
        cost += np.where(~is_used & ~is_doubted, refused, 0.0).sum(axis=-1)
        return BankUpdate(mean, covariance, is_used, cost, innovation, expected, square)

    def _fit(
        self, bank: Bank, number: int, rows: Rows, near: Prediction, most: int, *, is_new: bool
    ) -> tuple[Fit, BankUpdate]:
        """Update one hypothesis by ``rows``, linearised about its own shape after them.

        Each search from the shape ``near`` has at most ``most`` evaluations.
        """
        prior, channels = bank.hypothesis(number), channels_of(rows.channels(near))
        single = bank._replace(
            doubts=bank.doubts[number : number + 1],
            mean=bank.mean[[number]],
            covariance=bank.covariance[[number]],
        )
        is_used, limits = ~channels.is_in(bank.doubts[number]), channels.limits(self._rules.gate)
        start, spared = near, 0
        while True:
            if len(bank.doubts) > 1:  # the rest of the work is for the others
                left = near.work.evaluations
                spared = max(left - min(most, max(left - 1, 1)), 0)
            rows_used = rows.subset(np.flatnonzero(is_used))
            fit = agree(prior, rows_used, bank.shift_weight, near, spared, is_new=is_new)
            near, is_new = fit.prediction, False
            update = self._linearised(single, rows, near, is_used[np.newaxis])
            squares = channels.squares(update.innovation, update.expected)[0]
            is_refused = is_used & (squares > limits)
            if not fit.is_converged:
                # The squares are not exact then. If the search made no progress, all is refused.
                square, square_before = (
                    square_of(rows_used.innovation(point), rows_used.noise_root)
                    + np.array([0.0, square_of(point.x - prior.mean, prior.root)])
                    for point in (near, start)
                )
                is_diverged = square[0] > limits.max() and square[1] > _PROGRESS * square_before[1]
                is_refused = is_used & ((squares > _UNCONVERGED * limits) | is_diverged)
            if not is_refused.any():
                break
            is_used = is_used & ~is_refused
        covariance = (fit.known.root @ fit.known.root.T)[np.newaxis]
        return fit, update._replace(mean=fit.known.mean[np.newaxis], covariance=covariance)

    def with_suspected_sensors(self, bank: Bank, heard: Doubts) -> Bank:
        """Return the ``bank`` with hypotheses that one of the sensors ``heard`` is wrong.

        Load cells are suspected once another sensor is heard, which can show their errors.
        """
        sensors = bank.heard | heard
        is_same, bank = sensors == bank.heard, bank._replace(heard=sensors)
        if is_same or not self._rules.doubts_any or sensors <= self.cells:
            return bank
        return self._neighbours(bank, bank.doubts[bank.leader])

    def without_contradicted(self, bank: Bank) -> Bank:
        """Restart contradicted hypotheses from the state of the leader."""
        if len(bank.doubts) == 1:
            return bank
        doubts, cells = bank.doubts[bank.leader], self.cells
        is_single = len(doubts & cells) == len(doubts) == 1
        is_lost = bank.contradiction >= CONTRADICTED
        if is_lost[bank.leader] and is_single and not bank.is_open.any():
            # One wrong load cell does not explain the measurements, but two may.
            bank = self._neighbours(bank, doubts)
            is_lost = bank.contradiction >= CONTRADICTED
        is_lost |= np.array([names == cells for names in bank.doubts])
        is_lost[bank.leader] = False
        if not is_lost.any():
            return bank
        mean, covariance, leader = bank.mean.copy(), bank.covariance.copy(), bank.leader
        mean[is_lost], covariance[is_lost] = mean[leader], covariance[leader]
        bank = bank._replace(mean=mean, covariance=covariance)
        if doubts == self.cells:
            # Tensions drifted, so that the shape by the load cells may be far from the leader's.
            # What contradicted the states before does not count against the new ones.
            most = np.where(is_lost, CONTRADICTED, np.inf)
            bank = bank._replace(
                contradiction=np.minimum(bank.contradiction, most),
                is_open=bank.is_open | (is_lost & [not names for names in bank.doubts]),
            )
        return self._widened(bank, is_lost)

    def doubted_and_suspects(
        self, bank: Bank, *, is_common: bool
    ) -> tuple[Doubts, tuple[str, ...]]:
        """Return doubted sensors that are probably wrong; if none is, those of which one is.

        If it ``is_common``, see `CommonFault`, a sensor that contradicts the others may be the one
        that is right. Then only load cells are called wrong.
        """
        doubted = bank.doubts[bank.leader] & bank.heard
        if not doubted:
            return _NO_DOUBTS, ()
        weight, suspects = self._weight(bank), []
        sensors = sorted(bank.heard.intersection(frozenset().union(*bank.doubts)))
        doubting = {name: np.array([name in names for names in bank.doubts]) for name in sensors}
        possible = doubted & self.cells if is_common else doubted
        refused = frozenset(name for name in possible if weight[doubting[name]].sum() > 0.5)
        # Hypotheses that doubt only sensors which have not measured name none.
        remaining = weight * np.any(list(doubting.values()), axis=0)
        half = 0.5 * remaining.sum()
        while not refused and remaining.sum() >= half:
            suspects.append(max(sensors, key=lambda name: float(remaining[doubting[name]].sum())))
            remaining[doubting[suspects[-1]]] = 0.0
        return refused, tuple(suspects)

    def mixture(self, bank: Bank) -> Gaussian:
        """Return the leader's mean, with the covariance of the mixture of all hypotheses."""
        if len(bank.doubts) == 1:
            return bank.leading
        center = bank.mean[bank.leader]
        return Gaussian.mixture(center, self._weight(bank), bank.mean, bank.covariance)

    def _improbability(self, bank: Bank) -> FloatArray:
        """Return -ln of the prior probability of every hypothesis [nat], (hypotheses,)."""
        return np.array([self._rules.improbability(doubts, self.cells) for doubts in bank.doubts])

    def _weight(self, bank: Bank) -> FloatArray:
        """Return the probability of every hypothesis, (hypotheses,)."""
        total = bank.contradiction + self._improbability(bank)
        weight = np.exp(total.min() - total)
        return np.asarray(weight / weight.sum())

    def _neighbours(self, bank: Bank, root: Doubts) -> Bank:
        """Return the hypotheses with one doubt more or less than ``root``."""
        rules, leading = self._rules, bank.doubts[bank.leader]
        # Hypotheses about cells that have not measured widen the search where none does.
        suspects = sorted(self.cells) if rules.cell_fault else []
        all_cells = [self.cells] if suspects else []
        if rules.sensor_fault and not root:
            # All other sensors are not doubted at once: then the state of the arm is wrong.
            suspects += sorted(bank.heard - self.cells)
        sets = [root, leading, _NO_DOUBTS, *(root - {name} for name in sorted(root))]
        sets += [*(root | {name} for name in suspects), *all_cells]
        doubts = tuple(dict.fromkeys(sets))
        numbers = {names: number for number, names in enumerate(bank.doubts)}
        sources = [numbers.get(names, bank.leader) for names in doubts]
        is_new = np.array([names not in numbers for names in doubts])
        is_cell = np.array([len(names) == len(names & self.cells) == 1 for names in doubts])
        neighbours = bank._replace(
            doubts=doubts,
            mean=bank.mean[sources],
            covariance=bank.covariance[sources],
            contradiction=bank.contradiction[sources],
            leader=doubts.index(leading),
            is_open=np.where(is_new, is_cell & (not root), bank.is_open[sources]),
        )
        return self._widened(neighbours, is_new)

    def _widened(self, bank: Bank, is_new: NDArray[np.bool_]) -> Bank:
        """Return the ``bank``, whose new hypotheses forget what their doubted sensors measured."""
        leader_doubts, state = bank.doubts[bank.leader], self.model.state
        is_forgotten = np.zeros(bank.mean.shape, dtype=bool)
        for number in np.flatnonzero(is_new):
            doubts = bank.doubts[number]
            for name in () if doubts == self.cells else doubts - leader_doubts:
                # The external loads follow from this sensor first.
                is_forgotten[number, state.tip_force.start : state.current.stop] = True
                if name in self.cells:
                    is_forgotten[number, self._tension[name]] = True
            if leader_doubts == self.cells != doubts:
                # The leader does not know the tensions, which load cells measure again.
                is_forgotten[number, state.tension] = True
        prior = (is_forgotten * self._prior**2)[..., np.newaxis] * np.eye(state.size)
        return bank._replace(covariance=bank.covariance + prior)


def _updated(bank: Bank, update: BankUpdate) -> Bank:
    """Return the ``bank`` after an ``update``."""
    contradiction = np.minimum(bank.contradiction + update.cost, _MOST)
    return bank._replace(
        mean=update.mean, covariance=update.covariance, contradiction=contradiction
    )
