"""Cross sections that are no full circles, stiffness that is measured, and rods bent at rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.profile import Profile, as_profile
from octo_arm_model.arm.validation import finite, not_negative, set_fields

_TERMS = np.arange(1.0, 40.0, 2.0)  # of the torsion constant of a rectangle, to rounding


class Geometry(NamedTuple):
    """Cross sections at n places, each (n,).

    Attributes:
        area: of the material [m^2].
        about_n: second moment of area for bending about n [m^4].
        about_b: likewise about b.
        torsion: torsion constant, that of the polar moment where the section is round [m^4].
        displaced: area within the outline [m^2], a bore included.
    """

    area: FloatArray
    about_n: FloatArray
    about_b: FloatArray
    torsion: FloatArray
    displaced: FloatArray

    @classmethod
    def of_tube(cls, outer: FloatArray, inner: FloatArray) -> Geometry:
        """Of circles of radius ``outer`` [m] with bores of radius ``inner`` [m]."""
        second = 0.25 * np.pi * (outer**4 - inner**4)
        area = np.pi * (outer**2 - inner**2)
        return cls(area, second, second, 2.0 * second, np.pi * outer**2)

    @classmethod
    def of_rectangle(cls, width: FloatArray, height: FloatArray) -> Geometry:
        """Of rectangles of ``width`` along n and ``height`` along b [m].

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
    """Stiffness of cross sections that is measured, not that of shape and material.

    It is that at the Young's modulus of the material: what changes E changes it in proportion.
    Mass, buoyancy and drag stay those of the body.

    Attributes:
        axial: E A [N], or its `Profile` along s; 0 for that of shape and material, as the next.
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
        for field, unit in (
            ('axial', 'N'), ('bending_n', 'N m^2'), ('bending_b', 'N m^2'), ('torsion', 'N m^2'),
        ):  # fmt: skip
            given = getattr(self, field)
            if not isinstance(given, Profile):
                name = f'stiffness.{field}'
                set_fields(self, **{field: not_negative(name, given, 'stiffness', unit)})

    @property
    def profiles(self) -> dict[str, Profile]:
        """Those that are given, by the names of their fields."""
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return {name: as_profile(given) for name, given in fields.items() if given != 0.0}


@dataclass(frozen=True)
class RestShape:
    """How a rod is bent where nothing acts on it.

    Attributes:
        curvature_n: curvature about n [1/m], or its `Profile` along s; 0 for a straight rod.
        curvature_b: about b [1/m].
        torsion: rotation of the sections about the tangent per length [1/m].

    Raises:
        ArmDefinitionError: if a number is not finite; `Arm` checks whether it fits the body.
    """

    curvature_n: float | Profile = 0.0
    curvature_b: float | Profile = 0.0
    torsion: float | Profile = 0.0

    def __post_init__(self) -> None:
        for field in ('curvature_n', 'curvature_b', 'torsion'):
            given = getattr(self, field)
            if not isinstance(given, Profile):
                name = f'rest_{field}'
                set_fields(self, **{field: finite(name, given, 'a finite number [1/m]')})

    @property
    def profiles(self) -> tuple[Profile, Profile, Profile]:
        """Torsion and curvatures about n and b."""
        return as_profile(self.torsion), as_profile(self.curvature_n), as_profile(self.curvature_b)

    @property
    def is_straight(self) -> bool:
        """Whether the rod is straight and untwisted."""
        return (self.torsion, self.curvature_n, self.curvature_b) == (0.0, 0.0, 0.0)

    @property
    def knots(self) -> tuple[float, ...]:
        """Arc coordinates at which it is not smooth [m]."""
        return tuple(knot for profile in self.profiles for knot in profile.knots)

    def at(self, s: FloatArray) -> FloatArray:
        """Torsion and curvatures about n and b at ``s`` (n,) [m], (3, n) [1/m]."""
        return np.stack([profile.value(s) for profile in self.profiles])

    def check(self, length: float, s: FloatArray, radius: FloatArray) -> None:
        """Check that sections of a ``radius`` at ``s``, both (n,) [m], can be bent so.

        Raises:
            ArmDefinitionError: if a profile ends before the ``length`` [m], or bends a section
                more than about its own rim.
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
