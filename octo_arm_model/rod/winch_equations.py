"""The equations of tendons that winches hold at a length: tensions and shape together.

A winch has reeled in the length D of its tendon of axial stiffness k [N] and tension T >= 0 if

    D = L(unloaded) - L(z, T) + (integral of T over the unloaded length + T_base free length) / k

and the tendon is slack if D is less than this at T = 0. Newton's method solves the bordered system

    [ J   C ] [dz]   [-residual ]      C_ij = d residual_i / dT_j
    [-G   K ] [dT] = [D - reeled]      G_j = dL_j / dz,  K_j = d reeled_j / dT_j at fixed z

by elimination of dz. With the arm in balance, the derivative of the lengths reeled in by the
tensions is G J^-1 C + K. `complementary_step` finds from it which tendons are slack. Friction is
in J, C and K by the local tensions, which change with the tensions at the base and with z.

A tendon with friction that reverses slips next to its base first, so that the length reeled in
changes by the square of the change of its tension. But it is nearly proportional to the mean
tension. So steps are in mean tensions, and tensions at the base follow by the law of friction.
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

_LENGTH_WEIGHT = 10.0  # weight in the residual of errors of displacements over the length
_STIFFEST = 1e-6  # least compliance of a held tendon, over that with the arm
_STICKING = 1e-5  # part of a tendon that slips, below which it counts as sticking
_MOST_PASSES, _SAME_RATES = 8, 0.05  # passes to find rates over a step, and their tolerance
_LEAST_SECANT = 1e-9  # least change of a tension for a secant, over the largest tension
_FARTHEST = 4.0  # largest tension after a step, over those before and by Newton's method
_ROUNDING = 1e-13  # rounding error of displacements, over the length
_EXCHANGES = 40  # most exchanges of tendons between slack and taut in one step
_UNCERTAIN = 1e-4  # error of a step over the largest error before it


class BorderedSystem(NamedTuple):
    """The linearised equations of an arm with its winches."""

    z: FloatArray  #: twists that they are linearised about, or nearby, (N, m)
    factors: Linear  #: factors of the Jacobian
    by_tension: FloatArray  #: J^-1 C, minus the change of the twists by the tensions, (N m, J)
    lengths: FloatArray  #: G, (J, N m)
    changes: FloatArray  #: derivative of lengths reeled in by the tensions, (J, J) [m/N]
    rates: FloatArray  #: derivative of local tensions by those at the base at fixed twists, (N, J)
    #: derivative of lengths reeled in by local tensions, twists fixed, (N, J) [m/N]
    by_local: FloatArray
    #: derivatives of local tensions with friction; None if they do not change
    local: TensionDerivatives | None
    contradiction: float = 0.0  #: largest error of lengths that contradict each other [m]

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution (n,) or (n, k) for the sides ``right``, at fixed tensions."""
        return self.factors.solve(right)

    def reeled_in(self, twists: FloatArray) -> FloatArray:
        """Return the lengths reeled in (J, k) [m] by a change of the ``twists`` (N m, k)."""
        reeled = -self.lengths @ twists
        if self.local is not None:
            local = self.local.by_twists(twists.reshape(len(self.by_local), -1, twists.shape[1]))
            reeled += np.einsum('ij,ijk->jk', self.by_local, local)
        return reeled


class WinchEquations:
    """The equations of an arm and its winches at its nodes, for `continuation.newton`.

    Attributes:
        problem: the equations of the arm alone.
        others: loads that are not dead ones.
        turn: the rotation of the arm by a change of the twists, as in ``problem``.
        measure: weights of the squares of a step; zero for tensions, (N m + J,).
    """

    remembered = 4  # Where tendons reverse, the residual does not fall at every step.

    def __init__(self, problem: Problem, arm: Arm) -> None:
        """Add the winches of ``arm`` to the equations ``problem`` of the arm."""
        self.problem, self._arm = problem, arm
        self.others, self.turn = self.problem.others, self.problem.turn
        self._weights = self.problem.elements.weights
        self._unloaded = self.problem.rest_lengths
        count = self._unloaded.size
        self._free = arm.stretched(np.array(arm.free_length or np.zeros(count)))
        self._by_local = arm.stretched(self.problem.tendon_weights)
        self.measure = np.append(self.problem.measure, np.zeros(count))
        self._tolerance = Tolerance.of(arm.length, problem.friction is not None)

    def displacement(self, state: State) -> FloatArray:
        """Return the lengths reeled in, or that would make slack tendons taut [m], (J,)."""
        at_nodes, reeled = state.at_nodes, self._unloaded - self.problem.tendon_lengths(state)
        if self._arm.axial_stiffness:
            reeled += np.einsum('ij,ij->j', self._by_local, at_nodes.tensions)
            reeled += self._free * at_nodes.condition.tensions
        return np.asarray(reeled)

    def evaluate(self, condition: Condition, z: FloatArray, contradiction: float = 0.0) -> State:
        """Return the state of twists ``z`` (N, m) and the tensions of ``condition``.

        Its residual includes that of the lengths, less their ``contradiction`` [m].
        """
        state = self.balance(condition, z)
        reeled = self.displacement(state)
        wrong = np.where(condition.driven, condition.lengths - reeled, 0.0)
        counts = (condition.tensions > 0.0) | (wrong > 0.0)
        error = float(np.abs(wrong * counts).max(initial=0.0)) - contradiction
        residual = max(state.residual, _LENGTH_WEIGHT * error / self._arm.length)
        return state._replace(reeled=reeled, wrong=wrong, residual=residual)

    def balance(self, condition: Condition, z: FloatArray) -> State:
        """Return the state of the arm without the equations of the lengths."""
        return self.problem.evaluate(self.problem.at_nodes(condition), z)

    def linearise(
        self, state: State, factors: Linear | None = None, rates: FloatArray | None = None
    ) -> BorderedSystem:
        """Linearise at ``state``, by ``factors`` from nearby and `BorderedSystem.rates` if given.

        Raises:
            ConvergenceError: if the system is singular.
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
        # The lengths reeled in by local tensions at fixed twists.
        by_local = self._by_local - weights[:, np.newaxis] * tendons.stretch_by_tension
        local = problem.tension_derivatives(state)
        system = BorderedSystem(
            state.z, factors, by_tension, lengths, by_tension, rates, by_local, local
        )
        changes = system.reeled_in(-by_tension)
        changes += np.diag(np.einsum('ij,ij->j', by_local, rates) + self._free)
        if not (np.isfinite(changes).all() and changes.diagonal().all()):
            raise ConvergenceError('the displacement of the tendons', np.inf, 0)
        return system._replace(changes=changes)

    def _factors(self, state: State) -> Linear:
        problem, at_nodes = self.problem, state.at_nodes
        is_loaded = problem.follows or at_nodes.force.any() or at_nodes.couple.any()
        if is_loaded or self._arm.friction or problem.discs is not None:
            return problem.linearise(state)
        problem.compute_sections(state)
        return BlockFactors.of(problem.work.hessian)

    def rates(self, state: State) -> FloatArray:
        """Return `BorderedSystem.rates`; for a tendon that sticks, those once it slips."""
        rates, condition = self.problem.tension_rates(state), state.condition
        if condition.before is None or not condition.tensions.any():
            return rates
        angle = self.problem.local_tensions(state).angle
        slips = self.problem.tables.reach * np.exp(-self.problem.tables.friction * angle)
        return np.where(self._sticks(rates), slips, rates)

    def _sticks(self, rates: FloatArray) -> NDArray[np.bool_]:
        """Whether tendons whose local tensions change by ``rates`` (N, J) stick, (J,)."""
        return np.asarray(self._weights @ rates < _STICKING * self._unloaded)

    def step(self, state: State, system: Linear) -> tuple[FloatArray, BorderedSystem]:
        """Return Newton's step of twists and tensions, (N m + J,), and its linear system.

        The system has the rates of local tensions over this step.
        """
        condition = state.condition
        assert isinstance(system, BorderedSystem)
        at_fixed_tensions = system.solve(-state.imbalance.ravel())
        missing = state.wrong - system.reeled_in(at_fixed_tensions[:, np.newaxis])[:, 0]
        wrong = np.where(condition.driven, missing, 0.0)
        for passes in range(_MOST_PASSES):
            step, contradiction = complementary_step(
                system.changes, wrong, condition.tensions, condition.driven, self._tolerance
            )
            rates = self._secants(state, system, step)
            if np.abs(rates - system.rates).max() <= _SAME_RATES:
                break
            if passes > 1:  # tendons make each other reverse
                rates = 0.5 * (rates + system.rates)
            system = self.linearise(state, system.factors, rates)
        # The tension of a tendon that sticks does not change.
        step[self._tensions_after(state, system, step) == condition.tensions] = 0.0
        system = system._replace(contradiction=min(contradiction, self._tolerance.contradiction))
        return np.append(at_fixed_tensions - system.by_tension @ step, step), system

    def moved(self, state: State, step: FloatArray, system: Linear) -> State:
        """Return the ``state`` after a ``step`` (N m + J,) of twists and tensions."""
        assert isinstance(system, BorderedSystem)
        condition, size = state.condition, state.z.size
        condition = condition._replace(tensions=self._tensions_after(state, system, step[size:]))
        return self.evaluate(
            condition, state.z + step[:size].reshape(state.z.shape), system.contradiction
        )

    def _secants(self, state: State, system: BorderedSystem, step: FloatArray) -> FloatArray:
        """Return the mean rates of local tensions over a ``step`` (J,) of tensions."""
        friction, condition = self.problem.friction, state.condition
        tensions, before = condition.tensions, condition.before
        if friction is None or before is None:
            return system.rates
        change = self._tensions_after(state, system, step) - tensions
        angle, largest = self.problem.local_tensions(state).angle, float(tensions.max())
        local = friction.hold(tensions + change, before, angle).tensions
        change[np.abs(change) <= _LEAST_SECANT * largest] = np.nan
        secants = (local - state.at_nodes.tensions) / change
        is_defined = np.isfinite(change) & ~self._sticks(secants)
        return np.where(is_defined, secants, system.rates)

    def _tensions_after(
        self, state: State, system: BorderedSystem, step: FloatArray
    ) -> FloatArray:
        """Return the tensions (J,) [N] after a ``step`` (J,), in mean tensions with a history."""
        friction, condition = self.problem.friction, state.condition
        tensions, before = condition.tensions, condition.before
        new = np.maximum(tensions + step, 0.0)
        if friction is None or before is None:
            return new
        # The length that a tendon reels in per newton of its mean tension.
        compliance = system.changes.diagonal()
        per_mean = (compliance - self._free) / (self._weights @ system.rates)
        increase = np.abs(compliance * step) - _ROUNDING * self._arm.length
        integral = np.sign(step) * np.maximum(increase, 0.0) / per_mean
        angle, larger = self.problem.local_tensions(state).angle, np.maximum(tensions, new)
        by_mean = friction.pulled(tensions, before, angle, integral, self._free / per_mean)
        by_mean = np.minimum(by_mean, _FARTHEST * larger)
        return np.where((step == 0.0) | (new == 0.0) | ~(per_mean > 0.0), new, by_mean)

    def is_held(self, state: State, system: BorderedSystem) -> bool:
        """Whether the balance ``state``, with its ``system``, is stable while lengths are held.

        The energy then includes stiff springs for the lengths of taut tendons.
        """
        self.problem.fill_jacobian(state)
        variation, condition = self.problem.variation(), state.condition
        taut = condition.driven & (condition.tensions > 0.0)
        compliance = system.changes.diagonal()
        held_compliance = compliance - np.einsum('jn,nj->j', system.lengths, system.by_tension)
        least_compliance = np.maximum(held_compliance, _STIFFEST * np.abs(compliance))[taut]
        variation.add(system.lengths[taut] / np.sqrt(least_compliance)[:, np.newaxis])
        return variation.stability().is_stable


class RodWinchEquations(WinchEquations):
    """The equations of a `Rod` and its winches on one level of nodes."""

    def __init__(self, rod: Rod, level: int, problem: Problem | None = None) -> None:
        """Take the equations of ``rod`` on a ``level``, or the ``problem`` of another model."""
        super().__init__(problem or rod.problem(level), rod.arm)
        self._rod, self._level = rod, level

    def unloaded(self, condition: Condition) -> State:
        """Return the state under tensions alone; raise SolveError if there is no balance."""
        return self.balance(condition, self._rod.unloaded(self.problem, condition)[0])

    def is_resolved(self, state: State) -> bool:
        """Whether ``state`` is as accurate as the rod requires; SolveError on the last level."""
        return self._rod.is_resolved(state, self._level)

    @functools.cached_property
    def slack(self) -> tuple[State, BorderedSystem]:
        """The state of the arm without loads and tensions, and its linear system."""
        state = self.unloaded(Condition(np.zeros_like(self._unloaded), np.zeros(6), 0.0))
        return state, self.linearise(state)


# Which tendons are taut --------------------------------------------------------------------------


class Tolerance(NamedTuple):
    """The tolerances of lengths that do not determine tensions."""

    #: pivot over the largest, below which lengths do not determine tensions, because they do not
    #: distinguish tendons, or do so by friction alone
    singular: float
    #: error of the displacement up to which a slack tendon stays slack [m]. With less,
    #: antagonistic tendons would alternate between slack and taut.
    slack: float
    #: error up to which lengths may contradict each other [m]. Beyond it the tendon of least
    #: tension becomes slack.
    contradiction: float

    @classmethod
    def of(cls, length: float, has_friction: bool) -> Tolerance:
        """Return the tolerances for an arm of a ``length`` [m]."""
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
    """Return the step (J,) of ``tensions`` [N] that removes the errors ``wrong`` (J,) [m].

    ``changes`` (J, J) [m/N] are the derivatives of the lengths reeled in; the error of a tendon
    that is not ``driven`` is zero. This is a linear complementarity problem: every driven tendon
    is either taut with zero error, or slack with zero tension and an error within ``tolerance``.
    Principal pivoting exchanges the tendon that violates this most until none does. If errors do
    not determine the tensions of taut tendons, the step is the least one.

    Returns:
        The step, and the largest error of lengths that contradict each other [m].
    """
    taut = driven & (tensions > 0.0)
    largest_error = max(float(wrong.max()), -float((wrong * taut).min()), 0.0)
    uncertain = _UNCERTAIN * largest_error
    stays_slack = max(tolerance.slack, uncertain)
    if not taut.any():
        taut = driven & (wrong > stays_slack)
    size = np.abs(changes.diagonal())
    for _ in range(_EXCHANGES):
        step = np.where(taut | ~driven, 0.0, -tensions)
        right, contradiction = wrong - changes @ step, 0.0
        (index,) = taut.nonzero()
        if index.size:
            scale = 1.0 / np.sqrt(size[index])
            part, index_error = changes[index[:, np.newaxis], index], right[index]
            scaled = part * scale * scale[:, np.newaxis]
            factors, pivots, _ = dgetrf(scaled)
            pivot = np.abs(factors.diagonal())
            if pivot.min() > tolerance.singular * pivot.max():
                step[index] = scale * dgetrs(factors, pivots, scale * index_error)[0]
            else:
                least = np.linalg.lstsq(scaled, scale * index_error, rcond=tolerance.singular)[0]
                step[index] = scale * least
                contradiction = float(np.abs(part @ step[index] - index_error).max())
                if contradiction > max(tolerance.contradiction, uncertain):
                    taut[index[tensions[index].argmin()]] = False
                    continue
        new = tensions + step
        excess = np.where(taut, -size * new, wrong - changes @ step - stays_slack) * driven
        worst = excess.argmax()
        if not excess[worst] > 0.0:
            return step, contradiction
        taut[worst] = not taut[worst]
    return _quadratic_step(changes, wrong, tensions, driven), 0.0


def _quadratic_step(
    changes: FloatArray, wrong: FloatArray, tensions: FloatArray, driven: NDArray[np.bool_]
) -> FloatArray:
    """Return the `complementary_step` by a quadratic programme, with symmetric derivatives C.

    It minimises (T' - T) C (T' - T) / 2 - wrong (T' - T) over T' >= 0, where C = U^T U.
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
