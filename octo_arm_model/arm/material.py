"""The material of the arm, its elastic laws, its damping, and drag of the water around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from numpy.typing import ArrayLike

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray, Vector
from octo_arm_model.arm.loads import ZERO
from octo_arm_model.arm.profile import Profile, as_profile
from octo_arm_model.arm.validation import check_fields, finite, not_negative, positive, vector


class Law(NamedTuple):
    """An elastic law of a cross section."""

    number: int  #: number of the law in `rod.section_formulas`, which has its energy
    meant_for: str  #: the kind of arm for which it is meant, in one or two words


LINEAR, NEO_HOOKEAN = range(2)
LAWS = {'neo_hookean': Law(NEO_HOOKEAN, 'soft'), 'linear': Law(LINEAR, 'stiff')}
DEFAULT_LAW = 'neo_hookean'


@dataclass(frozen=True)
class Material:
    """An isotropic, elastic material (eq. 3), constant over every cross section.

    Attributes:
        youngs_modulus: E [Pa], > 0, or its `Profile` along s.
        poisson_ratio: nu [-], in (-1, 0.5], or its `Profile`; 0.5 is incompressible.
        density: mass per volume [kg/m^3], >= 0; used under gravity and in motion.

    Raises:
        ArmDefinitionError: if a value is outside its range; profiles are checked by `Arm`.
    """

    youngs_modulus: float | Profile
    poisson_ratio: float | Profile = 0.5
    density: float = 0.0

    def __post_init__(self) -> None:
        expected = 'a number in (-1, 0.5] [-]'
        checks = {'youngs_modulus': (positive, 'Pa'), 'poisson_ratio': (finite, expected)}
        check_fields(self, 'material.', checks, (Profile,))
        check_fields(self, 'material.', {'density': (not_negative, 'density', 'kg/m^3')})
        ratio = self.poisson_ratio
        if not isinstance(ratio, Profile) and not -1.0 < ratio <= 0.5:
            raise ArmDefinitionError('material.poisson_ratio', ratio, expected)

    @classmethod
    def from_moduli(
        cls, youngs_modulus: float, shear_modulus: float, density: float = 0.0
    ) -> Material:
        """Return a material with the moduli E and G [Pa].

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
        """The shear modulus G = E / (2 (1 + nu)) [Pa] at the base."""
        return float(self.shear_modulus_at(0.0))

    def youngs_modulus_at(self, s: ArrayLike) -> FloatArray:
        """Return Young's modulus E [Pa] at arc coordinates ``s`` [m]."""
        return as_profile(self.youngs_modulus).value(s)

    def poisson_ratio_at(self, s: ArrayLike) -> FloatArray:
        """Return Poisson's ratio nu [-] at arc coordinates ``s`` [m]."""
        return as_profile(self.poisson_ratio).value(s)

    def shear_modulus_at(self, s: ArrayLike) -> FloatArray:
        """Return the shear modulus G = E / (2 (1 + nu)) [Pa] at arc coordinates ``s`` [m]."""
        return self.youngs_modulus_at(s) / (2.0 * (1.0 + self.poisson_ratio_at(s)))

    @property
    def knots(self) -> tuple[float, ...]:
        """The arc coordinates at which E or nu is not smooth [m]."""
        return as_profile(self.youngs_modulus).knots + as_profile(self.poisson_ratio).knots


class WaterCoefficients(NamedTuple):
    """The coefficients of drag and added mass of a slender body in water [-]."""

    normal_drag: float  #: C_n of a flow across the body: drag per length rho R C_n v |v|
    tangential_drag: float  #: C_t of a flow along the body: drag per length rho R pi C_t v |v| / 2
    added_mass: float  #: C_a, mass of water accelerated across the body over the displaced mass


# Renda et al. 2018, IJRR 37(6) 648, for arms of the same silicone, and a long circular cylinder.
WATERS = {
    'renda2018': WaterCoefficients(2.5, 0.01, 1.5),
    'cylinder': WaterCoefficients(1.1, 0.01, 1.0),
}


@dataclass(frozen=True)
class MotionProperties:
    """The damping, drag and added mass of an arm that moves.

    The density of the water is `Loads.fluid_density`.

    Attributes:
        viscosity: eta [Pa s], >= 0: stress per rate of shear strain; stretch has three times eta.
        damping_time: tau [s], >= 0: damping of the sections over their stiffness, in place of
            ``viscosity``; both are equal for nu = 1/2 and tau = 3 eta / E.
        normal_drag: C_n of `WaterCoefficients` [-], >= 0.
        tangential_drag: C_t of `WaterCoefficients` [-], >= 0.
        added_mass: C_a of `WaterCoefficients` [-], >= 0.
        current: velocity of the water in base_frame [m/s].

    Raises:
        ArmDefinitionError: if a value is outside its range, or if both viscosity and damping_time
            are given.
    """

    viscosity: float = 0.0
    damping_time: float = 0.0
    normal_drag: float = 0.0
    tangential_drag: float = 0.0
    added_mass: float = 0.0
    current: Vector = ZERO

    def __post_init__(self) -> None:
        checks = {
            **dict.fromkeys(WaterCoefficients._fields, (not_negative, 'number', '-')),
            'viscosity': (not_negative, 'number', 'Pa s'),
            'damping_time': (not_negative, 'number', 's'),
            'current': (vector, 'm/s'),
        }
        check_fields(self, 'motion.', checks)
        if self.viscosity and self.damping_time:
            expected = '0 where motion.viscosity is given'
            raise ArmDefinitionError('motion.damping_time', self.damping_time, expected)
