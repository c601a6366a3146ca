"""First derivatives of the shape, and the covariance of the tip that follows from them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.special import gammaincinv

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import not_negative

# Derivatives of the tip's position and rotation vector by several quantities, (6, n) each; None
# where the model has none.
TipChanges: TypeAlias = Sequence[FloatArray | None]
# The quantities, by what people call them.
_QUANTITIES = {
    'tension': 'tension',
    'youngs_modulus': "Young's modulus",
    'poisson_ratio': "Poisson's ratio",
    'offset': "the tendons' offsets",
}

_UNITS = {
    'tension': 'N', 'youngs_modulus': '-', 'poisson_ratio': '-', 'offset': 'm',
    'model_position': 'm', 'model_rotation': 'rad', 'displacement': 'm',
}  # fmt: skip


@dataclass(frozen=True)
class Change:
    """Change of the shape per unit of one or several quantities, the last axis.

    Attributes:
        pose: displacement [m] and rotation vector [rad] of each cross section, in base_frame,
            (stations, 6, quantities).
        strain: change of tau, xi, k [1/m] and q [-], (stations, 4, quantities).
        tendon_length: change of the length of every tendon [m], (tendons, quantities).
        tendon_tension: change of the tension of every tendon averaged over its unloaded length
            [N], likewise; None without friction, where it equals the change at the base.
        twist: change of the twists at the nodes of the solver, (nodes, strains, quantities); None
            of the paper's models, and of tendons that are driven by length.
    """

    pose: FloatArray
    strain: FloatArray
    tendon_length: FloatArray
    tendon_tension: FloatArray | None = None
    twist: FloatArray | None = None

    @property
    def tip(self) -> FloatArray:
        """Displacement [m] and rotation [rad] of the tip, (6, quantities)."""
        return self.pose[-1]


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations of the quantities that the shape depends on, all independent.

    Attributes:
        tension: of every tension [N].
        youngs_modulus: of E, relative [-].
        poisson_ratio: of nu [-].
        offset: of every tendon's distance from the midline [m].
        model_position: of each coordinate of the tip, by the error of the model [m].
        model_rotation: of each component of its rotation vector, likewise [rad].
        displacement: of every displacement of a tendon that is driven by length [m].

    Raises:
        ArmDefinitionError: if one is not finite, or negative.
    """

    tension: float = 0.0
    youngs_modulus: float = 0.0
    poisson_ratio: float = 0.0
    offset: float = 0.0
    model_position: float = 0.0
    model_rotation: float = 0.0
    displacement: float = 0.0

    def __post_init__(self) -> None:
        """Validate."""
        for name, unit in _UNITS.items():
            value = getattr(self, name)
            value = not_negative(f'uncertainty.{name}', value, 'standard deviation', unit)
            object.__setattr__(self, name, value)

    @functools.cached_property
    def is_any(self) -> bool:
        """Whether anything is uncertain."""
        return self != Uncertainty()

    @functools.cached_property
    def quantities(self) -> tuple[str, ...]:
        """Those that are uncertain of tension, youngs_modulus, poisson_ratio and offset."""
        return tuple(name for name in _QUANTITIES if getattr(self, name))

    @functools.cached_property
    def of_model(self) -> FloatArray:
        """The part of `tip_covariance` that is the error of the model, (6, 6)."""
        return np.diag(np.repeat([self.model_position**2, self.model_rotation**2], 3))

    def tip_covariance(self, changes: TipChanges) -> FloatArray:
        """Covariance of the tip's position [m] and rotation vector [rad] in base_frame, (6, 6).

        ``changes`` are the derivatives by `quantities`. Displacements are left out: see
        `rod.displacements`.

        Raises:
            ConfigError: if there is no derivative by something that is uncertain.
        """
        covariance = self.of_model.copy()
        for name, change in zip(self.quantities, changes, strict=True):
            if change is None:
                what = _QUANTITIES[name]
                raise ConfigError(f'the model has no derivative by {what}: choose exact')
            covariance += getattr(self, name) ** 2 * change @ change.T
        return covariance


@dataclass(frozen=True)
class Sensitivity:
    """First derivatives of one solution.

    The paper's models have those by tension and by E alone; the others are None. Those by offset
    and by sheath are found when one is first asked for.

    Attributes:
        by_tension: per newton of each tendon's tension.
        by_tip_wrench: per newton of force and newton metre of moment on the tip, in base_frame.
        by_youngs_modulus: per relative change of E (of 1 for twice the stiffness), one column.
        by_poisson_ratio: per unit of nu, one column.
        by_offset: per metre of each tendon's distance from the midline.
        by_sheath_stiffness: per pascal of each tendon's sheath, zero for a rigid one; None where
            all are rigid.
        by_friction: per unit of each tendon's mu, where tendons have friction.
        find_path: finds `by_offset` and `by_sheath_stiffness`, by their quantities.
    """

    by_tension: Change
    by_youngs_modulus: Change
    by_tip_wrench: Change | None = None
    by_poisson_ratio: Change | None = None
    by_friction: Change | None = None
    find_path: Callable[[str], Change | None] = lambda _: None

    @functools.cached_property
    def by_offset(self) -> Change | None:
        """See above."""
        return self.find_path('offset')

    @functools.cached_property
    def by_sheath_stiffness(self) -> Change | None:
        """See above."""
        return self.find_path('sheath_stiffness')

    @property
    def compliance(self) -> FloatArray:
        """Displacement [m] and rotation [rad] of the tip per [N] and [N m] on it, (6, 6).

        Raises:
            ConfigError: if the model has no loads.
        """
        if self.by_tip_wrench is None:
            raise ConfigError('the model has no loads, so no compliance: choose exact')
        return self.by_tip_wrench.tip

    def tip_covariance(self, uncertainty: Uncertainty) -> FloatArray:
        """Covariance of the tip's position [m] and rotation vector [rad] in base_frame, (6, 6).

        Raises:
            ConfigError: if the model has no derivative by something that is uncertain.
        """
        changes: list[Change | None] = [
            getattr(self, f'by_{name}') for name in uncertainty.quantities
        ]
        return uncertainty.tip_covariance(
            [None if change is None else change.tip for change in changes]
        )


@functools.lru_cache(maxsize=1024)
def chi_square_limit(probability: float, size: int) -> float:
    """Quantile of the chi-square distribution of ``size`` degrees of freedom [-]."""
    # As scipy.stats.chi2.ppf, whose import takes a quarter of a second.
    return float(2.0 * gammaincinv(0.5 * size, probability))
