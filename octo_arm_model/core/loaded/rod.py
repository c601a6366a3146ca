"""A loaded rod: its equilibria at collocation points, and what they are elsewhere."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.budget import Spending
from octo_arm_model.core.loaded.collocation import Collocation, Readout
from octo_arm_model.core.loaded.equilibrium import Equilibrium
from octo_arm_model.core.loaded.loading.load_limits import LoadLimits
from octo_arm_model.core.loaded.loading.load_resultants import LoadTable, dead_resultants
from octo_arm_model.core.loaded.newton import Newton, newton
from octo_arm_model.core.loaded.read_out import read_out
from octo_arm_model.core.loaded.settle import Settling
from octo_arm_model.core.loaded.sliding.friction import Friction, Sliding
from octo_arm_model.core.loaded.sliding.sliding_balance import ExactSections, balance
from octo_arm_model.core.loaded.state import Condition, State
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.kinematics import Frame
from octo_arm_model.core.rod.solution import Shape, Solution, TendonTensions
from octo_arm_model.core.section.elastic_laws import Law
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.newton import initial_strain, minimise
from octo_arm_model.core.section.paper_balance import SectionStiffness
from octo_arm_model.core.section.parameter_derivatives import ParameterDerivatives
from octo_arm_model.core.section.sheaths.sheath import sections_of
from octo_arm_model.core.section.strain_measures import (
    check_fibres,
    to_twist,
)

# Elements are fine enough where the last Legendre coefficients of the twist are below this part
# of its values. Positions, which are integrals of it, are far more exact: of a twentieth of that
# part of the length at most, and of far less at the tip, where the error of Gauss points is of
# twice the order.
RESOLVED = 1e-4
# Of an arm that turns by less than this angle [rad] its angular twist counts as one that turns by
# it: smaller twists can be what the tolerance of the equilibrium leaves.
STRAIGHT = 1e-3
# An element that turns by more than this angle [rad] is too coarse however even its twist is, as
# the direction of the midline is interpolated within it. Four elements that turn by it leave an
# error of the position of 4e-7 of the length.
MOST_TURN = 4.0
# As `RESOLVED` for the tensions of tendons with friction, whose derivatives are far less exact.
RESOLVED_TENSIONS = 1e-6

# Elements that panels of rods of successive levels are cut into; the next where strains are not
# resolved.
CUTS: tuple[int, ...] = (1, 2, 4, 8)

_KEPT = 256  # entries of each cache: of resultants by loads, and of interpolations by rods

# From a state: its twist (n, nodes), positions (stations, 3) [m] and quaternions (stations, 4).
ReadOut: TypeAlias = Callable[[State], tuple[FloatArray, FloatArray, FloatArray]]

# From a condition and a shape nearby: the solution, or the shape of a stable equilibrium that the
# elements do not resolve, or None where Newton's method leads to neither. Counts its iterations in
# the `Spending`.
Settle: TypeAlias = Callable[[Condition, Shape, Spending], Solution | Shape | None]

# From tensions (tendons,) [N]: the twist (n, points) of least energy; raises SolveError.
Minimum: TypeAlias = Callable[[FloatArray], FloatArray]

# From tensions (tendons,) [N] of tendons with friction, and tensions (tendons, points) [N] that
# they slide from: the twist (n, points) without other loads; raises SolveError.
Slide: TypeAlias = Callable[[FloatArray, FloatArray | None], FloatArray]

# From a condition and the shape of its equilibrium: changes of pose (stations, 6, columns), strain
# (stations, 4, columns) and tendon length (tendons, columns). Columns are dead loads whose
# resultants per unit, force and moment (loads, 3, points) in base_frame, are given; without them
# the wrench on the tip, tensions, E, nu and, if these are wanted, offsets. Raises
# ConvergenceError.
Differentiate: TypeAlias = Callable[
    [Condition, Shape, tuple[FloatArray, FloatArray] | None, bool],
    tuple[FloatArray, FloatArray, FloatArray],
]

# From the same, standard deviations of tensions, E, nu and, if they are uncertain, offsets, and a
# covariance (6, 6), to which that of the pose of the tip by them is added; by reciprocity.
AddTipCovariance: TypeAlias = Callable[[Condition, Shape, FloatArray, FloatArray], None]


class LoadedRod:
    """One arm and its loads on elements of one size.

    Attributes:
        equilibrium: its equations.
        newton: Newton's method for these.
        minimum: the twist of least energy under tensions alone, see `Minimum`.
        near_minimum: an approximation of it that costs little.
        slide: the twist under tensions alone, of tendons with friction, see `Slide`.
        read_out: values of a state at nodes and stations, see `ReadOut`.
        settle: equilibrium and read-out from a shape nearby, see `Settle`; None where there is no
            such method.
        base: pose of the base.
        points: number of collocation points.
        is_finest: whether there are no finer elements, for what these do not resolve.
        station_node: node of each station.
        dead_resultants: for dead loads, forces [N] and free moments [N m] on every cross section,
            (3, points) each, in base_frame, with the wrench on the tip; cached by the loads.
        read_from: interpolation from the points of another rod to those of this one; cached.
        differentiate: derivatives by compiled kernels, see `Differentiate`; None without.
        add_tip_covariance: covariance of the tip by compiled kernels, see `AddTipCovariance`; None
            without.
    """

    def __init__(
        self, arm: Arm, grid: StationGrid, base: Frame, law: Law, shear: bool, loads: Loads,
        cuts: int, most_points: int = sys.maxsize,
    ) -> None:  # fmt: skip
        """Cut every panel of ``grid``, and its parts between knots, into ``cuts`` elements.

        Each has at most ``most_points`` points.

        Raises:
            ArmDefinitionError: if a load does not fit the arm, or is larger than `LoadLimits`
                allow.
        """
        self._arm, self._grid, self.base = arm, grid, base
        self._own = own = Collocation(arm, grid, (*arm.knots, *loads.knots), cuts, most_points)
        self.points, self.station_node = own.s.size, grid.station_node
        self.is_finest = cuts == CUTS[-1]
        energy = sections_of(arm, own.s, own.section, law, shear)
        with np.errstate(over='ignore', invalid='ignore'):
            table = LoadTable(arm, own, base.rotation, loads)
        LoadLimits(SectionStiffness.at(arm, grid.nodes)).check_loads(loads, table.straight)
        friction = Friction(arm, energy, own) if arm.friction else None
        self.equilibrium = Equilibrium(energy, own, table, base.rotation, friction)
        self.newton: Newton = functools.partial(newton, self.equilibrium)
        self.minimum: Minimum = self._minimum
        self.near_minimum: Minimum = self._near_minimum
        self.slide: Slide = self._slide
        self.read_out: ReadOut = functools.partial(read_out, self)
        self.settle: Settle | None = None
        if not loads.others:
            settling = Settling(self)
            self.newton, self.settle = settling.newton, settling
        self.read_from = functools.lru_cache(_KEPT)(self._read_from)
        self.dead_resultants = functools.lru_cache(_KEPT)(self._dead_resultants)
        self.differentiate: Differentiate | None = None
        self.add_tip_covariance: AddTipCovariance | None = None

    @functools.cached_property
    def nodes(self) -> Readout:
        """Interpolation from the points to the nodes of the grid."""
        stops = np.array([panel.stop for panel in self._grid.panels])
        return self._own.readout(self._grid.nodes, stops[self._grid.node_panel])

    @functools.cached_property
    def stations(self) -> Readout:
        """Interpolation from the points to the stations, from the panel towards the base."""
        return self._own.readout(self._grid.s, self._grid.s)

    @functools.cached_property
    def station_sections(self) -> SectionEnergy:
        """Cross sections at the stations."""
        energy, grid = self.equilibrium.energy, self._grid
        return sections_of(self._arm, grid.s, grid.section, energy.law, energy.strains == 6)

    @functools.cached_property
    def parameters(self) -> ParameterDerivatives:
        """Derivatives of the cross sections at the points by parameters of the arm."""
        return ParameterDerivatives(self.equilibrium.energy, self._arm)

    def unloaded(self, tensions: FloatArray, before: FloatArray | None = None) -> Shape:
        """The shape under ``tensions`` (tendons,) [N] alone, without other loads.

        Tendons with friction slide from tensions ``before`` (tendons, points) [N], or from slack.

        Raises:
            SolveError: if there is none.
        """
        slides = self.equilibrium.friction is not None
        twist = self.slide(tensions, before) if slides else self.minimum(tensions)
        return self.equilibrium.shape(twist)

    def near_unloaded(self, tensions: FloatArray, before: FloatArray | None = None) -> Shape:
        """An approximation of `unloaded` from which Newton's method converges as well.

        Without friction ``tensions`` may be (..., tendons). With friction it is `unloaded` itself.
        """
        if self.equilibrium.friction is not None:
            return self.unloaded(tensions, before)
        return self.equilibrium.shape(self.near_minimum(tensions))

    def under(self, local_tensions: FloatArray) -> Shape:
        """The shape under ``local_tensions`` (tendons, points) [N] at the points and nothing else.

        Raises:
            SolveError: if there is none.
        """
        sections = ExactSections(self.equilibrium.energy)
        return self.equilibrium.shape(sections(local_tensions[:, np.newaxis])[:, 0])

    def _minimum(self, tensions: FloatArray) -> FloatArray:
        """`Minimum` of the cross sections at the points."""
        energy, local_tensions = self.equilibrium.energy.pulled(tensions[np.newaxis])
        start = initial_strain(energy, local_tensions)
        strain = minimise(energy, local_tensions, start).strain
        check_fibres(energy, strain)
        return to_twist(energy.law, strain)[:, 0]

    def _slide(self, tensions: FloatArray, before: FloatArray | None) -> FloatArray:
        """`Slide` of the cross sections at the points."""
        friction = self.equilibrium.friction
        assert friction is not None
        rows = tensions[np.newaxis]
        some = friction.pulled(rows)
        held = None if before is None else before[some.pull]
        return balance(some, ExactSections(some.energy), rows[:, some.pull], held).twist[:, 0]

    def _near_minimum(self, tensions: FloatArray) -> FloatArray:
        """Approximate `Minimum`, as if tendons ran parallel to the midline; for (..., tendons)."""
        energy, local_tensions = self.equilibrium.energy.pulled(np.atleast_2d(tensions))
        strain = initial_strain(energy, local_tensions)
        twist = to_twist(energy.law, strain)
        return twist if tensions.ndim > 1 else twist[:, 0]

    def from_coarser(self, other: LoadedRod, shape: Shape) -> Shape:
        """The ``shape`` of an ``other`` rod at the points of this one."""
        return self.equilibrium.shape(self.read_from(other).interpolate(shape.twist))

    def _read_from(self, other: LoadedRod) -> Readout:
        return other._own.readout(self._own.s, self._own.s)

    def along_tendons(self, tensions: FloatArray) -> TendonTensions:
        """``tensions`` (tendons, ..., points) [N] along tendons with friction, at stations too."""
        return TendonTensions(tensions, self.stations.interpolate(tensions))

    def mean_along_tendons(self, values: FloatArray) -> FloatArray:
        """Means of ``values`` (tendons, columns, points) over the unloaded lengths of the tendons.

        Returns:
            (tendons, columns).
        """
        lengths = self.parameters.rest_stretches * self._own.weights
        total: FloatArray = np.einsum('jn,jcn->jc', lengths, values)
        return total / lengths.sum(axis=1, keepdims=True)

    def _dead_resultants(self, loads: Loads) -> tuple[FloatArray, FloatArray]:
        force, moment = dead_resultants(self._arm, self._own, loads)
        force = force + np.array(loads.tip_force)[:, np.newaxis]
        return force, moment + np.array(loads.tip_moment)[:, np.newaxis]

    def resolves(self, shape: Shape, sliding: Sliding | None = None) -> bool:
        """Whether elements resolve the ``shape`` of one arm and its tendons' tensions."""
        return self.resolves_twist(shape.twist[:, np.newaxis], sliding)

    def resolves_twist(self, twist: FloatArray, sliding: Sliding | None) -> bool:
        """Whether elements resolve ``twist`` (n, batch, points) and tensions of ``sliding``."""
        if sliding is not None and not self.is_finest:
            if sliding.sticks:
                # Where a tendon begins to stick strains have a kink, which no cuts resolve.
                return True
            tensions = sliding.tensions
            most = RESOLVED_TENSIONS * tensions.max(initial=0.0)
            if self._tail(tensions).max(initial=0.0) > most:
                return False
        return bool(self.are_resolved(twist).all())

    def are_resolved(self, twist: FloatArray) -> NDArray[np.bool_]:
        """Whether elements resolve ``twist`` (n, batch, points), for each arm, (batch,).

        The finest count as fine enough.
        """
        if self.is_finest:
            return np.ones(twist.shape[1], np.bool_)
        size = np.maximum.reduce(np.abs(twist), axis=-1)
        size[:3] = np.maximum(np.maximum.reduce(size[:3]), STRAIGHT / self._own.length)
        angular = twist[:3] * self._own.steps
        turn = np.maximum.reduce(np.add.reduce(angular * angular), axis=-1)
        smooth = np.logical_and.reduce(self._tail(twist) <= RESOLVED * size)
        return np.asarray(smooth & (turn <= MOST_TURN * MOST_TURN))

    def _tail(self, values: FloatArray) -> FloatArray:
        """Largest of the last two Legendre coefficients of ``values`` (n, arms, points).

        Over all elements, (n, arms).
        """
        tail = self._own.by_element(values) @ self._own.rule.tail.T
        return np.asarray(np.abs(tail).max(axis=(-2, -1)))
