"""Build from parameters what acts on an arm: loads, obstacles, damping and drag."""

import dataclasses
from collections.abc import Sequence
from typing import Any

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import Vector
from octo_arm_model.arm.loads import TIP, DistributedLoad, Loads, PointLoad
from octo_arm_model.arm.material import WATERS, MotionProperties
from octo_arm_model.arm.obstacles import Cylinder, Obstacle, Plane, Sphere
from octo_arm_model.config.parameter import Values, check_length

_KINDS: dict[str, type[Obstacle]] = {'plane': Plane, 'sphere': Sphere, 'cylinder': Cylinder}


def build_loads(given: Values) -> Loads:
    """Return the loads on the arm.

    Raises:
        ConfigError: if a list has the wrong length.
        ArmDefinitionError: if a load is invalid.
    """
    points, along = (
        _vectors(f'{of}_force', given[f'{of}_force'], len(given[f'{of}_s']), f'{of}_s')
        for of in ('loads.point', 'loads.distributed')
    )
    loads = Loads(
        gravity=given['loads.gravity'],
        fluid_density=given['loads.fluid_density'],
        tip_force=given['loads.tip_force'],
        tip_moment=given['loads.tip_moment'],
        points=tuple(PointLoad(s, force) for s, force in zip(given['loads.point_s'], points)),
        distributed=(DistributedLoad(given['loads.distributed_s'], along),) if along else (),
        obstacles=_obstacles(given),
    )
    return loads.following(given['body.length']) if given['loads.tip_frame'] == TIP else loads


def build_motion(given: Values) -> MotionProperties:
    """Return damping and drag of a moving arm; ArmDefinitionError if a number is given twice."""
    names = [field.name for field in dataclasses.fields(MotionProperties)]
    values = {name: given[f'motion.{name}'] for name in names}
    if given['motion.water']:
        values |= WATERS[given['motion.water']]._asdict()
    return MotionProperties(**values)


def _obstacles(given: Values) -> tuple[Obstacle, ...]:
    types = given['obstacles.type']
    positions = given['obstacles.position']
    directions = given['obstacles.direction'] or len(types) * (0.0, 0.0, 1.0)
    points, axes = (
        _vectors(f'obstacles.{name}', flat, len(types), 'obstacles.type')
        for name, flat in (('position', positions), ('direction', directions))
    )
    radii = given['obstacles.radius'] or len(types) * (0.0,)
    check_length('obstacles.radius', radii, len(types), ', one per obstacle')
    columns: dict[str, Sequence[Any]] = {
        **dict.fromkeys(('point', 'centre'), points),
        **dict.fromkeys(('normal', 'axis'), axes),
        'radius': radii,
        'stiffness': _each(given, 'stiffness'),
        'friction': _each(given, 'friction', 0.0),
        'creep_speed': _each(given, 'creep_speed', Obstacle.creep_speed),
    }
    obstacles = []
    for number, kind in enumerate(types):
        make = _KINDS[kind]
        try:
            fields = [field.name for field in dataclasses.fields(make)]
            obstacles.append(make(**{field: columns[field][number] for field in fields}))
        except ArmDefinitionError as error:
            name, at = error.field.partition('.')[2], f'{number}'
            if name in ('normal', 'axis'):  # of a plane, of a cylinder
                name, at = 'direction', f'{3 * number}:{3 * number + 3}'
            raise ArmDefinitionError(
                f'obstacles.{name}[{at}]', error.value, error.expected
            ) from None
    return tuple(obstacles)


def _each(given: Values, name: str, default: float | None = None) -> tuple[float, ...]:
    """Return the quantity ``name`` of each obstacle."""
    name, count = f'obstacles.{name}', len(given['obstacles.type'])
    values: tuple[float, ...] = given[name]
    if not values and default is not None:
        return count * (default,)
    if len(values) == 1 and count:
        return count * values
    check_length(name, values, count, ', one for all or one per obstacle')
    return values


def _vectors(name: str, flat: tuple[float, ...], count: int, of: str) -> tuple[Vector, ...]:
    """Return the vectors in the flat list ``name``, one for each value of the list ``of``."""
    check_length(name, flat, 3 * count, f', three for each of {of}')
    return tuple((flat[i], flat[i + 1], flat[i + 2]) for i in range(0, 3 * count, 3))
