"""``octo-arm estimate``: where and how hard an arm was touched, from a recording."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from octo_arm_model.arm.validation import finite, not_negative
from octo_arm_model.cli.options.estimator import (
    TENSIONS,
    add_estimator,
    read_estimator,
    refuse_idle,
)
from octo_arm_model.cli.options.shared import (
    add_config_option,
    add_flag,
    add_json,
    add_number,
    add_path,
    add_storage,
    add_tendons,
    add_value,
    read_config_option,
    refuse_without_effect,
)
from octo_arm_model.cli.output.estimate import as_dict, summary
from octo_arm_model.cli.output.files import check_out, refuse_inside, unwritten, writing
from octo_arm_model.cli.output.progress import Bar
from octo_arm_model.cli.read_experiment import read_alignment
from octo_arm_model.wire.measurement_messages import MEASUREMENT_TOPICS

if TYPE_CHECKING:
    from octo_arm_model.bags.reader import BagReader
    from octo_arm_model.experiment.estimating.estimates import TimedEstimate
    from octo_arm_model.experiment.estimating.history import Moment
    from octo_arm_model.experiment.estimating.recorded import Recorded, Sources
    from octo_arm_model.experiment.estimating.run import Result

SUMMARY = 'estimate shape and contact force from all that a bag holds'
DESCRIPTION = """\
Estimate the shape of an arm, the force that touches it and how well both are known, from whatever
a bag holds of these, each with its noise and at its own rate:

  tendon_tensions          what load cells read, in any form that replay reads
  tendon_displacements     sensor_msgs/JointState: lengths that winches have reeled in [m]
  measured/tip_pose        geometry_msgs/PoseWithCovarianceStamped
  measured/markers         geometry_msgs/PoseArray: points of the midline, with --marker-s
  measured/base_wrench     geometry_msgs/WrenchStamped: what a sensor under the base feels

Estimated are the inputs of the model: true tensions, a contact, perhaps biases and E. What does
not fit the rest is refused, and reported. Midlines of a camera are only compared with.
"""
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
  Normalised innovations are squares of what was measured less what was predicted, by their
  covariance and per number: 1 where noise, priors and model are as told; well over 1 where
  something is worse than that, under 1 where it is better. Directions that keep their prior are
  those that nothing measured tells of: a force along a straight arm does not move its tip.
  Friction of tendons makes their loss of tension along the arm unknown. A slack tendon's
  displacement counts as that of one just taut: leave the displacements out
  (--tendon-displacements -) where winches let tendons hang.

exit status: 0 done, 1 the arm has no trustworthy shape at any time, 2 the input is wrong or OUT
cannot be written, 130 interrupted
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    add_path(parser, 'bag', 'BAG', 'rosbag2 folder, .mcap or .db3 file; it stays as it is')
    add_config_option(parser, None, 'the arm_description in the bag')
    text = 'estimate each time from the whole recording instead of what was measured before'
    add_flag(parser, '--smooth', text)
    topics = parser.add_argument_group(
        'topics', 'by default those of the names above, in whatever namespace; - for none'
    )
    text = 'tensions, or any numeric field of any topic'
    add_value(topics, '--tensions', 'TOPIC[:FIELD]', text)
    for name, row in MEASUREMENT_TOPICS.items():
        topics.add_argument(
            f'--{name.rsplit("/", 1)[-1].replace("_", "-")}',
            dest=name,
            metavar='TOPIC',
            help=f'in place of {name} ({row.type_name})',
        )
    text = 'of a camera, to compare with: nav_msgs/Path, PoseArray, or tips (default: '
    add_value(topics, '--midlines', 'TOPIC', f'{text}camera/midline)')
    add_tendons(parser)
    topics.add_argument(
        '--align',
        nargs='+',
        metavar='A',
        help='pose in base_frame of frames that are not base_frame: X Y Z QX QY QZ QW, or none '
        'for the same, or fit (default: that of the camera is fitted, and other measurements in '
        'such a frame are refused)',
    )
    text = 'to add to the stamps of --midlines [s]; by default found from the motion'
    add_value(topics, '--clock-offset', 'S', text, float)
    add_estimator(parser)
    output = parser.add_argument_group('output', 'besides the summary')
    text = 'bag to write, not there yet: what BAG holds, and the topics of octo_arm_estimator'
    add_path(output, '--out', 'OUT', text)
    add_number(output, '--rate', 10.0, 'estimates a second in OUT at most; 0 for all', 'HZ')
    add_flag(output, '--no-copy', 'write to OUT the estimates alone')
    add_storage(parser)
    add_path(output, '--csv', 'DIR', 'folder for estimate.csv and innovations.csv')
    add_path(output, '--plot', 'PNG', 'picture of force and tip with their bands of 95 percent')
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Estimate from the bag, and print and write what was found."""
    from octo_arm_model.bags.reader import BagReader
    from octo_arm_model.experiment.estimating.recorded import read_recorded
    from octo_arm_model.experiment.estimating.run import estimate

    refuse_inside(options.bag, options.out, options.csv, options.plot)
    check_out(options, '--csv', folder=True)
    check_out(options, '--plot', folder=False, draws=True)
    not_negative('--rate', options.rate, 'rate', 'Hz')
    if options.out is None:
        refuse_without_effect(options, ('--rate', '--no-copy', '--storage'), 'without --out')
    sources, out = _sources(options), options.out
    with contextlib.ExitStack() as opened:
        reader = opened.enter_context(BagReader(options.bag))
        with Bar('messages') as bar:
            recorded = read_recorded(reader, sources, bar.on_terminal)
        sensors = ([TENSIONS] if recorded.sensors.tensions else []) + list(recorded.sensors.others)
        refuse_idle(options, sensors, recorded.settings.unknowns)
        if recorded.camera is None:
            refuse_without_effect(options, ('--clock-offset',), 'without --midlines to compare')
        outputs = []
        if out is not None:
            opened.enter_context(unwritten(out))
            outputs.append(_bag_output(options, opened, reader, recorded))
        if options.csv is not None:
            from octo_arm_model.experiment.estimating.tables import EstimateTables

            place = opened.enter_context(writing(options.csv, folder=True))
            tables = opened.enter_context(EstimateTables(place, recorded.models))
            outputs.append(tables.write)

        def write(moment: Moment, one: TimedEstimate) -> None:
            for output in outputs:
                output(moment, one)

        with Bar('times') as bar:
            result = estimate(recorded, options.smooth, write, bar)
    if options.plot is not None:
        _draw(options.plot, result)
    files = [str(path) for path in (out, options.csv, options.plot) if path is not None]
    print(json.dumps(as_dict(result)) if options.json else summary(result, files))
    return 0


def _sources(options: argparse.Namespace) -> Sources:
    """Where everything is taken from; OctoArmError if an option is wrong."""
    from octo_arm_model.experiment.estimating.recorded import Sources

    if options.clock_offset is not None:
        finite('--clock-offset', options.clock_offset, 'a finite time [s]')
    return Sources(
        options.tensions,
        {name: getattr(options, name) for name in MEASUREMENT_TOPICS},
        options.midlines,
        read_config_option(options),
        read_estimator(options),
        options.tendons,
        None if options.align is None else read_alignment(options.align),
        options.clock_offset,
    )  # fmt: skip


def _bag_output(
    options: argparse.Namespace,
    opened: contextlib.ExitStack,
    reader: BagReader,
    recorded: Recorded,
) -> Callable[[Moment, TimedEstimate], None]:
    """A function that writes estimates to the bag --out, at most --rate of them a second."""
    from octo_arm_model.bags.estimate_output import EstimateOutput, copy_bag
    from octo_arm_model.bags.writer import BagWriter

    custom = {**reader.metadata, 'octo_arm_estimate': f'estimates for {options.bag.name}'}
    writer = opened.enter_context(BagWriter(options.out, options.storage, custom))
    prefix = recorded.sensors.prefix
    if not options.no_copy:
        left_out = copy_bag(reader, writer, prefix)
        recorded.notes.extend(f'{topic} not copied: {why}' for topic, why in left_out.items())
    bag = EstimateOutput(writer, prefix, recorded.parameters, recorded.models, reader.start_ns)
    period = 1.0 / options.rate if options.rate else 0.0
    due = -math.inf

    def write(moment: Moment, one: TimedEstimate) -> None:
        nonlocal due
        if moment.time < due - 1e-9:
            return
        due = max(due + period, moment.time) if math.isfinite(due) else moment.time + period
        bag.write(one.hypothesis, one.estimate, one.stamp_ns, one.received_ns)

    return write


def _draw(path: Path, result: Result) -> None:
    """Write the picture of a ``result``."""
    from octo_arm_model.experiment.estimating.figures import draw_estimate
    from octo_arm_model.experiment.figure_files import save

    figure = draw_estimate(result.moments, result.touches, result.camera)
    with writing(path) as place:
        save(figure, place)
