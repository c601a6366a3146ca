"""The material of the arm with its elastic laws, and what resists motion in and around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from numpy.typing import ArrayLike

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray, Vector
from octo_arm_model.arm.loads import ZERO
from octo_arm_model.arm.profile import Profile, as_profile
from octo_arm_model.arm.validation import finite, not_negative, positive, set_fields, vector


class Law(NamedTuple):
    """An elastic law of a cross section.

    Attributes:
        number: by which `rod.section_formulas`, which has its energy, knows it.
        meant_for: the kind of arm it is for, in one or two words.
    """

    number: int
    meant_for: str


LINEAR, NEO_HOOKEAN = range(2)
LAWS = {'neo_hookean': Law(NEO_HOOKEAN, 'soft'), 'linear': Law(LINEAR, 'stiff')}
DEFAULT_LAW = 'neo_hookean'


@dataclass(frozen=True)
class Material:
    """Isotropic, elastic material (eq. 3), constant over every cross section.

    Attributes:
        youngs_modulus: E [Pa], > 0, or its `Profile` along s.
        poisson_ratio: nu [-], in (-1, 0.5], or its `Profile`; 0.5 is incompressible.
        density: mass per volume [kg/m^3], >= 0; used under gravity only.

    Raises:
        ArmDefinitionError: if a value is outside its range; profiles are checked by `Arm`.
    """

    youngs_modulus: float | Profile
    poisson_ratio: float | Profile = 0.5
    density: float = 0.0

    def __post_init__(self) -> None:
        young, ratio = self.youngs_modulus, self.poisson_ratio
        if not isinstance(young, Profile):
            young = positive('material.youngs_modulus', young, 'Pa')
        if not isinstance(ratio, Profile):
            expected = 'a number in (-1, 0.5] [-]'
            ratio = finite('material.poisson_ratio', ratio, expected)
            if not -1.0 < ratio <= 0.5:
                raise ArmDefinitionError('material.poisson_ratio', ratio, expected)
        density = not_negative('material.density', self.density, 'density', 'kg/m^3')
        set_fields(self, youngs_modulus=young, poisson_ratio=ratio, density=density)

    @classmethod
    def from_moduli(
        cls, youngs_modulus: float, shear_modulus: float, density: float = 0.0
    ) -> Material:
        """Material of given E and G [Pa].

        Raises:
            ArmDefinitionError: if no isotropic material has these moduli.
        """
        young = positive('material.youngs_modulus', youngs_modulus, 'Pa')
        shear = positive('material.shear_modulus', shear_modulus, 'Pa')
        ratio = young / (2.0 * shear) - 1.0
        # Rounded moduli of an incompressible material are accepted.
        if ratio > 0.5 + 1e-9:
            expected = f'at least E / 3 = {young / 3.0:.6g} [Pa]'
            raise ArmDefinitionError('material.shear_modulus', shear_modulus, expected)
        return cls(young, min(ratio, 0.5), density)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus G = E / (2 (1 + nu)) [Pa] at the base."""
        return float(self.shear_modulus_at(0.0))

    def youngs_modulus_at(self, s: ArrayLike) -> FloatArray:
        """E at arc coordinate ``s`` [Pa]."""
        return as_profile(self.youngs_modulus).value(s)

    def poisson_ratio_at(self, s: ArrayLike) -> FloatArray:
        """Poisson's ratio nu at arc coordinate ``s`` [-]."""
        return as_profile(self.poisson_ratio).value(s)

    def shear_modulus_at(self, s: ArrayLike) -> FloatArray:
        """G = E / (2 (1 + nu)) at arc coordinate ``s`` [Pa]."""
        return self.youngs_modulus_at(s) / (2.0 * (1.0 + self.poisson_ratio_at(s)))

    @property
    def knots(self) -> tuple[float, ...]:
        """Arc coordinates at which E or nu is not smooth [m]."""
        return as_profile(self.youngs_modulus).knots + as_profile(self.poisson_ratio).knots


class WaterCoefficients(NamedTuple):
    """Coefficients of a slender body in water [-].

    Attributes:
        normal_drag: C_n, of a flow across: drag per length rho R C_n v |v|.
        tangential_drag: C_t, of one along: rho R pi C_t v |v| / 2.
        added_mass: C_a, mass of water that is accelerated across, over that displaced.
    """

    normal_drag: float
    tangential_drag: float
    added_mass: float


# Renda et al. 2018, IJRR 37(6) 648, for arms of the same silicone, and a long circular cylinder.
WATERS = {
    'renda2018': WaterCoefficients(2.5, 0.01, 1.5),
    'cylinder': WaterCoefficients(1.1, 0.01, 1.0),
}


@dataclass(frozen=True)
class MotionProperties:
    """Damping of an arm that moves, besides what the statics know of it.

    The density of the water is `Loads.fluid_density`.

    Attributes:
        viscosity: eta [Pa s], >= 0: stress per rate of shear strain, three times that of stretch.
        damping_time: tau [s], >= 0, by which all stiffness of the sections is multiplied instead;
            the same as ``viscosity`` for nu = 1/2 and tau = 3 eta / E.
        normal_drag: see `WaterCoefficients`, as the next two, >= 0.
        tangential_drag: likewise.
        added_mass: likewise.
        current: velocity of the water in base_frame [m/s].

    Raises:
        ArmDefinitionError: if a value is outside its range, or both viscosity and damping_time
            are given.
    """

    viscosity: float = 0.0
    damping_time: float = 0.0
    normal_drag: float = 0.0
    tangential_drag: float = 0.0
    added_mass: float = 0.0
    current: Vector = ZERO

    def __post_init__(self) -> None:
        units = {'viscosity': 'Pa s', 'damping_time': 's'}
        units |= dict.fromkeys(WaterCoefficients._fields, '-')
        for field, unit in units.items():
            value = not_negative(f'motion.{field}', getattr(self, field), 'number', unit)
            set_fields(self, **{field: value})
        set_fields(self, current=vector('motion.current', self.current, 'm/s'))
        if self.viscosity and self.damping_time:
            expected = '0 where motion.viscosity is given'
            raise ArmDefinitionError('motion.damping_time', self.damping_time, expected)
