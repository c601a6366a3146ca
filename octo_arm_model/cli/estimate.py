"""``octo-arm estimate``: shape and contact force of an arm, from a recording."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.validation import finite, not_negative
from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import Bar, check_out, unwritten, writing
from octo_arm_model.cli.recordings import COLUMNS, read_alignment, read_columns
from octo_arm_model.config.parameter import Parameter
from octo_arm_model.estimation.estimator import EstimatorOutput
from octo_arm_model.estimation.settings import (
    CONTACTS,
    ESTIMATOR_PARAMETERS,
    PREFIX,
    RECORDING_DEFAULTS,
)
from octo_arm_model.estimation.unknowns import Unknowns
from octo_arm_model.wire.measurements import MARKERS, MEASUREMENT_TOPICS
from octo_arm_model.wire.tensions import DISPLACEMENTS

if TYPE_CHECKING:
    from octo_arm_model.arm.hints import FloatArray
    from octo_arm_model.bags.reader import BagReader
    from octo_arm_model.experiment.estimates import Moment, Output, Result, Touch
    from octo_arm_model.experiment.sensor_recording import SensorRecording, Sources


# Prefixes of parameters that describe sensors; the others describe what is unknown.
_SENSORS = tuple(row.parameters for row in MEASUREMENT_TOPICS.values())
_OF_ARM = ('tension_stddev', 'material.youngs_modulus_stddev')  # options of the arm itself
_APART = ('contact', 'contact_s', 'window')  # set by another option, or used by the node only
TENSIONS = 'tensions'
# The sensors that options apply to, by the prefixes of their names.
_OF_SENSOR = {
    'tendons': TENSIONS,
    'motors': DISPLACEMENTS,
    'spools': DISPLACEMENTS,
    'marker_names': MARKERS,
    'tension_stddev': TENSIONS,
    f'{PREFIX}tension_bias': TENSIONS,
    **{PREFIX + row.parameters: name for name, row in MEASUREMENT_TOPICS.items()},
}


def _offered() -> list[Parameter]:
    """Return the parameters that have an option of the same name."""
    return [row for row in ESTIMATOR_PARAMETERS if row.name.removeprefix(PREFIX) not in _APART]


def _parameter_options(of_sensors: bool) -> str:
    """Return options for parameters of the estimator: ``of_sensors``, or of what is unknown."""
    options = []
    for row in _offered():
        name = row.name.removeprefix(PREFIX)
        word = 'S...' if name == 'marker_s' else 'X'
        default = 'none' if row.is_array else f'{RECORDING_DEFAULTS.get(row.name, row.default):g}'
        if name.startswith(_SENSORS) == of_sensors:
            head = f'{_option(name)} {word} {row.kind.__name__} -> {row.name}'
            options.append(f'{head}: {row.description} (default: {default})')
    return '\n'.join(options)


def _refuse_idle(
    options: argparse.Namespace, sensors: Collection[str], unknowns: Mapping[str, Unknowns]
) -> None:
    """Check that each of the given options has an effect; ConfigError if one has none.

    ``sensors`` are those with measurements: `TENSIONS`, and names in `MEASUREMENT_TOPICS`.
    """
    for name in sorted(options.given):
        why = ''
        for prefix, sensor in _OF_SENSOR.items():
            if name.startswith(prefix) and sensor not in sensors:
                why = f'without {sensor}; there are {", ".join(sensors)}'
        if name == f'{PREFIX}force_stddev' and list(unknowns) == ['none']:
            why = 'with --contact none'
        if why:
            raise ConfigError(f'{_option(name)} has no effect {why}')


def _option(name: str) -> str:
    """Return the option that sets the parameter ``name``."""
    return f'--{name.removeprefix(PREFIX).replace("_", "-")}'


def _read_estimator(options: argparse.Namespace) -> dict[str, Any]:
    """Return the parameters that options set; ConfigError if --contact is not a contact."""
    names = [*_OF_ARM, *(row.name for row in _offered())]
    given = {name: getattr(options, name) for name in names}
    values = {name: value for name, value in given.items() if value not in (None, [])}
    if options.contact:
        contact, *places = options.contact
        if contact not in CONTACTS:
            raise ConfigError(f'--contact is {contact}, expected one of {", ".join(CONTACTS)}')
        try:
            values[f'{PREFIX}contact_s'] = [float(place) for place in places]
        except ValueError:
            raise ConfigError(
                f'--contact {contact} is followed by {" ".join(places)}, expected arc coordinates '
                '[m]'
            ) from None
        values[f'{PREFIX}contact'] = contact
    return values


def as_dict(result: Result, notes: Sequence[str]) -> dict[str, Any]:
    """Return the summary of a ``result`` in SI units, without the estimates of each time."""
    return {
        'times': len(result.moments),
        'touches': [
            {
                'start': touch.start,
                'stop': touch.stop,
                'contact': touch.hypothesis,
                'force': touch.force.tolist(),
                'force_stddev': touch.stddev.tolist(),
            }
            for touch in result.touches
        ],
        'innovations': {
            name: {
                'accepted': record.accepted,
                'refused': record.refused,
                'mean_square': record.mean if record.size else None,
            }
            for name, record in result.consistency.items()
        },
        'suspects': [
            {'sensors': list(names), 'times': len(times), 'start': times[0], 'stop': times[-1]}
            for names, times in result.suspects.items()
        ],
        'restarts': list(result.restarts),
        'without_estimate': result.failures.of(''),
        'left_out': result.recorded.refusals.lines(),
        'keeps_prior': list(result.unobserved),
        'hypotheses': dict(result.hypotheses),
        'camera': None
        if result.camera is None
        else {
            'frames': len(result.camera.time),
            'tip_error': [_median(errors) for errors in result.camera.tip],
            'mean_error': [_median(errors) for errors in result.camera.mean],
        },
        'notes': list(notes),
    }


def summary(result: Result, notes: Sequence[str], files: Sequence[str]) -> str:
    """Return the summary of a ``result`` as text, with the names of the written ``files``."""
    recorded, lines = result.recorded, [*notes]
    lines.append(f'{len(result.moments)} times estimated from {", ".join(recorded.sensors.all)}')
    lines += [_touch(touch) for touch in result.touches]
    if list(recorded.settings.unknowns) == ['none']:
        lines.append('touches are not looked for, with contact none')
    elif not result.touches:
        hidden = any('force' in why or 'current' in why for why in result.unobserved)
        found = 'no touch found, but not all forces are observable' if hidden else 'not touched'
        lines.append(f'{found}: no force is larger than its uncertainty explains')
    if len(result.hypotheses) > 1:
        parts = [f'{name} {100.0 * mean:.0f} %' for name, mean in result.hypotheses.items()]
        lines.append(f'place of contact, mean probability: {", ".join(parts)}')
    tip = 1e3 * np.median([moment.tip_stddev for moment in result.moments], axis=0)
    deviations = ', '.join(f'{value:.2f}' for value in tip)
    lines.append(f'tip known to {deviations} mm in x, y, z (median standard deviation)')
    for name, record in result.consistency.items():
        mean = f', normalised innovation {record.mean:.2f} (1)' if record.size else ''
        lines.append(f'{name}: {record.accepted} used{mean}')
        if record.refused_from is not None and record.refused_to is not None:
            stamps = record.refused_from, record.refused_to
            start, stop = (1e-9 * (stamp - recorded.origin_ns) for stamp in stamps)
            lines.append(
                f'  {record.refused} refused, which do not fit the rest, from {start:.2f} to '
                f'{stop:.2f} s'
            )
    lines += [
        f'one of these sensors may lie: {", ".join(names)} (at {len(times)} time(s) from '
        f'{times[0]:.2f} to {times[-1]:.2f} s)'
        for names, times in result.suspects.items()
    ]
    lines += [
        f'reset at {time:.2f} s: sensors agreed with each other and contradicted the estimate'
        for time in result.restarts
    ]
    lines += [
        f'{count} times without an estimate, as {reason}'
        for reason, count in result.failures.of('').items()
    ]
    lines += recorded.refusals.lines()
    if result.camera is not None:
        lines += _camera(result)
    lines += [f'not observable: {reason}' for reason in result.unobserved]
    lines += [f'{file} written' for file in files]
    return '\n'.join(lines)


def _touch(touch: Touch) -> str:
    """Describe one touch in a sentence."""
    size = 1e3 * float(np.linalg.norm(touch.force))
    parts = ', '.join(
        f'{1e3 * value:.1f} +- {1e3 * stddev:.1f}'
        for value, stddev in zip(touch.force, touch.stddev, strict=True)
    )
    where = {'tip': 'at the tip', 'current': 'by a current'}.get(
        touch.hypothesis, f'at {touch.hypothesis}'
    )
    return f'touched {where} from {touch.start:.2f} to {touch.stop:.2f} s: {size:.1f} mN ({parts})'


def _camera(result: Result) -> list[str]:
    """Describe the errors against the camera, for all frames and for those during a touch."""
    camera, check = result.camera, result.recorded.camera
    assert camera is not None and check is not None
    touched = np.zeros(camera.time.size, dtype=bool)
    for touch in result.touches:
        touched |= (camera.time >= touch.start) & (camera.time <= touch.stop)
    lines = []
    for when, frames in (('', np.ones_like(touched)), (' while touched', touched)):
        if not frames.any():
            continue
        for name, pair in (('tip', camera.tip), ('midline', camera.mean)):
            error, plain = (_median(errors[frames]) for errors in pair)
            if error is not None and plain is not None:
                lines.append(
                    f'against {check.topic}{when}: {name} off by {1e3 * error:.2f} mm, without '
                    f'the estimator {1e3 * plain:.2f} mm (medians of {frames.sum()} frames)'
                )
    return lines


def _median(values: FloatArray) -> float | None:
    """Return the median of the finite ``values``; None if there are none."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else None


SUMMARY = 'estimate shape and contact force from the measurements in a bag'
DESCRIPTION = """\
Estimate the shape of an arm, the contact force on it and the covariance of both, from those of
these measurements that a bag has, each with its own noise and rate:

  tendon_tensions          readings of load cells, in any form that replay reads
{measured}

The inputs of the model are estimated: true tensions, a contact and, if wanted, biases and E.
Measurements that contradict the others are refused and reported. Midlines of a camera are not
used for the estimate; the estimate is compared with them.
""".format(measured='\n'.join(f'  {n:24} {r.description}' for n, r in MEASUREMENT_TOPICS.items()))
EPILOG = """\
examples:
  octo-arm record-demo touched --touch 0.02
  octo-arm estimate touched --plot touch.png
  octo-arm estimate touched --smooth --out estimated --csv tables
  octo-arm estimate touched --contact at 0.2 --force-stddev 0.05
  octo-arm estimate touched --contact somewhere --markers - --json
  octo-arm estimate trial --markers /mocap/points --marker-s 0.09 0.18 0.27 --align 0 0 0.5 1 0 0 0
  octo-arm estimate trial --config arm.yaml --tension-bias-stddev 0.05 --modulus-stddev 0.1

how to read the summary:
  A touch is a time in which the force is larger than its covariance explains by chance (0.1 %).
  A normalised innovation is the square of the difference between measurement and prediction,
  divided by its covariance and per number. It is 1 if noise, priors and model are right, well
  over 1 if one of them is worse than assumed, and under 1 if it is better. Directions that no
  measurement depends on keep their prior: a force along a straight arm does not move its tip.
  With friction, the loss of tension along a tendon is unknown. The displacement of a slack tendon
  counts as that of a tendon just taut: if winches let tendons hang, leave displacements out with
  --tendon-displacements -.

exit status: 0 done, 1 the arm has no trustworthy shape at any time, 2 the input is wrong or OUT
cannot be written, 130 interrupted
"""


def _topic_options() -> str:
    """Return the options of the topics of measurements."""
    options = []
    for name, row in MEASUREMENT_TOPICS.items():
        word = 'TOPIC[:FIELD]' if name in (DISPLACEMENTS, MARKERS) else 'TOPIC'
        head = f'{_option(name.rsplit("/", 1)[-1])} {word} -> {name}'
        options.append(f'{head}: topic to use instead of {name} ({row.type_name})')
    return '\n'.join(options)


OPTIONS = f"""\
bag BAG path: rosbag2 folder, .mcap, .db3 or .csv file, which is not changed
{arguments.OF_BAG}
--smooth: estimate each time from the whole recording instead of earlier measurements only
[topics] by default topics of the names above, in any namespace; - for none
--tensions TOPIC[:FIELD]: tensions, or any numeric field of any topic
{_topic_options()}
--midlines TOPIC: midlines of a camera to compare with: nav_msgs/Path, PoseArray, or tips (default:
    camera/midline)
{arguments.TENDONS}
{COLUMNS}
--marker-names NAME...: names or numbers of the markers at --marker-s in a message of --markers
    TOPIC:FIELD, or in columns NAME_x, NAME_y and NAME_z of a table
--align A...: pose in base_frame of any other frame of measurements: X Y Z QX QY QZ QW, none if it
    equals base_frame, or fit (default: the pose of the camera is fitted, those of other frames are
    the transforms of the bag, without which measurements are refused)
--clock-offset S float: offset added to the stamps of --midlines [s]; by default found from the
    motion
[what is unknown]
--contact C...: {', '.join(CONTACTS)}: what acts on the arm besides its known loads; at S is a
    force at the arc coordinate S [m], somewhere one at S ..., or, without these, at five even
    steps (default: tip)
--modulus-stddev PART float -> material.youngs_modulus_stddev: standard deviation of E over E [-];
    0 if E is known (default: that of the arm)
{_parameter_options(of_sensors=False)}
[how exact sensors are]
--tension-stddev N float: standard deviation of the tensions [N] (default: tension_stddev of the
    arm, or else that of the recording)
{_parameter_options(of_sensors=True)}
[output] besides the summary
--out OUT path: new bag to write, with the topics of BAG and those of octo_arm_estimator
--rate HZ = 10.0: largest number of estimates per second in OUT; 0 for all
--no-copy: write only the estimates to OUT
--csv DIR path: folder for estimate.csv and innovations.csv
--plot PNG path: picture of force and tip with their bands of 95 percent
[]
{arguments.STORAGE}
{arguments.JSON}
"""


def run(options: argparse.Namespace) -> int:
    """Estimate from the measurements in the bag, and print and write the results."""
    from octo_arm_model.experiment.estimates import EstimateTables, estimate
    from octo_arm_model.experiment.sensor_recording import read_sensor_recording
    from octo_arm_model.experiment.table_bag import opened

    check_out(options, '--csv', folder=True)
    check_out(options, '--plot', folder=False, draws=True)
    not_negative('--rate', options.rate, 'rate', 'Hz')
    if options.out is None:
        arguments.refuse_without_effect(
            options, ('--rate', '--no-copy', '--storage'), 'without --out'
        )
    sources, out = _sources(options), options.out
    with contextlib.ExitStack() as resources:
        columns = read_columns(options.columns)
        with Bar('messages') as bar:
            bag = opened(options.bag, sources, columns, with_points=True)
            reader, sources = resources.enter_context(bag)
            recorded = read_sensor_recording(reader, sources, bar.on_terminal)
        notes = list(recorded.notes)
        sensors = ([TENSIONS] if recorded.sensors.tensions else []) + list(recorded.sensors.others)
        _refuse_idle(options, sensors, recorded.settings.unknowns)
        if recorded.camera is None:
            arguments.refuse_without_effect(
                options, ('--clock-offset',), 'without --midlines to compare'
            )
        outputs: list[Output] = []
        if out is not None:
            resources.enter_context(unwritten(out))
            write_bag, not_copied = _bag_output(options, resources, reader, recorded)
            outputs.append(write_bag)
            notes += not_copied
        if options.csv is not None:
            place = resources.enter_context(writing(options.csv, folder=True))
            tables = resources.enter_context(EstimateTables(place, recorded.models))
            outputs.append(tables.write)
        with Bar('times') as bar:
            result = estimate(recorded, options.smooth, outputs, bar)
    if options.plot is not None:
        from octo_arm_model.experiment.pictures import draw_estimate, save

        with writing(options.plot) as place:
            save(draw_estimate(result.moments, result.touches, result.camera), place)
    files = [str(path) for path in (out, options.csv, options.plot) if path is not None]
    notes += recorded.settings.notes
    print(json.dumps(as_dict(result, notes)) if options.json else summary(result, notes, files))
    return 0


def _sources(options: argparse.Namespace) -> Sources:
    """Return the topics, parameters and calibration that options give, or raise OctoArmError."""
    from octo_arm_model.experiment.sensor_recording import Sources

    if options.clock_offset is not None:
        finite('--clock-offset', options.clock_offset, 'a finite time [s]')
    return Sources(
        options.tensions,
        {name: getattr(options, name) for name in MEASUREMENT_TOPICS},
        options.midlines,
        arguments.read_config_option(options),
        _read_estimator(options),
        arguments.read_calibration(options),
        read_alignment(options.align) if options.align else None,
        options.clock_offset,
        tuple(options.marker_names),
    )


def _bag_output(
    options: argparse.Namespace,
    resources: contextlib.ExitStack,
    reader: BagReader,
    recorded: SensorRecording,
) -> tuple[Output, list[str]]:
    """Return a function that writes estimates to --out, at most --rate per second, and remarks."""
    from octo_arm_model.bags.outputs import copy_bag, estimate_output
    from octo_arm_model.bags.writer import BagWriter

    custom = {**reader.metadata, 'octo_arm_estimate': f'estimates for {options.bag.name}'}
    writer = resources.enter_context(BagWriter(options.out, options.storage, custom))
    prefix = recorded.sensors.prefix
    not_copied = {} if options.no_copy else copy_bag(reader, writer, prefix)
    described = recorded.parameters, recorded.models, reader.start_ns
    write_estimate = estimate_output(writer, prefix, *described)
    period, due = 1.0 / options.rate if options.rate else 0.0, -math.inf

    def write(moment: Moment, update: EstimatorOutput) -> None:
        nonlocal due
        if moment.time < due - 1e-9:
            return
        due = max(due + period, moment.time) if math.isfinite(due) else moment.time + period
        write_estimate(update.hypothesis, update.estimate, moment.stamp_ns, moment.received_ns)

    return write, [f'{topic} not copied: {why}' for topic, why in not_copied.items()]
