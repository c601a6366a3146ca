"""The paper's two models: linear material, no loads, and only the moments of the tendons.

With tendon j at the offset (r_n, r_b) in the axes of a cross section, tensions T enter by sums
over the tendons that act there,

    pull = sum T             n = sum T r_n          b = sum T r_b
    nn = sum T r_n^2         bb = sum T r_b^2       mixed = sum T r_n r_b
    torque = sum T (r_n r_b' - r_b r_n')

in the letters of the paper's equation (10), for four tendons a section, A1 = nn, B1 = bb,
alpha = n and beta = -b; the last two vanish. The moment of the tendons is M = F - D omega, with

    F = (-torque, -b, n)    D = [[nn + bb, 0, 0], [0, bb, -mixed], [0, -mixed, nn]]

linear in the strains omega = (tau, xi, k). The elastic moment of the section is
K (omega - omega at rest) with K = diag(GI, EJ_n, EJ_b).

`closed_form` is the balance (8a) with (3a), K omega = M, separately at every s: a linear system,
symmetric positive definite for tensions that are not negative.

`renda2012` is the model as published, (10), (11) and (12), from the tip to the base. The paper
states (10) only for circular sections that are straight at rest. The imbalance
p = K omega - M, with which omega = C (F + p) and C = (K + D)^-1, is not zero there: (10) is
p' = omega x M. All terms without p cancel, so that with (0, xi_0, k_0) = C F

    p_t' = k_0 p_n - xi_0 p_b + (B1 - A1) C_n C_b p_n p_b
    p_n' = -p_t (c k_0 + B1 C_t C_b p_b)
    p_b' = +p_t (c xi_0 + A1 C_t C_n p_n)        c = (EJ + A1 + B1) C_t

At an anchorage (11) adds to omega the bending by the tendons that end there alone, their C F. p is
zero from the tip to the second anchorage, and smooth in every element. There it is collocated at
the nodes and swept until it converges (Picard iteration, Clenshaw and Norton 1963).

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
from octo_arm_model.rod.loads import along, pose_rates
from octo_arm_model.rod.rod import WORST, Rod, Setting, require_resolved
from octo_arm_model.rod.sensitivity import Change, Sensitivity, part_of, strain_changes
from octo_arm_model.rod.statics import Setup, Shape, Shapes, Statics, strains_of
from octo_arm_model.rod.tables import AXIAL, PaperTables, errors_between, places_at
from octo_arm_model.rod.winch_equations import BorderedSystem, RodWinchEquations
from octo_arm_model.rod.winches import Winches

# Sweeps stop when p changes by less than this fraction of the largest moment in the arm. The error
# is ten times smaller, as each sweep gains more than one digit by then.
TOLERANCE = 5e-8
# The same with derivatives, which are imaginary parts of about 1e-6 of the real ones.
_OF_DERIVATIVES = 1e-13
_ROUNDING = 1e-14  # relative rounding error of products of offsets


class PaperEquations:
    """The equations of one of the paper's models at the N nodes of a problem and at S stations.

    Strains depend on the ratio of tensions to E alone, and analytically on the tensions.

    Attributes:
        problem: the problem, with the nodes.
        s: arc coordinates of nodes and stations [m], (N + S,).
        tables: the tables of the arm at these.
    """

    def __init__(self, arm: Arm, problem: Problem, s: FloatArray, *, is_published: bool) -> None:
        """Tabulate an ``arm`` at the nodes of ``problem`` and at stations ``s`` (S,) [m].

        The model is `renda2012` if ``is_published``, else `closed_form`.
        """
        self.problem, self.s = problem, np.concatenate([problem.elements.s, s])
        self.tables = tabulate_paper(arm, problem.elements, s, is_published=is_published)

    def solve(self, tensions: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return twists under ``tensions`` (A, J), or at all nodes and stations (A, N + S, J) [N].

        These are (1 + q) (tau, xi, k) [1/m] and 1 + q [-], (A, P, 4), at nodes and stations first.
        Also return relative residuals and iterations, (A,). Imaginary parts of tensions give
        derivatives.

        Raises:
            ConvergenceError: if the sweeps of equation (10) do not converge.
        """
        is_real, moments = not np.iscomplexobj(tensions), self.tables.moments
        if tensions.ndim == 2:
            # BLAS rounds several rows together in another way. Row by row, an arm of a batch has
            # the result of a single solve.
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
    """Return the tables of ``arm`` at the nodes of ``elements`` and stations ``s`` (S,) [m].

    They have equation (10) between nodes if ``is_published``.
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
    """Return the matrix from tensions to their sums at ``s`` (P,) [m], (J, 7, P).

    In the ``section`` i (P,), counted from the tip, the tendons of sections 1 to i act.
    """
    n, b, slope_n, slope_b = arm.tendon_paths(s)
    largest = float(np.hypot(n, b).max())
    mixed, torque = n * b, n * slope_b - b * slope_n
    # Rounding errors are removed, as straight tendons along n and b do not twist the arm.
    mixed[np.abs(mixed) <= _ROUNDING * largest**2] = 0.0
    torque[np.abs(torque) <= _ROUNDING * largest] = 0.0
    moments = np.stack([np.ones_like(n), n, b, n * n, b * b, mixed, torque], axis=1)
    moments *= (arm.tendon_section[:, np.newaxis] <= section)[:, np.newaxis]
    return moments


def check_is_papers(arm: Arm) -> None:
    """Check that the paper's equations cover ``arm``.

    Raises:
        ConfigError: if they do not; the message says which property they do not cover.
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

# With a history strains have kinks, which make the estimated error of positions too small. So the
# allowed error is smaller by this factor.
_OF_HISTORY = 1e-4
_OF_FRICTION = 0.1  # the factor with friction from slack tendons
_MOST_STEPS = 100  # largest number of iterations of tensions with friction
_SETTLED = 1e-13  # last change of these tensions, over the largest one


class Papers(Statics):
    """One of the paper's models on a rod."""

    def __init__(self, setup: Setup, *, is_published: bool) -> None:
        """Prepare `renda2012` if ``is_published``, else `closed_form`.

        Raises:
            ConfigError: if the model does not cover the arm.
        """
        super().__init__(setup)
        arm = setup.arm
        for name, value in (('sheath_stiffness', arm.sheath_stiffness), ('discs', arm.discs.s)):
            if value:
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
        """Return the problem at the nodes of a ``level``."""
        return self._at(level).problem

    @np.errstate(over='ignore', invalid='ignore', divide='ignore')
    def solve(self, target: Condition, start: Equilibrium | None, spending: Spending) -> Shape:
        """Return the shape in the ``target`` condition; ``start`` and ``spending`` are not used.

        Raises:
            SolveError: if a cross section is compressed to nothing (1 + q <= 0), or the nodes do
                not resolve the strains.
        """
        level = self.rod.first_level(target.before)
        while True:
            try:
                shape, error = self.shape(level, target)
            except ConvergenceError:
                if self.rod.is_last(level):
                    raise
            else:
                if self.is_resolved(level, target, error):
                    return shape
            level += 1

    def is_resolved(self, level: int, target: Condition, error: float) -> bool:
        """Return whether an ``error`` of positions, over the length, is small enough.

        Raises:
            SolveError: if it is not, and there is no finer level.
        """
        accuracy, factor = self._setup.accuracy, _OF_FRICTION if self._setup.arm.friction else 1.0
        if target.before is not None:
            is_resolved = error <= _OF_HISTORY * accuracy
        else:
            is_resolved = bool(errors_between(error / factor) <= accuracy)
        if not is_resolved and self.rod.is_last(level):
            require_resolved(self.problem(level), error, max(accuracy, WORST))
            return True
        return is_resolved

    def shape(self, level_number: int, target: Condition) -> tuple[Shape, float]:
        """Return the shape on a level, and the estimated error of positions over its length."""
        equations = self._at(level_number)
        problem, places, along = equations.problem, equations.tables.stations, None
        nodes = problem.elements.s.size
        if problem.friction is None:
            (twist,), residual, iterations = equations.solve(target.tensions[np.newaxis])
            node_tensions = np.empty((nodes, target.tensions.size))
            node_tensions[:] = target.tensions
        else:
            target = self.rod.at_level(target, level_number)
            (twist,), residual, iterations, node_tensions, along = self._slide(equations, target)
        check_compression(equations.s, twist[: equations.s.size, 3])
        z, imbalance = twist[:nodes], np.zeros((nodes, 4))
        problem.orient(z)
        position, quaternion, error = problem.form.poses(problem.tables, z, places, problem.work)
        dead = np.zeros((2, nodes, 3))
        at_nodes = NodeCondition(target, node_tensions, dead[0], dead[1], dead)
        state = State(at_nodes, z, imbalance, float(residual[0]))
        equilibrium = Equilibrium(state, level_number, None, None, int(iterations[0]))
        strains = strains_of(twist[nodes : equations.s.size])
        position += self._setup.base[0]
        return Shape(position[0], quaternion[0], strains, along, equilibrium), float(error[0])

    def wind(
        self, target: Condition, start: Equilibrium | None, spending: Spending
    ) -> tuple[Shape, FloatArray]:
        """Return the shape in the ``target`` condition with winches, and the lengths reeled in."""
        if start is not None:
            tensions = start.state.condition.tensions
            initial = target._replace(tensions=np.where(target.driven, tensions, target.tensions))
            start = self.shape(self.rod.first_level(initial.before), initial)[0].equilibrium
        result = self._winches.solve(target, start, spending)
        target = target._replace(tensions=result.state.condition.tensions)
        return self.shape(result.level, target)[0], result.state.reeled

    @np.errstate(over='ignore', invalid='ignore', divide='ignore')
    def _solve_at_once(
        self, level: int, tensions: FloatArray, numbers: IntArray, shapes: Shapes
    ) -> NDArray[np.bool_]:
        """Write the ``shapes`` under ``tensions`` (A, J) [N], and return which are valid, (A,)."""
        equations = self._at(level)
        try:
            twist, residual, iterations = equations.solve(tensions)
        except ConvergenceError:
            return np.zeros(len(tensions), np.bool_)
        nodes, places = equations.problem.elements.s.size, equations.tables.stations
        twist = twist[:, : equations.s.size]
        z = twist[:, :nodes].reshape(-1, 4)
        is_valid = self._write(self._batches(level, len(tensions)), z, places, numbers, shapes)
        shapes.strains[:, numbers] = strains_of(twist[:, nodes:])
        shapes.residual[numbers], shapes.iterations[numbers] = residual, iterations
        return is_valid & (twist[..., 3].min(axis=1) > 0.0)

    def _slide(
        self, level: PaperEquations, target: Condition
    ) -> tuple[FloatArray, FloatArray, IntArray, FloatArray, FloatArray]:
        """Solve for twists and for tensions with friction at nodes and at stations, (n, J) [N].

        The iteration converges, as friction depends on the bends nearer to the base alone.
        """
        problem, friction, s = level.problem, level.problem.friction, self._setup.s
        assert friction is not None
        tensions, past, tables = target.tensions, target.before, problem.tables
        base = tensions * (self._setup.arm.tendon_section <= self._setup.section[:, np.newaxis])
        past_tensions = np.zeros_like(base)
        if past is not None:
            past_tensions = friction.fine.interpolation(s) @ past
        local, at_stations = tensions * tables.reach, base
        for steps in range(1, _MOST_STEPS):
            everywhere = np.concatenate([local, at_stations])[np.newaxis]
            twist, residual, _ = level.solve(everywhere)
            held = friction.hold_along(twist[0, : len(local)], tensions, past, problem.work)
            loss = tables.friction * (level.tables.stations.between @ held.angle)
            loss[0] = 0.0
            at_stations = Band.of(base, loss, past_tensions).tensions
            change = float(np.abs(held.tensions - local).max())
            local = held.tensions
            if change <= _SETTLED * float(tensions.max()):
                return twist, 0.0 * residual, np.array([steps]), local, at_stations
        raise ConvergenceError('the tension of tendons with friction', change, _MOST_STEPS)

    def sensitivity(self, equilibrium: Equilibrium) -> Sensitivity:
        """Return the derivatives of the ``equilibrium`` by tensions, E and friction."""
        return self.derivatives(equilibrium.level, equilibrium.state)

    def derivatives(
        self, level: int, state: State, rates: FloatArray | None = None
    ) -> Sensitivity:
        """Return the derivatives of a ``state`` on a level by tensions, E and friction.

        If tendons may stick, ``rates`` (N, J) are derivatives of local tensions by those at the
        base.

        One tension is perturbed by a small imaginary step. The imaginary part of the strains over
        the step is the derivative, without cancellation (Squire and Trapp 1998). The step has to
        exceed the tolerance of the sweeps. Scaling E is equivalent to dividing all tensions by the
        factor.
        """
        equations, tensions = self._at(level), state.condition.tensions
        problem, places = equations.problem, equations.tables.stations
        problem.load_work(state)
        nodes, tendons = len(state.z), tensions.size
        stiffness = float(problem.tables.body[:, AXIAL].min())
        step = 1e-6 * max(float(tensions.max()), 1e-3 * stiffness)
        own, mean = 1j * step * np.eye(tendons), None
        if problem.friction is None:
            stepped, _, _ = equations.solve(tensions + own)
            columns = np.column_stack([np.eye(tendons), -tensions])
        else:
            stations = places.between @ state.at_nodes.tensions
            stations[0] = tensions
            both = np.concatenate([state.at_nodes.tensions, stations])
            stepped, _, _ = equations.solve(both + own[:, np.newaxis])
        by_local = stepped.imag.transpose(1, 2, 0)[: equations.s.size] / step
        if problem.friction is not None:
            names = self._setup.arm.tendon_names
            columns, local = _with_friction(equations, state, by_local[:nodes], names, rates)
            mean = problem.mean_along_tendons(local)
        change = by_local @ columns
        work, elements = problem.work, problem.elements
        along_arm = pose_rates(elements.from_base, work.rotation, work.slope, change[:nodes])
        pose, at = along(places.integration, along_arm), slice(nodes, len(change))
        strains = strain_changes(stepped[0, at].real, change[at])
        by_twist, weights = problem.tendons(state).stretch_by_twist, problem.elements.weights
        length = np.einsum('n,njm,nmc->jc', weights, by_twist, change[:nodes], optimize=True)
        whole = Change(pose, strains, length, mean)
        by_friction = None if mean is None else part_of(whole, slice(tendons + 1, None))
        by_stiffness = part_of(whole, slice(tendons, tendons + 1))
        return Sensitivity(part_of(whole, slice(tendons)), by_stiffness, by_friction=by_friction)


class _PaperWinchEquations(RodWinchEquations):
    """The equations of an arm with winches, whose only unknowns are its tensions."""

    def __init__(self, model: Papers, level: int) -> None:
        """Prepare the equations of a ``model`` on a ``level``."""
        super().__init__(model.rod, level, model.problem(level))
        self._model = model

    def balance(self, condition: Condition, z: FloatArray) -> State:
        """Return the state in a ``condition``, whatever the twists ``z``."""
        return self.unloaded(condition)

    def unloaded(self, condition: Condition) -> State:
        """Return the state in a ``condition``."""
        return self._model.shape(self._level, condition)[0].equilibrium.state

    def is_resolved(self, state: State) -> bool:
        """Return whether the nodes resolve the shape in the condition of a ``state``."""
        condition = state.condition
        error = self._model.shape(self._level, condition)[1]
        return self._model.is_resolved(self._level, condition, error)

    def linearise(
        self, state: State, factors: Linear | None = None, rates: FloatArray | None = None
    ) -> BorderedSystem:
        """Return the system of the tensions alone, linearised at a ``state``."""
        rates = self.rates(state) if rates is None else rates
        change = self._model.derivatives(self._level, state, rates).by_tension
        mean = change.tendon_tension
        mean_tension = np.eye(len(rates.T)) if mean is None else mean
        integrals = self._unloaded[:, np.newaxis] * mean_tension
        changes = self._arm.stretched(integrals.T).T + np.diag(self._free) - change.tendon_length
        zeros, (nodes, strains) = np.zeros((state.z.size, len(mean_tension))), state.z.shape
        blocks = BlockFactors(np.zeros((nodes, strains, strains)))
        return BorderedSystem(state.z, blocks, zeros, zeros.T, changes, rates, rates, None)


def _with_friction(
    equations: PaperEquations,
    state: State,
    by_local: FloatArray,
    names: tuple[str, ...],
    rates: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """Return derivatives of tensions by those at the base, E and mu, (n, J, 2 J + 1).

    The first ones are at nodes and stations, with tensions divided by E; the second ones are those
    of the tensions themselves at the nodes. ``by_local`` (N, 4, J) are the derivatives of z by
    tensions at the same node, and ``rates`` are those of `Papers.derivatives`.
    """
    problem, base = equations.problem, state.condition.tensions
    nodes, tendons = state.at_nodes.tensions.shape
    derivatives, diagonal = problem.tension_derivatives(state), np.arange(tendons)
    direct = np.zeros((nodes, tendons, 2 * tendons + 1))
    direct[:, diagonal, diagonal] = problem.tension_rates(state) if rates is None else rates
    direct[..., tendons] = -state.at_nodes.tensions
    total = direct.copy()
    if derivatives is not None:
        if rates is None:
            derivatives.require(names, base)
        direct[:, diagonal, tendons + 1 + diagonal] = derivatives.by_friction
        for _ in range(_MOST_STEPS):
            # Bends nearer to the base change tensions farther from it.
            added = direct + derivatives.by_twists(by_local @ total) - total
            total += added
            if np.abs(added).max() <= _SETTLED * np.abs(total).max():
                break
        else:
            raise ConvergenceError(
                'the change of tensions with friction', float(np.abs(added).max()), _MOST_STEPS
            )
    stations = np.tensordot(equations.tables.stations.between, total, 1)
    stations[0] = np.eye(tendons, 2 * tendons + 1)  # tensions at the base are given
    stations[0, :, tendons] = -base
    local = total.copy()
    local[..., tendons] += state.at_nodes.tensions
    return np.concatenate([total, stations]), local
