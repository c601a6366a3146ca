"""Models solved by compiled kernels, many times faster for one arm; see `numba_build`.

The results are those of NumPy up to rounding.
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
    add_tip_covariance,
    balance,
    differentiate,
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
    """Shapes of one arm under given tensions or tendon displacements."""

    _lengths: CompiledLengths | None  # None before `measure`, and with compliant sheaths

    def __init__(self, statics: Statics, grid: StationGrid, base: Frame) -> None:
        """Tabulate the arm of ``statics`` on ``grid``, with the base in the pose ``base``.

        Raises:
            ModuleNotFoundError: if numba is not installed.
            Exception: any error of a numba that does not work.
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
                add_tip_covariance,
            )  # fmt: skip
            statics.use(_speed_up)

    def read_out(
        self, twist: FloatArray, strains: FloatArray, position: FloatArray, quaternion: FloatArray
    ) -> None:
        """`ReadOut` of `Results`: the stations of one arm under ``twist`` (4, nodes)."""
        self._read_out(self._grid, own(twist), strains, position, quaternion)

    def measure(self, lengths: TendonLengths) -> None:
        """Let ``lengths`` be computed by a kernel, where no tendon has a compliant sheath."""
        tables = self._tables if isinstance(self._tables, ExactTables) else None
        if not isinstance(lengths.sections, SheathedSections):
            self._lengths = CompiledLengths(lengths, tables, self._grid)

    def wind(
        self, given: FloatArray, driven: NDArray[np.bool_], reeled: Reeled,
        tip_wrench: FloatArray, start: Backbone, results: Results, spending: Spending,
    ) -> bool:  # fmt: skip
        """As `Solver.wind`, filling in ``results``; returns whether it converged.

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

        Of the paper's models those without mixed second moment and routing torque, see
        `TendonSums`, or with friction; exact without shear, with the laws of this package.
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
            Indices of the arms for which the kernels did not converge.
        """
        if self._sliding is not None:
            return self._sliding.solve(tensions, before, results)
        strains, arrays = results.batch
        failures = self._find_shapes(
            self._tables, self._grid, tensions, results.twist, strains, *arrays
        )
        return np.flatnonzero(results.iterations < 0).tolist() if failures else []


def _make(*kernels: Callable[[], object]) -> None:
    """Load or compile ``kernels`` now, not during the first solve."""
    for made in kernels:
        made()


def _speed_up_sliding(rod: LoadedRod) -> None:
    """Let a ``rod`` whose tendons have friction be solved by kernels; see `SlidingRod`."""
    if not rod.equilibrium.loads.others:
        sliding = SlidingRod(rod)
        rod.newton, rod.settle, rod.slide = sliding.newton, sliding.settle, sliding.slide
        rod.read_out, rod.equilibrium.frames = sliding.read_out, sliding.frames


def _speed_up(rod: LoadedRod) -> None:
    """Let a ``rod`` be evaluated, solved and differentiated by kernels."""
    rod.equilibrium.evaluate = _evaluation(rod.equilibrium.energy)
    if not rod.equilibrium.loads.others:
        compiled = CompiledRod(rod)
        rod.newton, rod.read_out = compiled.newton, compiled.read_out
        rod.settle = compiled.settle
        if not isinstance(rod.equilibrium.energy, SheathedSections):
            rod.differentiate = compiled.differentiate
            rod.add_tip_covariance = compiled.add_tip_covariance
        rod.minimum = rod.near_minimum = compiled.minimum
        rod.equilibrium.frames = compiled.frames


def _evaluation(energy: SectionEnergy) -> Evaluate:
    """`Evaluate` for the cross sections ``energy``, by a kernel."""
    tables: SectionTables = own(section_tables(energy))
    kernel = evaluate_sections()
    count = energy.s.size

    def evaluate(
        tensions: FloatArray, twist: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        gradient, hessian, scale = (
            np.empty((4, count)),
            np.empty((4, 4, count)),
            np.empty((4, count)),
        )
        kernel(tables, own(tensions), own(twist), gradient, hessian, scale)
        return gradient, hessian, scale

    return evaluate
