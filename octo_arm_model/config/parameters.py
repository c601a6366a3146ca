"""The table of the parameters of an arm and its node.

The YAML loader reads it, the node declares its ROS parameters from it and the manual prints it.
"""

from dataclasses import dataclass

from octo_arm_model.arm import limits
from octo_arm_model.arm.errors import ConfigError, shown
from octo_arm_model.arm.loads import TIP, TIP_FRAMES, DistributedLoad, Loads, PointLoad
from octo_arm_model.arm.material import DEFAULT_LAW, LAWS
from octo_arm_model.config import surroundings
from octo_arm_model.config.parameter import (
    TABLE_BOUND,
    Parameter,
    ParameterGroup,
    Values,
    stated,
    vectors_of,
)
from octo_arm_model.rod.solver import DEFAULT_MODEL, MODELS
from octo_arm_model.rod.stations import DEFAULT_STATIONS


@dataclass(frozen=True)
class DiagnosticLimits(ParameterGroup):
    """Thresholds of the node's diagnostics."""

    GROUP = 'diagnostics'

    silence_limit: float = stated(
        'time without messages after which an input is called silent [s]', 2.0, '>= 0', 'time'
    )
    age_limit: float = stated(
        'age on arrival from which stamps of tensions are called old [s]', 1.0, '>= 0', 'time'
    )
    ahead_limit: float = stated(
        'how far stamps of tensions may be ahead of the clock, beside twice the last step of a '
        'simulated one [s]', 0.1, '>= 0', 'time',
    )  # fmt: skip


LOAD_PARAMETERS = (
    Parameter('loads.gravity', float, 'acceleration of gravity in base_frame [m/s^2]',
              (0.0, 0.0, 0.0), is_array=True),
    Parameter('loads.fluid_density', float, 'density of the fluid around the arm [kg/m^3]', 0.0,
              range='>= 0'),
    Parameter('loads.tip_force', float, 'force on the tip in base_frame [N]', (0.0, 0.0, 0.0),
              is_array=True),
    Parameter('loads.tip_moment', float, 'moment on the tip in base_frame [N m]',
              (0.0, 0.0, 0.0), is_array=True),
    Parameter('loads.tip_frame', str,
              'axes of tip_force and tip_moment: base, for base_frame, or tip, for t, n and b of '
              'the tip, with which they turn', 'base', range='base or tip'),
    Parameter('loads.point_s', float,
              f'arc coordinates of point forces [m]; at most {limits.MAX_POINT_LOADS}', (),
              is_array=True, range='in [0, body.length]', most=limits.MAX_POINT_LOADS),
    Parameter('loads.point_force', float,
              'x, y, z of each point force in base_frame [N], one after the other', (),
              is_array=True, most=3 * limits.MAX_POINT_LOADS),
    Parameter('loads.distributed_s', float,
              f'arc coordinates of a distributed force, linear between them [m]{TABLE_BOUND}', (),
              is_array=True, range='increasing, in [0, body.length]'),
    Parameter('loads.distributed_force', float,
              'x, y, z of the force per length at each, in base_frame [N/m], one after the other',
              (), is_array=True, most=3 * limits.MAX_TABLE_POINTS),
)  # fmt: skip


def build_loads(given: Values) -> Loads:
    """The loads on the arm.

    Raises:
        ConfigError: if lists do not have the lengths they need.
        ArmDefinitionError: if a load is invalid.
    """
    points, along = (
        vectors_of(f'{of}_force', given[f'{of}_force'], len(given[f'{of}_s']), f'{of}_s')
        for of in ('loads.point', 'loads.distributed')
    )
    if given['loads.tip_frame'] not in TIP_FRAMES:
        problem = f'loads.tip_frame is {shown(given["loads.tip_frame"])}'
        raise ConfigError(f'{problem}, expected {" or ".join(TIP_FRAMES)}')
    loads = Loads(
        gravity=given['loads.gravity'],
        fluid_density=given['loads.fluid_density'],
        tip_force=given['loads.tip_force'],
        tip_moment=given['loads.tip_moment'],
        points=tuple(PointLoad(s, force) for s, force in zip(given['loads.point_s'], points)),
        distributed=(DistributedLoad(given['loads.distributed_s'], along),) if along else (),
        obstacles=surroundings.build_obstacles(given),
    )
    return loads.following(given['body.length']) if given['loads.tip_frame'] == TIP else loads


_LAWS = ', '.join(f'{name} ({law.meant_for})' for name, law in LAWS.items())
_MODELS = f'{", ".join(MODELS[:-1])} or {MODELS[-1]}'

PARAMETERS = (
    Parameter('model', str, f'what turns tensions into strains: {_MODELS}', DEFAULT_MODEL,
              range=_MODELS),
    Parameter('stations', int,
              'stations along the backbone, anchorages and loads among them; at most '
              f'{limits.MAX_STATIONS}', DEFAULT_STATIONS,
              range='at least two, one more for every anchorage and load; at most '
              f'{limits.MAX_STATIONS}'),
    Parameter('base_frame', str, 'frame the backbone is expressed in', 'arm_base'),
    Parameter('frame_prefix', str,
              'what the names of the frames of tip and anchorages begin with', ''),
    Parameter('base.position', float, 'position of the base in base_frame [m]', (0.0, 0.0, 0.0),
              is_array=True),
    Parameter('base.quaternion', float,
              'orientation of the base in base_frame, x y z w: x axis along the arm, y axis n, '
              'z axis b', (0.0, 0.0, 0.0, 1.0), is_array=True, range='of length 1'),
    Parameter('material.youngs_modulus', float, "Young's modulus E [Pa]",
              unless=('material.table_s',), range='> 0'),
    Parameter('material.poisson_ratio', float, "Poisson's ratio nu [-]", 0.5,
              range='in (-1, 0.5]'),
    Parameter('material.shear_modulus', float,
              'shear modulus G [Pa] instead of poisson_ratio; 0 for E / (2 (1 + nu))', 0.0,
              range='0, or at least E / 3'),
    Parameter('material.density', float, 'density [kg/m^3]; needed under gravity and to move', 0.0,
              range='>= 0'),
    Parameter('material.law', str,
              f'elastic law of the model exact: {_LAWS}', DEFAULT_LAW,
              range=' or '.join(LAWS)),
    Parameter('material.shear', bool, 'whether cross sections shear, with law linear', False),
    Parameter('material.table_s', float,
              'arc coordinates of a material that varies along the arm, from 0 on [m]'
              + TABLE_BOUND, (), is_array=True, range='increasing from 0 to the tip'),
    Parameter('material.table_youngs_modulus', float, 'E at each of table_s [Pa]', (),
              is_array=True, range='> 0'),
    Parameter('material.table_poisson_ratio', float,
              'nu at each of table_s [-]; empty for poisson_ratio', (), is_array=True,
              range='in (-1, 0.5]'),
    Parameter('body.length', float, 'length L of the arm [m]', range='> 0'),
    Parameter('body.radius_base', float, 'radius at the base [m]',
              unless=('body.table_s', 'body.width'), range='> 0'),
    Parameter('body.radius_tip', float,
              'radius at the tip [m]; the arm is refused where more than '
              f'{limits.MAX_INTERVALS} intervals, each no longer than thick, are needed',
              unless=('body.table_s', 'body.width'), range='> 0'),
    Parameter('body.disc_radius', float,
              'radius of discs that lead tendons outside the body [m]; 0 for none; tendons are '
              'led all along, unless tendons.discs or disc_count says where the discs are', 0.0,
              range='>= 0'),
    Parameter('body.table_s', float,
              f'arc coordinates of a body that is no cone, from 0 to the tip [m]{TABLE_BOUND}', (),
              is_array=True, range='increasing from 0 to the tip'),
    Parameter('body.table_radius', float, 'radius at each of table_s [m]', (), is_array=True,
              range='> 0'),
    Parameter('body.inner_radius', float,
              'radius of the bore of a tube, closed and empty [m]; 0 for a solid body', 0.0,
              range='0 <= inner_radius < radius'),
    Parameter('body.table_inner_radius', float,
              'radius of the bore at each of table_s [m]; empty for inner_radius', (),
              is_array=True, range='0 <= inner_radius < radius'),
    Parameter('body.width', float,
              'size along n of a body of rectangular sections [m], instead of a radius; 0 for a '
              'round one', 0.0, range='0, or > 0 with height'),
    Parameter('body.height', float, 'size along b of rectangular sections [m]', 0.0,
              range='0, or > 0 with width'),
    Parameter('body.table_width', float,
              'width at each of body.table_s [m]; empty for a round body', (), is_array=True,
              range='> 0, with table_height'),
    Parameter('body.table_height', float, 'height at each of body.table_s [m]', (),
              is_array=True, range='> 0, with table_width'),
    Parameter('stiffness.axial', float,
              'E A of the cross sections [N], where it is measured; 0 for that of body and '
              'material, as the next', 0.0, range='>= 0'),
    Parameter('stiffness.bending', float,
              'E J of bending about n and about b [N m^2], or one number for both; empty for that '
              'of body and material', (), is_array=True, range='>= 0'),
    Parameter('stiffness.torsion', float, 'G I of the cross sections [N m^2]', 0.0,
              range='>= 0'),
    Parameter('stiffness.table_s', float,
              'arc coordinates of stiffness that varies along the arm, a smooth monotone cubic '
              f'between them, from 0 to the tip [m]{TABLE_BOUND}', (), is_array=True,
              range='increasing from 0 to the tip'),
    *(Parameter(f'stiffness.table_{name}', float,
                f'{what} at each of stiffness.table_s; empty for {one}', (), is_array=True,
                range='> 0')
      for name, what, one in (
          ('axial', 'E A [N]', 'axial'), ('bending_n', 'E J about n [N m^2]', 'bending'),
          ('bending_b', 'E J about b [N m^2]', 'bending'), ('torsion', 'G I [N m^2]', 'torsion'),
      )),
    Parameter('rest_curvature', float,
              'curvatures about n and about b of the arm where nothing acts on it [1/m]',
              (0.0, 0.0), is_array=True),
    Parameter('rest_torsion', float,
              'rotation of the cross sections about the tangent per length there [1/m]', 0.0),
    Parameter('rest.table_s', float,
              'arc coordinates of a shape at rest that varies along the arm, a smooth monotone '
              f'cubic between them, from 0 to the tip [m]{TABLE_BOUND}', (), is_array=True,
              range='increasing from 0 to the tip'),
    *(Parameter(f'rest.table_{name}', float,
                f'{what} at each of rest.table_s [1/m]; empty for {one}', (), is_array=True)
      for name, what, one in (
          ('curvature_n', 'curvature about n', 'rest_curvature'),
          ('curvature_b', 'curvature about b', 'rest_curvature'),
          ('torsion', 'torsion', 'rest_torsion'),
      )),
    Parameter('sections.anchorage', float,
              'arc coordinate of each anchorage, from the tip to the base [m]; at most '
              f'{limits.MAX_SECTIONS}', is_array=True,
              range='decreasing, in (0, body.length]'),
    Parameter('sections.tendons', int,
              'number of tendons of each section; empty for four each; at most '
              f'{limits.MAX_TENDONS} in all', (), is_array=True,
              range=f'>= 1, at most {limits.MAX_TENDONS} in all'),
    Parameter('sections.offset_base', float,
              "distance of each section's tendons from the midline at the base [m]",
              is_array=True, unless=('tendons.table_s',),
              range='from 0 to the radius of body or discs'),
    Parameter('sections.offset_anchorage', float,
              "distance of each section's tendons from the midline at its anchorage [m]",
              is_array=True, unless=('tendons.table_s',),
              range='from 0 to the radius of body or discs'),
    Parameter('tendons.angle', float,
              'direction of each tendon at the base [rad], from n towards b, section by section '
              'from the tip; empty for even spacing from n on', (), is_array=True),
    Parameter('tendons.twist', float,
              'angle each tendon winds about the midline up to its anchorage [rad]; empty for '
              'straight ones', (), is_array=True),
    Parameter('tendons.table_s', float,
              f'arc coordinates of tabulated paths of all tendons, from 0 on [m]{TABLE_BOUND}', (),
              is_array=True, range='increasing from 0 on, as far as the tendons go'),
    Parameter('tendons.table_between', str,
              'what distance and direction do between table_s: pchip, a smooth monotone cubic, or '
              'linear, with kinks at table_s as at rings that guide the tendons', 'pchip',
              range='pchip or linear'),
    Parameter('tendons.table_offset', float,
              'distance from the midline at each of table_s [m], tendon after tendon; at most '
              f'{limits.MAX_TENDON_TABLE}', (),
              is_array=True, range='from 0 to the radius of body or discs',
              most=limits.MAX_TENDON_TABLE),
    Parameter('tendons.table_angle', float,
              'direction at each of table_s [rad], tendon after tendon; empty for angle; at most '
              f'{limits.MAX_TENDON_TABLE}', (),
              is_array=True, most=limits.MAX_TENDON_TABLE),
    Parameter('tendons.axial_stiffness', float,
              'E A of each tendon itself [N], section by section from the tip, or one number for '
              'all, by which a winch that is driven by length has to reel in more; 0 for one that '
              'does not stretch; empty for none that does', (), is_array=True, range='>= 0'),
    Parameter('tendons.free_length', float,
              'length of each tendon between the base and its winch [m], which stretches as well '
              'as what runs in the arm, or one number for all; empty for none', (), is_array=True,
              range='>= 0'),
    Parameter('tendons.sheath_stiffness', float,
              'stiffness k of the body about each tendon [Pa]: force per length over how far it '
              'digs in, section by section from the tip, or one number for all; with model exact; '
              '0 for tendons that keep their places; empty for all such', (), is_array=True,
              range='>= 0'),
    Parameter('tendons.friction', float,
              "Coulomb's coefficient of friction mu of the tendons in their guides [-], one for "
              'all or one per tendon, section by section from the tip; empty for none; with model '
              'closed_form or exact', (), is_array=True,
              range=f'>= 0, at most {limits.MAX_FRICTION:g}'),
    Parameter('tendons.discs', float,
              'arc coordinates of the faces towards the tip of discs between which tendons are '
              'straight [m]; anchorages are discs too; empty for tendons that the body leads all '
              f'along; with model exact; at most {limits.MAX_DISCS}', (), is_array=True,
              range='increasing, in (0, body.length]', most=limits.MAX_DISCS),
    Parameter('tendons.disc_count', int,
              'number of discs, spaced evenly from the base to the tip, which is the last, '
              f'instead of discs; 0 for none; at most {limits.MAX_DISCS}', 0,
              range=f'0 to {limits.MAX_DISCS}'),
    Parameter('tendons.disc_thickness', float,
              'thickness of every disc, which is rigid, from its face on towards the base [m]; 0 '
              'for thin ones', 0.0, range='>= 0, less than the distance of discs'),
    Parameter('tendons.disc_mass', float,
              'mass of every disc, without that of what it displaces of the fluid [kg]; where '
              'disc_thickness is not 0', 0.0, range='>= 0'),
    Parameter('tendon_names', str,
              'names of the tendons, section by section from the tip; empty for '
              'tendon_<section>_<tendon>', (), is_array=True, range='distinct, not empty'),
    Parameter('tendon_limits', float,
              'largest tension that may be commanded of each tendon [N], section by section from '
              'the tip; empty for what the arm bears', (), is_array=True, range='> 0'),
    Parameter('tension_names', str,
              'name of the tension of each tendon in the messages that come in, or its number '
              'from 0 on where they have no names, section by section from the tip; - for a '
              'tendon without a load cell, which is slack; empty for tendon_names', (),
              is_array=True, range='distinct, but for -'),
    Parameter('tension_type', str,
              'type of the messages of tensions on the topic tendon_tensions/field, such as '
              'sensor_msgs/msg/LaserScan; empty for no such topic', ''),
    Parameter('tension_field', str,
              'the field of these that holds the tensions [N], such as ranges, wrench.force or '
              'poses[0].position.x', ''),
    Parameter('tension_deadband', float,
              'tensions within this of zero are zero, as load cells of slack tendons read; those '
              'further below are refused [N]', 0.0, range='>= 0'),
    Parameter('tension_offset', float,
              'what is added to the reading of each load cell, after tension_scale, section by '
              'section from the tip [N]; empty for nothing', (), is_array=True),
    Parameter('tension_scale', float,
              'what the reading of each load cell is multiplied by, section by section from the '
              'tip [-]; empty for 1', (), is_array=True, range='> 0'),
    Parameter('displacement_type', str,
              'type of the messages of encoders on tendon_displacements/field; empty for '
              'no such topic', ''),
    Parameter('displacement_field', str,
              'the field of these that holds the readings, such as angle or motors[0].position',
              ''),
    Parameter('displacement_names', str,
              'name of the reading of the encoder of each tendon in the messages that come in, or '
              'its number from 0 on where they have no names, section by section from the tip; '
              'tendons that one motor reels have the same; - for a tendon without an encoder; '
              'empty for tendon_names', (), is_array=True, range='not empty'),
    Parameter('displacement_scale', float,
              'length reeled in per unit of what the encoder reads [m]: the radius of the spool '
              'for radians, its circumference over the counts of a turn for counts; < 0 where the '
              'motor lets out as it turns forwards; one for all or one per tendon, section by '
              'section from the tip; empty for 1', (), is_array=True, range='not 0'),
    Parameter('displacement_offset', float,
              'what is added to the length of each encoder, after displacement_scale, section by '
              'section from the tip [m]; empty for nothing', (), is_array=True),
    *LOAD_PARAMETERS,
    *surroundings.OBSTACLE_PARAMETERS,
    *surroundings.MOTION_PARAMETERS,
    Parameter('solve_budget.iterations', int,
              "iterations of Newton's method that a solve of a loaded arm may take; one that "
              'would take more is refused', 1000, range='>= 1'),
    Parameter('solve_budget.seconds', float,
              'time that a solve of a loaded arm may take in the node, where nothing else is '
              'answered meanwhile; one that would take more is refused [s]', 0.08, range='> 0'),
    Parameter('friction_memory', float,
              'gap between tensions after which the history of tendons with friction is forgotten '
              'and they are pulled from slack anew [s]; 0 for never', 2.0, range='>= 0',
              what='time'),
    Parameter('markers_rate', float,
              'how often markers are published at most [Hz]; 0 for every shape', 30.0,
              range=f'0, or at least {limits.MIN_RATE:g}'),
    *DiagnosticLimits.table(),
    Parameter('tension_stddev', float, 'standard deviation of every tension [N]', 0.0,
              range='>= 0'),
    Parameter('displacement_stddev', float,
              'standard deviation of every displacement of tendons that are driven by length [m]',
              0.0, range='>= 0'),
    Parameter('model_error_stddev', float,
              'standard deviation of each coordinate of the tip by the error of the model, in '
              'parts of the length [-]; that of its rotation is twice as many [rad]', 0.0,
              range='>= 0'),
    Parameter('material.youngs_modulus_stddev', float,
              'standard deviation of E, relative to it [-]', 0.0, range='>= 0'),
    Parameter('material.poisson_ratio_stddev', float,
              'standard deviation of nu [-]; with model exact', 0.0, range='>= 0'),
    Parameter('tendons.offset_stddev', float,
              'standard deviation of the distance of every tendon [m]; with model exact',
              0.0, range='>= 0'),
)  # fmt: skip
