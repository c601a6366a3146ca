"""The arm in motion: time steps of the same rod, each a balance with what `inertia` adds.

Generalised alpha (Chung and Hulbert 1993) in the form of Arnold and Bruls 2007, on positions and
axes of the cross sections, which are vectors: with the acceleration a of the rule and that of the
rod, x'',

    x_1 = x_0 + h x'_0 + h^2 ((1/2 - beta) a_0 + beta a_1),
    x'_1 = x'_0 + h ((1 - gamma) a_0 + gamma a_1),
    (1 - alpha_m) a_1 + alpha_m a_0 = (1 - alpha_f) x''_1 + alpha_f x''_0,

so that x' and x'' are linear in x_1 and the balance holds at the end of each step. Second order,
without damping of what is slow, and with the factor rho_inf per step of what is fastest.
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
TOLERANCE = 1e-7  # residual of the balance at the end of a step
# Shorter steps leave more, as places are rounded: times the square of this over the step [s].
_ROUNDED = 5e-4
# Any progress serves: a step in time is halved where a search fails.
_RULE = Rule(iterations=30, again=0.6, predicted=1.0, first=1.0, progress=1.0, shortest=0.01)
_FEWER_POINTS = -2  # in each element than an equilibrium has
_LEAST_HALF = 2e-5  # step that is halved no more [s]
# A longer step than this [s] that takes more iterations than _CALM is not accurate: the arm whips.
_SHORT, _CALM = 1.25e-3, 5
STEPS = 1e-7, 1.0  # shortest and longest [s]


def base_of(pose: Pose) -> FloatArray:
    """Position [m] and quaternion w, x, y, z of a ``pose``, (7,)."""
    x, y, z, w = pose.quaternion
    return np.array([*pose.position, w, x, y, z])


def _quiet() -> np.errstate:
    """Where numbers that are none are looked for."""
    return np.errstate(over='ignore', invalid='ignore', divide='ignore')


class Dynamics:
    """Moves one arm in time.

    Not for two threads at once, but each may take a copy. States passed to it must be its own, or
    a copy's: those of another number of nodes, strains or tendons are refused.

    Attributes:
        solver: of its equilibria.
        properties: its damping, and the water's.
        problem: the equations at the nodes.
    """

    def __init__(
        self,
        solver: Solver,
        properties: MotionProperties = MotionProperties(),
        rho_inf: float = RHO_INF,
        level: int = 0,
    ) -> None:
        """Of the arm, loads, base and stations of ``solver``.

        Each ``level`` from 0 to 4 has more nodes, see `elements.LEVELS`.

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
        # At rest obstacles have no friction: it grows with the speed.
        smooth = solver.loads.without_friction()
        self._still = solver.with_loads(smooth) if loads.has_friction else solver
        self._options = rho_inf, level
        self._to_base = elements.interpolation(np.zeros(1))[0]
        self._numbers = {name: number for number, name in enumerate(arm.tendon_names)}

    def __reduce__(self) -> tuple[type[Dynamics], tuple[object, ...]]:
        """A copy, one in another process as well, is prepared from the same arguments."""
        return Dynamics, (copy.copy(self.solver), self.properties, *self._options)

    @property
    def nodes(self) -> Elements:
        """Where the nodes are."""
        return self.problem.elements

    @functools.cached_property
    def winches(self) -> WinchEquations:
        """The equations with winches."""
        return WinchEquations(self.problem, self.solver.arm)

    # States ------------------------------------------------------------------------------------

    def at_rest(self, inputs: Inputs, time: float = 0.0) -> MotionState:
        """The equilibrium under ``inputs``, on the base of the solver and in the current there.

        Raises:
            OctoArmError: as `Solver.solve`.
            ConfigError: if another base is given.
        """
        (wanted, current, base), solver = self.checked(inputs), self._still
        if not (base == self._base).all():
            raise ConfigError('inputs.base is another than that of the solver, expected None')
        tensions, wrench = wanted.tensions, wanted.tip_wrench - solver.loads.tip_wrench
        if wanted.driven.any():
            start, _ = solver.wind(wanted.lengths, wanted.driven, tensions, wrench, None)
        else:
            start = solver.solve(tensions.reshape(solver.arm.tension_shape), wrench)
        assert start.equilibrium is not None
        level, z = start.equilibrium.level, start.equilibrium.state.z
        problem = self.problem
        z = moved(z, solver.elements(level), problem.elements)
        problem.place_base(base)
        problem.reference = np.zeros(z.shape[1])
        condition = Condition(start.tensions.ravel(), wanted.tip_wrench)
        found = self._in_current(problem.at_nodes(condition), z, current)
        twist, place = np.zeros((4, *z.shape)), np.zeros((4, *problem.motion.place.shape))
        twist[0], place[0] = found.z, problem.motion.place
        water = np.array([current, *np.zeros((2, 3))])
        return self._state(time, base, found, (twist, place, water))

    def _in_current(self, at_nodes: NodeCondition, z: FloatArray, current: FloatArray) -> State:
        """The balance near ``z`` at rest, in a ``current`` that grows where it has to."""
        problem = self.problem
        with _quiet():
            for parts in (1, 8, 64):
                guess = z
                for part in range(1, parts + 1):
                    water = np.array([current * (part / parts), np.zeros(3)])
                    problem.rule = problem.rest._replace(water=water)
                    found = newton(problem, problem.evaluate(at_nodes, guess), TOLERANCE)
                    guess = found.state.z
                if found.state.residual <= TOLERANCE:
                    break
            self._require(found.state)
        return found.state

    def checked(self, inputs: Inputs) -> CheckedInputs:
        """Checked ``inputs``.

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
        found: State,
        moves: tuple[FloatArray, FloatArray, FloatArray],
        last: tuple[int, float, Linear | None] = (0, 0.0, None),
    ) -> MotionState:
        problem, condition = self.problem, found.condition
        history = None if problem.friction is None else problem.history(found)
        wrench = np.abs(problem.work.gradient).max(axis=0)
        beyond = np.concatenate([found.at_nodes.force, problem.work.moment], axis=1)
        given = condition.tensions, condition.tip_wrench, base, wrench, self._to_base @ beyond
        for array in (*moves, *given, history):
            if array is not None:
                array.setflags(write=False)
        return MotionState(time, *moves, *given, history, found.residual, *last)

    # Steps -------------------------------------------------------------------------------------

    def step(self, state: MotionState, inputs: Inputs, dt: float) -> MotionState:
        """The state after ``dt`` [s], when ``inputs`` act.

        In shorter steps where Newton's method fails.

        Raises:
            SolveError: if no step is short enough.
            ArmDefinitionError: if ``dt`` is not from 1e-7 to 1 s.
            ConfigError: if the state is that of another arm.
            OctoArmError: if the inputs do not fit the arm.
        """
        dt = within('dt', dt, *STEPS, 's')
        self._require_own(state)
        with _quiet():
            return self._advance(state, self.checked(inputs), dt, dt)

    def go_on(
        self, state: MotionState, inputs: Inputs, elapsed: float, longest: float
    ) -> MotionState:
        """The state after ``elapsed`` [s] in equal steps of at most ``longest`` [s].

        All inputs change linearly over them. A step that takes many iterations, as of an arm that
        whips, is replaced by shorter ones, as one that fails.

        Raises:
            As `step`.
        """
        self._require_own(state)
        given, count = self.checked(inputs), max(math.ceil(elapsed / longest - 1e-9), 1)
        dt = within('dt', elapsed / count, *STEPS, 's')
        with _quiet():
            for left in range(count, 0, -1):
                state = self._advance(state, self._between(state, given, 1.0 / left), dt, _SHORT)
        return state

    def _require_own(self, state: MotionState) -> None:
        """Refuse a state whose arrays are not as large as those of this arm."""
        expected = (4, *self.problem.rest.twist_rate.shape), (len(self._numbers),)
        if (state.twist.shape, state.tensions.shape) != expected:
            raise ConfigError('the state is that of another arm, or of other nodes')

    def _advance(
        self, state: MotionState, given: CheckedInputs, dt: float, short: float
    ) -> MotionState:
        """In one step, or two of half of it where that fails, or is hard and not ``short``."""
        is_calm = state.iterations <= _CALM or state.dt >= dt
        if dt <= short or is_calm:
            try:
                found = self._one_step(state, given, dt)
                if dt <= short or found.iterations <= _CALM:
                    return found
            except SolveError as error:
                if dt < _LEAST_HALF:
                    undamped = '; nothing damps its waves: state a viscosity or damping_time'
                    raise SolveError(
                        f'the motion ends at {state.time:.6g} s, no step of {dt:.2g} s succeeds: '
                        f'{error}{"" if self.problem.is_viscous else undamped}'
                    ) from None
        middle = self._advance(state, self._between(state, given, 0.5), 0.5 * dt, short)
        return self._advance(middle, given, 0.5 * dt, short)

    def _between(self, state: MotionState, given: CheckedInputs, part: float) -> CheckedInputs:
        """What acts after a ``part`` of the way from what acts on ``state``."""
        if part == 1.0:
            return given

        wanted, now, base = given.condition, state.water[0], state.base.copy()
        lengths = self.displacements(state) if wanted.driven.any() else wanted.lengths
        before = Condition(state.tensions, state.tip_wrench, lengths=lengths)
        # Of the two quaternions of an orientation the nearer one.
        base[3:] *= math.copysign(1.0, base[3:] @ given.base[3:])
        if not (base == given.base).all():  # as rounding would move a base at rest
            base += part * (given.base - base)
            base[3:] /= np.linalg.norm(base[3:])
        current = now + part * (given.current - now)
        return CheckedInputs(before.towards(wanted, part), current, base)

    def _one_step(self, state: MotionState, given: CheckedInputs, dt: float) -> MotionState:
        problem, (m, f, gamma, beta) = self.problem, self._rule
        z, (_, rate, bend, last_bend) = state.z, state.twist
        place, velocity, acceleration, own = state.place
        problem.place_base(state.base)
        if state.dt != dt and (given.base == state.base).all():
            # Rates of places and twists differ by the square of a step, much for a shorter one.
            problem.orient(z)
            velocity, own = problem.velocities(place, rate), acceleration
        # What the rule makes of the end of the step, x: a_1 = c x - a, and so on.
        c, ratio = 1.0 / (beta * dt * dt), (1.0 - m) / (1.0 - f)
        lost = (0.5 - beta) / beta

        def before(x: FloatArray, x_rate: FloatArray, a: FloatArray) -> FloatArray:
            return c * (x + dt * x_rate) + lost * a

        def to_rate(x_rate: FloatArray, a: FloatArray, own: FloatArray) -> FloatArray:
            return gamma * dt * a - x_rate - (1.0 - gamma) * dt * own

        a, a_z = before(place, velocity, own), before(z, rate, bend)
        water = np.empty((3, 3))
        water[0] = given.current
        water[2] = ((given.current - state.water[0]) / dt - (1 - gamma) * state.water[2]) / gamma
        water[1] = ((1 - m) * water[2] + m * state.water[2] - f * state.water[1]) / (1.0 - f)
        problem.rule = TimeRule(
            gamma * dt * c,
            ratio * c,
            to_rate(velocity, a, own),
            ratio * a - (m * own - f * acceleration) / (1.0 - f),
            to_rate(rate, a_z, bend),
            water[:2],
        )
        problem.place_base(given.base)
        problem.reference = state.wrench.copy()  # a copy, as `MotionState.z` is
        guess, factors = z + dt * rate + 0.5 * dt * dt * bend, None
        if state.dt == dt:
            factors = state.factors
            guess += beta * dt * dt * (bend - last_bend)
        tolerance = TOLERANCE * max(1.0, (_ROUNDED / dt) ** 2)
        wanted = given.condition._replace(before=state.history)
        found, next_factors, iterations = self._balance(state, wanted, guess, factors, tolerance)
        self._require(found, tolerance, iterations)
        self._check_contact(state)
        rule, (place, velocity, acceleration, _) = problem.rule, problem.motion
        rate = rule.by_velocity * found.z - rule.twist_rate
        twist = np.array([found.z, rate, c * found.z - a_z, bend])
        places = np.array([place, velocity, acceleration, c * place - a])
        last = iterations, dt, next_factors
        return self._state(state.time + dt, given.base, found, (twist, places, water), last)

    def _balance(
        self,
        state: MotionState,
        wanted: Condition,
        guess: FloatArray,
        factors: Linear | None,
        tolerance: float,
    ) -> tuple[State, Linear | None, int]:
        if wanted.driven.any():
            winches = self.winches
            pulled = np.where(wanted.driven, state.tensions, wanted.tensions)
            begun = winches.evaluate(wanted._replace(tensions=pulled), guess)
            # Lengths count little beside the balance: the first step may leave any.
            change, system = winches.step(begun, winches.linearise(begun, factors))
            begun = winches.moved(begun, change, system)
            found = newton(winches, begun, tolerance, system, rule=_RULE)
            assert isinstance(found.factors, BorderedSystem)
            return found.state, found.factors.factors, found.iterations
        problem = self.problem
        begun = problem.evaluate(problem.at_nodes(wanted), guess)
        found = newton(problem, begun, tolerance, factors, rule=_RULE)
        return found.state, found.factors, found.iterations

    def _require(self, state: State, tolerance: float = TOLERANCE, iterations: int = 0) -> None:
        if not state.residual <= tolerance:
            raise ConvergenceError('the balance of a time step', state.residual, iterations)
        check_stretches(self.problem, state.z)
        self.problem.load_work(state)

    def _check_contact(self, before: MotionState) -> None:
        """Refuse the step to where `problem` is that goes into an obstacle, or through it."""
        contact = self.problem.contact
        if contact is None:
            return
        place = self.problem.motion.place[:, POSITION]
        contact.check_depths(place)
        if contact.has_passed(before.place[0, :, POSITION], place):
            raise SolveError('the arm went through an obstacle')

    def save(
        self, state: MotionState, path: Path, more: Mapping[str, FloatArray] | None = None
    ) -> None:
        """Write a ``state``, and ``more`` arrays, to the file ``path``, see `save_state`."""
        save_state(state, path, more or {})

    def load(self, path: Path) -> MotionState:
        """The state in the file ``path``.

        Raises:
            ConfigError: if it cannot be read, or is none of this arm or version.
        """
        return load_state(path, self.problem)

    # Results -----------------------------------------------------------------------------------

    def displacements(self, state: MotionState) -> FloatArray:
        """Length that winches have reeled in [m], (J,); of slack ones what makes them taut."""
        return self.winches.displacement(self.still(state))

    def tendon_lengths(self, state: MotionState) -> FloatArray:
        """From the base to the anchorage [m], of `Arm.tension_shape`."""
        stretch = self.problem.tendons(self.still(state)).stretch
        return (self.nodes.weights @ stretch).reshape(self.solver.arm.tension_shape)

    def still(self, state: MotionState) -> State:
        """The ``state`` as one of `problem`, at rest."""
        self._require_own(state)
        problem = self.problem
        problem.rule = problem.rest._replace(water=np.array([state.water[0], np.zeros(3)]))
        problem.place_base(state.base)
        condition = Condition(state.tensions, state.tip_wrench, 1.0, state.history)
        return problem.evaluate(problem.at_nodes(condition), state.z)

    def backbone(self, state: MotionState) -> Backbone:
        """The shape at the stations of the solver."""
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
        """How obstacles act on the arm."""
        self._require_own(state)
        if self.problem.contact is None:
            return NONE
        place, velocity = state.place[:2]
        return self.problem.contact.report(place[:, POSITION], node_motion(place, velocity))

    def velocities(self, state: MotionState) -> FloatArray:
        """Of the stations in base_frame [m/s], (S, 3)."""
        self._require_own(state)
        return np.asarray(self.places.between @ state.place[1][:, POSITION])
