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
        'simulated one [s]',
        0.1,
        '>= 0',
        'time',
    )


LOAD_PARAMETERS = (
    Parameter('loads.gravity', 'acceleration of gravity in base_frame [m/s^2]', (0.0, 0.0, 0.0)),
    Parameter(
        'loads.fluid_density', 'density of the fluid around the arm [kg/m^3]', 0.0, range='>= 0'
    ),
    Parameter('loads.tip_force', 'force on the tip in base_frame [N]', (0.0, 0.0, 0.0)),
    Parameter('loads.tip_moment', 'moment on the tip in base_frame [N m]', (0.0, 0.0, 0.0)),
    Parameter(
        'loads.tip_frame',
        'axes of tip_force and tip_moment: base, for base_frame, or tip, for t, n and b of '
        'the tip, with which they turn',
        'base',
        range='base or tip',
    ),
    Parameter(
        'loads.point_s',
        f'arc coordinates of point forces [m]; at most {limits.MAX_POINT_LOADS}',
        (),
        range='in [0, body.length]',
        most=limits.MAX_POINT_LOADS,
    ),
    Parameter(
        'loads.point_force',
        'x, y, z of each point force in base_frame [N], one after the other',
        (),
        most=3 * limits.MAX_POINT_LOADS,
    ),
    Parameter(
        'loads.distributed_s',
        f'arc coordinates of a distributed force, linear between them [m]{TABLE_BOUND}',
        (),
        range='increasing, in [0, body.length]',
    ),
    Parameter(
        'loads.distributed_force',
        'x, y, z of the force per length at each, in base_frame [N/m], one after the other',
        (),
        most=3 * limits.MAX_TABLE_POINTS,
    ),
)


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
    Parameter(
        'model', f'what turns tensions into strains: {_MODELS}', DEFAULT_MODEL, range=_MODELS
    ),
    Parameter(
        'stations',
        'stations along the backbone, anchorages and loads among them; at most '
        f'{limits.MAX_STATIONS}',
        DEFAULT_STATIONS,
        range='at least two, one more for every anchorage and load; at most '
        f'{limits.MAX_STATIONS}',
    ),
    Parameter('base_frame', 'frame the backbone is expressed in', 'arm_base'),
    Parameter('frame_prefix', 'what the names of the frames of tip and anchorages begin with', ''),
    Parameter('base.position', 'position of the base in base_frame [m]', (0.0, 0.0, 0.0)),
    Parameter(
        'base.quaternion',
        'orientation of the base in base_frame, x y z w: x axis along the arm, y axis n, z axis b',
        (0.0, 0.0, 0.0, 1.0),
        range='of length 1',
    ),
    Parameter(
        'material.youngs_modulus',
        "Young's modulus E [Pa]",
        unless=('material.table_s',),
        range='> 0',
    ),
    Parameter('material.poisson_ratio', "Poisson's ratio nu [-]", 0.5, range='in (-1, 0.5]'),
    Parameter(
        'material.shear_modulus',
        'shear modulus G [Pa] instead of poisson_ratio; 0 for E / (2 (1 + nu))',
        0.0,
        range='0, or at least E / 3',
    ),
    Parameter(
        'material.density', 'density [kg/m^3]; needed under gravity and to move', 0.0, range='>= 0'
    ),
    Parameter(
        'material.law',
        f'elastic law of the model exact: {_LAWS}',
        DEFAULT_LAW,
        range=' or '.join(LAWS),
    ),
    Parameter('material.shear', 'whether cross sections shear, with law linear', False),
    Parameter(
        'material.table_s',
        'arc coordinates of a material that varies along the arm, from 0 on [m]' + TABLE_BOUND,
        (),
        range='increasing from 0 to the tip',
    ),
    Parameter('material.table_youngs_modulus', 'E at each of table_s [Pa]', (), range='> 0'),
    Parameter(
        'material.table_poisson_ratio',
        'nu at each of table_s [-]; empty for poisson_ratio',
        (),
        range='in (-1, 0.5]',
    ),
    Parameter('body.length', 'length L of the arm [m]', range='> 0'),
    Parameter(
        'body.radius_base',
        'radius at the base [m]',
        unless=('body.table_s', 'body.width'),
        range='> 0',
    ),
    Parameter(
        'body.radius_tip',
        'radius at the tip [m]; the arm is refused where more than '
        f'{limits.MAX_INTERVALS} intervals, each no longer than thick, are needed',
        unless=('body.table_s', 'body.width'),
        range='> 0',
    ),
    Parameter(
        'body.disc_radius',
        'radius of discs that lead tendons outside the body [m]; 0 for none; tendons are '
        'led all along, unless tendons.discs or disc_count says where the discs are',
        0.0,
        range='>= 0',
    ),
    Parameter(
        'body.table_s',
        f'arc coordinates of a body that is no cone, from 0 to the tip [m]{TABLE_BOUND}',
        (),
        range='increasing from 0 to the tip',
    ),
    Parameter('body.table_radius', 'radius at each of table_s [m]', (), range='> 0'),
    Parameter(
        'body.inner_radius',
        'radius of the bore of a tube, closed and empty [m]; 0 for a solid body',
        0.0,
        range='0 <= inner_radius < radius',
    ),
    Parameter(
        'body.table_inner_radius',
        'radius of the bore at each of table_s [m]; empty for inner_radius',
        (),
        range='0 <= inner_radius < radius',
    ),
    Parameter(
        'body.width',
        'size along n of a body of rectangular sections [m], instead of a radius; 0 for a '
        'round one',
        0.0,
        range='0, or > 0 with height',
    ),
    Parameter(
        'body.height',
        'size along b of rectangular sections [m]',
        0.0,
        range='0, or > 0 with width',
    ),
    Parameter(
        'body.table_width',
        'width at each of body.table_s [m]; empty for a round body',
        (),
        range='> 0, with table_height',
    ),
    Parameter(
        'body.table_height',
        'height at each of body.table_s [m]',
        (),
        range='> 0, with table_width',
    ),
    Parameter(
        'stiffness.axial',
        'E A of the cross sections [N], where it is measured; 0 for that of body and '
        'material, as the next',
        0.0,
        range='>= 0',
    ),
    Parameter(
        'stiffness.bending',
        'E J of bending about n and about b [N m^2], or one number for both; empty for that '
        'of body and material',
        (),
        range='>= 0',
    ),
    Parameter('stiffness.torsion', 'G I of the cross sections [N m^2]', 0.0, range='>= 0'),
    Parameter(
        'stiffness.table_s',
        'arc coordinates of stiffness that varies along the arm, a smooth monotone cubic '
        f'between them, from 0 to the tip [m]{TABLE_BOUND}',
        (),
        range='increasing from 0 to the tip',
    ),
    *(
        Parameter(
            f'stiffness.table_{name}',
            f'{what} at each of stiffness.table_s; empty for {one}',
            (),
            range='> 0',
        )
        for name, what, one in (
            ('axial', 'E A [N]', 'axial'),
            ('bending_n', 'E J about n [N m^2]', 'bending'),
            ('bending_b', 'E J about b [N m^2]', 'bending'),
            ('torsion', 'G I [N m^2]', 'torsion'),
        )
    ),
    Parameter(
        'rest_curvature',
        'curvatures about n and about b of the arm where nothing acts on it [1/m]',
        (0.0, 0.0),
    ),
    Parameter(
        'rest_torsion',
        'rotation of the cross sections about the tangent per length there [1/m]',
        0.0,
    ),
    Parameter(
        'rest.table_s',
        'arc coordinates of a shape at rest that varies along the arm, a smooth monotone '
        f'cubic between them, from 0 to the tip [m]{TABLE_BOUND}',
        (),
        range='increasing from 0 to the tip',
    ),
    *(
        Parameter(
            f'rest.table_{name}', f'{what} at each of rest.table_s [1/m]; empty for {one}', ()
        )
        for name, what, one in (
            ('curvature_n', 'curvature about n', 'rest_curvature'),
            ('curvature_b', 'curvature about b', 'rest_curvature'),
            ('torsion', 'torsion', 'rest_torsion'),
        )
    ),
    Parameter(
        'sections.anchorage',
        'arc coordinate of each anchorage, from the tip to the base [m]; at most '
        f'{limits.MAX_SECTIONS}',
        is_array=True,
        range='decreasing, in (0, body.length]',
    ),
    Parameter(
        'sections.tendons',
        'number of tendons of each section; empty for four each; at most '
        f'{limits.MAX_TENDONS} in all',
        (),
        kind=int,
        range=f'>= 1, at most {limits.MAX_TENDONS} in all',
    ),
    Parameter(
        'sections.offset_base',
        "distance of each section's tendons from the midline at the base [m]",
        is_array=True,
        unless=('tendons.table_s',),
        range='from 0 to the radius of body or discs',
    ),
    Parameter(
        'sections.offset_anchorage',
        "distance of each section's tendons from the midline at its anchorage [m]",
        is_array=True,
        unless=('tendons.table_s',),
        range='from 0 to the radius of body or discs',
    ),
    Parameter(
        'tendons.angle',
        'direction of each tendon at the base [rad], from n towards b, section by section '
        'from the tip; empty for even spacing from n on',
        (),
    ),
    Parameter(
        'tendons.twist',
        'angle each tendon winds about the midline up to its anchorage [rad]; empty for '
        'straight ones',
        (),
    ),
    Parameter(
        'tendons.table_s',
        f'arc coordinates of tabulated paths of all tendons, from 0 on [m]{TABLE_BOUND}',
        (),
        range='increasing from 0 on, as far as the tendons go',
    ),
    Parameter(
        'tendons.table_between',
        'what distance and direction do between table_s: pchip, a smooth monotone cubic, or '
        'linear, with kinks at table_s as at rings that guide the tendons',
        'pchip',
        range='pchip or linear',
    ),
    Parameter(
        'tendons.table_offset',
        'distance from the midline at each of table_s [m], tendon after tendon; at most '
        f'{limits.MAX_TENDON_TABLE}',
        (),
        range='from 0 to the radius of body or discs',
        most=limits.MAX_TENDON_TABLE,
    ),
    Parameter(
        'tendons.table_angle',
        'direction at each of table_s [rad], tendon after tendon; empty for angle; at most '
        f'{limits.MAX_TENDON_TABLE}',
        (),
        most=limits.MAX_TENDON_TABLE,
    ),
    Parameter(
        'tendons.axial_stiffness',
        'E A of each tendon itself [N], section by section from the tip, or one number for '
        'all, by which a winch that is driven by length has to reel in more; 0 for one that '
        'does not stretch; empty for none that does',
        (),
        range='>= 0',
    ),
    Parameter(
        'tendons.free_length',
        'length of each tendon between the base and its winch [m], which stretches as well '
        'as what runs in the arm, or one number for all; empty for none',
        (),
        range='>= 0',
    ),
    Parameter(
        'tendons.sheath_stiffness',
        'stiffness k of the body about each tendon [Pa]: force per length over how far it '
        'digs in, section by section from the tip, or one number for all; with model exact; '
        '0 for tendons that keep their places; empty for all such',
        (),
        range='>= 0',
    ),
    Parameter(
        'tendons.friction',
        "Coulomb's coefficient of friction mu of the tendons in their guides [-], one for "
        'all or one per tendon, section by section from the tip; empty for none; with model '
        'closed_form or exact',
        (),
        range=f'>= 0, at most {limits.MAX_FRICTION:g}',
    ),
    Parameter(
        'tendons.discs',
        'arc coordinates of the faces towards the tip of discs between which tendons are '
        'straight [m]; anchorages are discs too; empty for tendons that the body leads all '
        f'along; with model exact; at most {limits.MAX_DISCS}',
        (),
        range='increasing, in (0, body.length]',
        most=limits.MAX_DISCS,
    ),
    Parameter(
        'tendons.disc_count',
        'number of discs, spaced evenly from the base to the tip, which is the last, '
        f'instead of discs; 0 for none; at most {limits.MAX_DISCS}',
        0,
        range=f'0 to {limits.MAX_DISCS}',
    ),
    Parameter(
        'tendons.disc_thickness',
        'thickness of every disc, which is rigid, from its face on towards the base [m]; 0 '
        'for thin ones',
        0.0,
        range='>= 0, less than the distance of discs',
    ),
    Parameter(
        'tendons.disc_mass',
        'mass of every disc, without that of what it displaces of the fluid [kg]; where '
        'disc_thickness is not 0',
        0.0,
        range='>= 0',
    ),
    Parameter(
        'tendon_names',
        'names of the tendons, section by section from the tip; empty for '
        'tendon_<section>_<tendon>',
        (),
        kind=str,
        range='distinct, not empty',
    ),
    Parameter(
        'tendon_limits',
        'largest tension that may be commanded of each tendon [N], section by section from '
        'the tip; empty for what the arm bears',
        (),
        range='> 0',
    ),
    Parameter(
        'tension_names',
        'name of the tension of each tendon in the messages that come in, or its number '
        'from 0 on where they have no names, section by section from the tip; - for a '
        'tendon without a load cell, which is slack; empty for tendon_names',
        (),
        kind=str,
        range='distinct, but for -',
    ),
    Parameter(
        'tension_type',
        'type of the messages of tensions on the topic tendon_tensions/field, such as '
        'sensor_msgs/msg/LaserScan; empty for no such topic',
        '',
    ),
    Parameter(
        'tension_field',
        'the field of these that holds the tensions [N], such as ranges, wrench.force or '
        'poses[0].position.x',
        '',
    ),
    Parameter(
        'tension_deadband',
        'tensions within this of zero are zero, as load cells of slack tendons read; those '
        'further below are refused [N]',
        0.0,
        range='>= 0',
    ),
    Parameter(
        'tension_offset',
        'what is added to the reading of each load cell, after tension_scale, section by '
        'section from the tip [N]; empty for nothing',
        (),
    ),
    Parameter(
        'tension_scale',
        'what the reading of each load cell is multiplied by, section by section from the '
        'tip [-]; empty for 1',
        (),
        range='> 0',
    ),
    Parameter(
        'displacement_type',
        'type of the messages of encoders on tendon_displacements/field; empty for no such topic',
        '',
    ),
    Parameter(
        'displacement_field',
        'the field of these that holds the readings, such as angle or motors[0].position',
        '',
    ),
    Parameter(
        'displacement_names',
        'name of the reading of the encoder of each tendon in the messages that come in, or '
        'its number from 0 on where they have no names, section by section from the tip; '
        'tendons that one motor reels have the same; - for a tendon without an encoder; '
        'empty for tendon_names',
        (),
        kind=str,
        range='not empty',
    ),
    Parameter(
        'displacement_scale',
        'length reeled in per unit of what the encoder reads [m]: the radius of the spool '
        'for radians, its circumference over the counts of a turn for counts; < 0 where the '
        'motor lets out as it turns forwards; one for all or one per tendon, section by '
        'section from the tip; empty for 1',
        (),
        range='not 0',
    ),
    Parameter(
        'displacement_offset',
        'what is added to the length of each encoder, after displacement_scale, section by '
        'section from the tip [m]; empty for nothing',
        (),
    ),
    *LOAD_PARAMETERS,
    *surroundings.OBSTACLE_PARAMETERS,
    *surroundings.MOTION_PARAMETERS,
    Parameter(
        'solve_budget.iterations',
        "iterations of Newton's method that a solve of a loaded arm may take; one that "
        'would take more is refused',
        1000,
        range='>= 1',
    ),
    Parameter(
        'solve_budget.seconds',
        'time that a solve of a loaded arm may take in the node, where nothing else is '
        'answered meanwhile; one that would take more is refused [s]',
        0.08,
        range='> 0',
    ),
    Parameter(
        'friction_memory',
        'gap between tensions after which the history of tendons with friction is forgotten '
        'and they are pulled from slack anew [s]; 0 for never',
        2.0,
        range='>= 0',
        what='time',
    ),
    Parameter(
        'markers_rate',
        'how often markers are published at most [Hz]; 0 for every shape',
        30.0,
        range=f'0, or at least {limits.MIN_RATE:g}',
    ),
    *DiagnosticLimits.table(),
    Parameter('tension_stddev', 'standard deviation of every tension [N]', 0.0, range='>= 0'),
    Parameter(
        'displacement_stddev',
        'standard deviation of every displacement of tendons that are driven by length [m]',
        0.0,
        range='>= 0',
    ),
    Parameter(
        'model_error_stddev',
        'standard deviation of each coordinate of the tip by the error of the model, in '
        'parts of the length [-]; that of its rotation is twice as many [rad]',
        0.0,
        range='>= 0',
    ),
    Parameter(
        'material.youngs_modulus_stddev',
        'standard deviation of E, relative to it [-]',
        0.0,
        range='>= 0',
    ),
    Parameter(
        'material.poisson_ratio_stddev',
        'standard deviation of nu [-]; with model exact',
        0.0,
        range='>= 0',
    ),
    Parameter(
        'tendons.offset_stddev',
        'standard deviation of the distance of every tendon [m]; with model exact',
        0.0,
        range='>= 0',
    ),
)
