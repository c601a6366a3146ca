"""Tendons that winches hold at a length: their tensions, found together with the shape.

A winch that has reeled in D leaves its tendon of axial stiffness k [N] under T >= 0 with

    D = L(unloaded) - L(z, T) + (integral of T over the unloaded length + T_base free length) / k

or, where D is less than that at T = 0, slack. Newton's method is that of the bordered system

    [ J   C ] [dz]   [-residual ]      C_ij = d residual_i / dT_j
    [-G   K ] [dT] = [D - reeled]      G_j = dL_j / dz,  K_j = d reeled_j / dT_j at fixed z

by elimination of dz: the derivative of what is reeled in by the tensions, with the arm in balance,
is G J^-1 C + K, and which tendons are slack follows from it; see `complementary_step`. Friction is
in J, C and K by the local tensions, which change with those at the base and with z.

Where a tendon with friction turns round, it slips next to its base first, so that it is reeled in
by the square of what its tension changes by. But that is nearly in proportion to its mean tension:
steps are those of mean tensions, from which those at the base follow by the law of friction.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs
from scipy.optimize import nnls

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConvergenceError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.equilibrium import Condition, Problem, State
from octo_arm_model.rod.factors import BlockFactors, Linear
from octo_arm_model.rod.friction import TensionDerivatives
from octo_arm_model.rod.rod import Rod

_LENGTHS = 10.0  # errors of displacements over the length of the arm count so many times
_STIFFEST = 1e-6  # compliance of a held tendon over what the arm gives way, at least
_STICKS = 1e-5  # part of a tendon that slips, below which all of it is taken to
_MOST_PASSES, _SAME_RATES = 8, 0.05  # for rates over a step, and when they are these
_LEAST_SECANT = 1e-9  # step that rates are taken over, over the largest tension
_FARTHEST = 4.0  # tension that a step may end at, over those around it
_ROUNDING = 1e-13  # of displacements, over the length
_EXCHANGES = 40  # of tendons between slack and taut in one step, at most
_UNSURE = 1e-4  # error of a step over the largest error before it


class BorderedSystem(NamedTuple):
    """A linearised arm with its winches; solves as its `Factors`, of tensions that are held.

    Attributes:
        z: twists that it is about, or nearby, (N, m).
        factors: of the Jacobian.
        by_tension: J^-1 C, what the twists give way by the tensions, (N m, J).
        lengths: G, (J, N m).
        changes: derivative of what is reeled in by the tensions, (J, J) [m/N].
        rates: derivative of local tensions by those at the base at fixed twists, (N, J).
        by_local: derivative of what is reeled in by local tensions at fixed twists, (N, J) [m/N].
        local: derivatives of local tensions with friction; None where they do not change.
        contradiction: error that lengths which contradict each other leave, the largest [m].
    """

    z: FloatArray
    factors: Linear
    by_tension: FloatArray
    lengths: FloatArray
    changes: FloatArray
    rates: FloatArray
    by_local: FloatArray
    local: TensionDerivatives | None
    contradiction: float = 0.0

    def solve(self, right: FloatArray) -> FloatArray:
        """See `Factors.solve`."""
        return self.factors.solve(right)

    def reeled_in(self, twists: FloatArray) -> FloatArray:
        """By a change of the ``twists`` (N m, k), (J, k) [m]."""
        found = -self.lengths @ twists
        if self.local is not None:
            local = self.local.by_twists(twists.reshape(len(self.by_local), -1, twists.shape[1]))
            found += np.einsum('ij,ijk->jk', self.by_local, local)
        return found


class WinchEquations:
    """The equations of an arm and its winches at its nodes, for `continuation.newton`.

    Attributes:
        problem: the equations of the arm alone.
        others: loads of other kinds.
        measure: see `Problem`; tensions do not count.
    """

    remembered = 4  # where tendons turn round residuals do not fall at every step

    def __init__(self, problem: Problem, arm: Arm) -> None:
        """Of ``arm`` at the nodes of ``problem``."""
        self.problem, self._arm = problem, arm
        self.others, self.turn = self.problem.others, self.problem.turn
        self._weights = self.problem.elements.weights
        self._rest = self._weights[:, np.newaxis] * self.problem.unloaded_tendons.stretch
        self._unloaded = self._rest.sum(axis=0)
        count = self._unloaded.size
        self._free = arm.stretched(np.array(arm.free_length or np.zeros(count)))
        self._by_local = arm.stretched(self._rest)
        self.measure = np.append(self.problem.measure, np.zeros(count))
        self._tolerance = Tolerance.of(arm.length, problem.friction is not None)

    def displacement(self, state: State) -> FloatArray:
        """What winches have reeled in in a ``state`` [m], (J,); of slack ones what makes taut."""
        at_nodes, lengths = state.at_nodes, self._weights @ self.problem.tendons(state).stretch
        reeled = self._unloaded - lengths
        if self._arm.axial_stiffness:
            reeled += np.einsum('ij,ij->j', self._by_local, at_nodes.tensions)
            reeled += self._free * at_nodes.condition.tensions
        return np.asarray(reeled)

    def evaluate(self, condition: Condition, z: FloatArray, contradiction: float = 0.0) -> State:
        """The state of twists ``z`` (N, m) and the tensions of ``condition``.

        Its residual is also that of lengths, less the ``contradiction`` of them [m].
        """
        state = self.balance(condition, z)
        reeled = self.displacement(state)
        wrong = np.where(condition.driven, condition.lengths - reeled, 0.0)
        counts = (condition.tensions > 0.0) | (wrong > 0.0)
        left = float(np.abs(wrong * counts).max(initial=0.0)) - contradiction
        residual = max(state.residual, _LENGTHS * left / self._arm.length)
        return state._replace(reeled=reeled, wrong=wrong, residual=residual)

    def balance(self, condition: Condition, z: FloatArray) -> State:
        """The state of the arm alone."""
        return self.problem.evaluate(self.problem.at_nodes(condition), z)

    def linearise(
        self, state: State, factors: Linear | None = None, rates: FloatArray | None = None
    ) -> BorderedSystem:
        """The system linearised at ``state``, or nearby where its ``factors`` are known.

        With `BorderedSystem.rates` other than those at ``state``, if given.

        Raises:
            ConvergenceError: if it is singular.
        """
        problem, weights = self.problem, self._weights
        rates = self.rates(state) if rates is None else rates
        problem.load_work(state)
        if factors is None:
            factors = self._factors(state)
        tendons = problem.tendons(state)
        pull = tendons.stretch_by_twist.swapaxes(1, 2)
        columns = (pull * rates[:, np.newaxis]).reshape(-1, rates.shape[1])
        by_tension = factors.solve(columns)
        lengths = (pull * weights[:, np.newaxis, np.newaxis]).reshape(columns.shape).T
        # What is reeled in by the local tensions, at fixed twists.
        by_local = self._by_local - weights[:, np.newaxis] * tendons.stretch_by_tension
        local = problem.tension_derivatives(state)
        system = BorderedSystem(
            state.z, factors, by_tension, lengths, by_tension, rates, by_local, local
        )
        changes = system.reeled_in(-by_tension)
        changes += np.diag(np.einsum('ij,ij->j', by_local, rates) + self._free)
        if not np.isfinite(changes).all():
            raise ConvergenceError('the displacement of the tendons', np.inf, 0)
        return system._replace(changes=changes)

    def _factors(self, state: State) -> Linear:
        problem, at_nodes = self.problem, state.at_nodes
        is_loaded = at_nodes.force.any() or at_nodes.couple.any() or problem.others.loads
        if is_loaded or self._arm.friction or problem.discs is not None:
            return problem.linearise(state)
        problem.form.sections(problem.tables, state.z, at_nodes.tensions, problem.work)
        return BlockFactors.of(problem.work.hessian)

    def rates(self, state: State) -> FloatArray:
        """See `BorderedSystem.rates`; of a tendon that sticks those that it has once it slips."""
        rates, condition = self.problem.tension_rates(state), state.condition
        if condition.before is None or not condition.tensions.any():
            return rates
        angle = self.problem.local_tensions(state).angle
        slips = self.problem.tables.reach * np.exp(-self.problem.tables.friction * angle)
        return np.where(self._sticks(rates), slips, rates)

    def _sticks(self, rates: FloatArray) -> NDArray[np.bool_]:
        """Whether tendons whose local tensions change by ``rates`` (N, J) stick, (J,)."""
        return np.asarray(self._weights @ rates < _STICKS * self._unloaded)

    def step(self, state: State, system: Linear) -> tuple[FloatArray, BorderedSystem]:
        """Newton's step of twists and tensions, (N m + J,), by a `BorderedSystem`.

        And the ``system`` of local tensions that change as they do over this step.
        """
        condition = state.condition
        assert isinstance(system, BorderedSystem)
        own = system.solve(-state.imbalance.ravel())
        lacks = state.wrong - system.reeled_in(own[:, np.newaxis])[:, 0]
        wrong = np.where(condition.driven, lacks, 0.0)
        for passes in range(_MOST_PASSES):
            step, contradiction = complementary_step(
                system.changes, wrong, condition.tensions, condition.driven, self._tolerance
            )
            rates = self._secants(state, system, step)
            if np.abs(rates - system.rates).max() <= _SAME_RATES:
                break
            if passes > 1:  # between tendons that make each other turn round
                rates = 0.5 * (rates + system.rates)
            system = self.linearise(state, system.factors, rates)
        # Of tendons that stick there is none.
        step[self._pulled(state, system, step) == condition.tensions] = 0.0
        system = system._replace(contradiction=min(contradiction, self._tolerance.contradiction))
        return np.append(own - system.by_tension @ step, step), system

    def moved(self, state: State, step: FloatArray, system: Linear) -> State:
        """The ``state`` after a `step`."""
        assert isinstance(system, BorderedSystem)
        condition, size = state.condition, state.z.size
        condition = condition._replace(tensions=self._pulled(state, system, step[size:]))
        return self.evaluate(
            condition, state.z + step[:size].reshape(state.z.shape), system.contradiction
        )

    def _secants(self, state: State, system: BorderedSystem, step: FloatArray) -> FloatArray:
        """Mean of `BorderedSystem.rates` over a ``step`` (J,) of tensions with a history."""
        friction, condition = self.problem.friction, state.condition
        tensions, before = condition.tensions, condition.before
        if friction is None or before is None:
            return system.rates
        change = self._pulled(state, system, step) - tensions
        angle, least = self.problem.local_tensions(state).angle, float(tensions.max())
        local = friction.hold(tensions + change, before, angle).tensions
        change[np.abs(change) <= _LEAST_SECANT * least] = np.nan
        found = (local - state.at_nodes.tensions) / change
        is_known = np.isfinite(change) & ~self._sticks(found)
        return np.where(is_known, found, system.rates)

    def _pulled(self, state: State, system: BorderedSystem, step: FloatArray) -> FloatArray:
        """Tensions (J,) [N] after a ``step`` (J,), of tendons with a history one of their mean."""
        friction, condition = self.problem.friction, state.condition
        tensions, before = condition.tensions, condition.before
        new = np.maximum(tensions + step, 0.0)
        if friction is None or before is None:
            return new
        # What a tendon reels in by its own local tensions, per newton of their mean, and besides.
        give = system.changes.diagonal()
        per_mean = (give - self._free) / (self._weights @ system.rates)
        wanted = np.abs(give * step) - _ROUNDING * self._arm.length
        more = np.sign(step) * np.maximum(wanted, 0.0) / per_mean
        angle, most = self.problem.local_tensions(state).angle, np.maximum(tensions, new)
        far = friction.pulled(tensions, before, angle, more, self._free / per_mean)
        far = np.minimum(far, _FARTHEST * most)
        return np.where((step == 0.0) | (new == 0.0) | ~(per_mean > 0.0), new, far)

    def is_held(self, state: State, system: BorderedSystem) -> bool:
        """Whether the balance ``state``, with its ``system``, is stable while lengths are held.

        The energy then has that of the lengths of taut tendons, as stiff ones, besides.
        """
        self.problem.fill_jacobian(state)
        variation, condition = self.problem.variation(), state.condition
        taut = condition.driven & (condition.tensions > 0.0)
        give = system.changes.diagonal()
        own = give - np.einsum('jn,nj->j', system.lengths, system.by_tension)
        soft = np.maximum(own, _STIFFEST * np.abs(give))[taut]
        variation.add(system.lengths[taut] / np.sqrt(soft)[:, np.newaxis])
        return variation.stability().is_stable


class RodWinchEquations(WinchEquations):
    """Of a `Rod`."""

    def __init__(self, rod: Rod, level: int, problem: Problem | None = None) -> None:
        """Of ``rod`` on a ``level``, or by a model of its arm with a ``problem`` of its own."""
        super().__init__(problem or rod.problem(level), rod.arm)
        self._rod, self._level = rod, level

    def unloaded(self, condition: Condition) -> State:
        """Of the arm under tensions alone, to begin with; a `SolveError` if there is none."""
        return self.balance(condition, self._rod.unloaded(self.problem, condition)[0])

    def is_resolved(self, state: State) -> bool:
        """See `Rod.is_resolved`."""
        return self._rod.is_resolved(self.problem, state, self._level)

    @functools.cached_property
    def slack(self) -> tuple[State, BorderedSystem]:
        """Of the arm without loads whose tendons are all slack."""
        state = self.unloaded(Condition(np.zeros_like(self._unloaded), np.zeros(6), 0.0))
        return state, self.linearise(state)


# Which tendons are taut --------------------------------------------------------------------------


class Tolerance(NamedTuple):
    """What displacements do not tell of tensions.

    Attributes:
        singular: pivot over the largest, below which tensions are not determined: of tendons
            that lengths do not tell apart, or that friction alone does.
        slack: error of the displacement up to which a slack tendon stays slack [m]. With less,
            antagonistic tendons would alternate between slack and taut.
        contradiction: by how much lengths may contradict each other [m]; where they do by more,
            the tendon of least tension becomes slack.
    """

    singular: float
    slack: float
    contradiction: float

    @classmethod
    def of(cls, length: float, has_friction: bool) -> Tolerance:
        """Of an arm of a ``length`` [m]."""
        if has_friction:
            return cls(1e-5, 1e-10 * length, 1e-6 * length)
        return cls(1e-10, 1e-10 * length, 1e-10 * length)


def complementary_step(
    changes: FloatArray,
    wrong: FloatArray,
    tensions: FloatArray,
    driven: NDArray[np.bool_],
    tolerance: Tolerance,
) -> tuple[FloatArray, float]:
    """Step (J,) of ``tensions`` [N] that takes out what is ``wrong`` (J,) [m].

    By the derivatives ``changes`` (J, J) [m/N] of what is reeled in; nothing is wrong where a
    tendon is not ``driven``. A linear complementarity problem: every ``driven`` tendon is taut,
    its error zero, or slack, its tension zero and its error at most as the ``tolerance`` says. By
    principal pivoting the tendon that violates this most is exchanged until none does. Where
    errors do not determine the tensions of taut tendons the least change is taken.

    Returns:
        The step, and the largest error that lengths which contradict each other leave [m].
    """
    taut = driven & (tensions > 0.0)
    left = max(float(wrong.max()), -float((wrong * taut).min()), 0.0)
    unsure = _UNSURE * left
    stays_slack = max(tolerance.slack, unsure)
    if not taut.any():
        taut = driven & (wrong > stays_slack)
    size = np.abs(changes.diagonal())
    for _ in range(_EXCHANGES):
        step = np.where(taut | ~driven, 0.0, -tensions)
        right, contradiction = wrong - changes @ step, 0.0
        (index,) = taut.nonzero()
        if index.size:
            scale = 1.0 / np.sqrt(size[index])
            part, own = changes[index[:, np.newaxis], index], right[index]
            scaled = part * scale * scale[:, np.newaxis]
            factors, pivots, _ = dgetrf(scaled)
            pivot = np.abs(factors.diagonal())
            if pivot.min() > tolerance.singular * pivot.max():
                step[index] = scale * dgetrs(factors, pivots, scale * own)[0]
            else:
                least = np.linalg.lstsq(scaled, scale * own, rcond=tolerance.singular)[0]
                step[index] = scale * least
                contradiction = float(np.abs(part @ step[index] - own).max())
                if contradiction > max(tolerance.contradiction, unsure):
                    taut[index[tensions[index].argmin()]] = False
                    continue
        new = tensions + step
        excess = np.where(taut, -size * new, wrong - changes @ step - stays_slack) * driven
        worst = excess.argmax()
        if not excess[worst] > 0.0:
            return step, contradiction
        taut[worst] = not taut[worst]
    return _least(changes, wrong, tensions, driven), 0.0


def _least(
    changes: FloatArray, wrong: FloatArray, tensions: FloatArray, driven: NDArray[np.bool_]
) -> FloatArray:
    """The same by the quadratic programme of which it is the condition, of a symmetric part.

    Least (T' - T) C (T' - T) / 2 - wrong (T' - T) over T' >= 0, for C = U^T U.
    """
    (index,) = driven.nonzero()
    part = changes[np.ix_(index, index)]
    values, vectors = np.linalg.eigh(0.5 * (part + part.T))
    if not values[-1] > 0.0:
        raise ConvergenceError('the displacement of the tendons', np.inf, 0)
    root = np.sqrt(np.maximum(values, 1e-10 * values[-1]))
    goal = (vectors.T @ wrong[index]) / root + root * (vectors.T @ tensions[index])
    step = np.zeros_like(tensions)
    step[index] = nnls(root[:, np.newaxis] * vectors.T, goal)[0] - tensions[index]
    return step
