"""What every model of the statics is made from, takes and gives.

A new model is a module with a `Statics` and an entry in `catalogue.MODELS`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.budget import Allowance
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.kinematics import Frame
from octo_arm_model.core.rod.solution import Solution
from octo_arm_model.core.section.elastic_laws import Law
from octo_arm_model.core.sensitivity.results import Change, Sensitivity, Uncertainty

# Arms solved in one NumPy call: enough that the call costs little, few enough for the arrays to
# stay in cache and for BLAS to use one thread, as its threads wait for each other for long on a
# busy machine.
_LARGEST_BATCH = 128
_LARGEST_PRODUCT = 250_000  # multiplications


class Setup(NamedTuple):
    """What a model is prepared for.

    Attributes:
        arm: the arm.
        grid: where strains are wanted.
        base: pose of the base.
        law: elastic law that was asked for; the paper's models are linear whatever it is.
        shear: whether cross sections shear.
        loads: what loads the arm but its tendons and the wrench on its tip.
        allowance: what solves may take, where equilibria are followed.
        compiled: whether numba compiles what it can; None where it is installed.
    """

    arm: Arm
    grid: StationGrid
    base: Frame
    law: Law
    shear: bool
    loads: Loads
    allowance: Allowance
    compiled: bool | None = None

    @property
    def batch(self) -> int:
        """How many arms are solved in one NumPy call."""
        product = self.grid.nodes.size * len(self.arm.tendons)
        return max(1, min(_LARGEST_BATCH, _LARGEST_PRODUCT // product))


class Lengths(Protocol):
    """Lengths of the tendons of one arm, from the base to their anchorages."""

    @property
    def at_rest(self) -> FloatArray:
        """In the unloaded arm [m], (tendons,)."""

    def of(self, backbone: Backbone) -> FloatArray:
        """In a single solution of the model [m], (tendons,)."""

    def integrals(self, local_tensions: FloatArray) -> FloatArray:
        """Integrals of tensions (tendons, nodes) [N] over unloaded lengths [N m], (tendons,)."""

    @property
    def offset_weights(self) -> FloatArray:
        """Derivatives of unloaded lengths by the tendons' distances from the midline [-].

        As a sum over nodes: (tendons, nodes). Zero for tendons that do not wind about the midline.
        """


class Statics(Protocol):
    """A model of the arm's statics, prepared for a `Setup`."""

    @property
    def takes_loads(self) -> bool:
        """Whether there may be loads besides the tendons."""

    @property
    def law(self) -> Law:
        """Elastic law of the cross sections."""

    @property
    def strains(self) -> int:
        """How many strains a cross section has: 4, or 6 with shear."""

    @property
    def lengths(self) -> Lengths:
        """Lengths of the tendons."""

    def is_loaded(self, tip_wrench: FloatArray) -> bool:
        """Whether anything but the tendons loads an arm, with ``tip_wrench`` (..., 6) on its tip.

        Compiled kernels may solve arms that are not loaded instead of `solve`.
        """

    def solve(
        self,
        tensions: FloatArray,
        tip_wrench: FloatArray,
        start: Backbone | None,
        before: FloatArray | None = None,
    ) -> Solution:
        """Solve for ``tensions`` (..., tendons) [N] and ``tip_wrench`` (..., 6) [N, N m].

        ``start`` is a single solution to follow the equilibrium from, if the model does, and
        ``before`` the `Backbone.point_tensions` that tendons with friction slide from; None for
        slack ones.

        Raises:
            SolveError: if there is no trustworthy answer; its number is that in the batch.
        """

    def local_tensions(self, backbone: Backbone) -> FloatArray:
        """Tension of every tendon of a single solution at every node [N], (tendons, nodes)."""

    def sensitivity(self, backbone: Backbone, by_offsets: bool = True) -> Sensitivity:
        """First derivatives of a single solution of this model, see `Solver.sensitivity`."""

    def tip_covariance(self, backbone: Backbone, uncertainty: Uncertainty) -> FloatArray:
        """Covariance (6, 6) of the tip of a single solution, see `Solver.tip_covariance`."""

    def sensitivity_to_loads(self, backbone: Backbone, loads: Sequence[Loads]) -> Change:
        """Change of a single solution per unit of each of ``loads``, if the model takes loads."""
