"""Models in machine code, many times as quick for one arm; see `numba_build`.

Shapes are those of NumPy to rounding.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.compiled.compiled_lengths import CompiledLengths
from octo_arm_model.core.compiled.compiled_rod import CompiledRod
from octo_arm_model.core.compiled.compiled_sliding import CompiledSliding
from octo_arm_model.core.compiled.models.arm_tables import (
    GridTables,
    PapersTables,
    grid_tables,
    own,
    papers_tables,
)
from octo_arm_model.core.compiled.models.winding_kernels import Reeled
from octo_arm_model.core.compiled.numba_build import (
    balance,
    differentiate,
    differentiate_tip,
    evaluate_sections,
    find_exact_shapes,
    find_minima,
    find_shapes,
    find_turn,
    read_out,
    slide,
    slide_rod,
)
from octo_arm_model.core.compiled.section.section_tables import (
    ExactTables,
    SectionTables,
    exact_tables,
    section_tables,
)
from octo_arm_model.core.compiled.sliding_rod import SlidingRod
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.budget import Spending
from octo_arm_model.core.loaded.equilibrium import Evaluate
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.models.closed_form import ClosedForm
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.models.papers_model import PapersModel
from octo_arm_model.core.models.renda2012 import Renda2012
from octo_arm_model.core.models.sliding_closed_form import SlidingClosedForm
from octo_arm_model.core.models.statics import Statics
from octo_arm_model.core.rod.assembly import Results
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.kinematics import Frame
from octo_arm_model.core.section.elastic_laws import LinearElastic, NeoHookean
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.sheaths.sheath import SheathedSections
from octo_arm_model.core.section.tendons.tendon_lengths import TendonLengths


class Compiled:
    """Shapes of one arm under its tendons alone, or held by these at lengths."""

    _lengths: CompiledLengths | None  # where they keep their places

    def __init__(self, statics: Statics, grid: StationGrid, base: Frame) -> None:
        """Tabulate the arm of ``statics`` on ``grid``, standing on ``base``.

        Raises:
            ModuleNotFoundError: if numba is not installed.
            Exception: whatever a numba that does not work raises.
        """
        self._read_out = read_out()
        self._grid: GridTables = own(grid_tables(grid, base))
        self._tables: PapersTables | ExactTables | None = None
        self._sliding: CompiledSliding | None = None
        self._statics, self._lengths = statics, None
        if isinstance(statics, SlidingClosedForm) or (
            isinstance(statics, Exact) and statics.slides
        ):
            self._sliding = CompiledSliding(statics, self._grid)
            if isinstance(statics, Exact):
                _make(balance, find_turn, slide, slide_rod)
                statics.use(_speed_up_sliding)
        elif isinstance(statics, PapersModel):
            assert isinstance(statics.equations, ClosedForm | Renda2012)
            self._find_shapes = find_shapes()
            self._tables = own(papers_tables(statics.equations))
        else:
            assert isinstance(statics, Exact)
            self._find_shapes = find_exact_shapes()
            self._tables = own(exact_tables(statics))
            _make(
                balance, find_turn, find_minima, evaluate_sections, differentiate,
                differentiate_tip,
            )  # fmt: skip
            statics.use(_speed_up)

    def read_out(
        self, twist: FloatArray, strains: FloatArray, position: FloatArray, quaternion: FloatArray
    ) -> None:
        """Fill in stations of one arm under ``twist`` (4, nodes), a `ReadOut` of `Results`."""
        self._read_out(self._grid, own(twist), strains, position, quaternion)

    def measure(self, lengths: TendonLengths) -> None:
        """Have ``lengths`` of tendons that keep their places measured in machine code."""
        tables = self._tables if isinstance(self._tables, ExactTables) else None
        if not isinstance(lengths.sections, SheathedSections):
            self._lengths = CompiledLengths(lengths, tables, self._grid)

    def wind(
        self, given: FloatArray, driven: NDArray[np.bool_], reeled: Reeled,
        tip_wrench: FloatArray, start: Backbone, results: Results, spending: Spending,
    ) -> bool:  # fmt: skip
        """`Solver.wind`, of which ``results`` are filled in; whether tensions were found.

        Raises:
            SolveError: as `CompiledLengths.wind_loaded`.
        """
        statics, lengths = self._statics, self._lengths
        if lengths is None:
            return False
        winches = lengths.winches(given, driven)
        if not statics.is_loaded(tip_wrench):
            return lengths.wind(winches, reeled, results)
        if not isinstance(statics, Exact) or start.shape is None:
            return False
        rod = statics.rods.rod(statics.rods.level_of(start.shape.twist))
        found = lengths.wind_loaded(winches, reeled, tip_wrench, rod, start.shape, spending)
        if found is not None:
            results.add((), found)
        return found is not None

    @staticmethod
    def covers(statics: Statics) -> bool:
        """Whether the kernels cover the model and the arm.

        Of the paper's models they do where tendons make neither mixed second moment nor routing
        torque, see `TendonSums`; of exact without shear and for the elastic laws that there are.
        """
        if isinstance(statics, Exact):
            return statics.strains == 4 and type(statics.law) in (LinearElastic, NeoHookean)
        if isinstance(statics, SlidingClosedForm):
            return True
        if not isinstance(statics, PapersModel):
            return False
        equations = statics.equations
        return isinstance(equations, ClosedForm | Renda2012) and equations.weights.is_plain

    def solve(
        self, tensions: FloatArray, results: Results, before: FloatArray | None = None
    ) -> list[int]:
        """Solve for ``tensions`` (batch, tendons) [N] and fill in ``results``.

        Tendons with friction slide from tensions ``before`` (tendons, points) [N].

        Returns:
            Numbers of the arms that have no answer, and have to be solved otherwise.
        """
        if self._sliding is not None:
            return self._sliding.solve(tensions, before, results)
        strains, arrays = results.batch
        without = self._find_shapes(
            self._tables, self._grid, tensions, results.twist, strains, *arrays
        )
        return np.flatnonzero(results.iterations < 0).tolist() if without else []


def _make(*kernels: Callable[[], object]) -> None:
    """Compile ``kernels`` here where they are not kept, not in the middle of the first solve."""
    for made in kernels:
        made()


def _speed_up_sliding(rod: LoadedRod) -> None:
    """Have a ``rod`` whose tendons have friction iterate in machine code; see `SlidingRod`."""
    if not rod.equilibrium.loads.others:
        sliding = SlidingRod(rod)
        rod.newton, rod.settle, rod.slide = sliding.newton, sliding.settle, sliding.slide
        rod.read_out, rod.equilibrium.frames = sliding.read_out, sliding.frames


def _speed_up(rod: LoadedRod) -> None:
    """Have a ``rod`` evaluate its sections and iterate in machine code."""
    rod.equilibrium.evaluate = _evaluation(rod.equilibrium.energy)
    if not rod.equilibrium.loads.others:
        compiled = CompiledRod(rod)
        rod.newton, rod.read_out = compiled.newton, compiled.read_out
        rod.settle = compiled.settle
        if not isinstance(rod.equilibrium.energy, SheathedSections):
            rod.differentiate = compiled.differentiate
            rod.differentiate_tip = compiled.differentiate_tip
        rod.minimum = rod.near_minimum = compiled.minimum
        rod.equilibrium.frames = compiled.frames


def _evaluation(energy: SectionEnergy) -> Evaluate:
    """`Evaluate` for the cross sections ``energy``, compiled."""
    tables: SectionTables = own(section_tables(energy))
    machine = evaluate_sections()
    count = energy.s.size

    def evaluate(
        tensions: FloatArray, twist: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        gradient, hessian, scale = (
            np.empty((4, count)),
            np.empty((4, 4, count)),
            np.empty((4, count)),
        )
        machine(tables, own(tensions), own(twist), gradient, hessian, scale)
        return gradient, hessian, scale

    return evaluate
