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

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.budget import Spending
from octo_arm_model.core.errors import ContinuationError, ConvergenceError, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.rod.complementarity import complementary_step
from octo_arm_model.rod.continuation import MOST_CORRECTED, ON_THE_WAY, growth, judge
from octo_arm_model.rod.equilibrium import Condition, State
from octo_arm_model.rod.factors import Blocks, Linear
from octo_arm_model.rod.lengths import rest_stretches
from octo_arm_model.rod.newton import CHORD, FIRST, MOST, PREDICTED, PROGRESS, Chord
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
_BEYOND = 0.05  # the end of a branch
_MOST_KEPT = 20  # sets of equations
_MOST_JUMPS = 4  # to what an arm whose branch ends turns to under tensions that are held
_STIFFEST = 1e-6  # compliance of a held tendon over what the arm gives way, at least


class Aim(NamedTuple):
    """What is to be held.

    Attributes:
        condition: what acts on the arm; its tensions are those of tendons that are not driven.
        displacements: reeled in [m], (J,); they count where a tendon is driven.
    """

    condition: Condition
    displacements: FloatArray

    def towards(self, other: Aim, part: float) -> Aim:
        """This one, moved by ``part`` of the way to ``other``."""
        if part == 1.0:
            return other
        reeled = self.displacements + part * (other.displacements - self.displacements)
        return Aim(self.condition.towards(other.condition, part), reeled)


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

    def __init__(self, rod: Rod, level: int, driven: NDArray[np.bool_]) -> None:
        """Of ``rod`` on the elements of a ``level``; ``driven`` (J,) are held by winches."""
        self.problem, self._arm, self._driven = rod.problem(level), rod.arm, driven
        self._weights = self.problem.elements.weights
        tables = self.problem.tables
        self._has_sheaths = bool(tables.compliance.any())
        self._paths = np.ascontiguousarray(tables.tendons.transpose(2, 0, 1))
        rest = rest_stretches(tables)
        self._rest = self._weights[:, np.newaxis] * rest
        self._unloaded = self._rest.sum(axis=0)
        self._free = np.array(rod.arm.free_length or np.zeros(driven.size))
        self._measure = np.append(self.problem.measure, np.zeros(driven.size))

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
        wrong = np.where(self._driven, aim.displacements - displacement, 0.0)
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
        if self._arm.friction or acting.force.any() or acting.couple.any():
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

        # On the way tensions need not be exact, nor lengths.
        least, is_rough = (MET, False) if tolerance < ON_THE_WAY else (_ROUGHLY, True)
        while True:
            is_met = now.state.residual <= tolerance and now.left <= least * length
            is_fine = expected <= MET * float(now.tensions.max(initial=0.0))
            if is_met and (is_rough or is_worse or is_fine):
                return found(True)
            if iterations >= MOST:
                return found(is_met)
            if chord is None:
                try:
                    border, is_near = self.border(now.state), True
                except ConvergenceError:
                    return found(False)
                chord = Chord(self._measure)
            assert border is not None
            step = chord.corrected(self._step(now, border))
            moved_z, moved = step[:size].reshape(now.state.z.shape), step[size:]
            new = self.evaluate(aim, now.state.z + moved_z, np.maximum(now.tensions + moved, 0.0))
            iterations += 1
            before, after = (max(one.state.residual, one.left / length) for one in (now, new))
            most = PROGRESS * before
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
            if after > CHORD * before and not is_met:
                chord = None
            elif ((new.tensions > 0.0) != (now.tensions > 0.0)).any():
                chord = Chord(self._measure)
            now, is_first, is_near = new, False, False

    def _step(self, now: Reached, border: Border) -> FloatArray:
        """Newton's step of twists and tensions, (N m + J,)."""
        own = border.solve(-now.state.imbalance.ravel())
        wrong = np.where(self._driven, now.wrong + border.lengths @ own, 0.0)
        by_tension = complementary_step(
            border.changes, wrong, now.tensions, self._driven, self._arm.length
        )
        return np.append(own - border.by_tension @ by_tension, by_tension)

    def is_held(self, state: State, border: Border) -> bool:
        """Whether the balance ``state``, at which ``border`` is, is stable with winches held.

        The energy then has that of the lengths of taut tendons, as stiff ones, besides.
        """
        problem = self.problem
        problem.fill_jacobian(state)
        variation = problem.variation()
        taut = self._driven & (state.acting.condition.tensions > 0.0)
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
        self._kept: dict[tuple[int, bytes], Reeling] = {}

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
        rod = self._rod
        spending = spending or rod.spending()
        aim = Aim(
            condition._replace(tensions=np.where(driven, 0.0, condition.tensions)),
            np.where(driven, displacements, 0.0),
        )
        with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
            if start is None:
                return self._resolved(self._cold(aim, driven, spending), aim, driven, spending)
            try:
                held = self._from(aim, driven, start, spending)
            except ContinuationError:
                raise  # Its budget is spent.
            except SolveError:
                return self._resolved(self._cold(aim, driven, spending), aim, driven, spending)
            if held.equilibrium.judged is start.judged is not None:
                return held  # resolved as well as that
            return self._resolved(held, aim, driven, spending)

    def displacements(self, equilibrium: Equilibrium) -> FloatArray:
        """What winches have reeled in [m], (J,); of slack tendons what would make them taut."""
        state = equilibrium.state
        tensions = state.acting.condition.tensions
        reeling = self._reeling(equilibrium.level, np.zeros(tensions.shape[-1], np.bool_))
        reeling.problem.load_work(state)
        return reeling.displacement(state)

    def changes(self, equilibrium: Equilibrium, over: FloatArray) -> FloatArray:
        """What is reeled in more over ``over`` (J,) [N] more tension, (J, J) [m/N], nearly."""
        reeling = self._reeling(equilibrium.level, np.zeros(over.size, np.bool_))
        return reeling.border(equilibrium.state, None, over).changes

    def _reeling(self, level: int, driven: NDArray[np.bool_]) -> Reeling:
        key = level, driven.tobytes()
        if key not in self._kept:
            if len(self._kept) > _MOST_KEPT:
                self._kept.clear()
            self._kept[key] = Reeling(self._rod, level, driven)
        return self._kept[key]

    def _is_free(self, aim: Aim) -> bool:
        """Whether nothing but tendons acts, so that there is one equilibrium."""
        condition = aim.condition
        is_loaded = condition.factor > 0.0 and self._rod.is_loaded
        return not (is_loaded or condition.tip_wrench.any())

    def _from(
        self, aim: Aim, driven: NDArray[np.bool_], start: Equilibrium, spending: Spending
    ) -> Held:
        """From an equilibrium nearby, in one step or by continuation."""
        reeling, state = self._reeling(start.level, driven), start.state
        known = state.acting.condition
        tensions = np.where(driven, known.tensions, aim.condition.tensions)
        border = start.factors
        if border is not None and not isinstance(border, Border):
            border = reeling.border(state, border)
        found = reeling.settle(aim, state.z, tensions, spending.residual, border)
        spending.add(found.iterations, 0.0, found.reached.state.residual, found.reached.state.z)
        held = self._accepted(reeling, found, start, aim, spending)
        return held or self._followed(aim, driven, start, spending)

    def _accepted(
        self, reeling: Reeling, found: _Found, start: Equilibrium, aim: Aim, spending: Spending
    ) -> Held | None:
        """What was ``found``, if it is stable and nothing says that it left its branch."""
        state, border, total = found.reached.state, found.border, spending.iterations
        rod, problem, firm = self._rod, reeling.problem, start.judged
        if not found.is_met:
            return None
        if self._is_free(aim):
            return Held(Equilibrium(state, start.level, border, None, total), found.reached)
        if found.corrected > MOST_CORRECTED:
            return None
        if firm is None or not rod.is_near(problem, firm, state):
            try:
                judged = judge(problem, state)
            except ConvergenceError:
                return None
            border, firm = reeling.border(state, judged.factors), None
            if judged.stability.is_firm:
                firm = judged.state
            elif not (judged.stability.is_stable or reeling.is_held(state, border)):
                return None
        return Held(Equilibrium(state, start.level, border, firm, total), found.reached)

    def _followed(
        self, aim: Aim, driven: NDArray[np.bool_], start: Equilibrium, spending: Spending
    ) -> Held:
        """By continuation from the equilibrium ``start``, of the same loads or of none."""
        reeling, jumps = self._reeling(start.level, driven), 0
        held = self._begun(reeling, start, aim)
        known, done, step = self._known(held), 0.0, _FIRST_STEP
        is_loading = known.condition.factor < aim.condition.factor
        smallest = _SMALLEST_LOAD if is_loading else _SMALLEST_STEP
        while True:
            target = min(1.0, done + step)
            now, last = known.towards(aim, target), held.equilibrium
            border = last.factors if isinstance(last.factors, Border) else None
            tolerance = TOLERANCE if target == 1.0 else ON_THE_WAY
            tensions = np.where(driven, held.reached.tensions, now.condition.tensions)
            found = reeling.settle(now, last.state.z, tensions, tolerance, border)
            state = found.reached.state
            spending.add(found.iterations, done, state.residual, state.z)
            more = self._accepted(reeling, found, last, now, spending)
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
                left = found.reached.left / self._rod.arm.length
                if jumps > _MOST_JUMPS or self._is_free(aim) or is_loading:
                    what = 'the displacement of the tendons'
                    raise ConvergenceError(what, left, spending.iterations, state.z)
                # The branch ends: on with what the arm turns to under the tensions there.
                condition = known.towards(aim, min(1.0, done + _BEYOND)).condition
                pulled = np.where(driven, held.reached.tensions, condition.tensions)
                turned = self._rod.solve(pulled, condition.tip_wrench, last, spending)
                reeling = self._reeling(turned.level, driven)
                held = self._begun(reeling, turned, aim)
                known, done, step = self._known(held), 0.0, _FIRST_STEP

    def _begun(self, reeling: Reeling, start: Equilibrium, aim: Aim) -> Held:
        reeling.problem.load_work(start.state)
        return Held(start, reeling.reached(aim, start.state))

    def _known(self, held: Held) -> Aim:
        return Aim(held.equilibrium.state.acting.condition, held.reached.displacement)

    def _cold(self, aim: Aim, driven: NDArray[np.bool_], spending: Spending) -> Held:
        """From the arm without loads, whose winches are wound before it bears them."""
        rod, condition = self._rod, aim.condition
        problem = rod.problem(0)
        free = aim._replace(condition=condition._replace(tip_wrench=np.zeros(6), factor=0.0))
        z, _, iterations = rod.unloaded(problem, condition)
        spending.add(iterations, 0.0, 0.0, z)
        state = problem.evaluate(problem.acting(free.condition), z)
        wound = self._from(free, driven, Equilibrium(state, 0, None, None, 0), spending)
        if self._is_free(aim):
            return wound
        reeling = self._reeling(0, driven)
        start, tensions = wound.equilibrium, wound.reached.tensions
        found = reeling.settle(aim, start.state.z, tensions, TOLERANCE)
        spending.add(found.iterations, 0.0, found.reached.state.residual, found.reached.state.z)
        held = self._accepted(reeling, found, start, aim, spending)
        if held is not None:
            return held
        try:
            return self._followed(aim, driven, start, spending)
        except ContinuationError:
            raise  # Its budget is spent.
        except ConvergenceError:
            pass
        try:
            loaded = rod.solve(tensions, condition.tip_wrench, None, spending)
            return self._from(aim, driven, loaded, spending)
        except ContinuationError:
            raise  # Its budget is spent.
        except SolveError:
            loaded = rod.solve(condition.tensions, condition.tip_wrench, None, spending)
            return self._from(aim, driven, loaded, spending)

    def _resolved(
        self, held: Held, aim: Aim, driven: NDArray[np.bool_], spending: Spending
    ) -> Held:
        """What is ``held``, on as many nodes as it takes."""
        rod, last = self._rod, held.equilibrium
        while not rod.is_resolved(rod.problem(last.level), last.state, last.level):
            before, level = rod.problem(last.level), last.level + 1
            reeling = self._reeling(level, driven)
            z = moved(last.state.z, before.elements, reeling.problem.elements)
            found = reeling.settle(aim, z, held.reached.tensions, TOLERANCE)
            state = found.reached.state
            spending.add(found.iterations, 1.0, state.residual, state.z)
            finer = self._accepted(
                reeling, found, last._replace(level=level, judged=None), aim, spending
            )
            if finer is None:
                what, left = 'the displacement of the tendons', found.reached.left
                raise ConvergenceError(what, left / rod.arm.length, spending.iterations, z)
            held, last = finer, finer.equilibrium
        return held
