"""Bounds of loads and tensions, checked wherever they enter.

No material bears a strain of a tenth of `LARGEST_STRAIN`, and under larger forces the search for a
balance only takes long and fails.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ArmDefinitionError, LoadError, SolveError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import Loads
from octo_arm_model.arm.validation import real_numbers

LARGEST_STRAIN = 100.0  # of the weakest cross section, if it were linear [-]


class LoadLimits:
    """Largest force and moment on an arm.

    Attributes:
        force: `LARGEST_STRAIN` times the least E A [N].
        moment: the same times the root of the least E A times the least E I [N m].
        tension: largest tension that balances are found for at all [N].
    """

    def __init__(self, arm: Arm, s: FloatArray) -> None:
        """Derive the limits from the stiffness of ``arm`` at arc coordinates ``s`` (n,) [m]."""
        squared, young = arm.body.radius(s) ** 2, arm.material.youngs_modulus_at(s)
        axial = float(np.pi * (young * squared).min())
        bending = float(0.25 * np.pi * (young * squared**2).min())
        self.force = LARGEST_STRAIN * axial
        # The axial force is a difference of terms of this size; beyond, it is lost in rounding.
        self.tension = 1e6 * axial
        self.moment = LARGEST_STRAIN * math.sqrt(axial * bending)
        factor = f'{LARGEST_STRAIN:.0f} times'
        self._force = f'at most {self.force:.4g} N, {factor} the least E A of the arm'
        self._moment = (
            f'at most {self.moment:.4g} N m, {factor} the root of its least E A times its least '
            'E I'
        )

    def check_tensions(self, tensions: FloatArray) -> None:
        """Check the largest of ``tensions`` [N].

        Raises:
            SolveError: if it is too large.
        """
        if (largest := float(tensions.max(initial=0.0))) > self.tension:
            raise SolveError(
                f'tension of {largest:.4g} N is beyond {self.tension:.4g} N, a '
                'million times what would compress the thinnest cross section to nothing'
            )

    def check_tip_wrench(self, wrench: FloatArray) -> None:
        """Check the force and the moment of a ``wrench`` (..., 6) on the tip [N, N m].

        Raises:
            LoadError: if it is too large.
        """
        if (largest := _largest(wrench[..., :3])) > self.force:
            raise LoadError(f'force on the tip is {largest:.4g} N, expected {self._force}')
        if (largest := _largest(wrench[..., 3:])) > self.moment:
            raise LoadError(f'moment on the tip is {largest:.4g} N m, expected {self._moment}')

    def check_loads(self, loads: Loads, resultants: FloatArray) -> None:
        """Check ``loads``, and their ``resultants`` on the cross sections of the straight rod.

        The latter are forces and free moments (2, n, 3) [N, N m].

        Raises:
            ArmDefinitionError: if one is too large, or all together are.
        """
        if _largest(loads.tip_force) > self.force:
            raise ArmDefinitionError('loads.tip_force', loads.tip_force, self._force)
        if _largest(loads.tip_moment) > self.moment:
            raise ArmDefinitionError('loads.tip_moment', loads.tip_moment, self._moment)
        for point in loads.points:
            if _largest(point.moment) > self.moment:
                raise ArmDefinitionError('loads.point.moment', point.moment, self._moment)
        if (largest := _largest(resultants[0])) > self.force:
            raise ArmDefinitionError('force of all loads along the arm', largest, self._force)
        if (largest := _largest(resultants[1])) > self.moment:
            raise ArmDefinitionError('moment of all loads along the arm', largest, self._moment)


def tip_wrench_of(given: ArrayLike) -> FloatArray:
    """Return the wrench ``given`` (..., 6) [N, N m] as a float array.

    Raises:
        LoadError: if it is not six finite numbers.
    """
    array = real_numbers(given)
    if array is None or array.shape[-1:] != (6,) or not _are_finite(array):
        raise LoadError(
            f'tip_wrench is {shown(given)}, expected force and moment: (..., 6) finite numbers'
        )
    return array.copy()


def _are_finite(array: FloatArray) -> bool:
    if array.ndim == 1:  # as in `_largest`
        return all(map(math.isfinite, array.tolist()))
    return bool(np.isfinite(array).all())


def _largest(vectors: FloatArray | tuple[float, ...]) -> float:
    """The largest norm of ``vectors`` (..., 3); infinite where a number is none."""
    if np.ndim(vectors) == 1:  # one, as of one arm: the common case, and NumPy is slow with it
        norm = math.hypot(*(vectors.tolist() if isinstance(vectors, np.ndarray) else vectors))
        return math.inf if math.isnan(norm) else norm
    with np.errstate(over='ignore', invalid='ignore'):
        norms = np.linalg.norm(vectors, axis=-1)
    return float(np.nan_to_num(norms, nan=np.inf, posinf=np.inf).max(initial=0.0))
