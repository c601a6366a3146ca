"""The model exact: no small-stretch approximation, loads, friction, and a choice of laws."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.errors import ConvergenceError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.limits import Spending
from octo_arm_model.arm.loads import Loads
from octo_arm_model.arm.material import LAWS
from octo_arm_model.rod.checks import are_stretched
from octo_arm_model.rod.equilibrium import Condition, Equilibrium, Problem, Several
from octo_arm_model.rod.factors import RecentFactors
from octo_arm_model.rod.rod import Rod, Setting
from octo_arm_model.rod.sensitivity import Change, Derivatives, Sensitivity, Uncertainty
from octo_arm_model.rod.statics import Setup, Shape, Shapes, Statics, strains_of
from octo_arm_model.rod.winches import Winches

# Shapes whose factors are kept, and numbers in all of these: 128 MB.
_SHAPES_WITH_FACTORS, _NUMBERS = 32, 2**24


class Exact(Statics):
    """Equilibria of the rod, see `octo_arm_model.rod`.

    Attributes:
        rod: the rod.
    """

    takes_loads = True

    def __init__(self, setup: Setup) -> None:
        """Tabulate the arm and its loads.

        Raises:
            ArmDefinitionError: if gravity acts on an arm of no density.
            ModuleNotFoundError: if it is to be compiled but numba is not installed.
        """
        super().__init__(setup)
        self.law, self.strains = setup.law, 6 if setup.shear else 4
        setting = Setting(LAWS[setup.law].number, setup.shear, setup.accuracy, setup.compiled)
        # The rod begins at the origin.
        loads = setup.loads.moved(-setup.base[0])
        self.rod = Rod(setup.arm, loads, setup.base[1], setting)
        self.is_compiled = self.rod.is_compiled
        self._winches = Winches(self.rod)
        self._recent = RecentFactors(_SHAPES_WITH_FACTORS, _NUMBERS)
        self._readout = functools.cache(lambda level: self.rod.readout(level, setup.s))
        self._several = functools.lru_cache(8)(
            lambda level, arms: Several(self.rod.finer(level).own, arms)
        )
        self._derivatives = functools.cache(lambda level: Derivatives(self.rod, level, setup.s))

    def problem(self, level: int) -> Problem:
        """See `Statics`."""
        return self.rod.problem(level)

    def solve(
        self, tensions: FloatArray, tip_wrench: FloatArray, start: Equilibrium | None,
        before: FloatArray | None, spending: Spending,
    ) -> Shape:  # fmt: skip
        """See `Statics`."""
        near = None if start is None else self._with_factors(start)
        found = self.rod.solve(tensions, tip_wrench, near, spending, before)
        if near is not None and near.key and near.factors is None and found.factors is not None:
            # The next set that is solved from this shape begins with these.
            self._keep(near.key, found)
        return self.shape(found)

    def _loaded(self, tip_wrenches: FloatArray) -> bool:
        """See `Statics`."""
        return self.rod.is_loaded or bool(tip_wrenches.any())

    @np.errstate(over='ignore', invalid='ignore', divide='ignore')
    def _solve_at_once(
        self, level: int, tensions: FloatArray, numbers: IntArray, shapes: Shapes
    ) -> NDArray[np.bool_]:
        """See `Statics`."""
        several, readout = self._several(level, len(tensions)), self._readout(level)
        try:
            z, left, steps = several.balance(tensions)
        except ConvergenceError:
            return np.zeros(len(tensions), np.bool_)
        fine = self._write(several, z, readout.places, numbers, shapes)
        fine &= are_stretched(several.tables, z, len(tensions))
        z = readout.twists(z.reshape(len(tensions), -1, self.strains))
        shapes.strains[:, numbers] = strains_of(z)
        shapes.residual[numbers], shapes.iterations[numbers] = left, steps
        return fine

    def wind(
        self, displacements: FloatArray, driven: NDArray[np.bool_], condition: Condition,
        start: Equilibrium | None, spending: Spending,
    ) -> tuple[Shape, FloatArray]:  # fmt: skip
        """See `Statics`."""
        near = None if start is None else self._with_factors(start)
        found = self._winches.solve(displacements, driven, condition, near, spending)
        return self.shape(found), found.state.reeled

    def shape(self, found: Equilibrium) -> Shape:
        """An equilibrium at the stations."""
        reading = self._readout(found.level).read(found.state, found.fine)
        position, quaternion, twist, along = reading
        position = position + self._setup.base[0]
        if found.factors is not None:
            key = object()
            self._keep(key, found)
            found = found._replace(factors=None, key=key)
        return Shape(position, quaternion, strains_of(twist), along, found)

    def _keep(self, key: object, found: Equilibrium) -> None:
        """Keep the factors of ``found`` for the shape of this ``key``."""
        if found.factors is not None:
            self._recent.add(key, found.factors, found.state.z.size)

    def _with_factors(self, found: Equilibrium) -> Equilibrium:
        """The equilibrium of a shape with its factors, while they are among the recent ones."""
        return found if found.key is None else found._replace(factors=self._recent.find(found.key))

    def _linearised(self, found: Equilibrium) -> Derivatives:
        """Derivatives about an equilibrium, whose factors the next solve begins with too."""
        derivatives = self._derivatives(found.level)
        factors = derivatives.linearise(self._with_factors(found))
        if found.key is not None:
            self._recent.add(found.key, factors, found.state.z.size)
        return derivatives

    def sensitivity(self, found: Equilibrium) -> Sensitivity:
        """See `Statics`."""
        return self._linearised(found).sensitivity(found)

    def tip_covariance(self, found: Equilibrium, uncertainty: Uncertainty) -> FloatArray:
        """See `Statics`."""
        return self._linearised(found).tip_covariance(found, uncertainty)

    def by_loads(self, found: Equilibrium, loads: Sequence[Loads]) -> Change:
        """See `Statics`."""
        return self._linearised(found).by_loads(found, loads)
