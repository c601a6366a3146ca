"""``octo-arm replay``: compute the shapes for the tensions in a bag."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import time
from typing import TYPE_CHECKING

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import Bar, check_out, unwritten, writing
from octo_arm_model.cli.recordings import COLUMNS, read_columns

if TYPE_CHECKING:
    from octo_arm_model.bags.replay import Report

SUMMARY = 'add the shapes of the arm to a bag of tensions'
DESCRIPTION = """\
Answer every message of tensions or tendon_displacements in a bag as the node would, and write a
new bag with the content of the old one and the answers: backbone/path, backbone/poses, strains and
tip_pose, and tendon_tension_estimates if tendons are driven by length. Answers have the namespace
and the stamps of the inputs. ROS is not needed, and no message is skipped, at whatever rate they
were recorded.
"""
EPILOG = """\
examples:
  octo-arm replay experiment experiment_shapes
  octo-arm replay experiment exact_shapes --model exact --config renda2012_prototype
  octo-arm replay rosbag2_2024_05_02 shapes --topics /arm_1/tendon_tensions --storage sqlite3
  octo-arm replay experiment.mcap shapes --no-copy --json
  octo-arm replay experiment shapes --topics /tendon_tensions     # without tendon_displacements
  octo-arm replay swings shapes --dynamic --config my_arm.yaml

IN is a rosbag2 folder, of MCAP or sqlite3, or one of their files, or a table (.csv) with columns
of tensions or displacements and perhaps time; it is not changed. The arm is that of --config, or
else of the topic arm_description, which the node publishes. Messages without valid tensions of the
arm (wrong number or names, NaN, negative), and those without a trustworthy solution, are left out,
counted and listed with their stamps. Each solution of a loaded arm starts from the last one, or
from the unloaded shape after a stamp that runs backwards. The loads are those of the config; a
tip_wrench in IN is not applied. With --dynamic the arm is at rest at first, and again after stamps
that run backwards or are more than 10 s apart. If a step fails, there are no answers until then.

OUT appears when it is complete, and not at all after Ctrl-C or on a full disk. Shapes are solved
faster if numba is installed (the extra compiled).

exit status: 0 done, 1 no message has a trustworthy answer, 2 the input is wrong (no bag, damaged,
no tensions, none for this arm) or OUT cannot be written, 130 interrupted
"""


OPTIONS = f"""\
bag IN path: bag with tensions, or a table of tensions whose name ends in .csv
out OUT path: new bag to write
{arguments.OF_BAG}
{arguments.MODEL}
{arguments.DYNAMIC}
{arguments.DYNAMIC_STEP}
--topics TOPIC[:FIELD]...: topics of tensions or displacements, or any numeric field of any topic
    (default: all with the names that the node listens to, in any namespace, or else the only one
    of such a type)
--displacements TOPIC[:FIELD]...: further topics of displacements, or any numeric field of any
    topic, with --motors
{arguments.TENDONS}
{COLUMNS}
--lengths: write tendon_lengths too
--no-copy: write only the answers, without the content of IN
--csv DIR path: folder for stations.csv and tensions.csv, which `octo-arm play` reads if stamps
    rise
{arguments.STORAGE}
--json: print one JSON object
"""


def run(options: argparse.Namespace) -> None:
    """Write the bag of answers, and print how many messages have an answer."""
    from octo_arm_model.bags.replay import CsvAnswers, replay
    from octo_arm_model.bags.topics import find_arms
    from octo_arm_model.bags.writer import BagWriter
    from octo_arm_model.experiment.sensor_recording import Sources
    from octo_arm_model.experiment.table_bag import opened

    step = arguments.read_dynamic(options)
    if step is not None and options.model not in (None, 'exact'):
        raise ConfigError(f'--model is {options.model}, which does not move: expected exact')
    given = arguments.read_config_option(options), arguments.read_calibration(options)
    start = time.monotonic()
    check_out(options, '--csv', folder=True)
    wanted = Sources(parameters=given[0], calibration=given[1])
    bag = opened(options.bag, wanted, read_columns(options.columns), with_points=False)
    with unwritten(options.out), Bar('messages') as bar, bag as (reader, rest):
        of_arm = rest.parameters, options.model, rest.calibration
        arms = find_arms(reader, options.topics, *of_arm, options.displacements)
        sources = [source for arm in arms for source in arm.sources]
        are_lengths = {source.is_displacements for source in sources}
        if False not in are_lengths:
            why = 'on displacements, which have names'
            arguments.refuse_without_effect(options, ('--tendons',), why)
        if True not in are_lengths:
            why = 'on tensions alone, without encoders'
            arguments.refuse_without_effect(options, ('--motors', '--spools'), why)
        custom = {**reader.metadata, 'octo_arm_replay': f'shapes for {options.bag.name}'}
        with contextlib.ExitStack() as open_files:
            writer = open_files.enter_context(BagWriter(options.out, options.storage, custom))
            table = None
            if options.csv is not None:
                place = open_files.enter_context(writing(options.csv, folder=True))
                topics = [source.topic for source in sources]
                table = open_files.enter_context(CsvAnswers(place, topics))
            report = replay(
                reader,
                writer,
                arms,
                copy=not options.no_copy,
                lengths=options.lengths,
                step=step,
                table=table,
                progress=bar,
            )
        duration = reader.duration
    elapsed = time.monotonic() - start
    if options.json:
        content = dataclasses.asdict(report)
        del content['refusals']
        for name in report.topics:
            content['topics'][name]['reasons'] = report.refusals.of(name)
        content |= {'out': str(options.out), 'duration': duration, 'elapsed': elapsed}
        print(json.dumps(content))
    else:
        print(summary(report))
        print(f'{options.out}: {duration:.4g} s recorded, replayed in {elapsed:.4g} s')


def summary(report: Report) -> str:
    """Return the counts and reasons of a replay as text."""
    lines = []
    for name, topic in report.topics.items():
        lines.append(f'{name}: {topic.answered} answered by {topic.model}')
        for count, what in (
            (topic.refused, 'refused'),
            (topic.failed, 'without a trustworthy answer'),
            (topic.unsorted, 'with a stamp before that of the last'),
        ):
            if count:
                lines.append(f'  {count} {what}')
        for reason, count in report.refusals.of(name).items():
            lines.append(f'  {count} as {reason}')
        for stamp_ns, reason in topic.skips[:10]:
            lines.append(f'  {stamp_ns * 1e-9:.6f} s: {reason}')
        if (more := topic.refused + topic.failed - 10) > 0:
            lines.append(f'  ... and {more} more')
    if report.copied:
        lines.append(f'{report.copied} messages copied')
    lines += report.notes
    lines += [f'{topic} not copied: {why}' for topic, why in report.not_copied.items()]
    return '\n'.join(lines)
