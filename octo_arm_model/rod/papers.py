"""The paper's two models, whose sections carry moments of their tendons alone; linear, no loads.

With tendon j at the offset (r_n, r_b) in the axes of a cross section, tensions T enter by sums
over the tendons that act there,

    pull = sum T             n = sum T r_n          b = sum T r_b
    nn = sum T r_n^2         bb = sum T r_b^2       mixed = sum T r_n r_b
    torque = sum T (r_n r_b' - r_b r_n')

in the letters of the paper's equation (10), for four tendons a section, A1 = nn, B1 = bb,
alpha = n and beta = -b; the last two vanish. The moment of the tendons is M = F - D omega, with

    F = (-torque, -b, n)    D = [[nn + bb, 0, 0], [0, bb, -mixed], [0, -mixed, nn]]

linear in the strains omega = (tau, xi, k), and K (omega - omega at rest) that of the section, with
K = diag(GI, EJ_n, EJ_b).

`closed_form` is the balance (8a) with (3a), K omega = M, at every s by itself: a linear system,
symmetric positive definite for tensions that are not negative.

`renda2012` is the model as published, (10), (11) and (12), from the tip to the base, of circles
that are straight at rest, for which alone the paper states (10). The imbalance
p = K omega - M, with which omega = C (F + p) and C = (K + D)^-1, is not zero there: (10) is
p' = omega x M, or, as everything without p cancels, with (0, xi_0, k_0) = C F,

    p_t' = k_0 p_n - xi_0 p_b + (B1 - A1) C_n C_b p_n p_b
    p_n' = -p_t (c k_0 + B1 C_t C_b p_b)
    p_b' = +p_t (c xi_0 + A1 C_t C_n p_n)        c = (EJ + A1 + B1) C_t

At an anchorage (11) adds to omega what the tendons that end there would bend the arm by alone,
their C F. p is zero from the tip to the second anchorage, and smooth in every element, where it is
collocated at the nodes and swept until it converges (Picard iteration, Clenshaw and Norton 1963).

Both have (9a), q = N / (E A) with N = k n - xi b - pull.
"""

import functools

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.body import Body
from octo_arm_model.arm.errors import ConfigError, ConvergenceError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.limits import Spending
from octo_arm_model.arm.loads import Loads
from octo_arm_model.arm.material import LINEAR
from octo_arm_model.arm.profile import Profile
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.arm.tendon import Section
from octo_arm_model.rod import arrays
from octo_arm_model.rod.checks import check_compression
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.equilibrium import (
    ArmBatch,
    Condition,
    Equilibrium,
    NodeCondition,
    Problem,
    State,
)
from octo_arm_model.rod.factors import BlockFactors, Linear
from octo_arm_model.rod.friction import Band
from octo_arm_model.rod.loads import along
from octo_arm_model.rod.rod import WORST, Rod, Setting, require_resolved
from octo_arm_model.rod.sensitivity import Change, Sensitivity, part_of, pose_rates, strain_changes
from octo_arm_model.rod.statics import Setup, Shape, Shapes, Statics, strains_of
from octo_arm_model.rod.tables import AXIAL, PaperTables, allowed_between, places_at
from octo_arm_model.rod.winch_equations import BorderedSystem, RodWinchEquations
from octo_arm_model.rod.winches import Winches

# Sweeps stop when p changes by less than this part of the largest moment in the arm, which leaves
# an error ten times smaller, as each gains more than one digit by then.
TOLERANCE = 5e-8
# With derivatives, which are imaginary parts of about 1e-6 of the real ones.
_OF_DERIVATIVES = 1e-13
_ROUNDING = 1e-14  # of products of offsets


class PaperEquations:
    """One of the paper's models at the N nodes of a problem and at S stations.

    Strains depend on tensions and E through their ratio alone, and analytically on the tensions.

    Attributes:
        problem: the nodes.
        s: arc coordinates of nodes and stations [m], (N + S,).
        tables: the arm at these.
    """

    def __init__(self, arm: Arm, problem: Problem, s: FloatArray, *, is_published: bool) -> None:
        """Of ``arm`` at the nodes of ``problem`` and at stations ``s`` (S,) [m].

        Where ``is_published`` of `renda2012`, else of `closed_form`.
        """
        self.problem, self.s = problem, np.concatenate([problem.elements.s, s])
        self.tables = tabulate_paper(arm, problem.elements, s, is_published=is_published)

    def solve(self, tensions: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Twists under ``tensions`` (A, J), or at every node and station (A, N + S, J) [N].

        (1 + q) (tau, xi, k) [1/m] and 1 + q [-] at nodes and stations first, (A, P, 4), and
        relative residuals and iterations, (A,). Complex tensions give derivatives as imaginary
        parts.

        Raises:
            ConvergenceError: if equation (10) was not solved.
        """
        is_real, moments = not np.iscomplexobj(tensions), self.tables.moments
        if tensions.ndim == 2:
            # Row by row, as BLAS rounds several together otherwise: an arm of a batch is then that
            # of a single solve.
            rows = tensions[:, np.newaxis] @ moments.reshape(len(moments), -1)
            sums = rows.reshape(len(tensions), *moments.shape[1:])
        else:
            sums = np.einsum('apj,jcp->acp', tensions, moments)
        form, tolerance = (self.problem.form, TOLERANCE) if is_real else (arrays, _OF_DERIVATIVES)
        twist, outcome = form.paper_twists(self.tables, sums, tolerance)
        residual, sweeps, stuck = outcome.T
        if self.tables.swept and stuck.max() >= 0.0:
            worst = int(stuck.argmax())
            section = self.problem.elements.sections[int(stuck[worst])]
            error = f'equation (10) in section {section}'
            raise ConvergenceError(error, float(residual[worst]), int(sweeps[worst]))
        return twist, residual, sweeps.astype(np.int64)


def tabulate_paper(
    arm: Arm, elements: Elements, s: FloatArray, *, is_published: bool
) -> PaperTables:
    """Tables of ``arm`` at the nodes of ``elements`` and stations ``s`` (S,) [m].

    With equation (10) between nodes where ``is_published``.
    """
    stations, nodes = places_at(elements, s), elements.s.size
    # Sections are numbered from the tip.
    section = np.append(elements.sections, 0)
    swept = int((section > 1).sum()) if is_published else 0
    jumps = np.flatnonzero(section[1 : swept + 1] < section[:swept])
    anchorage = np.full(elements.lengths.size, -1)
    anchorage[jumps] = nodes + s.size + 2 * np.arange(jumps.size)
    sides = np.column_stack([section[jumps], section[jumps + 1]]).ravel()
    places = np.concatenate([elements.s, s, np.repeat(elements.edges[jumps + 1], 2)])
    section = np.concatenate([elements.section, section[stations.element], sides])
    rule, stiffness = elements.rule, SectionStiffness.at(arm, places)
    return PaperTables(
        tendon_moments(arm, places, section),
        np.stack(stiffness[:4]),
        np.stack(stiffness[1:4]) * arm.rest.at(places),
        elements.lengths,
        np.concatenate([rule.to_end, rule.weights[np.newaxis]]),
        swept,
        anchorage,
        stations,
    )


def tendon_moments(arm: Arm, s: FloatArray, section: IntArray) -> FloatArray:
    """From tensions to their sums at ``s`` (P,) [m], each in its ``section`` (P,): (J, 7, P).

    In the section numbered i from the tip the tendons of sections 1 to i act.
    """
    n, b, slope_n, slope_b = arm.tendon_paths(s)
    largest = float(np.hypot(n, b).max())
    mixed, torque = n * b, n * slope_b - b * slope_n
    # Not by rounding only: straight tendons along n and b do not twist the arm.
    mixed[np.abs(mixed) <= _ROUNDING * largest**2] = 0.0
    torque[np.abs(torque) <= _ROUNDING * largest] = 0.0
    found = np.stack([np.ones_like(n), n, b, n * n, b * b, mixed, torque], axis=1)
    found *= (arm.tendon_section[:, np.newaxis] <= section)[:, np.newaxis]
    return found


def check_is_papers(arm: Arm) -> None:
    """Check that the paper's equations cover ``arm``.

    Raises:
        ConfigError: if they do not; the message says what.
    """
    problem = ''
    if not isinstance(arm.body, Body):
        problem = 'a body whose radius is not linear in s (7)'
    elif arm.body.inner_radius != 0.0:
        problem = 'tubes, as its sections are full circles (3)'
    if arm.stiffness.profiles:
        problem = 'sections of given stiffness (3)'
    if not arm.rest.is_straight:
        problem = 'an arm that is bent at rest (3)'
    material = (arm.material.youngs_modulus, arm.material.poisson_ratio)
    if any(isinstance(value, Profile) for value in material):
        problem = 'a material that varies along s (3)'
    for number, section in enumerate(arm.sections, start=1):
        if not (isinstance(section, Section) and section.is_papers):
            problem = f'section {number}, whose tendons are not straight along n, b, -n, -b (5)'
    if arm.friction:
        problem = 'friction of the tendons'
    if problem:
        raise ConfigError(
            f"model is 'renda2012', which does not cover {problem}: choose exact or closed_form"
        )


# On a rod ----------------------------------------------------------------------------------------

# With a history strains have kinks, by which the estimated error of positions is too small: it has
# to be so much smaller.
_OF_HISTORY = 1e-4
_OF_FRICTION = 0.1  # likewise with friction from slack
_MOST_STEPS = 100  # of tensions with friction
_SETTLED = 1e-13  # change of these, over the largest tension


class Papers(Statics):
    """One of the paper's models on a rod."""

    def __init__(self, setup: Setup, *, is_published: bool) -> None:
        """Tabulate `renda2012` where ``is_published``, else `closed_form`.

        Raises:
            ConfigError: if it does not cover the arm.
        """
        super().__init__(setup)
        arm = setup.arm
        for name, given in (('sheath_stiffness', arm.sheath_stiffness), ('discs', arm.discs.s)):
            if given:
                raise ConfigError(
                    f"tendons.{name} goes with model exact: in the paper's models the body leads "
                    'tendons all along, in their places'
                )
        if is_published:
            check_is_papers(arm)
        setting = Setting(LINEAR, accuracy=setup.accuracy, compiled=setup.compiled)
        self.rod = Rod(arm, Loads(), setup.base[1], setting)
        self.is_compiled = self.rod.is_compiled
        self._at = functools.cache(
            lambda level: PaperEquations(
                arm, self.rod.problem(level, self.rod.added), setup.s, is_published=is_published
            )
        )
        self._at(0)
        self._winches = Winches(self.rod, lambda level: _PaperWinchEquations(self, level))
        self._batches = functools.lru_cache(8)(
            lambda level, arms: ArmBatch(self.problem(level), arms)
        )

    def problem(self, level: int) -> Problem:
        """See `Statics`."""
        return self._at(level).problem

    @np.errstate(over='ignore', invalid='ignore', divide='ignore')
    def solve(self, wanted: Condition, start: Equilibrium | None, spending: Spending) -> Shape:
        """See `Statics`; neither ``start`` nor ``spending`` matters.

        Raises:
            SolveError: if a cross section is compressed to nothing (1 + q <= 0), or the nodes do
                not resolve the strains.
        """
        number = self.rod.first_level(None, wanted)
        while True:
            try:
                shape, error = self.shape(number, wanted)
            except ConvergenceError:
                if self.rod.is_last(number):
                    raise
            else:
                if self.is_resolved(number, wanted, error):
                    return shape
            number += 1

    def is_resolved(self, number: int, wanted: Condition, error: float) -> bool:
        """Whether an ``error`` of positions, over the length, is small enough on a level.

        Raises:
            SolveError: if it is not, and there is no finer level.
        """
        accuracy = self._setup.accuracy
        allowed = allowed_between(accuracy) if wanted.before is None else _OF_HISTORY * accuracy
        if self._setup.arm.friction and wanted.before is None:
            allowed *= _OF_FRICTION
        if error > allowed and self.rod.is_last(number):
            require_resolved(self.problem(number), error, max(accuracy, WORST))
            return True
        return error <= allowed

    def shape(self, number: int, wanted: Condition) -> tuple[Shape, float]:
        """The arm on a level, and the estimated error of positions over its length."""
        level = self._at(number)
        problem, places, along = level.problem, level.tables.stations, None
        nodes = problem.elements.s.size
        if problem.friction is None:
            (twist,), residual, iterations = level.solve(wanted.tensions[np.newaxis])
            local = np.empty((nodes, wanted.tensions.size))
            local[:] = wanted.tensions
        else:
            wanted = self.rod.at_level(wanted, number)
            (twist,), residual, iterations, local, along = self._slide(level, wanted)
        check_compression(level.s, twist[: level.s.size, 3])
        z, nothing = twist[:nodes], np.zeros((nodes, 4))
        problem.orient(z)
        position, quaternion, error = problem.form.poses(problem.tables, z, places, problem.work)
        dead = np.zeros((2, nodes, 3))
        at_nodes = NodeCondition(wanted, local, dead[0], dead[1], dead)
        state = State(at_nodes, z, nothing, float(residual[0]))
        equilibrium = Equilibrium(state, number, None, None, int(iterations[0]))
        strains = strains_of(twist[nodes : level.s.size])
        position += self._setup.base[0]
        return Shape(position[0], quaternion[0], strains, along, equilibrium), float(error[0])

    def wind(
        self, wanted: Condition, start: Equilibrium | None, spending: Spending
    ) -> tuple[Shape, FloatArray]:
        """See `Statics`."""
        if start is not None:
            tensions = start.state.condition.tensions
            begun = wanted._replace(tensions=np.where(wanted.driven, tensions, wanted.tensions))
            start = self.shape(self.rod.first_level(None, begun), begun)[0].equilibrium
        found = self._winches.solve(wanted, start, spending)
        wanted = wanted._replace(tensions=found.state.condition.tensions)
        return self.shape(found.level, wanted)[0], found.state.reeled

    @np.errstate(over='ignore', invalid='ignore', divide='ignore')
    def _solve_at_once(
        self, level: int, tensions: FloatArray, numbers: IntArray, shapes: Shapes
    ) -> NDArray[np.bool_]:
        """See `Statics`."""
        own = self._at(level)
        try:
            twist, residual, iterations = own.solve(tensions)
        except ConvergenceError:
            return np.zeros(len(tensions), np.bool_)
        nodes, places = own.problem.elements.s.size, own.tables.stations
        twist = twist[:, : own.s.size]
        z = twist[:, :nodes].reshape(-1, 4)
        fine = self._write(self._batches(level, len(tensions)), z, places, numbers, shapes)
        shapes.strains[:, numbers] = strains_of(twist[:, nodes:])
        shapes.residual[numbers], shapes.iterations[numbers] = residual, iterations
        return fine & (twist[..., 3].min(axis=1) > 0.0)

    def _slide(
        self, level: PaperEquations, wanted: Condition
    ) -> tuple[FloatArray, FloatArray, IntArray, FloatArray, FloatArray]:
        """As `PaperEquations.solve`, and tensions with friction at nodes and stations, (n, J) [N].

        Iterated, which converges as a node is bent by what is before it.
        """
        problem, friction, s = level.problem, level.problem.friction, self._setup.s
        assert friction is not None
        tensions, before, tables = wanted.tensions, wanted.before, problem.tables
        base = tensions * (self._setup.arm.tendon_section <= self._setup.section[:, np.newaxis])
        held = np.zeros_like(base)
        if before is not None:
            held = friction.fine.interpolation(s) @ before
        local, at_stations = tensions * tables.reach, base
        for steps in range(1, _MOST_STEPS):
            both = np.concatenate([local, at_stations])[np.newaxis]
            twist, residual, _ = level.solve(both)
            found = friction.hold_along(twist[0, : len(local)], tensions, before, problem.work)
            loss = tables.friction * (level.tables.stations.between @ found.angle)
            loss[0] = 0.0
            at_stations = Band.of(base, loss, held).tensions
            change = float(np.abs(found.tensions - local).max())
            local = found.tensions
            if change <= _SETTLED * float(tensions.max()):
                return twist, 0.0 * residual, np.array([steps]), local, at_stations
        raise ConvergenceError('the tension of tendons with friction', change, _MOST_STEPS)

    def sensitivity(self, found: Equilibrium) -> Sensitivity:
        """By tensions, E and friction alone."""
        return self.derivatives(found.level, found.state)

    def derivatives(
        self, level: int, state: State, rates: FloatArray | None = None
    ) -> Sensitivity:
        """Of a ``state`` on a ``level``, with ``rates`` as of the function `sensitivity`."""
        return sensitivity(self._at(level), state, self._setup.arm.tendon_names, rates)


class _PaperWinchEquations(RodWinchEquations):
    """An arm whose winches are known by its tensions alone, of which all else follows."""

    def __init__(self, model: Papers, level: int) -> None:
        """Of a ``model`` on a ``level``."""
        super().__init__(model.rod, level, model.problem(level))
        self._model = model

    def balance(self, condition: Condition, z: FloatArray) -> State:
        """See `WinchEquations`."""
        return self.unloaded(condition)

    def unloaded(self, condition: Condition) -> State:
        """See `WinchEquations`."""
        return self._model.shape(self._level, condition)[0].equilibrium.state

    def is_resolved(self, state: State) -> bool:
        """See `WinchEquations`."""
        wanted = state.condition
        error = self._model.shape(self._level, wanted)[1]
        return self._model.is_resolved(self._level, wanted, error)

    def linearise(
        self, state: State, factors: Linear | None = None, rates: FloatArray | None = None
    ) -> BorderedSystem:
        """See `WinchEquations`."""
        rates = self.rates(state) if rates is None else rates
        change = self._model.derivatives(self._level, state, rates).by_tension
        mean = change.tendon_tension
        felt = np.eye(len(rates.T)) if mean is None else mean
        integrals = self._unloaded[:, np.newaxis] * felt
        changes = self._arm.stretched(integrals.T).T + np.diag(self._free) - change.tendon_length
        none, (nodes, strains) = np.zeros((state.z.size, len(felt))), state.z.shape
        held = BlockFactors(np.zeros((nodes, strains, strains)))
        return BorderedSystem(state.z, held, none, none.T, changes, rates, rates, None)


def sensitivity(
    level: PaperEquations, state: State, names: tuple[str, ...], rates: FloatArray | None = None
) -> Sensitivity:
    """By tensions, E and friction, of the ``state`` on a ``level``; ``names`` of the tendons.

    With derivatives ``rates`` (N, J) of local tensions by those at the base, if given, where
    tendons may stick.

    With one tension perturbed by a small imaginary step, the imaginary part of the strains over
    the step is the derivative (Squire and Trapp 1998), without cancellation; the step only has to
    exceed the tolerance of the sweeps of renda2012. Scaling E is equivalent to dividing all
    tensions by the same factor.
    """
    problem, tensions = level.problem, state.condition.tensions
    places = level.tables.stations
    problem.load_work(state)
    nodes, tendons = len(state.z), tensions.size
    stiffness = float(problem.tables.body[:, AXIAL].min())
    step = 1e-6 * max(float(tensions.max()), 1e-3 * stiffness)
    own, mean = 1j * step * np.eye(tendons), None
    if problem.friction is None:
        stepped, _, _ = level.solve(tensions + own)
        columns = np.column_stack([np.eye(tendons), -tensions])
    else:
        stations = places.between @ state.at_nodes.tensions
        stations[0] = tensions
        both = np.concatenate([state.at_nodes.tensions, stations])
        stepped, _, _ = level.solve(both + own[:, np.newaxis])
    by_local = stepped.imag.transpose(1, 2, 0)[: level.s.size] / step
    if problem.friction is not None:
        columns, local = _with_friction(level, state, by_local[:nodes], names, rates)
        rest = problem.elements.weights[:, np.newaxis] * problem.unloaded_tendons.stretch
        mean = np.einsum('nj,njc->jc', rest, local) / rest.sum(axis=0)[:, np.newaxis]
    change = by_local @ columns
    work, elements = problem.work, problem.elements
    rates = pose_rates(elements.from_base, work.rotation, work.slope, change[:nodes])
    pose, at = along(places.integration, rates), slice(nodes, len(change))
    strains = strain_changes(stepped[0, at].real, change[at])
    by_twist, weights = problem.tendons(state).stretch_by_twist, problem.elements.weights
    length = np.einsum('n,njm,nmc->jc', weights, by_twist, change[:nodes], optimize=True)
    whole = Change(pose, strains, length, mean)
    by_friction = None if mean is None else part_of(whole, slice(tendons + 1, None))
    by_stiffness = part_of(whole, slice(tendons, tendons + 1))
    return Sensitivity(part_of(whole, slice(tendons)), by_stiffness, by_friction=by_friction)


def _with_friction(
    level: PaperEquations,
    state: State,
    by_local: FloatArray,
    names: tuple[str, ...],
    rates: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """Changes of tensions by those at the base, E and mu, at nodes and stations, (n, J, 2 J + 1).

    As if tensions fell where E rises, which bends the arm as much less; those of the tensions
    themselves at the nodes are returned second. From changes of z ``by_local`` (N, 4, J) tensions
    at the same node, with ``rates`` as of `sensitivity`; refused as by `TensionDerivatives`.
    """
    problem, base = level.problem, state.condition.tensions
    nodes, tendons = state.at_nodes.tensions.shape
    derivatives, own = problem.tension_derivatives(state), np.arange(tendons)
    direct = np.zeros((nodes, tendons, 2 * tendons + 1))
    direct[:, own, own] = problem.tension_rates(state) if rates is None else rates
    direct[..., tendons] = -state.at_nodes.tensions
    felt = direct.copy()
    if derivatives is not None:
        if rates is None:
            derivatives.require(names, base)
        direct[:, own, tendons + 1 + own] = derivatives.by_friction
        for _ in range(_MOST_STEPS):
            # What is bent nearer to the base changes tensions farther from it.
            more = direct + derivatives.by_twists(by_local @ felt) - felt
            felt += more
            if np.abs(more).max() <= _SETTLED * np.abs(felt).max():
                break
        else:
            raise ConvergenceError(
                'the change of tensions with friction', float(np.abs(more).max()), _MOST_STEPS
            )
    stations = np.tensordot(level.tables.stations.between, felt, 1)
    stations[0] = np.eye(tendons, 2 * tendons + 1)  # at the base tensions are given
    stations[0, :, tendons] = -base
    local = felt.copy()
    local[..., tendons] += state.at_nodes.tensions
    return np.concatenate([felt, stations]), local
