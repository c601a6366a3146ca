"""Tendons that winches hold at a length: their tensions, found together with the shape.

A winch that has reeled in D leaves its tendon of axial stiffness k [N] under T >= 0 with

    D = L(unloaded) - L(z, T) + (integral of T over the unloaded length + T_base free length) / k

or, where D is less than that at T = 0, slack. Newton's method is that of the bordered system

    [ J   C ] [dz]   [-residual ]      C_ij = d residual_i / dT_j
    [-G   K ] [dT] = [D - reached]     G_j = dL_j / dz,  K_j = d reached_j / dT_j at fixed z

by elimination of dz: the derivative of what is reeled in by the tensions, with the arm in balance,
is G J^-1 C + K, and which tendons are slack follows from it; see `complementarity`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.budget import Spending
from octo_arm_model.arm.errors import ContinuationError, ConvergenceError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.checks import check_solution
from octo_arm_model.rod.complementarity import complementary_step
from octo_arm_model.rod.continuation import MOST_CORRECTED, ON_THE_WAY, growth, judge
from octo_arm_model.rod.equilibrium import Condition, State
from octo_arm_model.rod.factors import Blocks, Linear
from octo_arm_model.rod.lengths import rest_stretches
from octo_arm_model.rod.newton import (
    CHORD,
    FIRST,
    LINEAR_PROGRESS,
    MOST,
    MOST_LINEAR,
    PREDICTED,
    PROGRESS,
    Chord,
)
from octo_arm_model.rod.rod import Equilibrium, Rod, moved
from octo_arm_model.rod.tendons import Tendons

TOLERANCE = 1e-10  # residual of the balance
MET = 1e-9  # error of displacements over the length, and of tensions over the largest
_ROUGHLY = 3e-5  # the same of displacements on the way
ROUNDING = 1e-13  # of displacements, over the length
# Of continuation, see `rod.continuation`: the first step, the smallest, iterations of one that may
# grow, and factors on one that was not accepted or not found.
_FIRST_STEP, _SMALLEST_STEP, _QUICKLY, _SHORTER, _MUCH_SHORTER = 0.3, 1e-3, 5, 0.7, 0.25
_SMALLEST_LOAD = 0.03  # where loads begin to act
_SERVED = 3  # steps up to which a border from nearby will do for the next search too
_BEYOND = 0.05  # the end of a branch
_MOST_JUMPS = 4  # to what an arm whose branch ends turns to under tensions that are held
_STIFFEST = 1e-6  # compliance of a held tendon over what the arm gives way, at least


class Aim(NamedTuple):
    """What is to be held.

    Attributes:
        condition: what acts on the arm; its tensions are those of tendons that are not driven.
        displacements: reeled in [m], (J,); they count where a tendon is driven.
        driven: whether winches hold the length of a tendon, else its tension, (J,).
    """

    condition: Condition
    displacements: FloatArray
    driven: NDArray[np.bool_]

    def towards(self, other: Aim, part: float) -> Aim:
        """This one, moved by ``part`` of the way to ``other``."""
        if part == 1.0:
            return other
        reeled = self.displacements + part * (other.displacements - self.displacements)
        return Aim(self.condition.towards(other.condition, part), reeled, other.driven)

    def begin(self, tensions: FloatArray) -> FloatArray:
        """Those of ``tensions`` (J,) [N] that are to be found, and the given ones."""
        return np.where(self.driven, tensions, self.condition.tensions)


class Border(NamedTuple):
    """A linearised arm with its winches; solves as its `Factors`, of tensions that are held.

    Attributes:
        factors: of the Jacobian.
        by_tension: J^-1 C, what the twists give way by the tensions, (N m, J).
        lengths: G, (J, N m).
        changes: derivative of what is reeled in by the tensions, (J, J) [m/N].
    """

    factors: Linear
    by_tension: FloatArray
    lengths: FloatArray
    changes: FloatArray

    def solve(self, right: FloatArray) -> FloatArray:
        """See `Factors.solve`."""
        return self.factors.solve(right)


class Reached(NamedTuple):
    """A state, and what its winches have reeled in.

    Attributes:
        state: twists and what acts on them.
        displacement: (J,) [m]; of slack tendons what would make them taut.
        wrong: what displacements lack [m], (J,), zero of tendons that are not driven.
        left: the largest that counts: of taut tendons, or of slack ones that lack some [m].
    """

    state: State
    displacement: FloatArray
    wrong: FloatArray
    left: float

    @property
    def tensions(self) -> FloatArray:
        """At the base [N], (J,)."""
        return self.state.acting.condition.tensions


class _Found(NamedTuple):
    """Where a search ended; as `newton.Found`."""

    reached: Reached
    border: Border | None
    iterations: int
    corrected: float
    is_met: bool


class Reeling:
    """The equations of one arm and its winches at the nodes of a `Problem`."""

    def __init__(self, rod: Rod, level: int) -> None:
        """Of ``rod`` on the elements of a ``level``."""
        self.problem, self._arm = rod.problem(level), rod.arm
        self._weights = self.problem.elements.weights
        tables = self.problem.tables
        self._has_sheaths = bool(tables.compliance.any())
        self._paths = np.ascontiguousarray(tables.tendons.transpose(2, 0, 1))
        rest = rest_stretches(tables)
        self._rest = self._weights[:, np.newaxis] * rest
        self._unloaded = self._rest.sum(axis=0)
        count = self._unloaded.size
        self._free = np.array(rod.arm.free_length or np.zeros(count))
        self._measure = np.append(self.problem.measure, np.zeros(count))

    def displacement(self, state: State) -> FloatArray:
        """What winches have reeled in [m], (J,), of the state that is in `Problem.work`."""
        reeled = self._unloaded - self._weights @ self._stretches(state)
        if not self._arm.axial_stiffness:
            return reeled
        acting = state.acting
        integral = np.einsum('ij,ij->j', self._rest, acting.tensions)
        return reeled + self._arm.stretched(integral + self._free * acting.condition.tensions)

    def _stretches(self, state: State) -> FloatArray:
        """|u| of `Tendons`, (N, J), faster where that needs no offsets."""
        tables, z = self.problem.tables, state.z
        if self._has_sheaths:
            return self._tendons(state).stretches
        width = 1.0 / np.sqrt(z[:, 3:4]) if tables.widens else 1.0
        kappa = z[:, :3] * width
        t, n, b = kappa[:, :1], kappa[:, 1:2], kappa[:, 2:]
        x, y, dx, dy = self._paths
        u_t, u_n, u_b = z[:, 3:4] + n * y - b * x, width * dx - t * y, width * dy + t * x
        if z.shape[1] == 6:
            u_n, u_b = u_n + z[:, 4:5], u_b + z[:, 5:]
        return np.asarray(np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b) * tables.reach)

    def _tendons(self, state: State) -> Tendons:
        problem = self.problem
        return Tendons(problem.tables, state.z, state.acting.tensions, problem.work.offsets)

    def evaluate(self, aim: Aim, z: FloatArray, tensions: FloatArray) -> Reached:
        """What twists ``z`` (N, m) and ``tensions`` (J,) [N] leave of ``aim``."""
        acting = self.problem.acting(aim.condition._replace(tensions=tensions))
        return self.reached(aim, self.problem.evaluate(acting, z))

    def reached(self, aim: Aim, state: State) -> Reached:
        """What the ``state`` that is in `Problem.work` leaves of ``aim``."""
        displacement = self.displacement(state)
        wrong = np.where(aim.driven, aim.displacements - displacement, 0.0)
        counts = (state.acting.condition.tensions > 0.0) | (wrong > 0.0)
        return Reached(state, displacement, wrong, float(np.abs(wrong * counts).max(initial=0.0)))

    def border(
        self, state: State, factors: Linear | None = None, over: FloatArray | None = None
    ) -> Border:
        """The system linearised at ``state``, or nearby where its ``factors`` are known.

        Of local tensions by those at the base these are differences ``over`` (J,) [N], if given.

        Raises:
            ConvergenceError: if it is singular.
        """
        problem = self.problem
        rates = problem.tension_rates(state) if over is None else self._secants(state, over)
        problem.load_work(state)
        if factors is None:
            factors = self._factors(state)
        stretch, weights = self._tendons(state).stretch(), self._weights
        columns = (stretch.length_by_z * rates[..., np.newaxis]).swapaxes(1, 2)
        by_tension = factors.solve(columns.reshape(-1, rates.shape[1]))
        lengths = stretch.length_by_z * weights[:, np.newaxis, np.newaxis]
        lengths = lengths.swapaxes(1, 2).reshape(-1, rates.shape[1]).T
        # What is reeled in by the local tensions, at fixed twists.
        by_local = self._arm.stretched(self._rest) - weights[:, np.newaxis] * stretch.by_tension
        own = np.einsum('ij,ij->j', by_local, rates) + self._arm.stretched(self._free)
        changes = lengths @ by_tension + np.diag(own)
        slid = problem.tension_changes(state)
        if slid is not None:
            by_twists = slid.by_twists(-by_tension.reshape(*state.z.shape, -1))
            changes += np.einsum('ij,ijk->jk', by_local, by_twists)
        if not np.isfinite(changes).all():
            raise ConvergenceError('the displacement of the tendons', np.inf, 0)
        return Border(factors, by_tension, lengths, changes)

    def _secants(self, state: State, over: FloatArray) -> FloatArray:
        """Differences of local tensions where those at the base differ by ``over``, (N, J) [-]."""
        condition = state.acting.condition
        further = condition._replace(tensions=condition.tensions + over)
        moved = self.problem.evaluate(self.problem.acting(further), state.z)
        return np.asarray((moved.acting.tensions - state.acting.tensions) / over)

    def _factors(self, state: State) -> Linear:
        problem, acting = self.problem, state.acting
        is_loaded = acting.force.any() or acting.couple.any() or problem.others.loads
        if is_loaded or self._arm.friction:
            return problem.linearise(state)
        problem.form.sections(problem.tables, state.z, acting.tensions, problem.work)
        return Blocks.of(problem.work.hessian)

    def settle(
        self, aim: Aim, z: FloatArray, tensions: FloatArray, tolerance: float,
        border: Border | None = None,
    ) -> _Found:  # fmt: skip
        """Search for what holds ``aim`` from ``z`` (N, m) and ``tensions`` (J,) [N].

        With a ``border`` from nearby if there is any; as `newton.settle`.
        """
        problem, length = self.problem, self._arm.length
        now, iterations = self.evaluate(aim, z, tensions), 0
        chord = None if border is None else Chord(self._measure)
        is_near, is_first, is_worse, expected, size = False, True, False, np.inf, z.size
        predicted: State | None = None

        def found(is_met: bool) -> _Found:
            far = 0.0 if predicted is None else problem.turn(now.state.z - predicted.z)
            return _Found(now, border, iterations, far, is_met)

        limit, progress, again = MOST, PROGRESS, CHORD
        if problem.others.without_tangent:
            limit, progress, again = MOST_LINEAR, LINEAR_PROGRESS, LINEAR_PROGRESS
        # On the way tensions need not be exact, nor lengths.
        least, is_rough = (MET, False) if tolerance < ON_THE_WAY else (_ROUGHLY, True)
        while True:
            is_met = now.state.residual <= tolerance and now.left <= least * length
            is_fine = expected <= MET * float(now.tensions.max(initial=0.0))
            if is_met and (is_rough or is_worse or is_fine):
                return found(True)
            if iterations >= limit:
                return found(is_met)
            if chord is None:
                try:
                    border, is_near = self.border(now.state), True
                except ConvergenceError:
                    return found(False)
                chord = Chord(self._measure)
            assert border is not None
            step = chord.corrected(self._step(aim, now, border))
            moved_z, moved = step[:size].reshape(now.state.z.shape), step[size:]
            new = self.evaluate(aim, now.state.z + moved_z, np.maximum(now.tensions + moved, 0.0))
            iterations += 1
            before, after = (max(one.state.residual, one.left / length) for one in (now, new))
            most = progress * before
            if is_first:
                # Residuals are measured by tensions, which a first step may raise from nothing.
                most = max(FIRST * before, 1.0) if is_near else PREDICTED * before
            if not after <= most and not is_met:  # nor where it is NaN
                if is_near:
                    return found(False)
                chord = None
                continue
            if is_met and not after <= before:
                return found(True)  # it is all rounding
            # The next step is smaller in proportion, nearly.
            expected = float(np.abs(moved).max(initial=0.0)) * after / max(before, 1e-300)
            is_worse = is_met and after > CHORD * before
            predicted = new.state if is_first else predicted
            if after > again * before and not is_met:
                chord = None
            elif ((new.tensions > 0.0) != (now.tensions > 0.0)).any():
                chord = Chord(self._measure)
            now, is_first, is_near = new, False, False

    def _step(self, aim: Aim, now: Reached, border: Border) -> FloatArray:
        """Newton's step of twists and tensions, (N m + J,)."""
        own = border.solve(-now.state.imbalance.ravel())
        wrong = np.where(aim.driven, now.wrong + border.lengths @ own, 0.0)
        by_tension = complementary_step(
            border.changes, wrong, now.tensions, aim.driven, self._arm.length
        )
        return np.append(own - border.by_tension @ by_tension, by_tension)

    def is_held(self, aim: Aim, state: State, border: Border) -> bool:
        """Whether the balance ``state``, with its ``border``, is stable while ``aim`` is held.

        The energy then has that of the lengths of taut tendons, as stiff ones, besides.
        """
        problem = self.problem
        problem.fill_jacobian(state)
        variation = problem.variation()
        taut = aim.driven & (state.acting.condition.tensions > 0.0)
        give = border.changes.diagonal()
        own = give - np.einsum('jn,nj->j', border.lengths, border.by_tension)
        soft = np.maximum(own, _STIFFEST * np.abs(give))[taut]
        variation.add(border.lengths[taut] / np.sqrt(soft)[:, np.newaxis])
        return variation.stability().is_stable


class Held(NamedTuple):
    """An equilibrium that winches hold.

    Attributes:
        equilibrium: of the rod.
        reached: what winches have reeled in there.
    """

    equilibrium: Equilibrium
    reached: Reached


class Winches:
    """Equilibria of a `Rod` of which winches hold some tendons at a length."""

    def __init__(self, rod: Rod) -> None:
        """Of ``rod``."""
        self._rod = rod
        self.reeling = functools.cache(lambda level: Reeling(rod, level))

    def solve(
        self, displacements: FloatArray, driven: NDArray[np.bool_], condition: Condition,
        start: Equilibrium | None = None, spending: Spending | None = None,
    ) -> Held:  # fmt: skip
        """What holds ``displacements`` (J,) [m] of the ``driven`` tendons (J,).

        And the tensions of the others, in ``condition``; neither counts for the rest. From
        ``start``, or from the unloaded arm. Without friction.

        Raises:
            SolveError: if no tensions were found that hold these lengths.
            ContinuationError: if it would take more than the budget.
        """
        wanted = np.where(driven, displacements, 0.0)
        given = condition._replace(tensions=np.where(driven, 0.0, condition.tensions))
        search = _Search(self._rod, self.reeling, spending or self._rod.spending())
        with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
            aim = Aim(given, wanted, driven)
            held = search.find(aim, start)
            problem = self._rod.problem(held.equilibrium.level)
            check_solution(problem, held.equilibrium.state, not search.is_free(aim))
        return held

    def displacements(self, equilibrium: Equilibrium) -> FloatArray:
        """What winches have reeled in [m], (J,); of slack tendons what would make them taut."""
        reeling, state = self.reeling(equilibrium.level), equilibrium.state
        reeling.problem.load_work(state)
        return reeling.displacement(state)

    def changes(self, equilibrium: Equilibrium, over: FloatArray) -> FloatArray:
        """What is reeled in more over ``over`` (J,) [N] more tension, (J, J) [m/N], nearly."""
        return self.reeling(equilibrium.level).border(equilibrium.state, None, over).changes


class _Search:
    """One search for tensions."""

    def __init__(self, rod: Rod, reeling: Callable[[int], Reeling], spending: Spending) -> None:
        """On a ``rod`` with its equations of each level."""
        self._rod, self._reeling, self._spending = rod, reeling, spending

    def find(self, aim: Aim, start: Equilibrium | None) -> Held:
        """See `Winches.solve`."""
        if start is not None:
            try:
                held = self._from(aim, start)
            except ContinuationError:
                raise  # Its budget is spent.
            except SolveError:
                pass
            else:
                is_known = held.equilibrium.judged is start.judged is not None
                return held if is_known else self._resolved(held, aim)
        return self._resolved(self._cold(aim), aim)

    def is_free(self, aim: Aim) -> bool:
        """Whether nothing but tendons acts, so that there is one equilibrium."""
        condition = aim.condition
        is_loaded = condition.factor > 0.0 and self._rod.is_loaded
        return not (is_loaded or condition.tip_wrench.any())

    def _try(
        self, aim: Aim, last: Equilibrium, tolerance: float, part: float
    ) -> tuple[Held | None, _Found]:
        """What holds ``aim`` near the ``last`` equilibrium, if it is stable, and what was found.

        ``part`` of the way has been followed.
        """
        border = last.factors if isinstance(last.factors, Border) else None
        tensions = aim.begin(last.state.acting.condition.tensions)
        found = self._reeling(last.level).settle(aim, last.state.z, tensions, tolerance, border)
        state = found.reached.state
        self._spending.add(found.iterations, part, state.residual, state.z)
        return self._accepted(aim, last, found, tolerance), found

    def _accepted(
        self, aim: Aim, last: Equilibrium, found: _Found, tolerance: float
    ) -> Held | None:
        """What was ``found``, if it is stable and nothing says that it left its branch."""
        state, border, firm = found.reached.state, found.border, last.judged
        reeling, is_free = self._reeling(last.level), self.is_free(aim)
        if not found.is_met or (found.corrected > MOST_CORRECTED and not is_free):
            return None
        if is_free:
            firm = None
        elif firm is None or not self._rod.is_near(reeling.problem, firm, state):
            try:
                judged = judge(reeling.problem, state)
            except ConvergenceError:
                return None
            is_stable = judged.stability.is_stable
            served = tolerance < ON_THE_WAY and found.iterations <= _SERVED
            if border is None or not (served and is_stable):
                border = reeling.border(state, judged.factors)
            if not (is_stable or reeling.is_held(aim, state, border)):
                return None
            firm = judged.state if judged.stability.is_firm else None
        total = self._spending.iterations
        return Held(Equilibrium(state, last.level, border, firm, total), found.reached)

    def _from(self, aim: Aim, start: Equilibrium) -> Held:
        """From an equilibrium nearby, in one step or by continuation."""
        near, factors = start, start.factors
        if factors is not None and not isinstance(factors, Border):
            border = self._reeling(start.level).border(start.state, factors)
            near = start._replace(factors=border)
        return self._try(aim, near, self._spending.residual, 0.0)[0] or self._followed(aim, start)

    def _begun(self, aim: Aim, start: Equilibrium) -> tuple[Held, Aim]:
        """Where continuation begins, and what is held there."""
        reeling, state = self._reeling(start.level), start.state
        reeling.problem.load_work(state)
        held = Held(start, reeling.reached(aim, state))
        return held, Aim(state.acting.condition, held.reached.displacement, aim.driven)

    def _followed(self, aim: Aim, start: Equilibrium) -> Held:
        """By continuation from the equilibrium ``start``, of the same loads or of none."""
        held, known = self._begun(aim, start)
        done, step, jumps = 0.0, _FIRST_STEP, 0
        is_loading = known.condition.factor < aim.condition.factor
        smallest = _SMALLEST_LOAD if is_loading else _SMALLEST_STEP
        while True:
            target = min(1.0, done + step)
            tolerance = TOLERANCE if target == 1.0 else ON_THE_WAY
            last = held.equilibrium
            more, found = self._try(known.towards(aim, target), last, tolerance, done)
            if more is not None:
                if target == 1.0:
                    return more
                longer = growth(found.corrected) if found.iterations <= _QUICKLY else 1.0
                held, done, step = more, target, longer * (target - done)
            elif step > smallest:
                shorter = min(growth(found.corrected), _SHORTER) if found.is_met else _MUCH_SHORTER
                step = max(shorter * (target - done), smallest)
            else:
                jumps += 1
                if jumps > _MOST_JUMPS or self.is_free(aim) or is_loading:
                    raise self._error(found)
                # The branch ends: on with what the arm turns to under the tensions there.
                beyond = known.towards(aim, min(1.0, done + _BEYOND))
                pulled, wrench = beyond.begin(held.reached.tensions), beyond.condition.tip_wrench
                turned = self._rod.solve(pulled, wrench, last, self._spending)
                held, known = self._begun(aim, turned)
                done, step = 0.0, _FIRST_STEP

    def _error(self, found: _Found) -> ConvergenceError:
        left, count = found.reached.left / self._rod.arm.length, self._spending.iterations
        what = 'the displacement of the tendons'
        return ConvergenceError(what, left, count, found.reached.state.z)

    def _cold(self, aim: Aim) -> Held:
        """From the arm without loads, whose winches are wound before it bears them."""
        rod, condition = self._rod, aim.condition
        problem, wrench = rod.problem(0), condition.tip_wrench
        free = aim._replace(condition=condition._replace(tip_wrench=np.zeros(6), factor=0.0))
        z, _, iterations = rod.unloaded(problem, condition)
        self._spending.add(iterations, 0.0, 0.0, z)
        state = problem.evaluate(problem.acting(free.condition), z)
        wound = self._from(free, Equilibrium(state, 0, None, None, 0))
        if self.is_free(aim):
            return wound
        alone = wound.equilibrium._replace(factors=None)
        held = self._try(aim, alone, TOLERANCE, 0.0)[0]
        if held is not None:
            return held
        for begin in (
            lambda: self._followed(aim, alone),
            lambda: self._from(
                aim, rod.solve(wound.reached.tensions, wrench, None, self._spending)
            ),
        ):
            try:
                return begin()
            except ContinuationError:
                raise  # Its budget is spent.
            except SolveError:
                pass
        return self._from(aim, rod.solve(condition.tensions, wrench, None, self._spending))

    def _resolved(self, held: Held, aim: Aim) -> Held:
        """What is ``held``, on as many nodes as it takes."""
        rod, last = self._rod, held.equilibrium
        while not rod.is_resolved(rod.problem(last.level), last.state, last.level):
            before, now = rod.problem(last.level), rod.problem(last.level + 1)
            state = last.state._replace(z=moved(last.state.z, before.elements, now.elements))
            finer, found = self._try(
                aim, Equilibrium(state, last.level + 1, None, None, 0), TOLERANCE, 1.0
            )
            if finer is None:
                raise self._error(found)
            held, last = finer, finer.equilibrium
        return held
