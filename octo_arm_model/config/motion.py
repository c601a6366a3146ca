"""The parameters of an arm that moves, and its properties made from them."""

from __future__ import annotations

from octo_arm_model.arm.errors import ArmDefinitionError, ConfigError, shown
from octo_arm_model.arm.motion_properties import WATERS, MotionProperties
from octo_arm_model.config.parameter import Parameter, Values

_NAMES = ' or '.join(WATERS)
_COEFFICIENTS = 'normal_drag', 'tangential_drag', 'added_mass'

MOTION_PARAMETERS = (
    Parameter('motion.viscosity', float,
              'viscosity eta of the material [Pa s]: stress per rate of shear strain, three times '
              'that of stretch', 0.0, range='>= 0'),
    Parameter('motion.damping_time', float,
              'time by which the stiffness of cross sections is multiplied instead [s]; 3 eta / E '
              'is the same for poisson_ratio 0.5', 0.0, range='>= 0'),
    Parameter('motion.water', str,
              f'whose coefficients of drag and added mass are used: {_NAMES}; empty for the next '
              'three', '', range=f'{_NAMES}, or empty'),
    Parameter('motion.normal_drag', float,
              'coefficient C_n of the drag across, rho R C_n v |v| per length [-], in a fluid of '
              'loads.fluid_density', 0.0, range='>= 0'),
    Parameter('motion.tangential_drag', float,
              'coefficient C_t of the drag along, rho R pi C_t v |v| / 2 per length [-]', 0.0,
              range='>= 0'),
    Parameter('motion.added_mass', float,
              'mass of water that is accelerated across, over that displaced [-]', 0.0,
              range='>= 0'),
    Parameter('motion.current', float, 'velocity of the water in base_frame [m/s]',
              (0.0, 0.0, 0.0), is_array=True),
)  # fmt: skip


def build_motion(given: Values) -> MotionProperties:
    """The properties that motion depends on.

    Raises:
        ConfigError: if there is no such water.
        ArmDefinitionError: if a value is outside its range, or given twice.
    """
    across, along, added = coefficients = [given[f'motion.{name}'] for name in _COEFFICIENTS]
    water = given['motion.water']
    if water:
        if water not in WATERS:
            raise ConfigError(f'motion.water is {shown(water)}, expected {_NAMES}, or empty')
        for name, value in zip(_COEFFICIENTS, coefficients, strict=True):
            if value:
                expected = '0 where motion.water is given'
                raise ArmDefinitionError(f'motion.{name}', value, expected)
        across, along, added = WATERS[water]
    viscosity, time = given['motion.viscosity'], given['motion.damping_time']
    return MotionProperties(viscosity, time, across, along, added, given['motion.current'])
