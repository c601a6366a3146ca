"""The paper's models: strains from tensions at each node, linear material, no other loads."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.budget import Spending
from octo_arm_model.core.errors import ConfigError, SolveError
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.rod.elements import LEVELS
from octo_arm_model.rod.equilibrium import Condition, Problem, State
from octo_arm_model.rod.exact import strains_of
from octo_arm_model.rod.lengths import lengths_of
from octo_arm_model.rod.paper_balance import Strains
from octo_arm_model.rod.read_out import ADDED_POINTS, integrate_poses
from octo_arm_model.rod.resolution import position_error
from octo_arm_model.rod.rod import Equilibrium, Rod, Setting
from octo_arm_model.rod.sensitivity import Change, Sensitivity, Uncertainty
from octo_arm_model.rod.statics import Setup, Shape, Statics
from octo_arm_model.rod.tables import AXIAL
from octo_arm_model.rod.tendons import tendon_stretch

_ACCURACY = 1e-8  # of positions, over the length


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
    """

    problem: Problem
    equations: Equations
    integration: FloatArray


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

    def _level(self, level: int) -> _Level:
        setup, problem = self._setup, self._rod.problem(level, ADDED_POINTS)
        own = problem.elements
        places = np.concatenate([own.s, setup.s]), np.concatenate([own.section, setup.section])
        return _Level(problem, self._equations(setup.arm, *places), own.integration(setup.s))

    def problem(self, level: int) -> Problem:
        """See `Statics`."""
        return self._at(level).problem

    def solve(
        self, tensions: FloatArray, tip_wrench: FloatArray, start: Equilibrium | None,
        before: FloatArray | None, spending: Spending,
    ) -> Shape:  # fmt: skip
        """See `Statics`; neither ``start`` nor ``spending`` matters.

        Raises:
            SolveError: if a cross section is compressed to nothing (1 + q <= 0).
        """
        for level in range(len(LEVELS)):
            problem, equations, integration = self._at(level)
            found = equations.solve(tensions)
            self._check(problem, found.twist[3])
            nodes = problem.elements.s.size
            z = np.ascontiguousarray(found.twist[:, :nodes].T)
            problem.form.orientations(problem.tables, z, problem.work)
            error = position_error(problem.elements, z, problem.work.slope)
            if error <= _ACCURACY:
                break
        position, turn = integrate_poses(problem, z, integration)
        acting = problem.acting(Condition(tensions, tip_wrench))
        residual = float(found.residual)
        state = State(acting, z, np.zeros_like(z), residual)
        return Shape(
            position + self._setup.base[0],
            np.roll(turn, -1, axis=1),
            strains_of(found.twist[:, nodes:].T),
            None,
            Equilibrium(problem.known(state), level, None, None, int(found.iterations)),
        )

    def _check(self, problem: Problem, stretch: FloatArray) -> None:
        """Check that no cross section is compressed to nothing.

        Raises:
            SolveError: if one is.
        """
        if not stretch.min() > 0.0:  # nor NaN
            worst = int(np.argmin(stretch > 0.0))
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
    problem, equations, _ = level
    problem.load_work(state)
    tensions = state.acting.condition.tensions
    stiffness = float(problem.tables.body[:, AXIAL].min())
    step = 1e-6 * max(float(tensions.max()), 1e-3 * stiffness)
    moved = tensions + 1j * step * np.eye(tensions.size)
    by_tension = equations.solve(moved).twist.imag / step  # (4, J, N + S)
    by_young = np.einsum('ijn,j->in', by_tension, -tensions)
    change = np.concatenate([by_tension, by_young[:, np.newaxis]], axis=1)
    nodes = problem.elements.s.size
    pose, strains = _poses(level, change[..., :nodes]), change[..., nodes:].copy()
    z = equations.solve(tensions).twist[:, np.newaxis, nodes:]
    strains[:3] = (strains[:3] - z[:3] / z[3] * strains[3]) / z[3]
    along = state.acting.tensions
    stretch = tendon_stretch(problem.tables, state.z, along, problem.work.offsets)
    length = np.einsum('jnm,mcn->jc', lengths_of(problem, stretch).by_z, change[..., :nodes])
    strains = strains.transpose(2, 0, 1)
    parts = [
        Change(pose[..., own], strains[..., own], length[..., own])
        for own in (slice(0, -1), slice(-1, None))
    ]
    return Sensitivity(*parts)


def _poses(level: _Level, change: FloatArray) -> FloatArray:
    """Changes of poses at the stations, (S, 6, columns), by those of z (4, columns, N)."""
    work, own = level.problem.work, level.problem.elements
    turning = np.einsum('nik,kcn->nic', work.rotation, change[:3])
    turn = np.tensordot(own.integration(own.s), turning, 1)
    moved = np.cross(turn, work.slope[..., np.newaxis], axis=1)
    moved += work.rotation[:, :, :1] * change[3].T[:, np.newaxis]
    return np.tensordot(level.integration, np.concatenate([moved, turning], axis=1), 1)
