"""One arm and its loads: from tensions and a wrench on the tip to a stable equilibrium."""

import contextlib
import functools
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, ContinuationError, ConvergenceError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_NODES, Budget, Spending
from octo_arm_model.arm.loads import Loads
from octo_arm_model.arm.material import NEO_HOOKEAN
from octo_arm_model.rod import arrays
from octo_arm_model.rod.backbone import FinePoints, Readout
from octo_arm_model.rod.checks import LoadLimits, check_solution, explain, explain_discs
from octo_arm_model.rod.continuation import (
    MOST_CORRECTED,
    ON_THE_WAY,
    NewtonResult,
    Verdict,
    follow,
    judge_stable,
    newton,
    tolerance_of,
)
from octo_arm_model.rod.elements import COARSE, LEVELS, Elements, build_elements
from octo_arm_model.rod.equilibrium import Condition, Equilibrium, Problem, State, balance_sections
from octo_arm_model.rod.forms import choose_form
from octo_arm_model.rod.section_arrays import initial_twists
from octo_arm_model.rod.tables import added_points, allowed_between, least_bending, tabulate
from octo_arm_model.rod.tendons import unloaded_twists

_TENSION_ERROR = 100.0  # in parts of the tension, over that of positions in parts of the length
WORST = 1e-6  # error of positions, over the length, beyond which no shape is returned
_DEPTH, _WORST_DEPTH = 1e-5, 1e-4  # likewise of depths in obstacles, over the length
_WORST_TENSION = 1e-2  # likewise of tensions with friction, in parts of them
_GENTLE = 0.1  # part of tensions with friction to begin with, where all of them are too much
# The estimated error of positions is too small with friction: strains have kinks where tendons
# begin to slip, and tensions are what later ones slide from.
_OF_FRICTION = 0.01
_PART = 0.25  # first step of continuation, where `Rod._warm` has failed with the whole way
_FIRST_STEP = 0.1  # of continuation, where the whole way is too far for one
# An equilibrium that is stable by a margin is not judged again where since then the arm has turned
# by less than this [rad] and the force on it times the square of its lever over E J has changed by
# less than this, and where sheaths take less than this part of its bending stiffness.
_SAME_SHAPE, _SAME_LOADS, _SOFT = 0.25, 0.02, 0.25


class Setting(NamedTuple):
    """How an arm is modelled.

    Attributes:
        law: number of the elastic law, see `arm.material.LAWS`.
        shear: whether cross sections shear; linear law only.
        accuracy: of the position, over the length [-].
        compiled: see `forms.choose_form`.
    """

    law: int = NEO_HOOKEAN
    shear: bool = False
    accuracy: float = 1e-8
    compiled: bool | None = None


class Rod:
    """Equilibria of one arm under its loads.

    Attributes:
        arm: the arm.
        setting: how it is modelled.
        is_compiled: whether numba compiles the node functions.
        is_loaded: whether anything but tendons and the wrench on the tip loads it, or discs hold
            the tendons, so that sections are not in balance by themselves.
        has_obstacles: whether there are some.
        added: points that the finer problem of each level has more in each element.
    """

    def __init__(
        self,
        arm: Arm,
        loads: Loads = Loads(),
        base: FloatArray | None = None,
        setting: Setting = Setting(),
    ) -> None:
        """Of ``arm`` on a base of the orientation ``base``, a quaternion w, x, y, z.

        Raises:
            ArmDefinitionError: if gravity acts on an arm of no density, or if loads are larger
                than `LoadLimits` allow.
        """
        self.arm, self.setting, self._loads = arm, setting, loads
        self._base = np.array([1.0, 0.0, 0.0, 0.0]) if base is None else base
        self._form = choose_form(setting.compiled)
        self.is_compiled = self._form is not arrays
        self._strains = 6 if setting.shear else 4
        self.added = added_points(setting.accuracy, bool(arm.friction))
        # Problems of each level, and one of few nodes to follow an arm from its unloaded shape.
        self.problem = functools.lru_cache(self._problem)
        self.finer = functools.lru_cache(
            lambda level: FinePoints(self.problem(level), self.problem(level, self.added))
        )
        self.has_friction, self.has_obstacles = any(arm.friction), bool(loads.obstacles)
        self.is_loaded = bool(arm.discs.s or loads.others or loads.scaled or loads.obstacles)
        if loads.any:
            self.is_loaded |= bool(self._straight_resultants(loads).any())

    def _straight_resultants(self, loads: Loads) -> FloatArray:
        """Force and free moment of ``loads`` on the straight rod, unless they are too large."""
        own = self.problem(0)
        with np.errstate(over='ignore', invalid='ignore'):
            straight = own.straight_resultants()
        places = np.concatenate([own.elements.edges, own.elements.s])
        LoadLimits(self.arm, places).check_loads(loads, straight)
        return straight

    @functools.cached_property
    def _flexibility(self) -> tuple[float, float, FloatArray]:
        """How far the arm turns by a force on it and by a pull between discs, at most [1/N].

        And the part of its bending stiffness that each sheath takes per square of the tension.
        """
        tables, s = self.problem(0).tables, self.problem(0).elements.s
        bending = least_bending(tables)
        apart = np.diff([0.0, *self.arm.discs.faces, self.arm.length]).max()
        by_force = float(((self.arm.length - s) ** 2 / bending).max())
        return by_force, float((apart**2 / bending).max()), tables.compliance / bending.min()

    def _problem(self, level: int, added: int = 0) -> Problem:
        """The equations on elements of a ``level``, with so many points ``added`` to each."""
        breaks, knots = self._loads.breaks, self._loads.knots
        elements = build_elements(self.arm, breaks, knots, level, added)
        tables = tabulate(self.arm, elements, self._base, law=self.setting.law)
        given = self.arm, elements, tables, self._loads, self._form, self._strains
        return Problem(*given, has_jacobian=not added)

    def readout(self, level: int, s: FloatArray) -> Readout:
        """Reads equilibria of a ``level`` at arc coordinates ``s`` (S,) [m]."""
        return Readout(self.finer(level), self.arm, s)

    def solve(
        self, wanted: Condition, start: Equilibrium | None = None, spending: Spending | None = None
    ) -> Equilibrium:
        """The equilibrium in a condition that is ``wanted``, of tensions (J,) at the base.

        Followed from ``start``, or from the unloaded shape. Tendons with friction slide from
        `Condition.before` of any level, see `Problem.history`.

        Raises:
            SolveError: if there is no trustworthy answer.
            ContinuationError: if it would take more than the budget.
        """
        spending = spending or Spending(Budget())
        is_loaded = self.is_loaded or bool(wanted.tip_wrench.any())
        with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
            if is_loaded or self.has_friction:
                try:
                    found = self._loaded_equilibrium(wanted, start, spending)
                except ContinuationError:
                    raise
                except ConvergenceError as error:
                    why = self._explained(wanted, error)
                    raise explain_discs(self.problem(0), wanted.tensions, why) from None
            else:
                found = self._unloaded_equilibrium(wanted)
            check_solution(self.problem(found.level), found.state, is_loaded)
        return found

    def _explained(self, wanted: Condition, error: ConvergenceError) -> ConvergenceError:
        """Why there is no balance after ``error``, where an obstacle is in the way."""
        problem = self.problem(0)
        if problem.contact is None:
            return error
        problem.orient(self.unloaded(problem, wanted)[0])
        if not (where := problem.contact.inside(problem.places())):
            return error
        what = f'the balance of an arm that under its tensions alone is {where}'
        return ConvergenceError(what, error.residual, error.iterations)

    def _loaded_equilibrium(
        self, wanted: Condition, start: Equilibrium | None, spending: Spending
    ) -> Equilibrium:
        """A stable equilibrium under loads, on as many nodes as it takes."""
        start = self.at_least(start, wanted.before)
        found = None if start is None else self._warm(wanted, start, spending)
        if found is None and start is not None and start.guess is not None:
            raise ContinuationError('one search', 0.0, start.state.residual, spending.iterations)
        if found is None:
            found = self._followed(wanted, start, spending)
        if start is not None and found.firm_state is start.firm_state is not None:
            return found  # resolved as well as that
        return self._resolved(found, wanted, spending)

    def _fine(self, level: int) -> Elements:
        friction = self.problem(level).friction
        assert friction is not None
        return friction.fine

    def level_of(self, before: FloatArray) -> int:
        """The level at whose fine points ``before`` (M, J) is.

        Raises:
            ConfigError: if it is at those of no level of this arm.
        """
        for level in (*range(len(LEVELS)), COARSE):
            if len(before) == self._fine(level).s.size:
                return level
        raise ConfigError('the backbone was solved by another solver')

    def at_level(self, condition: Condition, level: int) -> Condition:
        """The ``condition`` with tensions ``before`` at the fine points of a ``level``."""
        before = condition.before
        if before is None or (given := self.level_of(before)) == level:
            return condition
        own = moved(before, self._fine(given), self._fine(level))
        return condition._replace(before=own)

    def at_least(self, start: Equilibrium | None, before: FloatArray | None) -> Equilibrium | None:
        """The ``start`` on no fewer nodes than ``before`` is given at."""
        if start is None or before is None or (level := self.level_of(before)) <= start.level:
            return start
        of, now = self.problem(start.level), self.problem(level)
        z = moved(start.state.z, of.elements, now.elements)
        condition = self.at_level(start.state.condition, level)
        state = now.evaluate(now.at_nodes(condition), z)
        return Equilibrium(state, level, None, None, start.iterations)

    def first_level(self, start: Equilibrium | None, wanted: Condition) -> int:
        """The level to begin a search on."""
        if start is not None:
            return start.level
        return 0 if wanted.before is None else max(self.level_of(wanted.before), 0)

    def _unloaded_equilibrium(self, wanted: Condition) -> Equilibrium:
        """The balance of every cross section by itself, on as many nodes as it takes."""
        iterations = 0
        for level in range(len(LEVELS)):
            # At the finer points at once, as no balance of the whole arm is sought.
            finer = self.finer(level)
            fine, left, steps = self.unloaded(finer.own, wanted)
            iterations += steps
            error = finer.own.position_error(fine)
            if error <= allowed_between(self.setting.accuracy):
                break
        require_resolved(finer.own, error, max(self.setting.accuracy, WORST))
        z = finer.to_nodes @ fine
        at_nodes = finer.problem.at_nodes(wanted)
        state = State(at_nodes, z, np.zeros_like(z), left)
        return Equilibrium(state, level, None, None, iterations, fine)

    def unloaded(self, problem: Problem, wanted: Condition) -> tuple[FloatArray, float, int]:
        """Twists at the nodes of ``problem`` under tensions alone, residual and steps.

        Nearly, where tendons have friction.

        Raises:
            SolveError: if there is no balance.
        """
        local = np.empty((problem.elements.s.size, wanted.tensions.size))
        local[:] = wanted.tensions
        if problem.friction is not None and wanted.tensions.any():
            straight = initial_twists(problem.tables, local, problem.strains)
            local = problem.first_tensions(wanted, straight)
        z = np.zeros((len(local), problem.strains))
        try:
            left, steps = balance_sections(problem.form, problem.tables, problem.work, local, z)
        except ConvergenceError as error:
            raise explain(problem, local, error) from None
        return z, left, steps

    def _warm(
        self, wanted: Condition, start: Equilibrium, spending: Spending
    ) -> Equilibrium | None:
        """By Newton's method from ``start``; None where that leads to no stable equilibrium."""
        problem = self.problem(start.level)
        at_nodes = problem.at_nodes(self.at_level(wanted, start.level))
        guess = start.state.z if start.guess is None else start.guess
        begun = problem.evaluate(at_nodes, guess)
        found = newton(problem, begun, spending.residual, start.factors)
        spending.add(found.iterations, 0.0, found.state.residual)
        return self._accepted(problem, found, start, spending)

    def _accepted(
        self, problem: Problem, found: NewtonResult, start: Equilibrium, spending: Spending
    ) -> Equilibrium | None:
        """What was ``found``, if it is stable and nothing says that it left its branch."""
        state, total = found.state, spending.iterations
        if not (state.residual <= spending.residual and found.corrected <= MOST_CORRECTED):
            return None
        if problem.passes(start.state.z, state.z):
            return None
        firm = start.firm_state
        if firm is not None and self.is_near(problem, firm, state):
            return Equilibrium(state, start.level, found.factors or start.factors, firm, total)
        verdict = judge_stable(problem, state)
        return None if verdict is None else self._equilibrium(verdict, start.level, total)

    def _equilibrium(self, verdict: Verdict, level: int, total: int) -> Equilibrium:
        firm = verdict.state if verdict.stability.is_firm else None
        return Equilibrium(verdict.state, level, verdict.factors, firm, total)

    def is_near(self, problem: Problem, firm: State, state: State) -> bool:
        """Whether ``state`` is stable as surely as the ``firm`` one, by a margin."""
        if problem.contact is not None or not problem.has_energy(state.condition):
            return False  # A contact that opens holds the arm no more.
        by_force, by_pull, by_square = self._flexibility
        if float(state.at_nodes.tensions.max(axis=0) ** 2 @ by_square) > _SOFT:
            return False
        change = state.at_nodes.force - firm.at_nodes.force
        loads = by_force * float(np.abs(change).max())
        if problem.discs is not None:  # between which the pull of tendons is a load
            pulls = state.at_nodes.tensions - firm.at_nodes.tensions
            loads += by_pull * float(np.abs(pulls).sum(axis=1).max())
        return loads <= _SAME_LOADS and problem.turn(state.z - firm.z) <= _SAME_SHAPE

    def _followed(
        self, wanted: Condition, start: Equilibrium | None, spending: Spending
    ) -> Equilibrium:
        """By continuation from ``start``, or from the unloaded shape."""
        if start is not None:
            problem, level = self.problem(start.level), start.level
            known, z = start.state.condition, start.state.z
            wanted = self.at_level(wanted, level)
            verdict = follow(problem, known, z, wanted, spending, step=_PART)
        else:
            level = self.first_level(None, wanted)
            verdict = self._cold(wanted, level, spending)
        return self._equilibrium(verdict, level, spending.iterations)

    def _known(self, problem: Problem, wanted: Condition) -> tuple[Condition, FloatArray]:
        """A condition without loads, under the tensions ``wanted``, and twists (N, m) in it.

        Under part of the tensions, or none, where friction or discs alone keep more of them from
        crushing the arm.
        """
        known = wanted._replace(tip_wrench=np.zeros(6), factor=0.0)
        if problem.contact is not None:
            return self._straight(problem, known)
        if problem.friction is None and problem.discs is None:
            return known, self.unloaded(problem, known)[0]
        for part in (1.0, _GENTLE):
            known = known._replace(tensions=part * wanted.tensions)
            with contextlib.suppress(ConvergenceError):
                z = self.unloaded(problem, known)[0]
                begun = problem.evaluate(problem.at_nodes(known), z)
                state = newton(problem, begun, ON_THE_WAY).state
                if state.residual <= ON_THE_WAY:
                    return known, state.z
        if problem.discs is not None:
            z = unloaded_twists(problem.tables, problem.strains)
            return known._replace(tensions=np.zeros_like(wanted.tensions)), z
        return known, self.unloaded(problem, known)[0]

    def _straight(self, problem: Problem, known: Condition) -> tuple[Condition, FloatArray]:
        """A ``known`` condition without tensions, beside obstacles as they find the arm at rest.

        And twists (N, m) in it, nearly.
        """
        known = known._replace(tensions=np.zeros_like(known.tensions))
        z = unloaded_twists(problem.tables, problem.strains)
        found = newton(problem, problem.evaluate(problem.at_nodes(known), z), ON_THE_WAY).state
        return known, found.z if found.residual <= ON_THE_WAY else z

    def _cold(self, wanted: Condition, level: int, spending: Spending) -> Verdict:
        """From the unloaded shape: by Newton's method, or followed on few nodes, or on all."""
        fine, coarse = self.problem(level), self.problem(COARSE)
        given, wanted = wanted, self.at_level(wanted, level)
        known, z = self._known(fine, wanted)
        tolerance = tolerance_of(fine)
        found = newton(fine, fine.evaluate(fine.at_nodes(wanted), z), tolerance)
        spending.add(found.iterations, 0.0, found.state.residual)
        is_near = found.corrected <= MOST_CORRECTED and not fine.passes(z, found.state.z)
        if found.state.residual <= tolerance and is_near:
            verdict = judge_stable(fine, found.state)
            if verdict is not None:
                return verdict
        if fine.contact is None and coarse.elements.s.size < fine.elements.s.size:
            try:
                roughly = self.at_level(given, COARSE)
                start, rough = self._known(coarse, roughly)
                rough_state = follow(
                    coarse, start, rough, roughly, spending, _FIRST_STEP, True
                ).state
                guess, reached = moved(rough_state.z, coarse.elements, fine.elements), wanted
                step = 1.0
                if rough_state.condition is not roughly:
                    # A branch of few nodes may end where that of the arm does not.
                    reached = rough_state.condition._replace(before=wanted.before)
                    step = _FIRST_STEP
                return follow(fine, reached, guess, wanted, spending, step)
            except ContinuationError:
                raise  # Its budget is spent.
            except ConvergenceError:
                pass  # Too few nodes, perhaps.
        return follow(fine, known, z, wanted, spending, _FIRST_STEP)

    def _resolved(self, found: Equilibrium, wanted: Condition, spending: Spending) -> Equilibrium:
        """What was ``found``, on as many nodes as it takes."""
        while not self.is_resolved(self.problem(found.level), found.state, found.level):
            level = found.level + 1
            problem = self.problem(level)
            z = moved(found.state.z, self.problem(found.level).elements, problem.elements)
            condition = self.at_level(wanted, level)
            verdict = follow(problem, condition, z, condition, spending)
            found = self._equilibrium(verdict, level, spending.iterations)
        return found

    def is_resolved(self, problem: Problem, state: State, level: int) -> bool:
        """Whether ``state`` on a ``level`` is as accurate as it should be.

        Raises:
            SolveError: if it is not, and there is no finer level.
        """
        error = problem.position_error(state.z)
        allowed = self.setting.accuracy
        if problem.contact is not None:
            allowed = max(allowed, WORST)
            depth = problem.contact.error(problem.places()) / self.arm.length
            if not depth <= (_WORST_DEPTH if self.is_last(level) else _DEPTH):
                if self.is_last(level):
                    raise SolveError(
                        f'{problem.elements.s.size} nodes do not resolve contact: error of '
                        f'depths of about {depth:.1e} of the length'
                    )
                return False
        # Between discs tensions do not change.
        slides = problem.friction is not None and problem.discs is None
        if slides:
            allowed *= _OF_FRICTION
        if self.is_last(level):
            allowed = max(allowed, WORST)
            require_resolved(problem, error, allowed)
        if not error <= allowed:
            return False
        if not slides:
            return True
        rough = self.finer(level).friction_error(state)
        if self.is_last(level) and not rough <= _WORST_TENSION:
            raise SolveError(
                f'{problem.elements.s.size} nodes do not resolve the tensions of tendons with '
                f'friction: error of about {rough:.1e} of them'
            )
        return self.is_last(level) or rough <= _TENSION_ERROR * allowed

    def is_last(self, level: int) -> bool:
        """Whether there is no finer level than this one."""
        if level == len(LEVELS) - 1:
            return True
        nodes, (cuts, more), (next_cuts, next_more) = (
            self.problem(level).elements,
            LEVELS[level],
            LEVELS[level + 1],
        )
        points = nodes.points - more + next_more
        return nodes.lengths.size // cuts * next_cuts * points > MAX_NODES


def require_resolved(problem: Problem, error: float, allowed: float) -> None:
    """Refuse an ``error`` of positions over the length of more than ``allowed``."""
    if not error <= allowed:
        raise SolveError(
            f'{problem.elements.s.size} nodes do not resolve the strains: error of '
            f'positions of about {error:.1e} of the length'
        )


def moved(z: FloatArray, before: Elements, now: Elements) -> FloatArray:
    """Twists ``z`` (N, m) at the nodes of other elements."""
    return np.ascontiguousarray(before.interpolation(now.s) @ z)
