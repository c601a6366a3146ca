"""Beyond the paper: no small-stretch approximation, loads, friction, and a choice of laws.

The rod of `octo_arm_model.rod` does all of it; here is what it gives at the stations.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.errors import ConfigError, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.models.statics import Setup
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.rod.solution import Solution, TendonTensions, stacked
from octo_arm_model.core.sensitivity.results import Change, Sensitivity, Uncertainty
from octo_arm_model.rod.derivatives import Derivatives
from octo_arm_model.rod.lengths import Lengths
from octo_arm_model.rod.read_out import Readout
from octo_arm_model.rod.rod import Equilibrium, Rod, Setting


class Exact:
    """Strains from tensions and loads.

    Attributes:
        takes_loads: True.
        law: the elastic law of the cross sections.
        strains: 4, or 6 with shear.
        is_compiled: whether numba has compiled the node functions.
        rod: the rod.
    """

    takes_loads = True

    def __init__(self, setup: Setup) -> None:
        """Tabulate the arm and its loads.

        Raises:
            ArmDefinitionError: if gravity acts on an arm of no density.
            ModuleNotFoundError: if it is to be compiled but numba is not installed.
        """
        self._setup = setup
        self.law, self.strains = setup.law, 6 if setup.shear else 4
        base = setup.base.rotation
        self.rod = Rod(
            setup.arm, setup.loads,
            np.array([base.a.real, base.a.imag, base.b.real, base.b.imag], dtype=float),
            Setting(setup.law.widens, setup.shear, compiled=setup.compiled),
        )  # fmt: skip
        self.is_compiled = self.rod.is_compiled
        self._readout = functools.cache(self._make_readout)

    def _make_readout(self, level: int) -> Readout:
        return self.rod.readout(level, self._setup.grid.s)

    @functools.cached_property
    def lengths(self) -> Lengths:
        """Lengths of the tendons."""
        return Lengths(self.rod)

    def is_loaded(self, tip_wrench: FloatArray) -> bool:
        """Whether an arm is loaded, with ``tip_wrench`` (..., 6) on its tip."""
        return self.rod.is_loaded or bool(np.count_nonzero(tip_wrench))

    def solve(
        self,
        tensions: FloatArray,
        tip_wrench: FloatArray,
        start: Backbone | None,
        before: FloatArray | None = None,
    ) -> Solution:
        """Solve, see `Statics.solve`.

        Raises:
            SolveError: if there is no trustworthy answer; its number is that in the batch.
        """
        if tensions.ndim == 1:
            return self._solve(tensions, tip_wrench, start, before)
        found = []
        wrenches = np.broadcast_to(tip_wrench, (len(tensions), 6))
        for number, (row, wrench) in enumerate(zip(tensions, wrenches)):
            try:
                found.append(self._solve(row, wrench, start, before))
            except SolveError as error:
                error.number = number
                raise
        return stacked(found)

    def _solve(
        self, tensions: FloatArray, tip_wrench: FloatArray, start: Backbone | None,
        before: FloatArray | None,
    ) -> Solution:  # fmt: skip
        spending = self._setup.allowance.spending()
        near = None if start is None else start.shape
        history = None if before is None else before.T
        found = self.rod.solve(tensions, tip_wrench, near, spending, history)
        return self.solution(found)

    def solution(self, found: Equilibrium) -> Solution:
        """What an equilibrium is at the stations."""
        readout = self._readout(found.level)
        reading = readout.read(found.state)
        z = readout.twists(reading)
        strains = np.empty((4, len(z)))
        strains[:3] = z[:, :3].T / z[:, 3]
        strains[3] = z[:, 3] - 1.0
        position = reading.position + self._setup.base.position
        tendons = None
        if self._setup.arm.friction:
            along = found.state.acting.tensions * self.rod.problem(found.level).tables.reach
            tendons = TendonTensions(along.T.copy(), readout.tensions(reading).T.copy())
        return Solution(
            found.state.z.T, found.state.residual, found.iterations, found,
            (position, np.roll(reading.quaternion, -1, axis=1)), tendons, strains,
        )  # fmt: skip

    def equilibrium_of(self, backbone: Backbone) -> Equilibrium:
        """The equilibrium that a single ``backbone`` of this model shows.

        Raises:
            ConfigError: if it is of another solver.
        """
        found = backbone.shape
        try:
            if found is not None and found.state.z.shape == self._shape_at(found.level):
                return found
        except IndexError:
            pass
        raise ConfigError('the backbone was solved by another solver')

    def _shape_at(self, level: int) -> tuple[int, int]:
        return self.rod.problem(level).elements.s.size, self.strains

    def local_tensions(self, backbone: Backbone) -> FloatArray:
        """Tension of every tendon at every node of the rod, see `Statics`."""
        found = self.equilibrium_of(backbone)
        reach = self.rod.problem(found.level).tables.reach
        return (found.state.acting.tensions * reach).T

    def _derivatives(self, backbone: Backbone) -> Derivatives:
        found = self.equilibrium_of(backbone)
        return Derivatives(self.rod, found, self._setup.grid.s)

    def sensitivity(self, backbone: Backbone, by_offsets: bool = True) -> Sensitivity:
        """First derivatives of ``backbone`` by all quantities of `Sensitivity`."""
        return self._derivatives(backbone).sensitivity(by_offsets)

    def tip_covariance(self, backbone: Backbone, uncertainty: Uncertainty) -> FloatArray:
        """Covariance of the tip of ``backbone``."""
        return self._derivatives(backbone).tip_covariance(uncertainty)

    def sensitivity_to_loads(self, backbone: Backbone, loads: Sequence[Loads]) -> Change:
        """Change of ``backbone`` per unit of each of ``loads``."""
        return self._derivatives(backbone).by_loads(loads)
