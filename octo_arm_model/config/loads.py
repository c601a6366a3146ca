"""The parameters of the loads, and the loads made from them."""

from __future__ import annotations

from octo_arm_model.arm.limits import MAX_POINT_LOADS, MAX_TABLE_POINTS
from octo_arm_model.arm.loads import DistributedLoad, Loads, PointLoad, Vector
from octo_arm_model.config.parameter import TABLE_BOUND, Parameter, Values, check_length

LOAD_PARAMETERS = (
    Parameter('loads.gravity', float, 'acceleration of gravity in base_frame [m/s^2]',
              (0.0, 0.0, 0.0), is_array=True),
    Parameter('loads.fluid_density', float, 'density of the fluid around the arm [kg/m^3]', 0.0,
              range='>= 0'),
    Parameter('loads.tip_force', float, 'force on the tip in base_frame [N]', (0.0, 0.0, 0.0),
              is_array=True),
    Parameter('loads.tip_moment', float, 'moment on the tip in base_frame [N m]',
              (0.0, 0.0, 0.0), is_array=True),
    Parameter('loads.point_s', float,
              f'arc coordinates of point forces [m]; at most {MAX_POINT_LOADS}', (),
              is_array=True, range='in [0, body.length]', most=MAX_POINT_LOADS),
    Parameter('loads.point_force', float,
              'x, y, z of each point force in base_frame [N], one after the other', (),
              is_array=True, most=3 * MAX_POINT_LOADS),
    Parameter('loads.distributed_s', float,
              f'arc coordinates of a distributed force, linear between them [m]{TABLE_BOUND}', (),
              is_array=True, range='increasing, in [0, body.length]'),
    Parameter('loads.distributed_force', float,
              'x, y, z of the force per length at each, in base_frame [N/m], one after the other',
              (), is_array=True, most=3 * MAX_TABLE_POINTS),
)  # fmt: skip


def build_loads(given: Values) -> Loads:
    """The loads on the arm.

    Raises:
        ConfigError: if lists do not have the lengths they need.
        ArmDefinitionError: if a load is invalid.
    """
    points = _vectors(given, 'loads.point_force', 'loads.point_s')
    along = _vectors(given, 'loads.distributed_force', 'loads.distributed_s')
    return Loads(
        gravity=given['loads.gravity'],
        fluid_density=given['loads.fluid_density'],
        tip_force=given['loads.tip_force'],
        tip_moment=given['loads.tip_moment'],
        points=tuple(PointLoad(s, force) for s, force in zip(given['loads.point_s'], points)),
        distributed=(DistributedLoad(given['loads.distributed_s'], along),) if along else (),
    )


def _vectors(given: Values, name: str, of: str) -> tuple[Vector, ...]:
    flat, count = given[name], len(given[of])
    check_length(name, flat, 3 * count, f', three for each of {of}')
    return tuple((flat[i], flat[i + 1], flat[i + 2]) for i in range(0, 3 * count, 3))
