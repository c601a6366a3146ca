"""``octo-arm record-demo``: a bag of a synthetic experiment."""

import argparse

from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import unwritten
from octo_arm_model.config.parameter_files import load_parameters

SUMMARY = 'write a bag of a synthetic experiment'
DESCRIPTION = """\
Write a synthetic experiment, for trying out compare, identify and replay: nothing of it was
measured. Its metadata and a topic note say so, and name the true parameters.

The first tendon is pulled by the tensions of the paper's Table 1, one after the other: 4 s each
and 1 s to the next. Topics:

  /tendon_tensions   octo_arm_msgs/TendonTensions, 100 Hz, noise of 0.005 N
  /camera/midline    nav_msgs/Path, 10 Hz, 41 points from base to tip in the frame of the camera:
                     the solution of the model exact with another E, noise of 0.5 mm, 5 percent of
                     the midlines missing, 3 percent outliers, and stamps of a clock that is ahead
  /arm_description   std_msgs/String, latched: the arm as the config has it
  /tendon_displacements
                     sensor_msgs/JointState, 100 Hz, with --sheath or --axial-stiffness: what
                     encoders of winches read, noise of 0.02 mm
  /measured/tip_pose geometry_msgs/PoseWithCovarianceStamped, 20 Hz, with --touch: noise of 0.5 mm
                     and 0.02 rad
  /measured/markers  geometry_msgs/PoseArray, 20 Hz, with --markers: noise of 0.5 mm
  /note              std_msgs/String, latched: what this is
"""
EPILOG = """\
examples:
  octo-arm record-demo experiment
  octo-arm record-demo experiment --storage sqlite3 --seed 7
  octo-arm record-demo digging --sheath 250000
  octo-arm record-demo stretching --axial-stiffness 300
  octo-arm record-demo softer --stiffness 0.8 --clock-offset -0.2
  octo-arm record-demo rough --friction 0.2
  octo-arm record-demo touched --touch 0.02
  octo-arm record-demo seen --touch 0.02 --stiffness 1.2 --markers 0.09 0.18

The same options give the same messages.

exit status: 0 done, 2 the input is wrong or OUT cannot be written, 130 interrupted
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    arguments.add_path(parser, 'out', 'OUT', 'bag to write, not there yet')
    more = '; arms that bear other tensions than this one are pulled accordingly'
    arguments.add_config_option(parser, 'renda2012_prototype', more=more)
    text = "true Young's modulus over that of the config (default: 1.1; 1 with --touch)"
    arguments.add_value(parser, '--stiffness', 'RATIO', text, float)
    arguments.add_number(
        parser, '--clock-offset', 0.08, "how far the camera's clock is ahead [s]", 'S'
    )
    sheath = "true stiffness of the tendons' sheaths [Pa]; 0 for that of the config"
    arguments.add_number(parser, '--sheath', 0.0, sheath, 'K')
    stretch = 'true E A of the tendons themselves [N]; 0 for that of the config'
    arguments.add_number(parser, '--axial-stiffness', 0.0, stretch, 'K')
    rub = 'true coefficient of friction of the tendons; with some, tensions rise and fall again'
    arguments.add_number(parser, '--friction', 0.0, rub, 'MU')
    touch = 'force on the tip while the middle tension is held [N], for octo-arm estimate'
    arguments.add_number(parser, '--touch', 0.0, touch, 'N')
    text = 'arc coordinates of markers that are measured [m]'
    arguments.add_values(parser, '--markers', 'S', text, float)
    arguments.add_number(parser, '--seed', 0, 'of everything random')
    arguments.add_storage(parser)


def run(options: argparse.Namespace) -> None:
    """Write the bag."""
    from octo_arm_model.bags.outputs import Experiment, add_demo, custom_data
    from octo_arm_model.bags.writer import BagWriter

    parameters, stiffness = load_parameters(options.config), options.stiffness
    if stiffness is None:
        stiffness = 1.0 if options.touch else Experiment.stiffness
    same = 'clock_offset', 'sheath', 'axial_stiffness', 'friction', 'touch', 'seed'
    given = {name: getattr(options, name) for name in same}
    experiment = Experiment(stiffness=stiffness, markers=tuple(options.markers), **given)
    custom = custom_data(experiment)
    with unwritten(options.out), BagWriter(options.out, options.storage, custom) as writer:
        add_demo(writer, parameters, experiment)
    print(f'{options.out}: synthetic, see its topic note')
