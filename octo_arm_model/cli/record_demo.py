"""``octo-arm record-demo``: write a bag of a synthetic experiment."""

import argparse

from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import unwritten
from octo_arm_model.config.parameter_files import load_parameters

SUMMARY = 'write a bag of a synthetic experiment'
DESCRIPTION = """\
Write a synthetic experiment to try out compare, identify and replay. None of it was measured; its
metadata and a topic note say so, and name the true parameters.

The tension of the first tendon steps through the values of the paper's Table 1: 4 s at each, and
1 s to the next. Topics:

  /tendon_tensions   octo_arm_msgs/TendonTensions, 100 Hz, noise of 0.005 N
  /camera/midline    nav_msgs/Path, 10 Hz, 41 points from base to tip in the frame of the camera:
                     the solution of the model exact with another E, noise of 0.5 mm, 5 percent of
                     the midlines missing, 3 percent outliers, and stamps of a clock that is ahead
  /arm_description   std_msgs/String, latched: the arm of the config
  /tendon_displacements
                     sensor_msgs/JointState, 100 Hz, with --sheath or --axial-stiffness: readings
                     of encoders of winches, noise of 0.02 mm
  /measured/tip_pose geometry_msgs/PoseWithCovarianceStamped, 20 Hz, with --touch: noise of 0.5 mm
                     and 0.02 rad
  /measured/markers  geometry_msgs/PoseArray, 20 Hz, with --markers: noise of 0.5 mm
  /note              std_msgs/String, latched: a description of the experiment
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


OPTIONS = f"""\
out OUT path: new bag to write
--config CONFIG = renda2012_prototype: {arguments.ARM_FILE}; tensions are scaled to what the arm
    bears
--stiffness RATIO float: true Young's modulus over that of the config (default: 1.1; 1 with
    --touch)
--clock-offset S = 0.08: how far the camera's clock is ahead [s]
--sheath K = 0.0: true stiffness of the tendons' sheaths [Pa]; 0 for that of the config
--axial-stiffness K = 0.0: true E A of the tendons themselves [N]; 0 for that of the config
--friction MU = 0.0: true coefficient of friction of the tendons; if not 0, tensions rise and fall
--touch N = 0.0: force on the tip while the middle tension is held [N], for octo-arm estimate
--markers S... float: arc coordinates of measured markers [m]
--seed SEED = 0: seed of all random numbers
{arguments.STORAGE}
"""


def run(options: argparse.Namespace) -> None:
    """Write the bag of the synthetic experiment."""
    from octo_arm_model.bags.outputs import Experiment, add_demo, custom_data
    from octo_arm_model.bags.writer import BagWriter

    parameters, stiffness = load_parameters(options.config), options.stiffness
    if stiffness is None:
        stiffness = 1.0 if options.touch else Experiment.stiffness
    names = 'clock_offset', 'sheath', 'axial_stiffness', 'friction', 'touch', 'seed'
    others = {name: getattr(options, name) for name in names}
    experiment = Experiment(stiffness=stiffness, markers=tuple(options.markers), **others)
    custom = custom_data(experiment)
    with unwritten(options.out), BagWriter(options.out, options.storage, custom) as writer:
        add_demo(writer, parameters, experiment)
    print(f'{options.out}: synthetic, see its topic note')
