"""One arm and its loads: stable equilibria for given tensions and a given wrench on the tip."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, ContinuationError, ConvergenceError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_NODES, Budget, Spending
from octo_arm_model.arm.loads import Loads
from octo_arm_model.arm.material import NEO_HOOKEAN
from octo_arm_model.arm.obstacles import Plane
from octo_arm_model.arm.stiffness import bending_force
from octo_arm_model.rod import arrays
from octo_arm_model.rod.backbone import FinePoints, Readout
from octo_arm_model.rod.checks import LoadLimits, check_solution, explain, explain_discs
from octo_arm_model.rod.contact import surface_radius
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
from octo_arm_model.rod.equilibrium import Condition, Equilibrium, Problem, State
from octo_arm_model.rod.factors import Linear
from octo_arm_model.rod.forms import choose_form
from octo_arm_model.rod.section_arrays import initial_twists
from octo_arm_model.rod.tables import added_points, least_bending, tabulate
from octo_arm_model.rod.tendons import unloaded_twists

# Errors of positions over the length beyond which no shape is returned, with contact or a history
# of friction, and without. The former bounds edges of contacts and kinks of tensions.
KINKED, WORST = 1e-5, 1e-6
_OF_KINKS = 1e3  # allowed error with a history of tensions, over that without, up to `KINKED`
# Largest errors of depths in obstacles over the length, and of tensions.
_WORST_DEPTH, _WORST_TENSION = 1e-4, 1e-2
_SOFT_DEPTH = 1e-3  # depth in soft planes over the deflection of the arm
_STIFFENING = 0.3  # first step from soft planes to stiff ones
_REDUCED = 0.1  # part of the tensions that a search begins with, if friction or discs need it
# Added part of the stiffness of sections, which leaves out motions to which an arm is neutral, as
# of an upright one that has buckled and may turn about the vertical: their errors are rounding.
_DAMPING = 1e-5
_RESTART_STEP = 0.25  # first step of continuation from a start where Newton's method has failed
_FIRST_STEP = 0.1  # first step of continuation otherwise
# An equilibrium counts as stable without a test if a stable one with a margin is near: the arm has
# turned by less [rad], the force on it times the square of its lever over E J has changed by less,
# and sheaths take less of its bending stiffness than this.
_SAME_SHAPE, _SAME_LOADS, _SOFT = 0.25, 0.02, 0.25


class Setting(NamedTuple):
    """The options of the model of an arm."""

    law: int = NEO_HOOKEAN  #: number of the elastic law, as in `arm.material.LAWS`
    shear: bool = False  #: whether cross sections shear; this requires the linear law
    accuracy: float = 1e-8  #: allowed error of positions over the length [-]
    #: whether numba compiles the node functions; None if it is installed and works
    compiled: bool | None = None


class Rod:
    """Equilibria of one arm under its loads.

    Attributes:
        arm: the arm.
        setting: the options of its model.
        is_compiled: whether numba compiles the node functions.
        is_loaded: whether sections are not in balance by themselves, because loads other than
            tendons and the wrench on the tip act, or because discs hold the tendons.
        has_friction: whether tendons have friction.
        has_obstacles: whether there are obstacles.
        added: number of points that the finer problem of each level has more in each element.
    """

    def __init__(
        self,
        arm: Arm,
        loads: Loads = Loads(),
        base: FloatArray | None = None,
        setting: Setting = Setting(),
    ) -> None:
        """Model ``arm`` on a base with the orientation ``base``, a quaternion w, x, y, z.

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
        # The problem of each level is built when it is first needed.
        self.problem = functools.lru_cache(self._problem)
        self.finer = functools.lru_cache(
            lambda level: FinePoints(self.problem(level), self.problem(level, self.added))
        )
        self.has_friction, self.has_obstacles = any(arm.friction), bool(loads.obstacles)
        self.is_loaded = bool(arm.discs.s or loads.others or loads.scaled or loads.obstacles)
        if loads.any:
            self.is_loaded |= bool(self._straight_resultants(loads).any())

    def _straight_resultants(self, loads: Loads) -> FloatArray:
        """Return force and free moment of ``loads`` on the straight rod; refuse too large ones."""
        problem = self.problem(0)
        with np.errstate(over='ignore', invalid='ignore'):
            straight = problem.straight_resultants()
        places = np.concatenate([problem.elements.edges, problem.elements.s])
        LoadLimits(self.arm, places).check_loads(loads, straight)
        return straight

    @functools.cached_property
    def without_obstacles(self) -> Rod:
        """The same rod without obstacles."""
        loads = dataclasses.replace(self._loads, obstacles=())
        return Rod(self.arm, loads, self._base, self.setting)

    @functools.cached_property
    def _flexibility(self) -> tuple[float, float, FloatArray]:
        """Bounds of the rotation by a force and by a pull between discs, and softness of sheaths.

        These are parts of the bending stiffness per square of the tension, (J,).
        """
        tables, s = self.problem(0).tables, self.problem(0).elements.s
        bending = least_bending(tables)
        apart = np.diff([0.0, *self.arm.discs.faces, self.arm.length]).max()
        by_force = float(((self.arm.length - s) ** 2 / bending).max())
        return by_force, float((apart**2 / bending).max()), tables.compliance / bending.min()

    def _problem(self, level: int, added: int = 0) -> Problem:
        """Build the equations on elements of a ``level``, with ``added`` more points in each."""
        breaks, knots = self._loads.breaks, self._loads.knots
        elements = build_elements(self.arm, breaks, knots, level, added)
        tables = tabulate(self.arm, elements, self._base, law=self.setting.law)
        described = self.arm, elements, tables, self._loads, self._form, self._strains
        return Problem(*described, has_jacobian=not added)

    def readout(self, level: int, s: FloatArray) -> Readout:
        """Return what reads equilibria of a ``level`` at arc coordinates ``s`` (S,) [m]."""
        return Readout(self.finer(level), self.arm, s)

    def solve(
        self, target: Condition, start: Equilibrium | None = None, spending: Spending | None = None
    ) -> Equilibrium:
        """Find the equilibrium in the condition ``target``, with tensions (J,) at the base.

        The arm is followed from ``start``, or from the unloaded shape. Tendons with friction slide
        from the tensions `Condition.before`, a `Problem.history` of any level.

        Raises:
            SolveError: if there is no trustworthy answer.
            ContinuationError: if it would take more than the budget.
        """
        spending = spending or Spending(Budget())
        is_loaded = self.is_loaded or bool(target.tip_wrench.any())
        with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
            if is_loaded or self.has_friction:
                try:
                    equilibrium = self._loaded_equilibrium(target, start, spending)
                except ContinuationError:
                    raise
                except ConvergenceError as error:
                    explained = self._explained(target, error)
                    raise explain_discs(self.problem(0), target.tensions, explained) from None
            else:
                equilibrium = self._unloaded_equilibrium(target)
            check_solution(self.problem(equilibrium.level), equilibrium.state, is_loaded)
        return equilibrium

    def _explained(self, target: Condition, error: ConvergenceError) -> ConvergenceError:
        """Return the ``error``, or one that says which obstacle keeps the arm from a balance."""
        problem = self.problem(0)
        if problem.contact is None:
            return error
        problem.orient(self.unloaded(problem, target)[0])
        if not (violation := problem.contact.inside(problem.places())):
            return error
        subject = f'the balance of an arm that under its tensions alone is {violation}'
        return ConvergenceError(subject, error.residual, error.iterations)

    def _loaded_equilibrium(
        self, target: Condition, start: Equilibrium | None, spending: Spending
    ) -> Equilibrium:
        """Find a stable equilibrium under loads, on enough nodes for the accuracy."""
        start = self.on_start_level(start, target.before)
        equilibrium = None if start is None else self._from_start(target, start, spending)
        if equilibrium is None and start is not None and start.guess is not None:
            raise ContinuationError('one search', 0.0, start.state.residual, spending.iterations)
        if equilibrium is None:
            equilibrium = self._by_continuation(target, start, spending)
        if start is not None and equilibrium.firm_state is start.firm_state is not None:
            return equilibrium  # The start was resolved, and this one is close to it.
        return self._resolved(equilibrium, target, spending)

    def _fine(self, level: int) -> Elements:
        friction = self.problem(level).friction
        assert friction is not None
        return friction.fine

    def level_of(self, before: FloatArray) -> int:
        """Return the level whose fine points the tensions ``before`` (M, J) are at.

        Raises:
            ConfigError: if no level of this arm has so many fine points.
        """
        for level in (*range(len(LEVELS)), COARSE):
            if len(before) == self._fine(level).s.size:
                return level
        raise ConfigError('the backbone was solved by another solver')

    def at_level(self, condition: Condition, level: int) -> Condition:
        """Return ``condition`` with the tensions before at the fine points of a ``level``."""
        before = condition.before
        if before is None or (given_level := self.level_of(before)) == level:
            return condition
        interpolated = moved(before, self._fine(given_level), self._fine(level))
        return condition._replace(before=interpolated)

    def on_level(self, equilibrium: Equilibrium, level: int) -> Equilibrium:
        """Return ``equilibrium`` with its twists interpolated to the nodes of a ``level``."""
        if level == equilibrium.level:
            return equilibrium
        before, after = self.problem(equilibrium.level), self.problem(level)

        def on_nodes(z: FloatArray) -> FloatArray:
            return moved(z, before.elements, after.elements)

        condition = self.at_level(equilibrium.state.condition, level)
        state = after.evaluate(after.at_nodes(condition), on_nodes(equilibrium.state.z))
        guess = None if equilibrium.guess is None else on_nodes(equilibrium.guess)
        return Equilibrium(state, level, None, None, equilibrium.iterations, guess=guess)

    def on_start_level(
        self, start: Equilibrium | None, before: FloatArray | None
    ) -> Equilibrium | None:
        """Return ``start`` on the coarsest level that resolves it, or on that of ``before``.

        A shape that took many nodes would otherwise make all later searches as slow.
        """
        if start is None:
            return None
        least = self.first_level(before)
        if start.level < least:
            return self.on_level(start, least)
        while start.level > least:
            if start.firm_state is not None and start.firm_state is not start.state:
                break  # It is close to a firm state, and has its level.
            coarser = self.on_level(start, start.level - 1)
            if not self.is_resolved(coarser.state, coarser.level):
                break
            start = coarser
        return start

    def first_level(self, before: FloatArray | None) -> int:
        """Return the level on which a search begins if tendons slide from tensions ``before``.

        It is the coarsest whose fine points have these tensions (M, J) to the accuracy.
        """
        if before is None:
            return 0
        level = max(self.level_of(before), 0)
        while level > 0:
            fine, coarse = self._fine(level), self._fine(level - 1)
            coarser = moved(before, fine, coarse)
            change = np.abs(moved(coarser, coarse, fine) - before).max()
            if not change <= self.allowed_error(before) * before.max():
                break
            before, level = coarser, level - 1
        return level

    def _unloaded_equilibrium(self, target: Condition) -> Equilibrium:
        """Find the balance of every cross section by itself, on enough nodes for the accuracy."""
        iterations = 0
        for level in range(len(LEVELS)):
            # Sections are in balance by themselves, so the finer points are solved for directly.
            finer = self.finer(level)
            fine, residual, steps = self.unloaded(finer.own, target)
            iterations += steps
            error = finer.error_between(fine)
            if error <= self.setting.accuracy:
                break
        require_resolved(finer.own, error, max(self.setting.accuracy, WORST))
        z = finer.to_nodes @ fine
        at_nodes = finer.problem.at_nodes(target)
        state = State(at_nodes, z, np.zeros(z.shape), residual)
        return Equilibrium(state, level, None, None, iterations, fine)

    def unloaded(self, problem: Problem, target: Condition) -> tuple[FloatArray, float, int]:
        """Return twists at the nodes of ``problem`` under tensions alone, residual and steps.

        With friction of the tendons the twists are approximate.

        Raises:
            SolveError: if there is no balance.
        """
        local = np.empty((problem.elements.s.size, target.tensions.size))
        local[:] = target.tensions
        if problem.friction is not None and target.tensions.any():
            straight = initial_twists(problem.tables, local, problem.strains)
            local = problem.first_tensions(target, straight)
        z = np.zeros((len(local), problem.strains))
        try:
            residual, steps = problem.balance_sections(local, z)
        except ConvergenceError as error:
            raise explain(problem, local, error) from None
        return z, residual, steps

    def _from_start(
        self, target: Condition, start: Equilibrium, spending: Spending
    ) -> Equilibrium | None:
        """Search by Newton's method from ``start``; None if it finds no stable equilibrium."""
        problem = self.problem(start.level)
        at_nodes = problem.at_nodes(self.at_level(target, start.level))
        guess = start.state.z if start.guess is None else start.guess
        initial = problem.evaluate(at_nodes, guess)
        result = newton(problem, initial, spending.residual, start.factors)
        spending.add(result.iterations, 0.0, result.state.residual)
        return self._accepted(problem, result, start, spending)

    def _accepted(
        self, problem: Problem, result: NewtonResult, start: Equilibrium, spending: Spending
    ) -> Equilibrium | None:
        """Return the ``result`` if it is stable and on the branch of ``start``, else None."""
        state, total = result.state, spending.iterations
        if not (state.residual <= spending.residual and result.corrected <= MOST_CORRECTED):
            return None
        if problem.passes(start.state.z, state.z):
            return None
        firm = start.firm_state
        if firm is not None and self.is_near(problem, firm, state):
            return Equilibrium(state, start.level, result.factors or start.factors, firm, total)
        verdict = judge_stable(problem, state)
        return None if verdict is None else self._equilibrium(verdict, start.level, total)

    def _equilibrium(self, verdict: Verdict, level: int, total: int) -> Equilibrium:
        firm = verdict.state if verdict.stability.is_firm else None
        return Equilibrium(verdict.state, level, verdict.factors, firm, total)

    def is_near(self, problem: Problem, firm: State, state: State) -> bool:
        """Whether ``state`` is so near the ``firm`` one, stable by a margin, that it is stable."""
        if any(each.at_nodes.is_touching for each in (firm, state)):
            return False  # A contact that opens no longer holds the arm.
        if not problem.has_energy(state.condition):
            return False
        by_force, by_pull, by_square = self._flexibility
        if float(state.at_nodes.tensions.max(axis=0) ** 2 @ by_square) > _SOFT:
            return False
        change = state.at_nodes.force - firm.at_nodes.force
        loads = by_force * float(np.abs(change).max())
        if problem.discs is not None:  # Between discs the pull of tendons is a load.
            pulls = state.at_nodes.tensions - firm.at_nodes.tensions
            loads += by_pull * float(np.abs(pulls).sum(axis=1).max())
        return loads <= _SAME_LOADS and problem.turn(state.z - firm.z) <= _SAME_SHAPE

    def _by_continuation(
        self, target: Condition, start: Equilibrium | None, spending: Spending
    ) -> Equilibrium:
        """Search by continuation from ``start``, or from the unloaded shape."""
        if start is not None:
            problem, level = self.problem(start.level), start.level
            initial, z = start.state.condition, start.state.z
            target = self.at_level(target, level)
            verdict = self._follow_softened(problem, initial, z, target, spending, _RESTART_STEP)
        else:
            level = self.first_level(target.before)
            verdict = self._from_unloaded(target, level, spending)
        return self._equilibrium(verdict, level, spending.iterations)

    def _easy_condition(self, problem: Problem, target: Condition) -> tuple[Condition, FloatArray]:
        """Return a condition that is easy to solve, to follow the arm from, and its twists (N, m).

        It has the tensions of ``target``, or part of them, or none, without other loads.
        """
        initial = target._replace(tip_wrench=np.zeros(6), factor=0.0)
        if problem.contact is not None and (straight := self._straight(problem, initial)):
            return straight
        if problem.friction is None and problem.discs is None:
            return initial, self.unloaded(problem, initial)[0]
        for part in (1.0, _REDUCED):
            initial = initial._replace(tensions=part * target.tensions)
            with contextlib.suppress(ConvergenceError):
                z = self.unloaded(problem, initial)[0]
                guess = problem.evaluate(problem.at_nodes(initial), z)
                state = newton(problem, guess, ON_THE_WAY).state
                if state.residual <= ON_THE_WAY:
                    return initial, state.z
        if problem.discs is not None:
            z = unloaded_twists(problem.tables, problem.strains)
            return initial._replace(tensions=np.zeros_like(target.tensions)), z
        return initial, self.unloaded(problem, initial)[0]

    def _straight(
        self, problem: Problem, condition: Condition
    ) -> tuple[Condition, FloatArray] | None:
        """Return ``condition`` without tensions, and nearly the twists (N, m) beside obstacles.

        None if the arm without tensions is inside an obstacle: then it has no side to begin on.
        """
        assert problem.contact is not None
        condition = condition._replace(tensions=np.zeros_like(condition.tensions))
        z = unloaded_twists(problem.tables, problem.strains)
        state = newton(problem, problem.evaluate(problem.at_nodes(condition), z), ON_THE_WAY).state
        if state.residual <= ON_THE_WAY:
            return condition, state.z
        problem.orient(z)
        return None if problem.contact.inside(problem.places()) else (condition, z)

    def _from_unloaded(self, target: Condition, level: int, spending: Spending) -> Verdict:
        """Search from the unloaded shape: by Newton's method, else by continuation."""
        fine, coarse = self.problem(level), self.problem(COARSE)
        given_target, target = target, self.at_level(target, level)
        initial, z = self._easy_condition(fine, target)
        tolerance = tolerance_of(fine)
        result = newton(fine, fine.evaluate(fine.at_nodes(target), z), tolerance)
        spending.add(result.iterations, 0.0, result.state.residual)
        is_near = result.corrected <= MOST_CORRECTED and not fine.passes(z, result.state.z)
        if result.state.residual <= tolerance and is_near:
            verdict = judge_stable(fine, result.state)
            if verdict is not None:
                return verdict
        if fine.contact is None and coarse.elements.s.size < fine.elements.s.size:
            try:
                rough_target = self.at_level(given_target, COARSE)
                start, rough_guess = self._easy_condition(coarse, rough_target)
                rough_state = follow(
                    coarse, start, rough_guess, rough_target, spending, _FIRST_STEP, True
                ).state
                guess, intermediate = moved(rough_state.z, coarse.elements, fine.elements), target
                step = 1.0
                if rough_state.condition is not rough_target:
                    # The branch of the coarse problem may end before that of the fine one.
                    intermediate = rough_state.condition._replace(before=target.before)
                    step = _FIRST_STEP
                return follow(fine, intermediate, guess, target, spending, step)
            except ContinuationError:
                raise  # The budget is spent.
            except ConvergenceError:
                pass  # The coarse problem may have too few nodes.
        return self._follow_softened(fine, initial, z, target, spending, _FIRST_STEP)

    def _follow_softened(
        self,
        problem: Problem,
        initial: Condition,
        z: FloatArray,
        target: Condition,
        spending: Spending,
        step: float,
    ) -> Verdict:
        """Follow the arm as `continuation.follow` does, but planes are soft while loads change.

        A contact with a stiff plane begins and ends within a small change of the loads, which
        would be a step each.
        """
        if self._soft_rigidity < 1.0:
            soft = initial._replace(rigidity=self._soft_rigidity)
            soft_target = target._replace(rigidity=self._soft_rigidity)
            try:
                z_soft = follow(problem, initial, z, soft, spending).state.z
                z_soft = follow(problem, soft, z_soft, soft_target, spending, step).state.z
                return follow(problem, soft_target, z_soft, target, spending, _STIFFENING)
            except ContinuationError:
                raise  # The budget is spent.
            except ConvergenceError:
                pass  # The arm may have sunk in too far.
        return follow(problem, initial, z, target, spending, step)

    @functools.cached_property
    def _soft_rigidity(self) -> float:
        """The `Condition.rigidity` that makes planes soft; 1 if there are other obstacles.

        An arm that rests on a soft plane all along sinks in by a part `_SOFT_DEPTH` of the
        deflection of its tip by the same force. It may slip past a soft post or ball.
        """
        obstacles, length = self._loads.obstacles, self.arm.length
        if not (obstacles and all(isinstance(each, Plane) for each in obstacles)):
            return 1.0
        stiffness = max(plane.stiffness for plane in obstacles)
        deflection = length / bending_force(self.arm, 1.0)  # [m/N]
        width = 2.0 * float(surface_radius(self.arm, self.problem(0).elements.s).mean())
        return min(1.0, 1.0 / (_SOFT_DEPTH * deflection * width * length * stiffness))

    def _resolved(
        self, equilibrium: Equilibrium, target: Condition, spending: Spending
    ) -> Equilibrium:
        """Return the ``equilibrium`` in the condition ``target``, on enough nodes."""
        while True:
            # What is stable by a margin amplifies errors little.
            factors = equilibrium.factors if equilibrium.firm_state is None else None
            if self.is_resolved(equilibrium.state, equilibrium.level, factors):
                return equilibrium
            finer = self.on_level(equilibrium, equilibrium.level + 1)
            problem, condition = self.problem(finer.level), self.at_level(target, finer.level)
            verdict = follow(problem, condition, finer.state.z, condition, spending)
            equilibrium = self._equilibrium(verdict, finer.level, spending.iterations)

    def allowed_error(self, before: FloatArray | None) -> float:
        """Return the allowed error of positions over the length, and of tensions.

        Tensions ``before`` (M, J) [N] have kinks, for which more nodes gain little.
        """
        accuracy = self.setting.accuracy
        return accuracy if before is None else max(accuracy, min(_OF_KINKS * accuracy, KINKED))

    def is_resolved(self, state: State, level: int, factors: Linear | None = None) -> bool:
        """Whether a ``level`` resolves ``state``, by ``factors`` of its Jacobian if it is soft.

        Raises:
            SolveError: if it is not, and there is no finer level.
        """
        problem, finer, is_last = self.problem(level), self.finer(level), self.is_last(level)
        before, error = state.condition.before, problem.position_error(state.z)
        allowed = self.allowed_error(before)
        depth_error = _depth_error(problem, is_last)
        if is_last or depth_error:
            is_kinked = depth_error or before is not None
            allowed = max(allowed, KINKED if is_kinked else WORST)
        if not (is_last or depth_error <= _WORST_DEPTH):
            return False
        if error <= allowed:
            error = max(error, finer.error_between(finer.balance(state)[1]))
        if error <= allowed and factors is not None:
            at_nodes = finer.error_at_nodes(state, factors)
            if not at_nodes <= allowed:
                at_nodes = finer.error_at_nodes(state, problem.linearise(state, _DAMPING))
            error = max(error, at_nodes)
        if is_last:
            require_resolved(problem, error, allowed)
        if not error <= allowed:
            return False
        if problem.friction is None or problem.discs is not None:
            return True  # Between discs tensions are constant.
        tension_error = finer.friction_error(state)
        if is_last and not tension_error <= _WORST_TENSION:
            raise SolveError(
                f'{problem.elements.s.size} nodes do not resolve the tensions of tendons with '
                f'friction: error of about {tension_error:.1e} of them'
            )
        return is_last or tension_error <= allowed

    def is_last(self, level: int) -> bool:
        """Whether there is no finer level than this one."""
        if level == len(LEVELS) - 1:
            return True
        nodes = self.problem(level).elements
        (cuts, more), (next_cuts, next_more) = LEVELS[level : level + 2]
        points = nodes.points - more + next_more
        return nodes.lengths.size // cuts * next_cuts * points > MAX_NODES


def _depth_error(problem: Problem, is_last: bool) -> float:
    """Return the error of depths in obstacles over the length, 0 if none is touched.

    Raises:
        SolveError: if it is too large, and this level ``is_last``.
    """
    if problem.contact is None:
        return 0.0
    error = problem.contact.error(problem.places()) / problem.elements.edges[-1]
    if is_last and not error <= _WORST_DEPTH:
        raise SolveError(
            f'{problem.elements.s.size} nodes do not resolve contact: error of depths of about '
            f'{error:.1e} of the length'
        )
    return float(error)


def require_resolved(problem: Problem, error: float, allowed: float) -> None:
    """Raise SolveError if the ``error`` of positions over the length is above ``allowed``."""
    if not error <= allowed:
        raise SolveError(
            f'{problem.elements.s.size} nodes do not resolve the strains: error of '
            f'positions of about {error:.1e} of the length'
        )


def moved(z: FloatArray, before: Elements, after: Elements) -> FloatArray:
    """Interpolate values ``z`` (N, ...) from the nodes of ``before`` to those of ``after``."""
    return np.ascontiguousarray(before.interpolation(after.s) @ z)
