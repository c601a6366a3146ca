"""The table of the parameters of an arm and of its node.

The YAML loader reads it, the node declares its ROS parameters from it and the manual prints it.
"""

from dataclasses import dataclass

from octo_arm_model.arm.limits import (
    MAX_DISCS,
    MAX_FRICTION,
    MAX_INTERVALS,
    MAX_OBSTACLES,
    MAX_POINT_LOADS,
    MAX_SECTIONS,
    MAX_STATIONS,
    MAX_TABLE_POINTS,
    MAX_TENDON_TABLE,
    MAX_TENDONS,
    MIN_RATE,
)
from octo_arm_model.arm.material import DEFAULT_LAW, LAWS, WATERS
from octo_arm_model.arm.obstacles import Obstacle
from octo_arm_model.config.parameter import ParameterGroup, read_table, stated
from octo_arm_model.rod.solver import DEFAULT_MODEL, MODELS
from octo_arm_model.rod.stations import DEFAULT_STATIONS


@dataclass(frozen=True)
class DiagnosticLimits(ParameterGroup):
    """The thresholds of the diagnostics of the node."""

    GROUP = 'diagnostics'

    silence_limit: float = stated(
        'double | 2.0 | >= 0 | what time',
        'time without messages after which an input is called silent [s]',
    )
    age_limit: float = stated(
        'double | 1.0 | >= 0 | what time',
        'age on arrival from which stamps of tensions are called old [s]',
    )
    ahead_limit: float = stated(
        'double | 0.1 | >= 0 | what time',
        'time that stamps of tensions may be ahead of the clock, beside twice the last step of a '
        'simulated clock [s]',
    )


_LAWS = ', '.join(f'{name} ({law.meant_for})' for name, law in LAWS.items())
_MODELS = f'one of {", ".join(MODELS)}'
_WATERS = ' or '.join(WATERS)

# The grammar is that of `read_table`.
_TABLE = f"""\
model | string | {DEFAULT_MODEL!r} | {_MODELS} | choice
    model of the statics
stations | integer | {DEFAULT_STATIONS} | 2 and 1 for each anchorage and load, to {MAX_STATIONS}
    stations along the backbone, anchorages and loads among them; at most {MAX_STATIONS}
base_frame | string | 'arm_base'
    frame the backbone is expressed in
frame_prefix | string | ''
    prefix of the names of the frames of tip and anchorages
base.position | double[] | [0.0, 0.0, 0.0]
    position of the base in base_frame [m]
base.quaternion | double[] | [0.0, 0.0, 0.0, 1.0] | of length 1
    orientation of the base in base_frame, x y z w: x axis along the arm, y axis n, z axis b
material.youngs_modulus | double | | > 0 | unless material.table_s
    Young's modulus E [Pa]
material.poisson_ratio | double | 0.5 | in (-1, 0.5]
    | unless material.table_poisson_ratio material.shear_modulus
    Poisson's ratio nu [-]
material.shear_modulus | double | 0.0 | 0, or at least E / 3 | unless material.table_s
    shear modulus G [Pa] instead of poisson_ratio; 0 for E / (2 (1 + nu))
material.density | double | 0.0 | >= 0
    density [kg/m^3]; needed under gravity and to move
material.law | string | {DEFAULT_LAW!r} | {' or '.join(LAWS)}
    elastic law of the model exact: {_LAWS}
material.shear | bool | False
    whether cross sections shear, with law linear
material.table_s | double[] | [] | increasing from 0 to the tip | most {MAX_TABLE_POINTS}
    arc coordinates of a material that varies along the arm, from 0 on [m]
material.table_youngs_modulus | double[] | [] | > 0 | with material.table_s
    E at each of table_s [Pa]
material.table_poisson_ratio | double[] | [] | in (-1, 0.5] | with material.table_s
    nu at each of table_s [-]; empty for poisson_ratio
body.length | double | | > 0
    length L of the arm [m]
body.radius_base | double | | > 0 | unless body.table_s body.width
    radius at the base [m]
body.radius_tip | double | | > 0 | unless body.table_s body.width
    radius at the tip [m]; the arm is refused where more than {MAX_INTERVALS} intervals, each
    no longer than thick, are needed
body.disc_radius | double | 0.0 | >= 0
    radius of discs that guide tendons outside the body [m]; 0 for none; they guide tendons
    everywhere, unless tendons.discs or disc_count says where the discs are
body.table_s | double[] | [] | increasing from 0 to the tip | most {MAX_TABLE_POINTS}
    arc coordinates of a body that is not a cone, from 0 to the tip [m]
body.table_radius | double[] | [] | > 0 | with body.table_s | unless body.width body.table_width
    radius at each of table_s [m]
body.inner_radius | double | 0.0 | 0 <= inner_radius < radius | unless body.width body.table_width
    radius of the bore of a tube, closed and empty [m]; 0 for a solid body
body.table_inner_radius | double[] | [] | 0 <= inner_radius < radius | with body.table_radius
    radius of the bore at each of table_s [m]; empty for inner_radius
body.width | double | 0.0 | 0, or > 0 with height
    size along n of a body of rectangular sections [m], instead of a radius; 0 for a round one
body.height | double | 0.0 | 0, or > 0 with width
    size along b of rectangular sections [m]
body.table_width | double[] | [] | > 0, with table_height
    width at each of body.table_s [m]; empty for a round body
body.table_height | double[] | [] | > 0, with table_width
    height at each of body.table_s [m]
stiffness.axial | double | 0.0 | >= 0
    measured E A of the cross sections [N]; 0 for that of body and material
stiffness.bending | double[] | [] | >= 0
    E J of bending about n and about b [N m^2], or one number for both; empty for that of body
    and material
stiffness.torsion | double | 0.0 | >= 0
    G I of the cross sections [N m^2]; 0 for that of body and material
stiffness.table_s | double[] | [] | increasing from 0 to the tip | most {MAX_TABLE_POINTS}
    arc coordinates of stiffness that varies along the arm, a smooth monotone cubic between
    them, from 0 to the tip [m]
stiffness.table_axial | double[] | [] | > 0
    E A [N] at each of stiffness.table_s; empty for axial
stiffness.table_bending_n | double[] | [] | > 0
    E J about n [N m^2] at each of stiffness.table_s; empty for bending
stiffness.table_bending_b | double[] | [] | > 0
    E J about b [N m^2] at each of stiffness.table_s; empty for bending
stiffness.table_torsion | double[] | [] | > 0
    G I [N m^2] at each of stiffness.table_s; empty for torsion
rest_curvature | double[] | [0.0, 0.0]
    curvatures about n and about b of the unloaded arm [1/m]
rest_torsion | double | 0.0
    torsion of the unloaded arm [1/m]
rest.table_s | double[] | [] | increasing from 0 to the tip | most {MAX_TABLE_POINTS}
    arc coordinates of a shape at rest that varies along the arm, a smooth monotone cubic
    between them, from 0 to the tip [m]
rest.table_curvature_n | double[] | []
    curvature about n at each of rest.table_s [1/m]; empty for rest_curvature
rest.table_curvature_b | double[] | []
    curvature about b at each of rest.table_s [1/m]; empty for rest_curvature
rest.table_torsion | double[] | []
    torsion at each of rest.table_s [1/m]; empty for rest_torsion
sections.anchorage | double[] | | decreasing, in (0, body.length] | most {MAX_SECTIONS}
    arc coordinate of each anchorage, from the tip to the base [m]
sections.tendons | integer[] | [] | >= 1, at most {MAX_TENDONS} in all
    number of tendons of each section; empty for four each; at most {MAX_TENDONS} in all
sections.offset_base | double[] | | 0 to the radius of body or discs | unless tendons.table_s
    distance of each section's tendons from the midline at the base [m]
sections.offset_anchorage | double[] | | 0 to the radius of body or discs | unless tendons.table_s
    distance of each section's tendons from the midline at its anchorage [m]
tendons.angle | double[] | [] | from -2 pi to 2 pi | unless tendons.table_angle
    direction of each tendon at the base [rad], from n towards b, section by section from the
    tip; empty for even spacing from n on
tendons.twist | double[] | [] | | unless tendons.table_s
    angle by which each tendon winds about the midline up to its anchorage [rad]; empty for
    straight tendons
tendons.table_s | double[] | [] | increasing from 0 to all anchorages | most {MAX_TABLE_POINTS}
    arc coordinates of tabulated paths of all tendons, from 0 on [m]
tendons.table_between | string | 'pchip' | pchip or linear | choice | with tendons.table_s
    interpolation of distance and direction between table_s: pchip, a smooth monotone cubic, or
    linear, with kinks at table_s as at rings that guide the tendons
tendons.table_offset | double[] | [] | 0 to the radius of body or discs | most {MAX_TENDON_TABLE}
    | with tendons.table_s
    distance from the midline at each of table_s [m], tendon after tendon
tendons.table_angle | double[] | [] | | most {MAX_TENDON_TABLE} | with tendons.table_s
    direction at each of table_s [rad], tendon after tendon; empty for angle
tendons.axial_stiffness | double[] | [] | >= 0
    E A of each tendon [N], section by section from the tip, or one number for all; winches
    that are driven by length reel in the stretch too; 0 for a tendon that does not stretch;
    empty if none does
tendons.free_length | double[] | [] | >= 0
    length of each tendon between the base and its winch [m], which stretches too, or one
    number for all; empty for none
tendons.sheath_stiffness | double[] | [] | >= 0
    stiffness k of the body about each tendon [Pa]: force per length over the depth to which the
    tendon presses in, section by section from the tip, or one number for all; with model exact;
    0 for a rigid sheath; empty if all are rigid
tendons.friction | double[] | [] | >= 0, at most {MAX_FRICTION:g}
    Coulomb's coefficient of friction mu of the tendons in their guides [-], one for all or one
    per tendon, section by section from the tip; empty for none; with model closed_form or
    exact
tendons.discs | double[] | [] | increasing, in (0, body.length] | most {MAX_DISCS}
    arc coordinates of the faces towards the tip of discs between which tendons are straight
    [m]; anchorages are discs too; empty for tendons that the body guides everywhere; with model
    exact
tendons.disc_count | integer | 0 | in [0, {MAX_DISCS}] | unless tendons.discs
    number of evenly spaced discs, the last of them at the tip, instead of discs; 0 for none;
    at most {MAX_DISCS}
tendons.disc_thickness | double | 0.0 | >= 0, less than the distance of discs
    thickness of every disc, which is rigid, from its face towards the base [m]; 0 for thin
    discs
tendons.disc_mass | double | 0.0 | >= 0
    mass of every disc less that of the fluid it displaces [kg]; if disc_thickness is not 0
tendon_names | string[] | [] | distinct, not empty
    names of the tendons, section by section from the tip; empty for tendon_<section>_<tendon>
tendon_limits | double[] | [] | > 0
    largest tension that may be commanded for each tendon [N], section by section from the tip;
    empty for the largest that the arm bears
tension_names | string[] | [] | distinct, but for -
    name of the tension of each tendon in incoming messages, or its index from 0 on in messages
    without names, section by section from the tip; - for a tendon without a load cell, which
    is slack; empty for tendon_names
tension_type | string | '' | | with tension_field
    type of the messages on the topic tendon_tensions/field, such as
    sensor_msgs/msg/LaserScan; empty for no such topic
tension_field | string | '' | | with tension_type
    field of these messages with the tensions [N], such as ranges, wrench.force or
    poses[0].position.x
tension_deadband | double | 0.0 | >= 0
    largest reading of a load cell of a slack tendon: tensions within it count as zero, and
    those further below zero are refused [N]
tension_offset | double[] | []
    offset that is added to the reading of each load cell, after tension_scale, section by
    section from the tip [N]; empty for 0
tension_scale | double[] | [] | > 0
    factor on the reading of each load cell, section by section from the tip [-]; empty for 1
displacement_type | string | '' | | with displacement_field
    type of the messages of encoders on tendon_displacements/field; empty for no such topic
displacement_field | string | '' | | with displacement_type
    field of these messages with the readings, such as angle or motors[0].position
displacement_names | string[] | [] | not empty
    name of the reading of the encoder of each tendon in incoming messages, or its index from 0
    on in messages without names, section by section from the tip; the same for tendons that
    one motor reels; - for a tendon without an encoder; empty for tendon_names
displacement_scale | double[] | [] | not 0
    length reeled in per unit of the reading of the encoder [m]: the radius of the spool for
    radians, its circumference over the counts of a turn for counts; < 0 if the motor lets the
    tendon out as it turns forwards; one for all or one per tendon, section by section from the
    tip; empty for 1
displacement_offset | double[] | []
    offset that is added to the length of each encoder, after displacement_scale, section by
    section from the tip [m]; empty for 0
loads.gravity | double[] | [0.0, 0.0, 0.0]
    acceleration of gravity in base_frame [m/s^2]
loads.fluid_density | double | 0.0 | >= 0
    density of the fluid around the arm [kg/m^3]
loads.tip_force | double[] | [0.0, 0.0, 0.0]
    force on the tip in base_frame [N]
loads.tip_moment | double[] | [0.0, 0.0, 0.0]
    moment on the tip in base_frame [N m]
loads.tip_frame | string | 'base' | base or tip | choice
    axes of tip_force and tip_moment: base for base_frame, or tip for t, n and b of the tip,
    which turn with it
loads.point_s | double[] | [] | in [0, body.length] | most {MAX_POINT_LOADS}
    arc coordinates of point forces [m]
loads.point_force | double[] | [] | | most {3 * MAX_POINT_LOADS}
    x, y, z of each point force in base_frame [N], one after the other
loads.distributed_s | double[] | [] | increasing, in [0, body.length] | most {MAX_TABLE_POINTS}
    arc coordinates of a distributed force, linear between them [m]
loads.distributed_force | double[] | [] | | most {3 * MAX_TABLE_POINTS}
    x, y, z of the force per length at each, in base_frame [N/m], one after the other
obstacles.type | string[] | [] | plane, sphere or cylinder | choice | most {MAX_OBSTACLES}
    kind of each obstacle that the arm may touch: plane, sphere or cylinder; empty for none;
    with model exact
obstacles.position | double[] | [] | | most {3 * MAX_OBSTACLES}
    x, y, z of a point of each plane, of the centre of a sphere and of a point of the axis of a
    cylinder, in base_frame [m], one after the other
obstacles.direction | double[] | [] | | most {3 * MAX_OBSTACLES}
    x, y, z of the outward normal of each plane and of the axis of a cylinder, which has no
    ends, one after the other; unused for spheres; empty for 0, 0, 1
obstacles.radius | double[] | [] | >= 0 | most {MAX_OBSTACLES}
    radius of each sphere and cylinder [m]; unused for planes
obstacles.stiffness | double[] | [] | > 0 | most {MAX_OBSTACLES}
    pressure over the depth to which the arm enters each [N/m^3], one for all or one per
    obstacle
obstacles.friction | double[] | [] | >= 0, at most {MAX_FRICTION:g} | most {MAX_OBSTACLES}
    Coulomb's coefficient of friction of the arm on each [-], for an arm that moves: there are
    no shapes at rest with it; one for all or one per obstacle; empty for none
obstacles.creep_speed | double[] | [] | > 0 | most {MAX_OBSTACLES}
    speed at which friction on each has 0.71 of its full size, below which it is smaller [m/s],
    one for all or one per obstacle; empty for {Obstacle.creep_speed:g}
motion.viscosity | double | 0.0 | >= 0
    viscosity eta of the material [Pa s]: stress per rate of shear strain; the stress per rate
    of stretch is three times as large
motion.damping_time | double | 0.0 | >= 0
    factor of the stiffness of cross sections that gives their viscosity, instead [s]; 3 eta / E
    is the same for poisson_ratio 0.5
motion.water | string | '' | {_WATERS}, or empty | choice | with loads.fluid_density
    source of the coefficients of drag and added mass: {_WATERS}; empty for the next three
motion.normal_drag | double | 0.0 | >= 0 | unless motion.water | with loads.fluid_density
    coefficient C_n of the drag across, rho R C_n v |v| per length [-], in a fluid of
    loads.fluid_density
motion.tangential_drag | double | 0.0 | >= 0 | unless motion.water | with loads.fluid_density
    coefficient C_t of the drag along, rho R pi C_t v |v| / 2 per length [-]
motion.added_mass | double | 0.0 | >= 0 | unless motion.water | with loads.fluid_density
    mass of water that is accelerated across over the mass of displaced water [-]
motion.current | double[] | [0.0, 0.0, 0.0] | | with loads.fluid_density
    velocity of the water in base_frame [m/s]
solve_budget.iterations | integer | 1000 | >= 1
    iterations of Newton's method that a solve of a loaded arm may take; it is refused if it
    needs more
solve_budget.seconds | double | 0.0 | >= 0 | what time
    time that a solve of a loaded arm may take in the node, which answers nothing else
    meanwhile; it is refused if it needs more [s]; 0 for 0.08, or 1 where there are obstacles
friction_memory | double | 2.0 | >= 0 | what time
    gap between tensions after which the history of tendons with friction is forgotten, so that
    they are pulled from slack again [s]; 0 for never
markers_rate | double | 30.0 | 0, or at least {MIN_RATE:g}
    largest rate at which markers are published [Hz]; 0 for every shape
tension_stddev | double | 0.0 | >= 0
    standard deviation of every tension [N]
displacement_stddev | double | 0.0 | >= 0
    standard deviation of every displacement of tendons that are driven by length [m]
model_error_stddev | double | 0.0 | >= 0
    standard deviation of the error of the model in each coordinate of the tip, over the length
    [-]; that of its rotation is twice as large [rad]
material.youngs_modulus_stddev | double | 0.0 | >= 0
    standard deviation of E, relative to it [-]
material.poisson_ratio_stddev | double | 0.0 | >= 0
    standard deviation of nu [-]; with model exact
tendons.offset_stddev | double | 0.0 | >= 0
    standard deviation of the distance of every tendon from the midline [m]; with model exact
"""

PARAMETERS = (*read_table(_TABLE), *DiagnosticLimits.table())
