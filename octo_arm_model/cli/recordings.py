"""Options that compare and identify share, and the recording read as they say."""

import argparse
from collections.abc import Callable, Sequence
from typing import TypeVar

from octo_arm_model.arm.errors import ConfigError, MeasurementError, SolveError, shown
from octo_arm_model.arm.limits import MAX_YAML_BYTES
from octo_arm_model.arm.pose import Pose
from octo_arm_model.arm.validation import finite, not_negative
from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import Bar
from octo_arm_model.config.config import Config
from octo_arm_model.config.files import load_yaml, read_text, reading
from octo_arm_model.experiment.camera import Alignment
from octo_arm_model.experiment.csv_recording import DISPLACEMENT, CsvSources
from octo_arm_model.experiment.motion import TensionTrajectory
from octo_arm_model.experiment.observations import (
    MOMENTS,
    POSES,
    RAMP,
    STEPS,
    Observations,
    Pairing,
    observe,
)
from octo_arm_model.experiment.read_recording import read_recording
from octo_arm_model.experiment.recording import LENGTH_UNITS, MarkerSources, Recording
from octo_arm_model.experiment.steady_windows import SteadyRule
from octo_arm_model.experiment.unknowns import OF_ENCODERS
from octo_arm_model.rod.solver import MODELS

ALL = 'all'
# How recordings are read, behind the examples of each of the commands.
RECORDINGS = """\
recordings of laboratories, for compare and identify alike:
  octo-arm compare trial --tensions /daq/cells:data --tendons 3 0 1 -
  octo-arm compare trial --midlines /mocap/markers --marker-s 0 0.09 0.18 0.27 --length-unit mm
  octo-arm compare trial --marker-s 0.09 0.27 --marker-frames middle tip
  octo-arm compare trial --displacements /winches/encoders
  octo-arm compare trial --displacements /servos:angle --motors 0 1 0 1 --spools .01 .01 -.01 -.01
  octo-arm compare trial --ramp
  octo-arm compare --config arm.yaml --tension-csv poses.csv --midline-csv tips.csv --poses
  octo-arm compare --config arm.yaml --tension-csv loads.csv --midline-csv track.csv \\
      --columns time=Zeit tendon_1_1="LC 1" tendon_1_2=0 tendon_1_3=0 tendon_1_4=0

how a recording is read:
  Tensions are steady while none of them leaves a band of twice --steady, for at least --hold; the
  first --settle seconds do not count. With --poses each row is a step, with the frames within
  --tolerance of its stamp. The frames of the camera in a step become its mean midline, without
  those more than three times as far from the median as the median frame. The base is the end of
  the midlines that moves least, or --base-end. The offset of the camera's clock is found from the
  motion, or --clock-offset. What the model published itself (backbone/path, tip_pose) is no
  measurement unless named by --midlines. All these decisions are printed.

exit status: 0 done, 1 no trustworthy answer or nothing to compare, 2 the input is wrong
"""


def add_recording(parser: argparse.ArgumentParser, default: str = 'that of the config') -> None:
    """Add the bag and how it is read; without --model it is the ``default``."""
    bag = 'rosbag2 folder, .mcap or .db3 file with tensions and measured midlines or tips'
    parser.add_argument('bag', nargs='?', type=arguments.path_of, metavar='BAG', help=bag)
    arguments.add_config_option(parser, None, 'the arm_description in the bag')
    parser.add_argument(
        '--model',
        nargs='+',
        choices=(*MODELS, ALL),
        metavar='MODEL',
        help=f'models: {", ".join(MODELS)} or {ALL} (default: {default})',
    )
    text = (
        'measured midlines (nav_msgs/Path, geometry_msgs/PoseArray) or tips '
        '(geometry_msgs/PoseStamped, PointStamped, TransformStamped), sensor_msgs/PointCloud2, or '
        'any field of points or poses of any message; by default the only ones there; with '
        '--marker-s perhaps one of each marker, with --marker-frames topics of TF'
    )
    arguments.add_values(parser, '--midlines', 'TOPIC[:FIELD]', text)
    text = (
        'arc coordinates of markers [m], from the base on: what is measured are points at these, '
        'NaN where a marker is hidden, and no midlines'
    )
    arguments.add_values(parser, '--marker-s', 'S', text, float)
    text = (
        'their frames in /tf and /tf_static, or in the topics of --midlines, in the same order; '
        'chains of frames are followed to base_frame, or else to their root'
    )
    arguments.add_values(parser, '--marker-frames', 'FRAME', text)
    text = (
        'their names among those of one message, or their numbers there from 0 on, or in a table '
        'of columns NAME_x, NAME_y, NAME_z, in the same order'
    )
    arguments.add_values(parser, '--marker-names', 'NAME', text)
    parser.add_argument(
        '--length-unit',
        choices=LENGTH_UNITS,
        default='m',
        help='of what was measured (default: %(default)s)',
    )
    text = 'tensions, or any numeric field of any topic; by default the only ones there'
    arguments.add_value(parser, '--tensions', 'TOPIC[:FIELD]', text)
    text = (
        'lengths that winches have reeled in, as encoders read them (sensor_msgs/JointState, '
        'position [m] by name), or any numeric field of any topic, see --motors and --spools; by '
        'default tendon_displacements; where no tensions were recorded these follow from them '
        '(model exact)'
    )
    arguments.add_value(parser, '--displacements', 'TOPIC[:FIELD]', text)
    arguments.add_tendons(parser)
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
    arguments.add_path(tables, '--tension-csv', 'CSV', text)
    text = 'midlines, tips or markers: time [s], and x, y, z [m] or x1, y1, z1, x2 ... [m]'
    arguments.add_path(tables, '--midline-csv', 'CSV', text)
    text = f'encoders: time [s] and a column {DISPLACEMENT}TENDON for each that has one [m]'
    arguments.add_path(tables, '--displacement-csv', 'CSV', text)
    text = 'a table of static poses: in each row tensions or encoders, and what was measured; '
    arguments.add_path(tables, '--pose-csv', 'CSV', f'{text}with or without a time')
    add_columns(tables)
    pairing = parser.add_argument_group('pairing of frames and tensions')
    tolerance = (
        'how far stamps may be off [s] (default: %(default)s): a frame has a sample of tensions '
        'within this time, and lies at least that far inside its steady step'
    )
    arguments.add_number(pairing, '--tolerance', 0.1, tolerance, 'S')
    text = 'to add to the stamps of frames [s]; by default found from the motion'
    arguments.add_value(pairing, '--clock-offset', 'S', text, float)
    pairing.add_argument(
        '--base-end',
        choices=('first', 'last'),
        help='point of the midlines at the base; by default the end that moves least',
    )
    text = (
        'half the band that steady tensions stay in [N], or lengths [m] where there are no '
        'tensions (default: the larger of 2 percent of the highest and four times the noise, as '
        'far as that is below 5 percent of it)'
    )
    arguments.add_value(pairing, '--steady', 'N', text, float)
    arguments.add_number(pairing, '--hold', 1.0, 'least duration of a steady step [s]', 'S')
    kind = pairing.add_mutually_exclusive_group()
    arguments.add_dynamic(pairing, kind)
    kind.add_argument(
        '--ramp',
        nargs='?',
        type=float,
        const=True,
        metavar='N',
        help='tensions change slowly instead of in steps, and the arm is in equilibrium all the '
        'time: windows of so many N (default: 5 percent of the highest tension, or eight times '
        'the noise)',
    )
    text = 'each row of tensions is a static pose, as in a table of poses'
    arguments.add_flag(kind, '--poses', text)
    settle = 'time from its beginning until the arm is at rest [s]'
    arguments.add_number(pairing, '--settle', 0.5, settle, 'S')


def add_columns(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """Add ``--columns``."""
    text = (
        'columns of other names, or #N for the N-th, or a number in place of one (tendon_1_2=0), '
        'or a YAML file of such; of one file alone tension:, midline: or displacement:NAME; units '
        'are those in the header, such as "force [mN]"'
    )
    arguments.add_values(parser, '--columns', 'NAME=COLUMN', text)


def _read_files(options: argparse.Namespace) -> CsvSources:
    """The CSV files that options name; MeasurementError if they do not go together."""
    columns, pose = read_columns(options.columns), options.pose_csv
    if pose is None:
        named = options.tension_csv, options.midline_csv, options.displacement_csv
        return CsvSources(*named, columns)
    for name in ('tension_csv', 'midline_csv', 'displacement_csv'):
        if getattr(options, name) is not None:
            raise MeasurementError(
                f'--pose-csv and --{name.replace("_", "-")} are given, expected one or the other'
            )
    return CsvSources(pose, pose, None, columns, is_poses=True)


def _read_pairing(options: argparse.Namespace) -> tuple[Pairing, float | None]:
    """How frames are paired with tensions, and the step of a motion [s], None of equilibria.

    OctoArmError if an option is wrong, or has no effect.
    """
    not_negative('--tolerance', options.tolerance, 'time', 's')
    if options.clock_offset is not None:
        finite('--clock-offset', options.clock_offset, 'a finite time [s]')
    steady = SteadyRule(options.steady, options.hold, options.settle)
    step = arguments.read_dynamic(options)
    is_poses = options.poses or options.pose_csv is not None
    kind = POSES if is_poses else RAMP if options.ramp is not None else STEPS
    other = {POSES: 'poses', RAMP: 'ramp', STEPS: 'dynamic'}[kind]
    if step is not None:
        if kind != STEPS:
            raise ConfigError(f'--dynamic, or a fit of a motion, does not go with --{other}')
        kind = MOMENTS
    if kind != STEPS:
        arguments.refuse_without_effect(
            options, ('--steady', '--hold', '--settle'), f'with --{other}'
        )
    width = None if options.ramp is True else options.ramp
    given = options.tolerance, options.clock_offset, options.base_end, kind, width
    return Pairing(steady, *given), step


T = TypeVar('T')


def read_options(
    options: argparse.Namespace, default_models: Sequence[str] = ()
) -> tuple[
    Recording, Observations, list[str], Alignment | None, list[str], TensionTrajectory | None
]:
    """The recording of `add_recording`'s options, and how it is to be compared.

    Without --model it is ``default_models``, or the config's if there are none.

    Returns:
        The recording; its shapes; names of the models; the alignment of the camera, None for one
        to be fitted; notes on all choices; and the tensions along which the arm moves, None where
        it is in equilibrium.

    Raises:
        OctoArmError: if the bag or an option is wrong, or the bag holds nothing to compare.
    """
    pairing, step = _read_pairing(options)
    alignment = None if options.align is None else read_alignment(options.align)
    measured = MarkerSources(
        tuple(options.midlines),
        tuple(options.marker_s),
        tuple(options.marker_frames),
        options.length_unit,
        tuple(options.marker_names),
    )
    files = _read_files(options)
    with Bar('messages') as bar:
        recording = read_recording(
            options.bag,
            options.config,
            options.tensions,
            measured,
            files,
            arguments.read_calibration(options),
            options.displacements,
            progress=bar.on_terminal,
        )
    if recording.is_driven:
        arguments.refuse_without_effect(
            options, ('--tendons',), 'on encoder readings, which have names'
        )
    elif not {*OF_ENCODERS} & {*getattr(options, 'fit', ())}:
        why = f'beside tensions, which count, but for identify --fit {" ".join(OF_ENCODERS)}'
        arguments.refuse_without_effect(
            options, ('--displacements', '--displacement-csv', '--motors', '--spools'), why
        )
    if recording.is_tips or recording.marker_s is not None:
        arguments.refuse_without_effect(options, ('--base-end',), 'on tips and markers')
    config = Config.from_parameters(recording.parameters)
    notes: list[str] = []
    if options.align is None and recording.frame_id == config.base_frame:
        alignment = Alignment.none()
        notes.append(f'midlines are in base_frame, {config.base_frame}: no alignment')
    elif options.align is None:
        notes.append(
            f'midlines are in {recording.frame_id!r}, base_frame is {config.base_frame!r}: the '
            'alignment is fitted'
        )
    observations, trajectory = observe(recording, pairing, alignment), None
    models = _models(options.model or default_models, config)
    if step is not None:
        trajectory = TensionTrajectory(recording.tension_time, recording.tensions, step)
        models = _models(options.model or ['exact'], config)
        if models != ['exact']:
            raise ConfigError(f'--model is {" ".join(models)}, of which only exact moves')
    found = [*observations.notes, *notes]
    return recording, observations, models, alignment, found, trajectory


def of_each(
    models: Sequence[str], done: str, notes: list[str], work: Callable[[str], T]
) -> list[T]:
    """Results of ``work`` for those ``models`` where it raises no ConfigError or SolveError.

    For the others ``notes`` say why they are not ``done``, such as 'compared'.

    Raises:
        ConfigError: that of the last model, if there is no result for any.
        SolveError: likewise.
    """
    found: list[T] = []
    for model in models:
        try:
            found.append(work(model))
        except (ConfigError, SolveError) as error:
            if model == models[-1] and not found:
                raise
            notes.append(f'{model} is not {done}: {error}')
    return found


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
    pose = Pose.called('--align: position', '--align: quaternion', (x, y, z), (a, b, c, d))
    return Alignment.from_pose(pose)


def read_columns(words: Sequence[str]) -> dict[str, str]:
    """Columns by what they are, from ``words`` name=COLUMN, or the name of a YAML file of such.

    Raises:
        MeasurementError: if a word is neither, or the file cannot be read.
    """
    found: dict[str, str] = {}

    def take(name: str, column: str) -> None:
        if name in found:
            raise MeasurementError(f'--columns names {shown(name)} twice, expected once')
        found[name] = column

    for word in words:
        name, equals, column = word.partition('=')
        if equals and name and column:
            take(name, column)
            continue
        if not word.endswith(('.yaml', '.yml')):
            raise MeasurementError(
                f'--columns has {shown(word)}, expected name=COLUMN or a YAML file'
            )
        with reading(word, MeasurementError):
            content = load_yaml(read_text(word, MAX_YAML_BYTES))
        if not isinstance(content, dict) or not all(
            isinstance(value, (str, int, float)) and not isinstance(value, bool)
            for value in content.values()
        ):
            raise MeasurementError(f'{word}: expected names with a column each, such as time: t')
        for key, value in content.items():
            take(str(key), str(value))
    return found
