"""The outer shape of the arm, its cross sections, their measured stiffness, the shape at rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.profile import Linear, Profile, as_profile
from octo_arm_model.arm.validation import check_class, check_fields, finite, not_negative, positive

_TERMS = np.arange(1.0, 40.0, 2.0)  # of the series of the torsion constant of a rectangle


class Geometry(NamedTuple):
    """The geometry of cross sections at n arc coordinates, each (n,)."""

    area: FloatArray  #: area of the material [m^2]
    about_n: FloatArray  #: second moment of area for bending about n [m^4]
    about_b: FloatArray  #: second moment of area for bending about b [m^4]
    torsion: FloatArray  #: torsion constant [m^4]; the polar moment of a round section
    displaced: FloatArray  #: area within the outline, with a bore [m^2]

    @classmethod
    def of_tube(cls, outer: FloatArray, inner: FloatArray) -> Geometry:
        """Return circles of radius ``outer`` (n,) [m] with bores of radius ``inner`` (n,) [m]."""
        second = 0.25 * np.pi * (outer**4 - inner**4)
        area = np.pi * (outer**2 - inner**2)
        return cls(area, second, second, 2.0 * second, np.pi * outer**2)

    @classmethod
    def of_rectangle(cls, width: FloatArray, height: FloatArray) -> Geometry:
        """Return rectangles of ``width`` (n,) along n and ``height`` (n,) along b [m].

        The torsion constant is Saint-Venant's: Timoshenko and Goodier, Theory of Elasticity,
        section 109.
        """
        area, long = width * height, np.maximum(width, height)
        short = np.minimum(width, height)
        odd = _TERMS[:, np.newaxis]
        terms = np.tanh(0.5 * np.pi * odd * long / short) / odd**5
        torsion = long * short**3 * (1.0 - 192.0 / np.pi**5 * short / long * terms.sum(axis=0))
        return cls(area, area * height**2 / 12.0, area * width**2 / 12.0, torsion / 3.0, area)


@dataclass(frozen=True)
class GivenStiffness:
    """The measured stiffness of cross sections, in place of that by shape and material.

    It holds at the Young's modulus of the material, and changes in proportion if E changes. Mass,
    buoyancy and drag stay those of the body.

    Attributes:
        axial: E A [N], or its `Profile` along s; 0, here and below, for shape and material.
        bending_n: E J of bending about n [N m^2].
        bending_b: E J of bending about b [N m^2].
        torsion: G I [N m^2].

    Raises:
        ArmDefinitionError: if a value is outside its range; profiles are checked by `Arm`.
    """

    axial: float | Profile = 0.0
    bending_n: float | Profile = 0.0
    bending_b: float | Profile = 0.0
    torsion: float | Profile = 0.0

    def __post_init__(self) -> None:
        checks = dict.fromkeys(vars(self), (not_negative, 'stiffness', 'N m^2'))
        checks['axial'] = not_negative, 'stiffness', 'N'
        check_fields(self, 'stiffness.', checks, (Profile,))

    @property
    def profiles(self) -> dict[str, Profile]:
        """The profiles of the given stiffnesses, by the names of their fields."""
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return {name: as_profile(given) for name, given in fields.items() if given != 0.0}


@dataclass(frozen=True)
class RestShape:
    """The shape of a rod when nothing acts on it.

    Attributes:
        curvature_n: curvature about n [1/m], or its `Profile` along s; 0 for a straight rod.
        curvature_b: curvature about b [1/m], or its `Profile`.
        torsion: rotation of the sections about the tangent per length [1/m], or its `Profile`.

    Raises:
        ArmDefinitionError: if a number is not finite; `Arm` checks whether it fits the body.
    """

    curvature_n: float | Profile = 0.0
    curvature_b: float | Profile = 0.0
    torsion: float | Profile = 0.0

    def __post_init__(self) -> None:
        checks = dict.fromkeys(vars(self), (finite, 'a finite number [1/m]'))
        check_fields(self, 'rest_', checks, (Profile,))

    @property
    def profiles(self) -> tuple[Profile, Profile, Profile]:
        """The profiles of torsion, curvature about n and curvature about b."""
        return as_profile(self.torsion), as_profile(self.curvature_n), as_profile(self.curvature_b)

    @property
    def is_straight(self) -> bool:
        """Whether the rod is straight and untwisted."""
        return (self.torsion, self.curvature_n, self.curvature_b) == (0.0, 0.0, 0.0)

    @property
    def knots(self) -> tuple[float, ...]:
        """The arc coordinates at which a profile is not smooth [m]."""
        return tuple(knot for profile in self.profiles for knot in profile.knots)

    def at(self, s: FloatArray) -> FloatArray:
        """Return torsion and curvatures about n and b at ``s`` (n,) [m], (3, n) [1/m]."""
        return np.stack([profile.value(s) for profile in self.profiles])

    def check(self, length: float, s: FloatArray, radius: FloatArray) -> None:
        """Check that sections of a ``radius`` at ``s``, both (n,) [m], can have this shape.

        Raises:
            ArmDefinitionError: if a profile ends before the ``length`` [m], or a section has the
                centre of its bend within it.
        """
        for name, profile in zip(('torsion', 'curvature', 'curvature'), self.profiles):
            profile.cover(f'rest_{name}', length)
        torsion, about_n, about_b = self.at(s)
        curvature = np.hypot(about_n, about_b)
        bad = ~(np.isfinite(torsion) & (curvature * radius < 1.0))
        if bad.any():
            first = int(np.argmax(bad))
            raise ArmDefinitionError(
                f'rest_curvature at s = {s[first]:.6g} m',
                float(curvature[first]),
                f'less than 1 over the distance of what is farthest from the midline there, '
                f'{1.0 / radius[first]:.6g} [1/m], and a finite rest_torsion',
            )


# Checks of the sizes of all bodies, and of those that may be profiles.
_POSITIVE, _RADIUS = (positive, 'm'), (not_negative, 'radius', 'm')
_SIZES = {
    **dict.fromkeys(('length', 'radius_base', 'radius_tip'), _POSITIVE),
    'disc_radius': _RADIUS,
}
_PROFILED = {'width': _POSITIVE, 'height': _POSITIVE, 'inner_radius': _RADIUS}


class _Outline:
    """The base class of bodies: the sizes of the outline along s, and what follows from them."""

    is_round = True
    length: float
    disc_radius: float
    inner_radius: float | Profile = 0.0

    def __post_init__(self) -> None:
        check_fields(self, 'body.', _SIZES)
        check_fields(self, 'body.', _PROFILED, (Profile,))

    @property
    def profiles(self) -> dict[str, Profile]:
        """The sizes of the outline along s [m], by their names in errors."""
        raise NotImplementedError

    @property
    def knots(self) -> tuple[float, ...]:
        """The arc coordinates at which the body or its bore is not smooth [m]."""
        profiles = (*self.profiles.values(), as_profile(self.inner_radius))
        return tuple(knot for profile in profiles for knot in profile.knots)

    def half_sizes(self, s: ArrayLike) -> FloatArray:
        """Return half the sizes along n and b at arc coordinates ``s`` [m], (2, *shape of s)."""
        sizes = [profile.value(s) for profile in self.profiles.values()]
        return np.stack(2 * sizes) if self.is_round else 0.5 * np.stack(sizes)

    def radius(self, s: ArrayLike) -> FloatArray:
        """Return the radius R(s) of the circle around the body at ``s``, both [m] (eq. 7)."""
        along_n, along_b = self.half_sizes(s)
        return np.asarray(along_n if self.is_round else np.hypot(along_n, along_b))

    def geometry(self, s: FloatArray) -> Geometry:
        """Return areas and second moments of the cross sections at ``s`` (n,) [m]."""
        if self.is_round:
            return Geometry.of_tube(self.radius(s), as_profile(self.inner_radius).value(s))
        return Geometry.of_rectangle(*(2.0 * self.half_sizes(s)))


@dataclass(frozen=True)
class Body(_Outline):
    """A round body whose radius varies linearly along s (eq. 7).

    Attributes:
        length: L [m], > 0.
        radius_base: R_max [m], > 0.
        radius_tip: R_min [m], > 0.
        disc_radius: radius of discs that guide tendons outside the body [m], >= 0; 0 for none.
            `Arm.discs` says where they are; without it tendons are guided all along.
        inner_radius: radius of the closed, empty bore of a tube [m], or its `Profile` along s,
            less than the radius of the body; 0 for a solid body.

    Raises:
        ArmDefinitionError: if a value is outside its range; the bore is checked by `Arm`.
    """

    length: float
    radius_base: float
    radius_tip: float
    disc_radius: float = 0.0
    inner_radius: float | Profile = 0.0

    @property
    def profiles(self) -> dict[str, Profile]:
        """The radius along s [m], by its name in errors."""
        return {'body.radius': Linear(self.radius_base, self.radius_tip, self.length)}


@dataclass(frozen=True)
class ProfiledBody(_Outline):
    """A round body of any radius along s.

    Attributes:
        length: L [m], > 0.
        profile: radius along s [m], > 0 everywhere.
        disc_radius: radius of discs that guide tendons outside the body [m], >= 0; 0 for none.
        inner_radius: radius of the bore of a tube [m], or its `Profile`; 0 for a solid body.

    Raises:
        ArmDefinitionError: if a value is outside its range or the profile ends before the tip;
            the radii themselves are checked by `Arm`.
    """

    length: float
    profile: Profile
    disc_radius: float = 0.0
    inner_radius: float | Profile = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_class('body.profile', self.profile, Profile)
        self.profile.cover('body.profile', self.length)

    @property
    def profiles(self) -> dict[str, Profile]:
        """The radius along s [m], by its name in errors."""
        return {'body.radius': self.profile}


@dataclass(frozen=True)
class RectangularBody(_Outline):
    """A body of rectangular cross sections.

    Attributes:
        length: L [m], > 0.
        width: size along n [m], > 0, or its `Profile` along s.
        height: size along b [m], > 0, or its `Profile` along s.
        disc_radius: radius of discs that guide tendons outside the body [m], >= 0; 0 for none.

    Raises:
        ArmDefinitionError: if a value is outside its range; profiles are checked by `Arm`.
    """

    length: float
    width: float | Profile
    height: float | Profile
    disc_radius: float = 0.0
    is_round = False

    @property
    def profiles(self) -> dict[str, Profile]:
        """The width and the height along s [m], by their names in errors."""
        return {'body.width': as_profile(self.width), 'body.height': as_profile(self.height)}
