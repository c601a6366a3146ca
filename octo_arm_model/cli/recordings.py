"""Options that compare and identify share, and the recording that they describe."""

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
from octo_arm_model.experiment.unknowns import OF_ENCODERS, OF_MOTION
from octo_arm_model.rod.solver import MODELS

ALL = 'all'
# The part of the help of both commands about recordings.
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
  Tensions are steady while all of them stay in bands of twice --steady for at least --hold; the
  first --settle seconds do not count. With --poses each row is a step, with the frames within
  --tolerance of its stamp. The frames of the camera in a step are averaged to its mean midline,
  without those more than three times as far from the median as the median frame. The base is the
  end of the midlines that moves least, or --base-end. The offset of the camera's clock is found
  from the motion, or is --clock-offset. Outputs of the model (backbone/path, tip_pose) are not
  used as measurements unless --midlines names them. All these decisions are printed.

exit status: 0 done, 1 no trustworthy answer or nothing to compare, 2 the input is wrong
"""


COLUMNS = """\
--columns NAME=COLUMN...: column of the quantity NAME: its header, #N for the N-th column, or a
    constant (tendon_1_2=0); or a YAML file of such pairs; tension:NAME, midline:NAME or
    displacement:NAME for one of the files; units are those in the header, as "force [mN]"
"""
_SOURCES = f"""\
--midlines TOPIC[:FIELD]...: measured midlines (nav_msgs/Path, geometry_msgs/PoseArray) or tips
    (geometry_msgs/PoseStamped, PointStamped, TransformStamped), sensor_msgs/PointCloud2, or any
    field of points or poses of any message; by default the only such topic; with --marker-s one
    topic for all or for each marker, with --marker-frames topics of TF
--marker-s S... float: arc coordinates of markers [m], from the base on: the measured points are
    those of the markers, NaN if one is hidden, instead of midlines
--marker-frames FRAME...: frames of the markers in /tf and /tf_static, or in the topics of
    --midlines, in the same order; chains of frames are followed to base_frame, or else to their
    root
--marker-names NAME...: names of the markers in a message or in columns NAME_x, NAME_y, NAME_z of a
    table, or their numbers in a message from 0 on, in the same order
--length-unit {arguments.choice(LENGTH_UNITS)} = m: unit of the measured points
--tensions TOPIC[:FIELD]: tensions, or any numeric field of any topic; by default the only topic of
    tensions
--displacements TOPIC[:FIELD]: lengths that winches have reeled in, as encoders read them
    (sensor_msgs/JointState, position [m] by name), or any numeric field of any topic with --motors
    and --spools; by default tendon_displacements; if no tensions were recorded, the model exact
    computes them from these lengths
{arguments.TENDONS}
--align A...: pose of the camera in base_frame: 'fit', 'none' if it measures in base_frame, or X Y
    Z QX QY QZ QW (default: 'none' if the midlines are in base_frame, or move in it by /tf, which
    is used then; else 'fit')
[CSV files] instead of topics; BAG is left out if midlines and readings are in CSV files
--tension-csv CSV path: tensions: time [s] and a column for each tendon [N]
--midline-csv CSV path: midlines, tips or markers: time [s], and x, y, z [m] or x1, y1, z1, x2 ...
    [m]
--displacement-csv CSV path: encoders: time [s] and a column {DISPLACEMENT}TENDON for each encoder
    [m]
--pose-csv CSV path: a table of static poses: each row has tensions or encoders, and the measured
    points; a time is optional
{COLUMNS}
[pairing of frames and tensions]
--tolerance S = 0.1: tolerance of stamps [s]: a frame needs a sample of tensions within this time,
    and must lie at least that far inside its steady step
--clock-offset S float: offset added to the stamps of frames [s]; by default found from the motion
--base-end {{first,last}}: end of the midlines at the base; by default the end that moves least
--steady N float: half of the band that steady tensions stay in [N], or lengths [m] if there are no
    tensions (default: 2 percent of the highest, or four times the noise if that is larger, but at
    most 5 percent of the highest)
--hold S = 1.0: least duration of a steady step [s]
{arguments.DYNAMIC_STEP}
(
{arguments.DYNAMIC}
--ramp N? float: tensions change slowly instead of in steps, and the arm is always in equilibrium:
    each window spans N newtons (default: 5 percent of the highest tension, or eight times the
    noise)
--poses: each row of tensions is a static pose, as in a table of poses
)
--settle S = 0.5: time from the start of a step until the arm is at rest [s]
[]
"""


def recording_options(default: str) -> str:
    """Return the bag and the options to read it; the help of --model names the ``default``."""
    return f"""\
bag BAG? path: rosbag2 folder, .mcap or .db3 file with tensions and measured midlines or tips
{arguments.OF_BAG}
--model MODEL... {arguments.choice((*MODELS, ALL))}: models: {', '.join(MODELS)} or {ALL} (default:
    {default})
{_SOURCES}"""


def _read_files(options: argparse.Namespace) -> CsvSources:
    """Return the CSV files that options name; ConfigError if they exclude each other."""
    columns, pose = read_columns(options.columns), options.pose_csv
    if pose is None:
        paths = options.tension_csv, options.midline_csv, options.displacement_csv
        return CsvSources(*paths, columns)
    others = '--tension-csv', '--midline-csv', '--displacement-csv'
    arguments.refuse_without_effect(options, others, 'with --pose-csv')
    return CsvSources(pose, pose, None, columns, is_poses=True)


def _read_pairing(options: argparse.Namespace) -> tuple[Pairing, float | None]:
    """Return the rule that pairs frames with tensions, and the step of a motion [s] or None.

    OctoArmError if an option is wrong, or has no effect.
    """
    not_negative('--tolerance', options.tolerance, 'time', 's')
    if options.clock_offset is not None:
        finite('--clock-offset', options.clock_offset, 'a finite time [s]')
    steady = SteadyRule(options.steady, options.hold, options.settle)
    # Only a motion depends on some parameters.
    fits_motion = not {*OF_MOTION}.isdisjoint(getattr(options, 'fit', ()))
    step = arguments.read_dynamic(options, fits_motion)
    is_poses = options.poses or options.pose_csv is not None
    kind = POSES if is_poses else RAMP if options.ramp is not None else STEPS
    option = {POSES: 'poses', RAMP: 'ramp', STEPS: 'dynamic'}[kind]
    if step is not None:
        if kind != STEPS:
            raise ConfigError(f'--dynamic, or a fit of a motion, does not go with --{option}')
        kind = MOMENTS
    if kind != STEPS:
        arguments.refuse_without_effect(
            options, ('--steady', '--hold', '--settle'), f'with --{option}'
        )
    if options.pose_csv is not None:  # A row is one measurement: it has one time, if any.
        of_stamps = '--clock-offset', '--tolerance'
        arguments.refuse_without_effect(options, of_stamps, 'with --pose-csv')
    tolerance = options.tolerance if options.pose_csv is None else 0.0
    width = None if options.ramp is True else options.ramp
    of_pairing = tolerance, options.clock_offset, options.base_end, kind, width
    return Pairing(steady, *of_pairing), step


T = TypeVar('T')


def read_options(
    options: argparse.Namespace, default_models: Sequence[str] = ()
) -> tuple[Recording, Observations, list[str], Pose | None, list[str], TensionTrajectory | None]:
    """Read the recording of `recording_options`, and prepare its comparison.

    Without --model the models are ``default_models``, or that of the config if there are none; an
    arm that moves has the model exact.

    Returns:
        The recording; its shapes; the names of the models; the alignment of the camera, None if it
        is to be fitted; notes on all choices; and the tensions over time of a moving arm, None for
        equilibria.

    Raises:
        OctoArmError: if the bag or an option is wrong, or the bag has nothing to compare.
    """
    pairing, step = _read_pairing(options)
    alignment = read_alignment(options.align) if options.align else None
    markers = MarkerSources(
        tuple(options.midlines),
        tuple(options.marker_s),
        tuple(options.marker_frames),
        options.length_unit,
        tuple(options.marker_names),
        bool(options.align),
    )
    files = _read_files(options)
    with Bar('messages') as bar:
        recording = read_recording(
            options.bag,
            options.config,
            options.tensions,
            markers,
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
    if not options.align and recording.frame_id == config.base_frame:
        alignment = Pose()
        notes.append(f'midlines are in base_frame, {config.base_frame}: no alignment')
    elif not options.align:
        notes.append(
            f'midlines are in {recording.frame_id!r}, base_frame is {config.base_frame!r}: the '
            'alignment is fitted'
            if recording.frame_id
            else f'the midlines name no frame: their alignment with {config.base_frame} is fitted'
        )
    observations, trajectory = observe(recording, pairing, alignment), None
    names = options.model or (['exact'] if step is not None else default_models or [config.model])
    models = list(MODELS) if ALL in names else list(dict.fromkeys(names))
    if step is not None:
        trajectory = TensionTrajectory(recording.tension_time, recording.tensions, step)
        if models != ['exact']:
            raise ConfigError(f'--model is {" ".join(models)}, of which only exact moves')
    all_notes = [*observations.notes, *notes]
    return recording, observations, models, alignment, all_notes, trajectory


def of_each(
    models: Sequence[str], done: str, notes: list[str], work: Callable[[str], T]
) -> list[T]:
    """Return the results of ``work`` for those ``models`` for which it succeeds.

    For the others ``notes`` say why they are not ``done``, such as 'compared'.

    Raises:
        ConfigError: for the last model, if ``work`` has failed for all.
        SolveError: for the last model, if ``work`` has failed for all.
    """
    results: list[T] = []
    for model in models:
        try:
            results.append(work(model))
        except (ConfigError, SolveError) as error:
            if model == models[-1] and not results:
                raise
            notes.append(f'{model} is not {done}: {error}')
    return results


def read_alignment(words: Sequence[str]) -> Pose | None:
    """Return the alignment that ``--align`` gives; None if it is to be fitted.

    Raises:
        ConfigError: if the ``words`` are not an alignment.
    """
    if list(words) == ['fit']:
        return None
    if list(words) == ['none']:
        return Pose()
    try:
        x, y, z, *quaternion = (float(word) for word in words)
        a, b, c, d = quaternion
    except ValueError:
        raise ConfigError(
            f'--align is {" ".join(words)}, expected fit, none or X Y Z QX QY QZ QW'
        ) from None
    names = '--align: position', '--align: quaternion'
    return Pose((x, y, z), (a, b, c, d), names)


def read_columns(words: Sequence[str]) -> dict[str, str]:
    """Return columns by name, from ``words`` such as name=COLUMN or names of YAML files.

    Raises:
        MeasurementError: if a word is neither, or the file cannot be read.
    """
    columns: dict[str, str] = {}

    def add(name: str, column: str) -> None:
        if name in columns:
            raise MeasurementError(f'--columns names {shown(name)} twice, expected once')
        columns[name] = column

    for word in words:
        name, equals, column = word.partition('=')
        if equals and name and column:
            add(name, column)
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
            add(str(key), str(value))
    return columns
