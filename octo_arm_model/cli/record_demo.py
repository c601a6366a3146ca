"""``octo-arm record-demo``: a bag to try the other commands on."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from octo_arm_model.cli.replay import INTERRUPTED, STORAGES
from octo_arm_model.config.config import load_parameters
from octo_arm_model.config.presets import find_path

_DESCRIPTION = """\
Make up a recorded experiment, for trying out compare, identify and replay: nothing of it was
measured, and its metadata and a topic note say so, with the truth it was made with.

The first tendon is pulled by the tensions of the paper's Table 1, one after the other: 4 s each
and 1 s to the next. Topics:

  /tendon_tensions   octo_arm_msgs/TendonTensions, 100 Hz, noise of 0.005 N
  /camera/midline    nav_msgs/Path, 10 Hz, 41 points from base to tip in the frame of the camera:
                     the arm as the model exact has it with an E of its own, noise of 0.5 mm, 5
                     percent of the midlines missing, 3 percent gone astray, and stamps by a clock
                     that is ahead
  /arm_description   std_msgs/String, latched: the arm as the config has it
  /note              std_msgs/String, latched: what this is
"""
_EPILOG = """\
examples:
  octo-arm record-demo experiment
  octo-arm record-demo experiment --storage sqlite3 --seed 7
  octo-arm record-demo softer --stiffness 0.8 --clock-offset -0.2

The same options give the same messages.

exit status: 0 done, 2 the input is wrong or OUT cannot be written, 130 interrupted
"""


def add_command(commands: Any) -> None:
    """Add the command to the subparsers ``commands``."""
    parser = commands.add_parser(
        'record-demo',
        help='make up a bag of an experiment',
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('out', metavar='OUT', type=Path, help='bag to write, not there yet')
    parser.add_argument(
        '--config',
        default='renda2012_prototype',
        help='ROS parameter file of the arm, or the name of a preset (default: %(default)s); '
        'arms that bear other tensions than this one are pulled accordingly',
    )
    parser.add_argument(
        '--stiffness',
        type=float,
        default=1.1,
        metavar='RATIO',
        help="true Young's modulus over that of the config (default: %(default)s)",
    )
    parser.add_argument(
        '--clock-offset',
        type=float,
        default=0.08,
        metavar='S',
        help="how far the camera's clock is ahead [s] (default: %(default)s)",
    )
    parser.add_argument(
        '--seed', type=int, default=0, help='of everything random (default: %(default)s)'
    )
    parser.add_argument(
        '--storage', choices=STORAGES, default='mcap', help='of OUT (default: %(default)s)'
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from octo_arm_model.bags.demo import Experiment, add_demo, custom_data
    from octo_arm_model.bags.writer import BagWriter

    parameters = load_parameters(find_path(options.config))
    experiment = Experiment(stiffness=options.stiffness, clock_offset=options.clock_offset)
    custom = custom_data(experiment, options.seed)
    try:
        with BagWriter(options.out, options.storage, custom) as writer:
            add_demo(writer, parameters, experiment, options.seed)
    except KeyboardInterrupt:
        print(f'octo-arm: interrupted, no {options.out} written', file=sys.stderr)
        return INTERRUPTED
    print(f'{options.out}: synthetic, see its topic note')
    return 0
