"""Parameters of what is around an arm: obstacles, and the water that it moves in."""

from collections.abc import Callable

from octo_arm_model.arm.errors import ArmDefinitionError, ConfigError, shown
from octo_arm_model.arm.hints import Vector
from octo_arm_model.arm.limits import MAX_FRICTION, MAX_OBSTACLES
from octo_arm_model.arm.material import WATERS, MotionProperties
from octo_arm_model.arm.obstacles import Cylinder, Obstacle, Plane, Sphere
from octo_arm_model.config.parameter import Parameter, Values, check_length, vectors_of

_NAMES = ' or '.join(WATERS)
_COEFFICIENTS = 'normal_drag', 'tangential_drag', 'added_mass'

MOTION_PARAMETERS = (
    Parameter(
        'motion.viscosity',
        'viscosity eta of the material [Pa s]: stress per rate of shear strain, three times '
        'that of stretch',
        0.0,
        range='>= 0',
    ),
    Parameter(
        'motion.damping_time',
        'time by which the stiffness of cross sections is multiplied instead [s]; 3 eta / E '
        'is the same for poisson_ratio 0.5',
        0.0,
        range='>= 0',
    ),
    Parameter(
        'motion.water',
        f'whose coefficients of drag and added mass are used: {_NAMES}; empty for the next three',
        '',
        range=f'{_NAMES}, or empty',
    ),
    Parameter(
        'motion.normal_drag',
        'coefficient C_n of the drag across, rho R C_n v |v| per length [-], in a fluid of '
        'loads.fluid_density',
        0.0,
        range='>= 0',
    ),
    Parameter(
        'motion.tangential_drag',
        'coefficient C_t of the drag along, rho R pi C_t v |v| / 2 per length [-]',
        0.0,
        range='>= 0',
    ),
    Parameter(
        'motion.added_mass',
        'mass of water that is accelerated across, over that displaced [-]',
        0.0,
        range='>= 0',
    ),
    Parameter('motion.current', 'velocity of the water in base_frame [m/s]', (0.0, 0.0, 0.0)),
)


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


_TYPES = 'plane', 'sphere', 'cylinder'
# Parameters that fields of obstacles are made from.
_VECTORS = {'point': 'position', 'centre': 'position', 'normal': 'direction', 'axis': 'direction'}
_EACH = 'one for all or one per obstacle'

OBSTACLE_PARAMETERS = (
    Parameter(
        'obstacles.type',
        'what each obstacle is that the arm may touch: plane, sphere or cylinder; empty for '
        f'none; with model exact; at most {MAX_OBSTACLES}',
        (),
        kind=str,
        range=f'{", ".join(_TYPES[:-1])} or {_TYPES[-1]}',
        most=MAX_OBSTACLES,
    ),
    Parameter(
        'obstacles.position',
        'x, y, z of a point of each plane, of the centre of a sphere and of a point of the '
        'axis of a cylinder, in base_frame [m], one after the other',
        (),
        most=3 * MAX_OBSTACLES,
    ),
    Parameter(
        'obstacles.direction',
        'x, y, z of the outward normal of each plane and of the axis of a cylinder, which '
        'has no ends, one after the other; those of spheres do not count; empty for 0, 0, 1',
        (),
        most=3 * MAX_OBSTACLES,
    ),
    Parameter(
        'obstacles.radius',
        'radius of each sphere and cylinder [m]; those of planes do not count',
        (),
        range='>= 0',
        most=MAX_OBSTACLES,
    ),
    Parameter(
        'obstacles.stiffness',
        f'pressure over the depth to which the arm enters each [N/m^3], {_EACH}',
        (),
        range='> 0',
        most=MAX_OBSTACLES,
    ),
    Parameter(
        'obstacles.friction',
        "Coulomb's coefficient of friction of the arm on each [-], for an arm that moves: "
        f'there are no shapes at rest with it; {_EACH}; empty for none',
        (),
        range=f'>= 0, at most {MAX_FRICTION:g}',
        most=MAX_OBSTACLES,
    ),
    Parameter(
        'obstacles.creep_speed',
        'speed at which friction on each has 0.71 of its full size, as slower sliding meets '
        f'less of it [m/s], {_EACH}; empty for {Obstacle.creep_speed:g}',
        (),
        range='> 0',
        most=MAX_OBSTACLES,
    ),
)


def build_obstacles(given: Values) -> tuple[Obstacle, ...]:
    """What the arm may touch.

    Raises:
        ConfigError: if there is no such type, or lists do not have the lengths they need.
        ArmDefinitionError: if a value is outside its range.
    """
    types = given['obstacles.type']
    points, directions = _vectors(given, 'position', ()), _vectors(given, 'direction', (0, 0, 1))
    radii = given['obstacles.radius'] or len(types) * (0.0,)
    check_length('obstacles.radius', radii, len(types), ', one per obstacle')
    surfaces = zip(
        _each(given, 'stiffness'),
        _each(given, 'friction', 0.0),
        _each(given, 'creep_speed', Obstacle.creep_speed),
    )
    found = []
    each = zip(types, points, directions, radii, surfaces)
    for number, (kind, point, direction, radius, surface) in enumerate(each):
        if kind not in _TYPES:
            raise ConfigError(f'obstacles.type has {shown(kind)}, expected {", ".join(_TYPES)}')
        stiffness, friction, creep_speed = surface
        make: Callable[..., Obstacle] = {
            'plane': lambda **of: Plane(point, direction, **of),
            'sphere': lambda **of: Sphere(point, radius, **of),
            'cylinder': lambda **of: Cylinder(point, direction, radius, **of),
        }[kind]
        try:
            found.append(make(stiffness=stiffness, friction=friction, creep_speed=creep_speed))
        except ArmDefinitionError as error:
            raise _named(error, number) from None
    return tuple(found)


def _named(error: ArmDefinitionError, number: int) -> ArmDefinitionError:
    """The ``error`` of the obstacle of a ``number``, by its place in the lists of the file."""
    name = error.field.partition('.')[2]
    at = f'{3 * number}:{3 * number + 3}' if name in _VECTORS else f'{number}'
    name = f'obstacles.{_VECTORS.get(name, name)}[{at}]'
    return ArmDefinitionError(name, error.value, error.expected)


def _each(given: Values, name: str, default: float | None = None) -> tuple[float, ...]:
    """One value of each obstacle."""
    name, count = f'obstacles.{name}', len(given['obstacles.type'])
    values: tuple[float, ...] = given[name]
    if not values and default is not None:
        return count * (default,)
    if len(values) == 1 and count:
        return count * values
    check_length(name, values, count, f', {_EACH}')
    return values


def _vectors(given: Values, name: str, default: tuple[float, ...]) -> tuple[Vector, ...]:
    """Three values of each obstacle."""
    name, count = f'obstacles.{name}', len(given['obstacles.type'])
    return vectors_of(name, given[name] or count * default, count, 'obstacles.type')
