"""The paper's models: strains from tensions at each node, linear material, no other loads."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.budget import Spending
from octo_arm_model.arm.errors import ConfigError, ConvergenceError, SolveError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.loads import Loads
from octo_arm_model.rod.closed_form import ClosedForm
from octo_arm_model.rod.elements import LEVELS, Elements
from octo_arm_model.rod.equilibrium import Condition, Problem, State
from octo_arm_model.rod.friction import clipped
from octo_arm_model.rod.lengths import lengths_of, rest_stretches
from octo_arm_model.rod.paper_balance import Strains
from octo_arm_model.rod.read_out import ADDED_POINTS, integrate_poses
from octo_arm_model.rod.resolution import allowed_between, position_error
from octo_arm_model.rod.rod import Equilibrium, Rod, Setting, moved
from octo_arm_model.rod.sensitivity import Change, Sensitivity, Uncertainty
from octo_arm_model.rod.several import Several
from octo_arm_model.rod.statics import XYZW, Setup, Shape, Shapes, Statics, strains_of
from octo_arm_model.rod.tables import AXIAL
from octo_arm_model.rod.tendons import tendon_stretch

# With a history strains have kinks, by which the estimated error of positions is too small: it has
# to be so much smaller.
_OF_HISTORY = 1e-4
_MOST_STEPS = 100  # of tensions with friction
_SETTLED = 1e-13  # change of these, over the largest tension


class Equations(Protocol):
    """Strains from tensions at certain nodes.

    They depend on tensions and E through their ratio alone, and analytically on the tensions.
    """

    def solve(self, tensions: FloatArray) -> Strains:
        """Strains under ``tensions`` (..., J) [N].

        Complex tensions give derivatives as imaginary parts.

        Raises:
            ConvergenceError: if the equations were not solved.
        """


class _Level(NamedTuple):
    """The equations at the nodes of one level, then at the stations.

    Attributes:
        problem: the nodes.
        equations: at both.
        integration: from values at the nodes to integrals up to the stations, (S, N).
        between: from values at the nodes to those at the stations, (S, N).
        names: of the tendons.
    """

    problem: Problem
    equations: Equations
    integration: FloatArray
    between: FloatArray
    names: tuple[str, ...]


class Papers(Statics):
    """One of the paper's models on a rod."""

    def __init__(
        self, equations: Callable[[Arm, FloatArray, IntArray], Equations], setup: Setup
    ) -> None:
        """Tabulate the ``equations`` of (arm, nodes, section of each node).

        Raises:
            ConfigError: if they do not cover the arm.
        """
        super().__init__(setup)
        if setup.arm.sheath_stiffness:
            raise ConfigError(
                "tendons.sheath_stiffness goes with model exact: the paper's models keep tendons "
                'in their places'
            )
        self._equations = equations
        setting = Setting(widens=False, compiled=setup.compiled)
        self._rod = Rod(setup.arm, Loads(), setup.base[1], setting)
        self.is_compiled = self._rod.is_compiled
        self._at = functools.cache(self._level)
        self._at(0)
        self._several = functools.lru_cache(8)(
            lambda level, arms: Several(self._at(level).problem, arms)
        )

    def _level(self, level: int) -> _Level:
        setup, problem = self._setup, self._rod.problem(level, ADDED_POINTS)
        own = problem.elements
        places = np.concatenate([own.s, setup.s]), np.concatenate([own.section, setup.section])
        equations = self._equations(setup.arm, *places)
        stations = own.integration(setup.s), own.interpolation(setup.s)
        return _Level(problem, equations, *stations, setup.arm.tendon_names)

    def problem(self, level: int) -> Problem:
        """See `Statics`."""
        return self._at(level).problem

    @np.errstate(over='ignore', invalid='ignore', divide='ignore')
    def solve(
        self, tensions: FloatArray, tip_wrench: FloatArray, start: Equilibrium | None,
        before: FloatArray | None, spending: Spending,
    ) -> Shape:  # fmt: skip
        """See `Statics`; neither ``start`` nor ``spending`` matters.

        Raises:
            SolveError: if a cross section is compressed to nothing (1 + q <= 0).
        """
        allowed = allowed_between(self._setup.accuracy)
        first = 0
        if before is not None:
            first, allowed = self._level_of(before), _OF_HISTORY * self._setup.accuracy
        for number in range(first, len(LEVELS)):
            level, history = self._at(number), before
            problem, nodes = level.problem, level.problem.elements.s.size
            if before is not None and number > first:
                history = moved(before, self._fine(first), self._fine(number))
            acting = problem.acting(Condition(tensions, tip_wrench, before=history))
            along = None
            if self._setup.arm.friction:
                found, local, along = self._slide(level, tensions, history)
                acting = acting._replace(tensions=local)
            else:
                found = level.equations.solve(tensions)
            self._check(problem, found.twist[3])
            z = np.ascontiguousarray(found.twist[:, :nodes].T)
            problem.form.orientations(problem.tables, z, problem.work)
            error = position_error(problem.elements, z, problem.work.slope)
            if error <= allowed:
                break
        base = problem.tables.base
        position, turn = integrate_poses(problem.work, base, z, level.integration)
        state = State(acting, z, np.zeros_like(z), float(found.residual))
        return Shape(
            position[0] + self._setup.base[0],
            turn[0].take(XYZW, axis=1),
            strains_of(found.twist[:, nodes:].T),
            along,
            Equilibrium(state, number, None, None, int(found.iterations)),
        )

    @np.errstate(over='ignore', invalid='ignore', divide='ignore')
    def _solve_at_once(
        self, level: int, tensions: FloatArray, numbers: IntArray, shapes: Shapes
    ) -> NDArray[np.bool_]:
        """See `Statics`."""
        own = self._at(level)
        try:
            found = own.equations.solve(tensions)
        except ConvergenceError:
            return np.zeros(len(tensions), np.bool_)
        nodes = own.problem.elements.s.size
        z = found.twist[..., :nodes].transpose(1, 2, 0).reshape(-1, 4)
        several = self._several(level, len(tensions))
        fine = self._write(several, z, own.integration, numbers, shapes)
        shapes.strains[:, numbers] = strains_of(found.twist[..., nodes:].transpose(1, 2, 0))
        shapes.residual[numbers], shapes.iterations[numbers] = found[1:]
        return fine & (found.twist[3].min(axis=1) > 0.0)

    def _slide(
        self, level: _Level, tensions: FloatArray, before: FloatArray | None
    ) -> tuple[Strains, FloatArray, FloatArray]:
        """Strains, and tensions along tendons with friction at nodes and stations, (n, J) [N].

        What bends the arm at a node depends on how it is bent before it, so that iterating both
        converges.

        Raises:
            ConvergenceError: if it does not.
        """
        problem, equations, friction = level.problem, level.equations, level.problem.friction
        assert isinstance(equations, ClosedForm) and friction is not None
        setup, tables = self._setup, problem.tables
        base = tensions * (setup.arm.tendon_section <= setup.section[:, np.newaxis])
        held = None if before is None else friction.fine.interpolation(setup.s) @ before
        local, at_stations = tensions * tables.reach, base
        for steps in range(1, _MOST_STEPS):
            both = np.concatenate([local, at_stations])
            twist = equations.local_twist(both.T[:, np.newaxis])[:, 0]
            z = np.ascontiguousarray(twist[:, : len(local)].T)
            found = friction.slide_along(z, tensions, before, problem.work)
            loss = tables.friction * (level.between @ found.angle)
            loss[0] = 0.0
            at_stations = clipped(base, np.zeros_like(base) if held is None else held, loss)
            change = float(np.abs(found.tensions - local).max())
            local = found.tensions
            if change <= _SETTLED * float(tensions.max()):
                return Strains(twist, 0.0, steps), local, at_stations
        raise ConvergenceError('the tension of tendons with friction', change, _MOST_STEPS)

    def _level_of(self, before: FloatArray) -> int:
        """The level at whose fine points tensions ``before`` (M, J) are.

        Raises:
            ConfigError: if they are at those of none.
        """
        for level in range(len(LEVELS)):
            if len(before) == self._fine(level).s.size:
                return level
        raise ConfigError('the backbone was solved by another solver')

    def _fine(self, level: int) -> Elements:
        friction = self.problem(level).friction
        assert friction is not None
        return friction.fine

    def _check(self, problem: Problem, stretch: FloatArray) -> None:
        """Check that no cross section is compressed to nothing.

        Raises:
            SolveError: if one is.
        """
        if not stretch.min() > 0.0:  # nor NaN
            worst = int(np.argmin(stretch))
            s = np.concatenate([problem.elements.s, self._setup.s])[worst]
            raise SolveError(
                f'tensions compress the arm to nothing at s = {s:.4g} m '
                f'(q = {stretch[worst] - 1.0:.4g}, must be > -1)'
            )

    def sensitivity(self, found: Equilibrium, by_offsets: bool = True) -> Sensitivity:
        """By tensions and E alone."""
        return sensitivity(self._at(found.level), found.state)

    def tip_covariance(self, found: Equilibrium, uncertainty: Uncertainty) -> FloatArray:
        """See `Statics`."""
        return self.sensitivity(found).tip_covariance(uncertainty)

    def by_loads(self, found: Equilibrium, loads: Sequence[Loads]) -> Change:
        """Never called, as no loads are taken."""
        raise NotImplementedError


def sensitivity(level: _Level, state: State) -> Sensitivity:
    """By tensions and E, from those of the strains, of the ``state`` on a ``level``.

    With one tension perturbed by a small imaginary step, the imaginary part of the strains over
    the step is the derivative (Squire and Trapp 1998), without cancellation; the step only has to
    exceed the tolerance of the sweeps of renda2012. Scaling E is equivalent to dividing all
    tensions by the same factor.
    """
    problem, equations = level.problem, level.equations
    problem.load_work(state)
    tensions, nodes = state.acting.condition.tensions, problem.elements.s.size
    stiffness = float(problem.tables.body[:, AXIAL].min())
    step = 1e-6 * max(float(tensions.max()), 1e-3 * stiffness)
    own, rest = np.eye(tensions.size), rest_stretches(problem.tables)
    local: FloatArray | None = None
    if problem.friction is not None:
        assert isinstance(equations, ClosedForm)
        stations = level.between @ state.acting.tensions
        stations[0] = tensions
        both = np.concatenate([state.acting.tensions, stations])
        stepped = both.T[:, np.newaxis] + 1j * step * own[..., np.newaxis]
        by_local = equations.local_twist(stepped).imag / step  # (4, J, N + S)
        change, local = _with_friction(level, state, by_local)
        z = equations.local_twist(both.T[:, np.newaxis])[:, :, nodes:]
    else:
        by_tension = equations.solve(tensions + 1j * step * own).twist.imag / step
        by_young = np.einsum('ijn,j->in', by_tension, -tensions)
        change = np.concatenate([by_tension, by_young[:, np.newaxis]], axis=1)
        z = equations.solve(tensions).twist[:, np.newaxis, nodes:]
    pose, strains = _poses(level, change[..., :nodes]), change[..., nodes:].copy()
    strains[:3] = (strains[:3] - z[:3] / z[3] * strains[3]) / z[3]
    along = state.acting.tensions
    stretch = tendon_stretch(problem.tables, state.z, along, problem.work.offsets)
    length = np.einsum('jnm,mcn->jc', lengths_of(problem, stretch).by_z, change[..., :nodes])
    strains, mean = strains.transpose(2, 0, 1), None
    if local is not None:
        weights = problem.elements.weights
        mean = np.einsum('n,nj,njc->jc', weights, rest, local) / (weights @ rest)[:, np.newaxis]
    tendons, parts = tensions.size, list[Change]()
    for where in (slice(tendons), slice(tendons, tendons + 1), slice(tendons + 1, None)):
        some = None if mean is None else mean[:, where]
        parts.append(Change(pose[..., where], strains[..., where], length[..., where], some))
    by_friction = None if mean is None else parts[2]
    return Sensitivity(parts[0], parts[1], by_friction=by_friction)


def _with_friction(
    level: _Level, state: State, by_local: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Changes of z (4, columns, N + S) and of the local tensions (N, J, columns).

    By base tensions, E and mu, from those ``by_local`` (4, J, N + S) tensions at the same place.

    Raises:
        SolveError: if there are none, see `friction.Changes.require`.
    """
    problem, tensions = level.problem, state.acting.tensions
    nodes, tendons = tensions.shape
    slides = problem.tension_changes(state)
    direct, own = np.zeros((nodes, tendons, 2 * tendons + 1)), np.arange(tendons)
    direct[:, own, own] = problem.tension_rates(state)
    # Derivatives of the tensions by z, (N, J, 4 N).
    by_z = np.zeros((nodes, tendons, 4 * nodes))
    if slides is not None:
        slides.require(level.names, state.acting.condition.tensions)
        direct[:, own, tendons + 1 + own] = slides.by_friction
        by_z = slides.by_twists(np.eye(4 * nodes).reshape(nodes, 4, -1))
    # Scaling E is scaling all tensions the other way.
    direct[..., tendons] = -tensions
    at_nodes = by_local[..., :nodes].transpose(2, 0, 1)
    rows = (at_nodes @ direct).reshape(4 * nodes, -1)
    coupled = (at_nodes @ by_z).reshape(4 * nodes, -1)
    z = np.linalg.solve(np.eye(4 * nodes) - coupled, rows)
    effective = direct + by_z @ z
    stations = np.tensordot(level.between, effective, 1)
    stations[0] = np.eye(tendons, 2 * tendons + 1)  # at the base tensions are given
    stations[0, :, tendons] = -state.acting.condition.tensions
    change = np.einsum('ajn,njc->acn', by_local, np.concatenate([effective, stations]))
    # The tensions themselves do not change with E as their effect does.
    effective[..., tendons] += tensions
    return change, effective


def _poses(level: _Level, change: FloatArray) -> FloatArray:
    """Changes of poses at the stations, (S, 6, columns), by those of z (4, columns, N)."""
    work, own = level.problem.work, level.problem.elements
    turning = np.einsum('nik,kcn->nic', work.rotation, change[:3])
    turn = np.tensordot(own.integration(own.s), turning, 1)
    moved = np.cross(turn, work.slope[..., np.newaxis], axis=1)
    moved += work.rotation[:, :, :1] * change[3].T[:, np.newaxis]
    return np.tensordot(level.integration, np.concatenate([moved, turning], axis=1), 1)
