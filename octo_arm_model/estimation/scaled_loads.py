"""Dead loads in given proportions, whose magnitudes are unknowns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.arm.loads import DeformedRod, Loads, Resultants, Tangent
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.load_resultants import dead_resultants


class ScaledLoads:
    """A `Load` that is the sum of dead loads, each times its magnitude.

    The magnitudes belong to whoever made this and its solver, and are set before every solve.

    Attributes:
        loads: of magnitude one each.
        magnitudes: of each of ``loads``, (k,).
        breaks: see `Load`.
        knots: see `Load`.
    """

    def __init__(self, arm: Arm, loads: Sequence[Loads]) -> None:
        """Of ``loads`` on ``arm``, zero at first."""
        self._arm, self.loads = arm, tuple(loads)
        self.magnitudes = np.zeros(len(self.loads))
        self.breaks = tuple(s for one in self.loads for s in one.breaks)
        self.knots = tuple(s for one in self.loads for s in one.knots)
        self._s: FloatArray | None = None
        self._parts: FloatArray = np.zeros((0, 2, 3, 0))

    def resultants(self, rod: DeformedRod) -> Resultants:
        """What they put on every cross section of ``rod``."""
        if rod.s is not self._s:  # other elements
            self._parts = np.stack([dead_resultants(self._arm, rod, one) for one in self.loads])
            self._s = rod.s
        force, moment = np.tensordot(self.magnitudes, self._parts, axes=1)
        return Resultants(force, moment)

    def tangents(self, rod: DeformedRod) -> tuple[Tangent, ...]:
        """None: they are fixed in base_frame."""
        return ()
