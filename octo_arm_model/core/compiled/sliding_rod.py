"""Loaded rods whose tendons have friction: Newton's method in machine code."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.compiled_rod import CompiledRod, KnownSystem
from octo_arm_model.core.compiled.friction.friction_kernels import remembered
from octo_arm_model.core.compiled.friction.friction_tables import FrictionTables, friction_tables
from octo_arm_model.core.compiled.kernel_compiler import entry_point
from octo_arm_model.core.compiled.loaded.readout_kernels import Readings
from octo_arm_model.core.compiled.loaded.rod_kernels import READINGS, Outcome
from octo_arm_model.core.compiled.loaded.rod_state import RodState
from octo_arm_model.core.compiled.models.arm_tables import own
from octo_arm_model.core.compiled.numba_build import slide, slide_rod
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.newton import Iterate
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.sliding.friction import Sliding
from octo_arm_model.core.loaded.stability import SAME_LOADS
from octo_arm_model.core.loaded.state import Condition, State
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod.solution import Shape, TendonTensions

_NOTHING = np.zeros((0, 0))


class SlidingRod(CompiledRod):
    """`Newton`, `Settle`, `ReadOut` and `Slide` of one rod."""

    def __init__(self, rod: LoadedRod) -> None:
        """Tabulate ``rod``.

        Raises:
            Exception: whatever a numba that does not work raises.
        """
        super().__init__(rod)
        friction: FrictionTables = own(friction_tables(rod, None))
        self._friction = friction._replace(sections=self._tables.sections)
        self._slide, self._slide_rod = entry_point(slide()), entry_point(slide_rod())
        # Which say why there is nothing.
        self._unloaded, self._by_numpy = rod.slide, rod.newton
        self._slip = np.empty_like(friction.transmission)

    def slide(self, tensions: FloatArray, before: FloatArray | None) -> FloatArray:
        """`Slide` of the rod.

        Raises:
            SolveError: if there is none.
        """
        held = _NOTHING if before is None else own(before)
        memory = np.empty((remembered(int(np.count_nonzero(tensions))), self._rod.points))
        _, sweeps, _ = self._slide(self._friction, own(tensions), held, _NOTHING, memory)
        return self._unloaded(tensions, before) if sweeps < 0 else memory[:4].copy()

    def newton(self, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
        """Iterate until the residual is within ``tolerance``."""
        found = super().newton(condition, shape, tolerance)
        if found.state.residual == np.inf:
            return self._by_numpy(condition, shape, tolerance)
        along = self._tensions_along(condition.tensions).copy()
        sliding = Sliding(along, self._slip[:, np.newaxis].copy())
        return found._replace(state=found.state._replace(sliding=sliding))

    def _tendon_tensions(self) -> TendonTensions:
        """Tensions along the tendons in the last equilibrium, copied."""
        along, stations = self._tables.sections, self._tables.station_sections
        return TendonTensions(along.transmission.copy(), stations.transmission.copy())

    def read_out(self, state: State) -> tuple[FloatArray, FloatArray, FloatArray]:
        """`ReadOut` of the rod."""
        assert state.sliding is not None
        along, condition = state.sliding.tensions[:, 0], state.condition
        self._tables.sections.transmission[:] = along
        self._tables.station_sections.transmission[:] = self._rod.stations.interpolate(along)
        held = condition._replace(tensions=np.sign(condition.tensions))
        return super().read_out(state._replace(condition=held))

    def _tensions_along(self, tensions: FloatArray) -> FloatArray:
        """As that of `CompiledRod`, whatever ``tensions`` at the base they follow from."""
        return self._tables.sections.transmission[:, np.newaxis]

    def _balance(
        self, condition: Condition, shape: Shape, known: KnownSystem, tolerance: float,
        wanted: int, readings: Readings, compliance: FloatArray, change: FloatArray,
    ) -> tuple[Outcome, RodState, Shape]:  # fmt: skip
        """`sliding_rod_kernels.slide_rod`, as that of `CompiledRod`."""
        # Which the kernel only reads.
        before = _NOTHING if condition.before is None else np.ascontiguousarray(condition.before)
        tensions = np.ascontiguousarray(condition.tensions)
        tip_wrench = np.ascontiguousarray(condition.tip_wrench)
        has_energy = self._loads.has_energy(tip_wrench)
        reach = self._reach(known, condition) if has_energy and wanted == READINGS else 0.0
        system, nothing = self._room_for_system(), self._nothing_known
        for near in (nothing,) if known is nothing else (known, nothing):
            state, orientation = self._start(shape, wanted)
            *found, changed = self._slide_rod(
                self.tables, self._friction, tensions, before, tip_wrench,
                float(condition.factor), tolerance, has_energy, wanted, near is not nothing,
                near.system, reach, SAME_LOADS - near.changed, orientation, state, self._slip,
                system, compliance, change, readings,
            )  # fmt: skip
            outcome = Outcome(*found)
            if outcome.residual < np.inf:
                break
        self._keep(shape, state, outcome, near, system, changed, condition)
        return outcome, state, Shape(state.twist, Quaternions(orientation[0], orientation[1]))
