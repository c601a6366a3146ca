"""The motion of an arm by time steps, each a balance of the rod with the loads of `inertia`.

The rule is generalised alpha (Chung and Hulbert 1993) in the form of Arnold and Bruls 2007, on
positions and axes of the cross sections, which are vectors. With the acceleration a of the rule
and that of the rod, x'',

    x_1 = x_0 + h x'_0 + h^2 ((1/2 - beta) a_0 + beta a_1),
    x'_1 = x'_0 + h ((1 - gamma) a_0 + gamma a_1),
    (1 - alpha_m) a_1 + alpha_m a_0 = (1 - alpha_f) x''_1 + alpha_f x''_0,

so that x' and x'' are linear in x_1, and the balance holds at the end of each step. The rule is of
second order. It hardly damps slow motions, and the fastest by the factor rho_inf per step.
"""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from octo_arm_model.arm.errors import (
    ArmDefinitionError,
    ConfigError,
    ConvergenceError,
    SolveError,
    TensionError,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.material import MotionProperties
from octo_arm_model.arm.pose import Pose
from octo_arm_model.arm.validation import vector, within
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.checks import check_stretches, check_tensions
from octo_arm_model.rod.contact import NONE, Contacts
from octo_arm_model.rod.continuation import Rule, newton
from octo_arm_model.rod.displacements import check_displacements
from octo_arm_model.rod.elements import LEVELS, Elements, build_elements
from octo_arm_model.rod.equilibrium import Condition, NodeCondition, State
from octo_arm_model.rod.factors import Linear
from octo_arm_model.rod.forms import choose_form
from octo_arm_model.rod.inertia import MovingProblem, node_motion
from octo_arm_model.rod.motion_state import (
    CheckedInputs,
    Inputs,
    MotionState,
    load_state,
    save_state,
)
from octo_arm_model.rod.rod import moved
from octo_arm_model.rod.solver import Solver
from octo_arm_model.rod.statics import strains_of
from octo_arm_model.rod.tables import POSITION, TimeRule, places_at, tabulate
from octo_arm_model.rod.winch_equations import BorderedSystem, WinchEquations

RHO_INF = 0.85
TOLERANCE = 1e-7  # residual of the balance at the end of a step, but for rounding of places
# Any progress is accepted, as a time step is halved if its search fails.
_RULE = Rule(iterations=30, again=0.6, predicted=1.0, first=1.0, progress=1.0, shortest=0.01)
_FEWER_POINTS = -2  # points of an element more than for an equilibrium
_LEAST_HALF = 2e-5  # shortest step that is halved [s]
# A longer step than this [s] with more than _CALM iterations is not accurate: the arm whips.
_SHORT, _CALM = 1.25e-3, 5
STEPS = 1e-7, 1.0  # shortest and longest [s]


def base_of(pose: Pose) -> FloatArray:
    """Return position [m] and quaternion w, x, y, z of a ``pose``, (7,)."""
    x, y, z, w = pose.quaternion
    return np.array([*pose.position, w, x, y, z])


class Dynamics:
    """The dynamics of one arm.

    It is not for two threads at once, but each may have a copy. States have to come from it or a
    copy; those with another number of nodes, strains or tendons are refused.

    Attributes:
        solver: solver of the equilibria of the arm.
        properties: damping of the arm, and the properties of the water.
        problem: equations of the moving arm at its nodes.
    """

    def __init__(
        self,
        solver: Solver,
        properties: MotionProperties = MotionProperties(),
        rho_inf: float = RHO_INF,
        level: int = 0,
    ) -> None:
        """Prepare the equations of the arm, loads, base and stations of ``solver``.

        Higher levels, 0 to 4, have more nodes, see `elements.LEVELS`.

        Raises:
            ConfigError: if the model of ``solver`` is not exact, or there is no such level.
            ArmDefinitionError: if the arm has no density, or ``rho_inf`` is not in [0, 1].
        """
        if solver.model != 'exact':
            raise ConfigError(f'model is {solver.model!r}, which does not move: choose exact')
        self.solver, self.properties, arm = solver, properties, solver.arm
        rho = within('rho_inf', rho_inf, 0.0, 1.0, '-')
        m, f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        self._rule = m, f, 0.5 - m + f, 0.25 * (1.0 - m + f) ** 2
        base = base_of(solver.base)
        loads = solver.loads.moved(-base[:3])
        if level not in range(len(LEVELS)):
            raise ConfigError(f'level is {level!r}, expected 0 to {len(LEVELS) - 1}')
        elements = build_elements(arm, loads.breaks, loads.knots, level, _FEWER_POINTS)
        tables = tabulate(arm, elements, base[3:], law=solver.law.number)
        form = choose_form(solver.is_compiled)
        self.problem = MovingProblem(
            arm, elements, tables, loads, form, solver.strains, properties
        )
        self.problem.origin = base[:3]
        self._base, self.places = base, places_at(elements, solver.grid.s)
        # At rest obstacles have no friction, as it grows with the speed.
        smooth = solver.loads.without_friction()
        self._still = solver.with_loads(smooth) if loads.has_friction else solver
        self._options = rho_inf, level
        self._to_base = elements.interpolation(np.zeros(1))[0]
        self._numbers = {name: number for number, name in enumerate(arm.tendon_names)}

    def __reduce__(self) -> tuple[type[Dynamics], tuple[object, ...]]:
        """Copy by preparing another one with the same arguments, also in another process."""
        return Dynamics, (copy.copy(self.solver), self.properties, *self._options)

    @property
    def nodes(self) -> Elements:
        """The elements with the nodes."""
        return self.problem.elements

    @functools.cached_property
    def winches(self) -> WinchEquations:
        """The equations of the arm with winches."""
        return WinchEquations(self.problem, self.solver.arm)

    # States ------------------------------------------------------------------------------------

    def at_rest(self, inputs: Inputs, time: float = 0.0) -> MotionState:
        """Return the equilibrium under ``inputs``, on the base of the solver.

        Raises:
            OctoArmError: if the inputs do not fit the arm, or there is no equilibrium.
            ConfigError: if the inputs have another base.
        """
        (target, current, base), solver = self.checked(inputs), self._still
        if not (base == self._base).all():
            raise ConfigError('inputs.base is another than that of the solver, expected None')
        tensions, wrench = target.tensions, target.tip_wrench - solver.loads.tip_wrench
        if target.driven.any():
            start, _ = solver.wind(target.lengths, target.driven, tensions, wrench, None)
        else:
            start = solver.solve(tensions.reshape(solver.arm.tension_shape), wrench)
        assert start.equilibrium is not None
        level, z = start.equilibrium.level, start.equilibrium.state.z
        problem = self.problem
        z = moved(z, solver.elements(level), problem.elements)
        problem.place_base(base)
        problem.reference = np.zeros(z.shape[1])
        condition = Condition(start.tensions.ravel(), target.tip_wrench)
        state = self._in_current(problem.at_nodes(condition), z, current)
        twist, place = np.zeros((4, *z.shape)), np.zeros((4, *problem.motion.place.shape))
        twist[0], place[0] = state.z, problem.motion.place
        water = np.array([current, *np.zeros((2, 3))])
        return self._state(time, base, state, (twist, place, water))

    @np.errstate(over='ignore', invalid='ignore', divide='ignore')
    def _in_current(self, at_nodes: NodeCondition, z: FloatArray, current: FloatArray) -> State:
        """Return the balance near ``z`` at rest, in a ``current`` that is raised step by step."""
        problem = self.problem
        for steps in (1, 8, 64):
            guess = z
            for step in range(1, steps + 1):
                water = np.array([current * (step / steps), np.zeros(3)])
                problem.rule = problem.rest._replace(water=water)
                result = newton(problem, problem.evaluate(at_nodes, guess), TOLERANCE)
                guess = result.state.z
            if result.state.residual <= TOLERANCE:
                break
        beginning = 'the equilibrium in which the motion begins'
        self._require(beginning, result.state, TOLERANCE, result.iterations)
        return result.state

    def checked(self, inputs: Inputs) -> CheckedInputs:
        """Check ``inputs`` and return them as arrays.

        Raises:
            TensionError: if tensions or displacements do not fit the arm.
            LoadError: if the wrench on the tip is not six finite numbers, or too large.
            ArmDefinitionError: if the current is not three finite numbers, or the base no pose.
        """
        solver, count = self.solver, len(self._numbers)
        tensions = check_tensions(solver.arm, inputs.tensions).reshape(-1)
        if tensions.size != count:
            raise TensionError(f'inputs.tensions are {tensions.size}, expected one set of {count}')
        lengths, driven = np.zeros(count), np.zeros(count, np.bool_)
        check_displacements(solver.arm, inputs.displacements, {})
        if inputs.displacements:
            numbers = [self._numbers[name] for name in inputs.displacements]
            lengths[numbers], driven[numbers] = [*inputs.displacements.values()], True
            solver.check_displacements(lengths[numbers], numbers)
        wrench = np.array(solver.loads.tip_wrench)
        if inputs.tip_wrench is not None:
            wrench += solver.check_tip_wrench(inputs.tip_wrench)
        current = self.properties.current
        if inputs.current is not None:
            current = vector('inputs.current', inputs.current, 'm/s')
        if not isinstance(inputs.base, Pose | None):
            raise ArmDefinitionError('inputs.base', inputs.base, 'a Pose or None')
        base = self._base if inputs.base is None else base_of(inputs.base)
        condition = Condition(tensions, wrench, 1.0, None, lengths, driven)
        return CheckedInputs(condition, np.array(current), base)

    def _state(
        self,
        time: float,
        base: FloatArray,
        balance: State,
        motion: tuple[FloatArray, FloatArray, FloatArray],
        last: tuple[int, float, Linear | None] = (0, 0.0, None),
    ) -> MotionState:
        problem, condition = self.problem, balance.condition
        history = None if problem.friction is None else problem.history(balance)
        wrench = np.abs(problem.work.gradient).max(axis=0)
        beyond = np.concatenate([balance.at_nodes.force, problem.work.moment], axis=1)
        loads = condition.tensions, condition.tip_wrench, base, wrench, self._to_base @ beyond
        for array in (*motion, *loads, history):
            if array is not None:
                array.setflags(write=False)
        return MotionState(time, *motion, *loads, history, balance.residual, *last)

    # Steps -------------------------------------------------------------------------------------

    @np.errstate(over='ignore', invalid='ignore', divide='ignore')
    def step(self, state: MotionState, inputs: Inputs, dt: float) -> MotionState:
        """Return the state after ``dt`` [s], at whose end ``inputs`` act.

        If Newton's method fails the step is divided into shorter ones.

        Raises:
            SolveError: if no step is short enough.
            ArmDefinitionError: if ``dt`` is not from 1e-7 to 1 s.
            ConfigError: if the state is that of another arm.
            OctoArmError: if the inputs do not fit the arm.
        """
        dt = within('dt', dt, *STEPS, 's')
        self._require_own(state)
        return self._advance(state, self.checked(inputs), dt, dt)

    @np.errstate(over='ignore', invalid='ignore', divide='ignore')
    def go_on(
        self, state: MotionState, inputs: Inputs, elapsed: float, longest: float
    ) -> MotionState:
        """Return the state after ``elapsed`` [s] in equal steps of at most ``longest`` [s].

        All inputs change linearly over them. A step that fails, or takes many iterations because
        the arm whips, is divided into shorter ones.

        Raises:
            OctoArmError: if no step is short enough, or an argument does not fit, see `step`.
        """
        self._require_own(state)
        checked, count = self.checked(inputs), max(math.ceil(elapsed / longest - 1e-9), 1)
        dt = within('dt', elapsed / count, *STEPS, 's')
        for steps in range(count, 0, -1):
            state = self._advance(state, self._between(state, checked, 1.0 / steps), dt, _SHORT)
        return state

    def _require_own(self, state: MotionState) -> None:
        """Refuse a state whose arrays are not as large as those of this arm."""
        expected = (4, *self.problem.rest.twist_rate.shape), (len(self._numbers),)
        if (state.twist.shape, state.tensions.shape) != expected:
            raise ConfigError('the state is that of another arm, or of other nodes')

    def _advance(
        self, state: MotionState, inputs: CheckedInputs, dt: float, short: float
    ) -> MotionState:
        """Return the state after one step, or two half ones if that fails or is inaccurate."""
        is_calm = state.iterations <= _CALM or state.dt >= dt
        if dt <= short or is_calm:
            try:
                new = self._one_step(state, inputs, dt)
                if dt <= short or new.iterations <= _CALM:
                    return new
            except SolveError as error:
                if dt < _LEAST_HALF:
                    undamped = '; nothing damps its waves: state a viscosity or damping_time'
                    raise SolveError(
                        f'the motion ends at {state.time:.6g} s, no step of {dt:.2g} s succeeds: '
                        f'{error}{"" if self.problem.is_viscous else undamped}'
                    ) from None
        middle = self._advance(state, self._between(state, inputs, 0.5), 0.5 * dt, short)
        return self._advance(middle, inputs, 0.5 * dt, short)

    def _between(self, state: MotionState, inputs: CheckedInputs, part: float) -> CheckedInputs:
        """Return the inputs at a ``part`` of the way from those of ``state``."""
        if part == 1.0:
            return inputs
        target, current_before, base = inputs.condition, state.water[0], state.base.copy()
        lengths = self.displacements(state) if target.driven.any() else target.lengths
        initial = Condition(state.tensions, state.tip_wrench, lengths=lengths)
        # Two quaternions have the same orientation; take the nearer one.
        base[3:] *= math.copysign(1.0, base[3:] @ inputs.base[3:])
        if not (base == inputs.base).all():  # else rounding would move a base at rest
            base += part * (inputs.base - base)
            base[3:] /= np.linalg.norm(base[3:])
        current = current_before + part * (inputs.current - current_before)
        return CheckedInputs(initial.towards(target, part), current, base)

    def _one_step(self, state: MotionState, inputs: CheckedInputs, dt: float) -> MotionState:
        problem, (m, f, gamma, beta) = self.problem, self._rule
        z, (_, rate, bend, last_bend) = state.z, state.twist
        place, velocity, acceleration, own = state.place
        problem.place_base(state.base)
        if state.dt != dt and (inputs.base == state.base).all():
            # Rates of places and twists differ by the square of a step, too much for a short one.
            problem.orient(z)
            velocity, own = problem.velocities(place, rate), acceleration
        # Coefficients of the rule for the end of the step, x: a_1 = c x - a, and so on.
        c, ratio = 1.0 / (beta * dt * dt), (1.0 - m) / (1.0 - f)
        carried = (0.5 - beta) / beta

        def before(x: FloatArray, x_rate: FloatArray, a: FloatArray) -> FloatArray:
            return c * (x + dt * x_rate) + carried * a

        def to_rate(x_rate: FloatArray, a: FloatArray, own: FloatArray) -> FloatArray:
            return gamma * dt * a - x_rate - (1.0 - gamma) * dt * own

        a, a_z = before(place, velocity, own), before(z, rate, bend)
        water = np.empty((3, 3))
        water[0] = inputs.current
        water[2] = ((inputs.current - state.water[0]) / dt - (1 - gamma) * state.water[2]) / gamma
        water[1] = ((1 - m) * water[2] + m * state.water[2] - f * state.water[1]) / (1.0 - f)
        problem.rule = TimeRule(
            gamma * dt * c,
            ratio * c,
            to_rate(velocity, a, own),
            ratio * a - (m * own - f * acceleration) / (1.0 - f),
            to_rate(rate, a_z, bend),
            water[:2],
        )
        problem.place_base(inputs.base)
        problem.reference = state.wrench.copy()  # a copy, as `MotionState.z` is
        guess, factors = z + dt * rate + 0.5 * dt * dt * bend, None
        if state.dt == dt:
            factors = state.factors
            guess += beta * dt * dt * (bend - last_bend)
        tolerance = max(TOLERANCE, problem.rounding / dt**2)
        target = inputs.condition._replace(before=state.history)
        balance, next_factors, iterations = self._balance(state, target, guess, factors, tolerance)
        self._require('the balance of a time step', balance, tolerance, iterations)
        self._check_contact(state)
        rule, (place, velocity, acceleration, _) = problem.rule, problem.motion
        rate = rule.by_velocity * balance.z - rule.twist_rate
        twist = np.array([balance.z, rate, c * balance.z - a_z, bend])
        places = np.array([place, velocity, acceleration, c * place - a])
        last = iterations, dt, next_factors
        return self._state(state.time + dt, inputs.base, balance, (twist, places, water), last)

    def _balance(
        self,
        state: MotionState,
        target: Condition,
        guess: FloatArray,
        factors: Linear | None,
        tolerance: float,
    ) -> tuple[State, Linear | None, int]:
        if target.driven.any():
            winches = self.winches
            pulled = np.where(target.driven, state.tensions, target.tensions)
            guess_state = winches.evaluate(target._replace(tensions=pulled), guess)
            # Lengths have little weight beside the balance: the first step may have any residual.
            change, system = winches.step(guess_state, winches.linearise(guess_state, factors))
            guess_state = winches.moved(guess_state, change, system)
            result = newton(winches, guess_state, tolerance, system, rule=_RULE)
            assert isinstance(result.factors, BorderedSystem)
            return result.state, result.factors.factors, result.iterations
        problem = self.problem
        guess_state = problem.evaluate(problem.at_nodes(target), guess)
        result = newton(problem, guess_state, tolerance, factors, rule=_RULE)
        return result.state, result.factors, result.iterations

    def _require(self, what: str, state: State, tolerance: float, iterations: int) -> None:
        if not state.residual <= tolerance:
            raise ConvergenceError(what, state.residual, iterations)
        check_stretches(self.problem, state.z)
        self.problem.load_work(state)

    def _check_contact(self, last: MotionState) -> None:
        """Refuse a step whose end is inside an obstacle, or on its other side."""
        contact = self.problem.contact
        if contact is None:
            return
        place = self.problem.motion.place[:, POSITION]
        contact.check_depths(place)
        if contact.has_passed(last.place[0, :, POSITION], place):
            raise SolveError('the arm went through an obstacle')

    def save(
        self, state: MotionState, path: Path, more: Mapping[str, FloatArray] | None = None
    ) -> None:
        """Write a ``state``, and ``more`` arrays, to the file ``path``."""
        save_state(state, path, more or {})

    def load(self, path: Path) -> MotionState:
        """Return the state in the file ``path``.

        Raises:
            ConfigError: if the file cannot be read, or is of another arm or version.
        """
        return load_state(path, self.problem)

    # Results -----------------------------------------------------------------------------------

    def displacements(self, state: MotionState) -> FloatArray:
        """Return lengths that winches have reeled in, (J,) [m]; slack tendons as if just taut."""
        return self.winches.displacement(self.still(state))

    def tendon_lengths(self, state: MotionState) -> FloatArray:
        """Return the tendons' lengths from base to anchorage [m], of `Arm.tension_shape`."""
        lengths = self.problem.tendon_lengths(self.still(state))
        return lengths.reshape(self.solver.arm.tension_shape)

    def still(self, state: MotionState) -> State:
        """Return the ``state`` as one of `problem`, without its motion."""
        self._require_own(state)
        problem = self.problem
        problem.rule = problem.rest._replace(water=np.array([state.water[0], np.zeros(3)]))
        problem.place_base(state.base)
        condition = Condition(state.tensions, state.tip_wrench, 1.0, state.history)
        return problem.evaluate(problem.at_nodes(condition), state.z)

    def backbone(self, state: MotionState) -> Backbone:
        """Return the shape in a ``state`` at the stations of the solver."""
        self._require_own(state)
        problem, places = self.problem, self.places
        problem.place_base(state.base)
        z = state.z
        problem.orient(z)
        position, quaternion, _ = problem.form.poses(problem.tables, z, places, problem.work)
        strains = strains_of(places.between @ z)
        return self.solver.shaped(
            position[0] + state.base[:3],
            quaternion[0],
            strains,
            state.tensions,
            state.tip_wrench,
            (state.residual, state.iterations),
        )

    def contacts(self, state: MotionState) -> Contacts:
        """Return penetrations and forces of the obstacles in a ``state``."""
        self._require_own(state)
        if self.problem.contact is None:
            return NONE
        place, velocity = state.place[:2]
        return self.problem.contact.report(place[:, POSITION], node_motion(place, velocity))

    def velocities(self, state: MotionState) -> FloatArray:
        """Return the velocities of the stations in base_frame [m/s], (S, 3)."""
        self._require_own(state)
        return np.asarray(self.places.between @ state.place[1][:, POSITION])
