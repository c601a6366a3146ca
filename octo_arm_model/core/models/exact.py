"""Beyond the paper: no small-stretch approximation, loads, and a choice of elastic laws.

Without loads every cross section is in balance by itself, see `unloaded_exact`. Under loads that
is where continuation begins.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence

import numpy as np

from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.errors import ContinuationError, ConvergenceError, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.budget import Spending
from octo_arm_model.core.loaded.continuation import MOST_CORRECTED, ON_THE_WAY, TOLERANCE, follow
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.settle import Settling
from octo_arm_model.core.loaded.sliding.friction import Friction
from octo_arm_model.core.loaded.sliding.sliding_balance import ExactSections
from octo_arm_model.core.loaded.stability import stability_of
from octo_arm_model.core.loaded.state import Condition
from octo_arm_model.core.models.sliding import CUTS, Rods
from octo_arm_model.core.models.statics import Setup
from octo_arm_model.core.models.unloaded_exact import UnloadedExact
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.rod.solution import Shape, Solution, TendonTensions, stacked
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.sheaths.sheath import sections_of
from octo_arm_model.core.section.strain_measures import check_fibres, to_scaled
from octo_arm_model.core.sensitivity.analytic import derivatives
from octo_arm_model.core.sensitivity.by_loads import by_loads
from octo_arm_model.core.sensitivity.results import Change, Sensitivity, TipBy
from octo_arm_model.core.sensitivity.tip import is_reciprocal, tip_derivatives

_FIRST_STEP = 0.1  # of continuation, where the whole way is too far for one
COARSE = 3  # points in each of the elements in which an arm is followed from its unloaded shape


class Exact:
    """Strains from tensions and loads.

    Attributes:
        takes_loads: always.
        law: elastic law.
        strains: 4, or 6 with shear.
        slides: whether tendons have friction.
        rods: where it is solved under loads, or with friction.
        unloaded: the arm without loads.
    """

    takes_loads = True

    def __init__(self, setup: Setup) -> None:
        """Tabulate the arm and its loads.

        Raises:
            ArmDefinitionError: if gravity acts on an arm of no density.
        """
        self._setup = setup
        self.law, self.strains = setup.law, 6 if setup.shear else 4
        arm, grid, base, law, shear, loads, _ = setup
        self._compiled: Callable[[LoadedRod], None] | None = None

        def rod(level: int, most_points: int = sys.maxsize) -> LoadedRod:
            rod = LoadedRod(arm, grid, base, law, shear, loads, CUTS[level], most_points)
            if self._compiled:
                self._compiled(rod)
            return rod

        self._rod = functools.lru_cache(rod)
        self.rods = Rods(self._rod)
        self.slides = bool(arm.friction)
        self._is_loaded = not self._rod(0).equilibrium.loads.is_empty
        self.unloaded = UnloadedExact(setup)

    def use(self, compiled: Callable[[LoadedRod], None]) -> None:
        """Have ``compiled`` change how every loaded rod evaluates sections and iterates."""
        self._compiled = compiled
        self._rod.cache_clear()
        if self._is_loaded:
            self._rod(0)

    @functools.cached_property
    def sections(self) -> SectionEnergy:
        """Cross sections at the nodes."""
        setup, grid = self._setup, self._setup.grid
        return sections_of(setup.arm, grid.nodes, grid.node_section, setup.law, setup.shear)

    def is_loaded(self, tip_wrench: FloatArray) -> bool:
        """Whether an arm is loaded, with ``tip_wrench`` (..., 6) on its tip."""
        return self._is_loaded or bool(tip_wrench.any())

    def solve(
        self,
        tensions: FloatArray,
        tip_wrench: FloatArray,
        start: Backbone | None,
        before: FloatArray | None = None,
    ) -> Solution:
        """Twist at every node under ``tensions`` (..., tendons) [N] and ``tip_wrench`` (..., 6).

        A loaded arm is followed from ``start``, or from the unloaded shape. Tendons with friction
        have tensions ``before`` (tendons, points) [N], or are slack.

        Raises:
            SolveError: if there is no trustworthy answer; its number is that in the batch.
        """
        is_loaded = self.is_loaded(tip_wrench)
        if is_loaded and tensions.ndim == 1:
            return self._solve_loaded(tensions, tip_wrench, start, before)
        if self.slides and not is_loaded:
            return self.rods.slide(_sections, tensions, before)
        rows = np.atleast_2d(tensions)
        if not is_loaded:
            solution = self.unloaded.solve(rows)
        else:
            wrenches = np.broadcast_to(tip_wrench, (len(rows), 6))
            settled = self._settle_all(rows, wrenches, start)
            found = []
            for number, (row, wrench) in enumerate(zip(rows, wrenches)):
                try:
                    one = settled[number]
                    found.append(one or self._solve_loaded(row, wrench, start, before))
                except SolveError as error:
                    error.number = number
                    raise
            solution = stacked(found)
        return solution if tensions.ndim > 1 else solution.one()

    def _settle_all(
        self, tensions: FloatArray, tip_wrench: FloatArray, start: Backbone | None
    ) -> list[Solution | None]:
        """`solve` of loaded arms, ``tensions`` (arms, tendons) [N] and ``tip_wrench`` (arms, 6).

        None for those that are to be solved one by one, as Newton's method alone does not lead
        them to a stable balance, or takes more than the budget.
        """
        rod = self._rod(self._level_of(start))
        nothing: list[Solution | None] = [None] * len(tensions)
        if not isinstance(rod.settle, Settling):
            return nothing
        shape = rod.near_unloaded(tensions) if start is None else _shape_of(start, rod)
        found = rod.settle.settle_all(Condition(tensions, tip_wrench, 1.0), shape)
        most = self._setup.budget.iterations
        return [one if one is not None and one.iterations <= most else None for one in found]

    def _level_of(self, start: Backbone | None) -> int:
        """Level of the rod on which a ``start`` was found, or on which to begin."""
        return 0 if start is None or start.shape is None else self.rods.level_of(start.shape.twist)

    def _solve_loaded(
        self,
        tensions: FloatArray,
        tip_wrench: FloatArray,
        start: Backbone | None,
        before: FloatArray | None,
    ) -> Solution:
        """`solve` for one arm."""
        level = self._level_of(start)
        wanted = Condition(tensions, tip_wrench, 1.0, self.rods.at_level(before, level))
        spending, rod = Spending(self._setup.budget), self._rod(level)
        shape, found = None if start is None else _shape_of(start, rod, wanted.before), None
        if rod.settle is not None:
            begin = shape or rod.near_unloaded(tensions, wanted.before)
            found = rod.settle(wanted, begin, spending)
        if isinstance(found, Solution):
            return found
        if found is not None:
            known, shape = wanted, found
        elif start is None or shape is None:
            known, shape = self._nearly(wanted, spending)
        else:
            known = wanted._replace(tensions=start.tensions.ravel(), tip_wrench=start.tip_wrench)
        state = follow(rod.equilibrium, rod.newton, known, shape, wanted, spending)
        while not rod.resolves(state.shape, state.sliding) and level + 1 < len(CUTS):
            level, coarser = level + 1, rod
            rod = self._rod(level)
            shape = rod.from_coarser(coarser, state.shape)
            wanted = wanted._replace(before=self.rods.at_level(before, level))
            state = follow(rod.equilibrium, rod.newton, wanted, shape, wanted, spending)
        energy = rod.equilibrium.energy
        strain = to_scaled(energy.law, state.shape.twist[:, np.newaxis])
        check_fibres(energy, strain)
        local_tensions, tendons = energy.local_tensions(tensions[np.newaxis]), None
        if state.sliding is not None:
            local_tensions = state.sliding.tensions
            along = local_tensions[:, 0]
            tendons = TendonTensions(along, rod.stations.interpolate(along))
        energy.check_tendons(strain, local_tensions)
        twist, position, quaternion = rod.read_out(state)
        return Solution(
            twist, state.residual, spending.iterations, state.shape, (position, quaternion),
            tendons,
        )  # fmt: skip

    def _nearly(self, wanted: Condition, spending: Spending) -> tuple[Condition, Shape]:
        """A condition and the shape of a balance in it, or nearly so, to follow the arm from.

        That is ``wanted`` itself where Newton's method or few points lead there, else that of the
        unloaded shape.

        Raises:
            SolveError: if there is none.
        """
        known = wanted._replace(tip_wrench=np.zeros(6), factor=0.0)
        fine, coarse = self._rod(0), self._rod(0, COARSE)
        is_plain = not (self.slides or fine.equilibrium.loads.without_tangent)
        if not (is_plain and coarse.points < fine.points):
            return known, fine.unloaded(wanted.tensions, wanted.before)
        if fine.settle is None:
            found = fine.newton(wanted, fine.unloaded(wanted.tensions), TOLERANCE)
            state = found.state
            spending.add(found.iterations, 0.0, state.residual, state.shape.twist)
            if state.residual <= TOLERANCE and found.corrected <= MOST_CORRECTED:
                stability = stability_of(fine.equilibrium, state, found.system)
                if stability.is_stable or (stability.is_stable is None and stability.sign > 0):
                    return wanted, state.shape
        shape = coarse.unloaded(wanted.tensions)
        try:
            state = follow(
                coarse.equilibrium, coarse.newton, known, shape, wanted, spending, ON_THE_WAY,
                _FIRST_STEP,
            )  # fmt: skip
        except ContinuationError:
            raise  # Its budget is spent.
        except ConvergenceError:
            return known, fine.unloaded(wanted.tensions)  # Too few points, perhaps.
        return wanted, fine.from_coarser(coarse, state.shape)

    def local_tensions(self, backbone: Backbone) -> FloatArray:
        """Tension of every tendon at every node, see `Statics`."""
        if self.slides:
            return self.rods.at_nodes(backbone)
        return self.sections.local_tensions(backbone.tensions.reshape(1, -1))[:, 0]

    def sensitivity(self, backbone: Backbone) -> Sensitivity:
        """First derivatives of ``backbone``, by all there is."""
        return derivatives(*self._balance_of(backbone))

    def tip_by(self, backbone: Backbone) -> TipBy:
        """Derivatives of the tip of ``backbone``, by reciprocity where that holds."""
        rod, condition, shape = self._balance_of(backbone)
        if not is_reciprocal(rod, condition):
            return self.sensitivity(backbone).tip_by
        return tip_derivatives(rod, condition, shape)

    def sensitivity_to_loads(self, backbone: Backbone, loads: Sequence[Loads]) -> Change:
        """Change of ``backbone`` per unit of each of ``loads``."""
        return by_loads(*self._balance_of(backbone), loads)

    def _balance_of(self, backbone: Backbone) -> tuple[LoadedRod, Condition, Shape]:
        """The rod that a ``backbone`` is a solution of, what acts on it and its shape."""
        tensions = backbone.tensions.ravel()
        condition = Condition(tensions, backbone.tip_wrench, 1.0, backbone.point_tensions)
        shape, level = backbone.shape, 0
        if shape is None and backbone.point_tensions is not None:
            level = self.rods.level_of(backbone.point_tensions)
            shape = self._rod(level).under(backbone.point_tensions)
        elif shape is None:
            shape = self._rod(0).unloaded(tensions)
            while not self._rod(level).resolves(shape) and level + 1 < len(CUTS):
                level += 1
                shape = self._rod(level).unloaded(tensions)
        else:
            level = self.rods.level_of(shape.twist)
        return self._rod(level), condition, shape


def _shape_of(start: Backbone, rod: LoadedRod, before: FloatArray | None = None) -> Shape:
    """The shape of a ``start`` at the points of a ``rod``; tensions ``before`` are of the next.

    Raises:
        SolveError: if there is none.
    """
    return start.shape or rod.unloaded(start.tensions.ravel(), before)


def _sections(_: LoadedRod, friction: Friction) -> ExactSections:
    return ExactSections(friction.energy)
