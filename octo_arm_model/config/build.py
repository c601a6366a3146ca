"""Build an arm, and what acts on it, from its parameters."""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

from octo_arm_model.arm.arm import Arm, check_size
from octo_arm_model.arm.body import Body, GivenStiffness, ProfiledBody, RectangularBody, RestShape
from octo_arm_model.arm.errors import ArmDefinitionError, ConfigError
from octo_arm_model.arm.hints import Vector
from octo_arm_model.arm.loads import TIP, DistributedLoad, Loads, PointLoad
from octo_arm_model.arm.material import WATERS, Material, MotionProperties
from octo_arm_model.arm.obstacles import Cylinder, Obstacle, Plane, Sphere
from octo_arm_model.arm.profile import LINEAR, Constant, Profile, Table
from octo_arm_model.arm.tendon import Discs, RoutedSection, Section, Tendon, check_angle
from octo_arm_model.config.parameter import Values, check_length
from octo_arm_model.rod.sensitivity import Uncertainty

_KINDS: dict[str, type[Obstacle]] = {'plane': Plane, 'sphere': Sphere, 'cylinder': Cylinder}


def build_arm(given: Values) -> Arm:
    """Return the arm with the parameters ``given``.

    Raises:
        ConfigError: if a list has the wrong length.
        ArmDefinitionError: if the arm cannot exist.
    """
    return Arm(
        _material(given),
        _body(given),
        _sections(given),
        given['tendon_names'],
        axial_stiffness=given['tendons.axial_stiffness'],
        free_length=given['tendons.free_length'],
        sheath_stiffness=given['tendons.sheath_stiffness'],
        friction=given['tendons.friction'],
        stiffness=_stiffness(given),
        rest=_rest(given),
        discs=_discs(given),
    )


def build_uncertainty(given: Values, arm: Arm) -> Uncertainty:
    """Return standard deviations of tensions, displacements, material and offsets of tendons."""
    model = given['model_error_stddev']
    return Uncertainty(
        tension=given['tension_stddev'],
        displacement=given['displacement_stddev'],
        youngs_modulus=given['material.youngs_modulus_stddev'],
        poisson_ratio=given['material.poisson_ratio_stddev'],
        offset=given['tendons.offset_stddev'],
        # An error of the curvature that is constant along the arm and moves the tip by d turns
        # the tip by 2 d / length.
        model_position=model * arm.length,
        model_rotation=2.0 * model,
    )


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


def _material(given: Values) -> Material:
    density, ratio = given['material.density'], given['material.poisson_ratio']
    shear = given['material.shear_modulus']
    s = given['material.table_s']
    if s:
        young = _table(given, 'material.table_youngs_modulus', s)
        if given['material.table_poisson_ratio']:
            ratio = _table(given, 'material.table_poisson_ratio', s)
        return Material(young, ratio, density)
    young = given['material.youngs_modulus']
    return (
        Material.from_moduli(young, shear, density) if shear else Material(young, ratio, density)
    )


def _discs(given: Values) -> Discs:
    s, count = given['tendons.discs'], given['tendons.disc_count']
    disc = given['tendons.disc_thickness'], given['tendons.disc_mass']
    return Discs.evenly(count, given['body.length'], *disc) if count else Discs(s, *disc)


def _body(given: Values) -> Body | ProfiledBody | RectangularBody:
    length, discs = given['body.length'], given['body.disc_radius']
    width, height = (_along(given, 'body', x, given[f'body.{x}']) for x in ('width', 'height'))
    bore = _along(given, 'body', 'inner_radius', given['body.inner_radius'])
    if width != 0.0 or height != 0.0:
        _all_along(given, 'body', {'width': 0.0, 'height': 0.0})
        return RectangularBody(length, width, height, discs)
    if given['body.table_s']:
        radius = _table(given, 'body.table_radius', given['body.table_s'])
        return ProfiledBody(length, radius, discs, bore)
    return Body(length, given['body.radius_base'], given['body.radius_tip'], discs, bore)


def _stiffness(given: Values) -> GivenStiffness:
    bending = given['stiffness.bending'] or (0.0,)
    if len(bending) not in (1, 2):
        check_length('stiffness.bending', bending, 2, ', about n and about b, or one for both')
    values = {
        'axial': given['stiffness.axial'],
        'bending_n': bending[0],
        'bending_b': bending[-1],
        'torsion': given['stiffness.torsion'],
    }
    return GivenStiffness(**_all_along(given, 'stiffness', values))


def _rest(given: Values) -> RestShape:
    curvature = given['rest_curvature']
    check_length('rest_curvature', curvature, 2, ', about n and about b')
    values = {
        'curvature_n': curvature[0],
        'curvature_b': curvature[1],
        'torsion': given['rest_torsion'],
    }
    return RestShape(**_all_along(given, 'rest', values))


def _all_along(
    given: Values, group: str, constants: Mapping[str, float]
) -> dict[str, float | Profile]:
    """Return the profiles in the tables of a ``group``, or its ``constants`` without a table."""
    tables = [f'{group}.table_{name}' for name in constants]
    if given[f'{group}.table_s'] and not any(given[table] for table in tables):
        raise ConfigError(f'{group}.table_s has no effect without one of {", ".join(tables)}')
    return {name: _along(given, group, name, value) for name, value in constants.items()}


def _along(given: Values, group: str, name: str, constant: float) -> float | Profile:
    """Return the profile ``name`` in a table of a ``group``, or the ``constant`` without one."""
    table, s = f'{group}.table_{name}', f'{group}.table_s'
    if not given[table]:
        return constant
    if constant:
        raise ConfigError(f'{table} and the same for all s are given, expected one of both')
    return _table(given, table, given[s])


def _sections(given: Values) -> tuple[Section | RoutedSection, ...]:
    anchorages = given['sections.anchorage']
    count = len(anchorages)
    expected = ' like sections.anchorage, one per section'
    numbers = given['sections.tendons'] or count * (4,)
    check_length('sections.tendons', numbers, count, expected)
    for number in numbers:
        if number < 1:
            raise ConfigError(f'sections.tendons is {list(numbers)}, expected at least 1 each')
    total = sum(numbers)
    check_size(count, total)
    angles = given['tendons.angle'] or tuple(
        2.0 * math.pi * j / number for number in numbers for j in range(number)
    )
    twists = given['tendons.twist'] or total * (0.0,)
    for name, column in (('tendons.angle', angles), ('tendons.twist', twists)):
        check_length(name, column, total, ', one per tendon')
    for number, angle in enumerate(angles):
        check_angle(f'tendons.angle[{number}]', angle)
    ends = itertools.accumulate(numbers)
    parts = [slice(end - number, end) for number, end in zip(numbers, ends, strict=True)]
    if given['tendons.table_s']:
        tendons = _routed(given, angles, total)
        return tuple(
            RoutedSection(anchorage, tuple(tendons[part]))
            for anchorage, part in zip(anchorages, parts, strict=True)
        )
    offsets = [given[f'sections.offset_{end}'] for end in ('base', 'anchorage')]
    for end, column in zip(('base', 'anchorage'), offsets, strict=True):
        check_length(f'sections.offset_{end}', column, count, expected)
    return tuple(
        Section(anchorage, base, end, angles[part], twists[part])
        for anchorage, base, end, part in zip(anchorages, *offsets, parts, strict=True)
    )


def _routed(given: Values, angles: Sequence[float], total: int) -> list[Tendon]:
    """Return the tendons with paths from tables."""
    s, between = given['tendons.table_s'], given['tendons.table_between']
    if between == LINEAR and any(given['tendons.friction']):
        raise ConfigError(
            'tendons.table_between is linear, and tendons.friction is given: it has no friction '
            'at kinks, expected pchip'
        )

    def tables(name: str) -> list[Profile]:
        column, count = given[f'tendons.table_{name}'], len(s)
        what = f', {count} for each of {total} tendons'
        check_length(f'tendons.table_{name}', column, total * count, what)
        rows = [column[j * count : (j + 1) * count] for j in range(total)]
        return [Table(s, row, f'{name} of tendon {j}', between) for j, row in enumerate(rows, 1)]

    offsets = tables('offset')
    directions = tables('angle') if given['tendons.table_angle'] else map(Constant, angles)
    return list(map(Tendon, offsets, directions))


def _table(given: Values, name: str, s: Sequence[float]) -> Table:
    check_length(name, given[name], len(s), f', one for each of {name.split(".")[0]}.table_s')
    return Table(tuple(s), tuple(given[name]), name)


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
