"""Beyond the paper: no small-stretch approximation, loads, and a choice of elastic laws.

Without loads every cross section is in balance by itself, see `unloaded_exact`. Under loads that
is where continuation begins, see `loaded_exact`.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence

import numpy as np

from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.errors import SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.rod import CUTS, LoadedRod
from octo_arm_model.core.loaded.sliding.friction import Friction
from octo_arm_model.core.loaded.sliding.sliding_balance import ExactSections
from octo_arm_model.core.loaded.state import Condition
from octo_arm_model.core.models.loaded_exact import LoadedExact
from octo_arm_model.core.models.sliding import Rods
from octo_arm_model.core.models.statics import Setup
from octo_arm_model.core.models.unloaded_exact import UnloadedExact
from octo_arm_model.core.numerics.floating_point import silenced
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.rod.solution import Shape, Solution, stacked
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.sheaths.sheath import sections_of
from octo_arm_model.core.sensitivity.analytic import derivatives
from octo_arm_model.core.sensitivity.by_loads import by_loads
from octo_arm_model.core.sensitivity.results import Change, Sensitivity, Uncertainty
from octo_arm_model.core.sensitivity.tip import is_reciprocal, tip_covariance


class Exact:
    """Strains from tensions and loads.

    Attributes:
        takes_loads: True.
        law: the elastic law of the cross sections.
        strains: 4, or 6 with shear.
        slides: whether tendons have friction.
        rods: at whose points the arm is solved under loads, or with friction.
        unloaded: solves the arm without loads.
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
        self._loaded = LoadedExact(self._rod, self.rods, setup.allowance)

    def use(self, compiled: Callable[[LoadedRod], None]) -> None:
        """Have ``compiled`` put its kernels into every loaded rod that is made from now on."""
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
        return self._is_loaded or bool(np.count_nonzero(tip_wrench))

    def solve(
        self,
        tensions: FloatArray,
        tip_wrench: FloatArray,
        start: Backbone | None,
        before: FloatArray | None = None,
    ) -> Solution:
        """Solve, see `Statics.solve`.

        A loaded arm is followed from ``start``, or from the unloaded shape. Tendons with friction
        slide from tensions ``before`` (tendons, points) [N], or from slack.

        Raises:
            SolveError: if there is no trustworthy answer; its number is that in the batch.
        """
        is_loaded = self.is_loaded(tip_wrench)
        if tensions.ndim == 1 and is_loaded:
            return self._loaded.solve(tensions, tip_wrench, start, before)
        with silenced():
            return self._solve(is_loaded, tensions, tip_wrench, start, before)

    def _solve(
        self,
        is_loaded: bool,
        tensions: FloatArray,
        tip_wrench: FloatArray,
        start: Backbone | None,
        before: FloatArray | None,
    ) -> Solution:
        """As `solve`, of several arms or of one without loads."""
        is_one = tensions.ndim == 1
        if self.slides and not is_loaded:
            return self.rods.slide(_sections, tensions, before)
        rows = tensions[np.newaxis] if is_one else tensions
        if not is_loaded:
            solution = self.unloaded.solve(rows)
        else:
            wrenches = np.broadcast_to(tip_wrench, (len(rows), 6))
            settled = self._loaded.settle_all(rows, wrenches, start)
            found = []
            for number, (row, wrench) in enumerate(zip(rows, wrenches)):
                try:
                    one = settled[number]
                    found.append(one or self._loaded.solve(row, wrench, start, before))
                except SolveError as error:
                    error.number = number
                    raise
            solution = stacked(found)
        return solution.one() if is_one else solution

    def local_tensions(self, backbone: Backbone) -> FloatArray:
        """Tension of every tendon at every node, see `Statics`."""
        if self.slides:
            return self.rods.at_nodes(backbone)
        return self.sections.local_tensions(backbone.tensions.reshape(1, -1))[:, 0]

    def sensitivity(self, backbone: Backbone, by_offsets: bool = True) -> Sensitivity:
        """First derivatives of ``backbone`` by all quantities of `Sensitivity`."""
        return derivatives(*self._balance_of(backbone), by_offsets)

    def tip_covariance(self, backbone: Backbone, uncertainty: Uncertainty) -> FloatArray:
        """Covariance of the tip of ``backbone``, by reciprocity where that holds."""
        rod, condition, shape = self._balance_of(backbone)
        if not is_reciprocal(rod, condition):
            return self.sensitivity(backbone).tip_covariance(uncertainty)
        return tip_covariance(rod, condition, shape, uncertainty)

    def sensitivity_to_loads(self, backbone: Backbone, loads: Sequence[Loads]) -> Change:
        """Change of ``backbone`` per unit of each of ``loads``."""
        return by_loads(*self._balance_of(backbone), loads)

    def _balance_of(self, backbone: Backbone) -> tuple[LoadedRod, Condition, Shape]:
        """The rod at whose points ``backbone`` is an equilibrium, its condition and its shape."""
        tensions = backbone.tensions.ravel()
        condition = Condition(tensions, backbone.tip_wrench, 1.0, backbone.point_tensions)
        shape, level = backbone.shape, 0
        if shape is None and backbone.point_tensions is not None:
            level = self.rods.level_of(backbone.point_tensions)
            shape = self._rod(level).under(backbone.point_tensions)
        elif shape is None:
            shape = self._rod(0).unloaded(tensions)
            while not self._rod(level).resolves(shape):
                level += 1
                shape = self._rod(level).unloaded(tensions)
        else:
            level = self.rods.level_of(shape.twist)
        return self._rod(level), condition, shape


def _sections(_: LoadedRod, friction: Friction) -> ExactSections:
    return ExactSections(friction.energy)
