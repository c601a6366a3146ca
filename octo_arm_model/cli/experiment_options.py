"""Options that compare and identify share."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from octo_arm_model.cli.options import add_config_option, add_number, add_path, add_tendons
from octo_arm_model.cli.progress import Bar
from octo_arm_model.config.config import Config
from octo_arm_model.core.errors import ConfigError
from octo_arm_model.core.rod.kinematics import Pose
from octo_arm_model.core.solver import MODELS
from octo_arm_model.experiment.recording.alignment import Alignment
from octo_arm_model.experiment.recording.csv_recording import DISPLACEMENT, CsvSources
from octo_arm_model.experiment.recording.csv_table import read_columns
from octo_arm_model.experiment.recording.measured_points import LENGTH_UNITS, Measured
from octo_arm_model.experiment.recording.observations import Observations, Pairing, observe
from octo_arm_model.experiment.recording.read_recording import read_recording
from octo_arm_model.experiment.recording.recording import Recording
from octo_arm_model.experiment.recording.steady_windows import SteadyRule

ALL = 'all'
EPILOG = """\
recordings of laboratories, for compare and identify alike:
  octo-arm compare trial --tensions /daq/cells:data --tendons 3 0 1 -
  octo-arm compare trial --midlines /mocap/markers --marker-s 0 0.09 0.18 0.27 --length-unit mm
  octo-arm compare trial --marker-s 0.09 0.27 --marker-frames middle tip
  octo-arm compare trial --ramp
  octo-arm compare --config arm.yaml --tension-csv loads.csv --midline-csv track.csv \\
      --columns time=Zeit tendon_1_1="LC 1" tendon_1_2=0 tendon_1_3=0 tendon_1_4=0

how a recording is read:
  Tensions are steady while none of them leaves a band of twice --steady, for at least --hold; the
  first --settle seconds do not count. The frames of the camera in a steady step become its mean
  midline, without those more than three times as far from the median as the median frame. The
  base is the end of the midlines that moves least, or --base-end. The offset of the camera's clock
  is found from the motion, or --clock-offset. What the model published itself (backbone/path,
  tip_pose) is no measurement unless named by --midlines. All these decisions are printed.

exit status: 0 done, 1 no trustworthy answer or nothing to compare, 2 the input is wrong
"""


def add_recording(parser: argparse.ArgumentParser, default: str = 'that of the config') -> None:
    """Add the bag and how it is read; without --model it is the ``default``."""
    bag = 'rosbag2 folder, .mcap or .db3 file with tensions and measured midlines or tips'
    parser.add_argument('bag', nargs='?', type=Path, metavar='BAG', help=bag)
    add_config_option(parser, None, 'the arm_description in the bag')
    parser.add_argument(
        '--model',
        nargs='+',
        choices=(*MODELS, ALL),
        metavar='MODEL',
        help=f'models: {", ".join(MODELS)} or {ALL} (default: {default})',
    )
    parser.add_argument(
        '--midlines',
        nargs='+',
        default=[],
        metavar='TOPIC',
        help='measured midlines (nav_msgs/Path, geometry_msgs/PoseArray) or tips '
        '(geometry_msgs/PoseStamped, PoseWithCovarianceStamped, PointStamped, TransformStamped); '
        'by default the only ones there; with --marker-s perhaps one of each marker, with '
        '--marker-frames topics of TF',
    )
    parser.add_argument(
        '--marker-s',
        nargs='+',
        type=float,
        default=[],
        metavar='S',
        help='arc coordinates of markers [m], from the base on: what is measured are points at '
        'these, NaN where a marker is hidden, and no midlines',
    )
    parser.add_argument(
        '--marker-frames',
        nargs='+',
        default=[],
        metavar='FRAME',
        help='their frames in /tf and /tf_static, or in the topics of --midlines, in the same '
        'order; chains of frames are followed to base_frame, or else to their root',
    )
    parser.add_argument(
        '--length-unit',
        choices=LENGTH_UNITS,
        default='m',
        help='of what was measured (default: %(default)s)',
    )
    parser.add_argument(
        '--tensions',
        metavar='TOPIC[:FIELD]',
        help='tensions, or any numeric field of any topic; by default the only ones there',
    )
    parser.add_argument(
        '--displacements',
        metavar='TOPIC',
        help='lengths that winches have reeled in, as encoders read them '
        '(sensor_msgs/JointState, position [m] by name); by default tendon_displacements; where '
        'no tensions were recorded these follow from them (model exact)',
    )
    add_tendons(parser)
    parser.add_argument(
        '--align',
        nargs='+',
        metavar='A',
        help="'fit' the camera's pose; 'none': it measures in base_frame; or X Y Z QX QY QZ QW, "
        "its pose in base_frame (default: 'none' if the midlines are in base_frame, else 'fit')",
    )
    tables = parser.add_argument_group(
        'CSV files', 'in place of topics; with midlines and readings from them there is no BAG'
    )
    text = 'tensions: time [s] and a column for each tendon [N]'
    add_path(tables, '--tension-csv', 'CSV', text)
    text = 'midlines, tips or markers: time [s], and x, y, z [m] or x1, y1, z1, x2 ... [m]'
    add_path(tables, '--midline-csv', 'CSV', text)
    text = f'encoders: time [s] and a column {DISPLACEMENT}TENDON for each that has one [m]'
    add_path(tables, '--displacement-csv', 'CSV', text)
    tables.add_argument(
        '--columns',
        nargs='+',
        default=[],
        metavar='NAME=COLUMN',
        help='columns of other names, or a number in place of one (tendon_1_2=0), or a YAML file '
        'of such; units are those in the header, such as "force [mN]"',
    )
    pairing = parser.add_argument_group('pairing of frames and tensions')
    tolerance = (
        'how far stamps may be off [s] (default: %(default)s): a frame has a sample of tensions '
        'within this time, and lies at least that far inside its steady step'
    )
    add_number(pairing, '--tolerance', 0.1, tolerance, 'S')
    pairing.add_argument(
        '--clock-offset',
        type=float,
        metavar='S',
        help='to add to the stamps of frames [s]; by default found from the motion',
    )
    pairing.add_argument(
        '--base-end',
        choices=('first', 'last'),
        help='point of the midlines at the base; by default the end that moves least',
    )
    pairing.add_argument(
        '--steady',
        type=float,
        metavar='N',
        help='half the band that steady tensions stay in [N] (default: the larger of 2 percent '
        'of the highest tension and four times the noise)',
    )
    add_number(pairing, '--hold', 1.0, 'least duration of a steady step [s]', 'S')
    pairing.add_argument(
        '--ramp',
        nargs='?',
        type=float,
        const=math.nan,
        metavar='N',
        help='tensions change slowly instead of in steps, and the arm is in equilibrium all the '
        'time: windows of so many N (default: 5 percent of the highest tension, or eight times '
        'the noise)',
    )
    settle = 'time from its beginning until the arm is at rest [s]'
    add_number(pairing, '--settle', 0.5, settle, 'S')


def read_options(
    options: argparse.Namespace, default_models: Sequence[str] = ()
) -> tuple[Recording, Observations, list[str], Alignment | None, list[str]]:
    """The recording of `add_recording`'s options, and how it is to be compared.

    Without --model it is ``default_models``, or the config's if there are none.

    Returns:
        The recording, its shapes, the models, the alignment (None for one to be fitted) and
        notes on these choices.

    Raises:
        OctoArmError: if the bag or an option is wrong, or the bag holds nothing to compare.
    """
    tolerance, offset = options.tolerance, options.clock_offset
    if not (math.isfinite(tolerance) and tolerance >= 0.0):
        raise ConfigError(f'--tolerance is {tolerance!r}, expected a time >= 0 [s]')
    if offset is not None and not math.isfinite(offset):
        raise ConfigError(f'--clock-offset is {offset!r}, expected a finite time [s]')
    steady = SteadyRule(options.steady, options.hold, options.settle)
    if options.align is not None:
        read_alignment(options.align)  # Checked before the bag is read.
    measured = Measured(
        tuple(options.midlines), tuple(options.marker_s), tuple(options.marker_frames),
        options.length_unit,
    )  # fmt: skip
    columns = read_columns(options.columns)
    with Bar('messages, rows and values') as bar:
        recording = read_recording(
            options.bag,
            options.config,
            options.tensions,
            measured,
            CsvSources(
                options.tension_csv, options.midline_csv, options.displacement_csv, columns
            ),
            options.tendons,
            options.displacements,
            progress=bar.on_terminal,
        )
    config = Config.from_parameters(recording.parameters)
    notes: list[str] = []
    if options.align is not None:
        alignment = read_alignment(options.align)
    elif recording.frame_id == config.base_frame:
        alignment = Alignment.none()
        notes.append(f'midlines are in base_frame, {config.base_frame}: no alignment')
    else:
        alignment = None
        notes.append(
            f'midlines are in {recording.frame_id!r}, base_frame is {config.base_frame!r}: the '
            'alignment is fitted'
        )
    ramp = options.ramp
    width = None if ramp is None or math.isnan(ramp) else ramp
    pairing = Pairing(steady, tolerance, offset, options.base_end, ramp is not None, width)
    with Bar('clock offsets') as bar:
        observations = observe(recording, pairing, alignment, bar.on_terminal)
    return (
        recording,
        observations,
        _models(options.model or default_models, config),
        alignment,
        notes,
    )


def _models(given: Sequence[str], config: Config) -> list[str]:
    if not given:
        return [config.model]
    return list(MODELS) if ALL in given else list(dict.fromkeys(given))


def read_alignment(words: Sequence[str]) -> Alignment | None:
    """The alignment of ``--align``; None for one to be fitted.

    Raises:
        ConfigError: if it is none.
    """
    if list(words) == ['fit']:
        return None
    if list(words) == ['none']:
        return Alignment.none()
    try:
        x, y, z, *quaternion = (float(word) for word in words)
        a, b, c, d = quaternion
    except ValueError:
        raise ConfigError(
            f'--align is {" ".join(words)}, expected fit, none or X Y Z QX QY QZ QW'
        ) from None
    try:
        return Alignment.from_pose(Pose((x, y, z), (a, b, c, d)))
    except ConfigError as error:
        raise ConfigError(f'--align: {str(error).replace("base.", "")}') from error
