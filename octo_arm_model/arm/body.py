"""The outer shape of the arm."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.profile import Linear, Profile
from octo_arm_model.arm.validation import not_negative, positive, set_fields


@dataclass(frozen=True)
class Body:
    """Circular body whose radius varies linearly along s (eq. 7).

    Attributes:
        length: L [m], > 0.
        radius_base: R_max [m], > 0.
        radius_tip: R_min [m], > 0.
        disc_radius: radius of thin discs that guide tendons outside the body [m], >= 0; 0 for
            none.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    length: float
    radius_base: float
    radius_tip: float
    disc_radius: float = 0.0

    def __post_init__(self) -> None:
        set_fields(
            self,
            length=positive('body.length', self.length, 'm'),
            radius_base=positive('body.radius_base', self.radius_base, 'm'),
            radius_tip=positive('body.radius_tip', self.radius_tip, 'm'),
            disc_radius=not_negative('body.disc_radius', self.disc_radius, 'radius', 'm'),
        )

    @property
    def profile(self) -> Profile:
        """Radius along s."""
        return Linear(self.radius_base, self.radius_tip, self.length)

    def radius(self, s: ArrayLike) -> FloatArray:
        """Radius R(s) [m] at arc coordinate ``s`` [m] (eq. 7)."""
        return self.profile.value(s)


@dataclass(frozen=True)
class ProfiledBody:
    """Circular body of any radius along s.

    Attributes:
        length: L [m], > 0.
        profile: radius along s [m], > 0 everywhere.
        disc_radius: radius of thin discs around the tendons, as of a `Body` [m], >= 0.

    Raises:
        ArmDefinitionError: if a value is outside its range or the profile ends before the tip;
            the radius itself is checked by `Arm`.
    """

    length: float
    profile: Profile
    disc_radius: float = 0.0

    def __post_init__(self) -> None:
        set_fields(
            self,
            length=positive('body.length', self.length, 'm'),
            disc_radius=not_negative('body.disc_radius', self.disc_radius, 'radius', 'm'),
        )
        self.profile.cover('body.profile', self.length)

    def radius(self, s: ArrayLike) -> FloatArray:
        """Radius R(s) [m] at arc coordinate ``s`` [m]."""
        return self.profile.value(s)
