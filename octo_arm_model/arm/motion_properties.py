"""What resists motion: viscosity of the body, and drag and added mass of the water around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import Vector
from octo_arm_model.arm.loads import ZERO
from octo_arm_model.arm.validation import not_negative, set_fields, vector


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
        def checked(field: str, what: str, unit: str) -> float:
            return not_negative(f'motion.{field}', getattr(self, field), what, unit)

        set_fields(
            self,
            viscosity=checked('viscosity', 'viscosity', 'Pa s'),
            damping_time=checked('damping_time', 'time', 's'),
            normal_drag=checked('normal_drag', 'coefficient', '-'),
            tangential_drag=checked('tangential_drag', 'coefficient', '-'),
            added_mass=checked('added_mass', 'coefficient', '-'),
            current=vector('motion.current', self.current, 'm/s'),
        )
        if self.viscosity and self.damping_time:
            expected = '0 where motion.viscosity is given'
            raise ArmDefinitionError('motion.damping_time', self.damping_time, expected)
