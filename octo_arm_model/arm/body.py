"""The outer shape of the arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.cross_section import Geometry
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.profile import Linear, Profile, as_profile
from octo_arm_model.arm.validation import not_negative, positive, set_fields


class _Outline:
    """What all bodies have: their outline, and what follows from it."""

    is_round = True
    length: float
    disc_radius: float
    inner_radius: float | Profile = 0.0

    @property
    def profiles(self) -> dict[str, Profile]:
        """The sizes of the outline along s [m], by the names that errors call them."""
        raise NotImplementedError

    @property
    def knots(self) -> tuple[float, ...]:
        """Arc coordinates at which the body is not smooth [m]."""
        return tuple(knot for profile in self.profiles.values() for knot in profile.knots)

    def half_sizes(self, s: ArrayLike) -> FloatArray:
        """Half the size along n and along b at arc coordinate ``s`` [m], (2, *shape of s)."""
        raise NotImplementedError

    def radius(self, s: ArrayLike) -> FloatArray:
        """Radius R(s) [m] of the circle around the body at arc coordinate ``s`` [m] (eq. 7)."""
        raise NotImplementedError

    def geometry(self, s: FloatArray) -> Geometry:
        """Areas and second moments of the cross sections at ``s`` (n,) [m]."""
        raise NotImplementedError

    def _check_common(self) -> None:
        set_fields(
            self,
            length=positive('body.length', self.length, 'm'),
            disc_radius=not_negative('body.disc_radius', self.disc_radius, 'radius', 'm'),
        )


class _Round(_Outline):
    """A solid body or a tube."""

    @property
    def knots(self) -> tuple[float, ...]:
        """See `_Outline`; those of the bore too."""
        return super().knots + as_profile(self.inner_radius).knots

    def half_sizes(self, s: ArrayLike) -> FloatArray:
        """See `_Outline`."""
        return np.stack(2 * [self.radius(s)])

    def radius(self, s: ArrayLike) -> FloatArray:
        """See `_Outline`."""
        (profile,) = self.profiles.values()
        return profile.value(s)

    def geometry(self, s: FloatArray) -> Geometry:
        """See `_Outline`."""
        return Geometry.of_tube(self.radius(s), as_profile(self.inner_radius).value(s))

    def _check_common(self) -> None:
        super()._check_common()
        if not isinstance(self.inner_radius, Profile):
            inner = not_negative('body.inner_radius', self.inner_radius, 'radius', 'm')
            set_fields(self, inner_radius=inner)


@dataclass(frozen=True)
class Body(_Round):
    """Circular body whose radius varies linearly along s (eq. 7).

    Attributes:
        length: L [m], > 0.
        radius_base: R_max [m], > 0.
        radius_tip: R_min [m], > 0.
        disc_radius: radius of discs that guide tendons outside the body [m], >= 0; 0 for none.
            Where they are `Arm.discs` says; without, tendons are led all along.
        inner_radius: radius of the closed, empty bore of a tube [m], or its `Profile` along s,
            less than that of the body; 0 for a solid one.

    Raises:
        ArmDefinitionError: if a value is outside its range; the bore is checked by `Arm`.
    """

    length: float
    radius_base: float
    radius_tip: float
    disc_radius: float = 0.0
    inner_radius: float | Profile = 0.0

    def __post_init__(self) -> None:
        self._check_common()
        set_fields(
            self,
            radius_base=positive('body.radius_base', self.radius_base, 'm'),
            radius_tip=positive('body.radius_tip', self.radius_tip, 'm'),
        )

    @property
    def profiles(self) -> dict[str, Profile]:
        """See `_Outline`."""
        return {'body.radius': Linear(self.radius_base, self.radius_tip, self.length)}


@dataclass(frozen=True)
class ProfiledBody(_Round):
    """Circular body of any radius along s.

    Attributes:
        length: L [m], > 0.
        profile: radius along s [m], > 0 everywhere.
        disc_radius: radius of discs around the tendons, as of a `Body` [m], >= 0.
        inner_radius: of a bore, as of a `Body` [m].

    Raises:
        ArmDefinitionError: if a value is outside its range or the profile ends before the tip;
            the radii themselves are checked by `Arm`.
    """

    length: float
    profile: Profile
    disc_radius: float = 0.0
    inner_radius: float | Profile = 0.0

    def __post_init__(self) -> None:
        self._check_common()
        self.profile.cover('body.profile', self.length)

    @property
    def profiles(self) -> dict[str, Profile]:
        """See `_Outline`."""
        return {'body.radius': self.profile}


@dataclass(frozen=True)
class RectangularBody(_Outline):
    """Body of rectangular cross sections.

    Attributes:
        length: L [m], > 0.
        width: size along n [m], > 0, or its `Profile` along s.
        height: size along b [m], > 0, or its `Profile` along s.
        disc_radius: radius of thin discs around the tendons, as of a `Body` [m], >= 0.

    Raises:
        ArmDefinitionError: if a value is outside its range; profiles are checked by `Arm`.
    """

    length: float
    width: float | Profile
    height: float | Profile
    disc_radius: float = 0.0
    is_round = False

    def __post_init__(self) -> None:
        self._check_common()
        for field in ('width', 'height'):
            if not isinstance(given := getattr(self, field), Profile):
                set_fields(self, **{field: positive(f'body.{field}', given, 'm')})

    @property
    def profiles(self) -> dict[str, Profile]:
        """See `_Outline`."""
        return {'body.width': as_profile(self.width), 'body.height': as_profile(self.height)}

    def half_sizes(self, s: ArrayLike) -> FloatArray:
        """See `_Outline`."""
        return 0.5 * np.stack([profile.value(s) for profile in self.profiles.values()])

    def radius(self, s: ArrayLike) -> FloatArray:
        """See `_Outline`."""
        return np.asarray(np.hypot(*self.half_sizes(s)))

    def geometry(self, s: FloatArray) -> Geometry:
        """See `_Outline`."""
        return Geometry.of_rectangle(*(2.0 * self.half_sizes(s)))
