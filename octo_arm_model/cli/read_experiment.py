"""The recording that compare and identify are given, read as their options say."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import TypeVar

from octo_arm_model.arm.errors import ConfigError, MeasurementError, SolveError, shown
from octo_arm_model.arm.limits import MAX_YAML_BYTES
from octo_arm_model.arm.pose import Pose
from octo_arm_model.arm.validation import finite, not_negative
from octo_arm_model.cli.options.experiment import ALL
from octo_arm_model.cli.options.shared import refuse_without_effect
from octo_arm_model.cli.output.progress import Bar
from octo_arm_model.config.config import Config
from octo_arm_model.config.yaml_files import load_yaml, read_text, reading
from octo_arm_model.experiment.fitting.unknowns.unknown import AXIAL
from octo_arm_model.experiment.recording.csv_recording import CsvSources
from octo_arm_model.experiment.recording.measured_points import Measured
from octo_arm_model.experiment.recording.read_recording import read_recording
from octo_arm_model.experiment.recording.recording import Recording
from octo_arm_model.experiment.shapes.alignment import Alignment
from octo_arm_model.experiment.shapes.observations import (
    POSES,
    RAMP,
    STEPS,
    Observations,
    Pairing,
    observe,
)
from octo_arm_model.experiment.shapes.steady_windows import SteadyRule
from octo_arm_model.rod.solver import MODELS

T = TypeVar('T')


def read_options(
    options: argparse.Namespace, default_models: Sequence[str] = ()
) -> tuple[Recording, Observations, list[str], Alignment | None, list[str]]:
    """The recording of `add_recording`'s options, and how it is to be compared.

    Without --model it is ``default_models``, or the config's if there are none.

    Returns:
        The recording, its shapes, the models, the alignment (None for one to be fitted) and
        notes on all choices.

    Raises:
        OctoArmError: if the bag or an option is wrong, or the bag holds nothing to compare.
    """
    tolerance, offset = options.tolerance, options.clock_offset
    not_negative('--tolerance', tolerance, 'time', 's')
    if offset is not None:
        finite('--clock-offset', offset, 'a finite time [s]')
    steady = SteadyRule(options.steady, options.hold, options.settle)
    kind = POSES if options.poses else STEPS if options.ramp is None else RAMP
    if kind != STEPS:
        idle = '--steady', '--hold', '--settle'
        refuse_without_effect(options, idle, f'with --{"poses" if options.poses else "ramp"}')
    alignment = None if options.align is None else read_alignment(options.align)
    measured = Measured(
        tuple(options.midlines), tuple(options.marker_s), tuple(options.marker_frames),
        options.length_unit,
    )  # fmt: skip
    columns = _columns(options.columns)
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
    if recording.is_driven:
        refuse_without_effect(options, ('--tendons',), 'on encoder readings, which have names')
    elif AXIAL not in getattr(options, 'fit', ()):
        why = f'beside tensions, which count, but for identify --fit {AXIAL}'
        refuse_without_effect(options, ('--displacements', '--displacement-csv'), why)
    if recording.is_tips or recording.marker_s is not None:
        refuse_without_effect(options, ('--base-end',), 'on tips and markers')
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
    width = None if options.ramp is True else options.ramp
    pairing = Pairing(steady, tolerance, offset, options.base_end, kind, width)
    with Bar('clock offsets') as bar:
        observations = observe(recording, pairing, alignment, bar.on_terminal)
    models = _models(options.model or default_models, config)
    return recording, observations, models, alignment, [*observations.notes, *notes]


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


def _columns(words: Sequence[str]) -> dict[str, str]:
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
