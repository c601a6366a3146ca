"""Options that several commands share."""

import argparse
import contextlib
import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, TensionError, shown
from octo_arm_model.arm.loads import TIP_FRAMES
from octo_arm_model.arm.material import LAWS, WATERS, WaterCoefficients
from octo_arm_model.arm.validation import within
from octo_arm_model.config.config import Config, load_config
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.rod.displacements import check_displacements
from octo_arm_model.rod.motion import STEPS
from octo_arm_model.rod.solver import MODELS
from octo_arm_model.simulation.moving_arm import STEP

ARM_FILE = 'ROS parameter file of the arm, or the name of a preset'


def refuse_without_effect(options: argparse.Namespace, names: Sequence[str], why: str) -> None:
    """Check that none of the options ``names`` is given; ``why`` completes the message.

    Raises:
        ConfigError: if one is given, because it has no effect.
    """
    for name in names:
        key = name.lstrip('-').replace('-', '_')
        is_set = key in getattr(options, 'given', ())
        if is_set or getattr(options, key) != options.default_of(key):
            raise ConfigError(f'{name} has no effect {why}')


def path_of(text: str) -> Path:
    """Return ``text`` as a path.

    Raises:
        ArgumentTypeError: if it is empty, for example from a shell variable that is not set: an
            empty path would be the current folder.
    """
    if not text:
        raise argparse.ArgumentTypeError('empty, expected a path')
    return Path(text)


_TYPES = {'float': float, 'int': int, 'path': path_of}
_LINE = re.compile(  # name, words, type or choices, default, name in the namespace, help
    rf'[\w-]+( [^a-z{{ ]+)*( ({"|".join(_TYPES)}|{{\S+}}))?( = .+?)?( -> \S+)?: .'
)


def add(parser: argparse.ArgumentParser, text: str) -> None:
    """Add the options and arguments that a ``text`` describes, in the order of their lines.

    Each begins a line with its name, words for its values, and behind a colon its help, which
    goes on in indented lines. Values are texts, unless a type (float, int, path) or the choices
    are behind the words, or the default is a number. An option without a word is a flag.
    ValueError is raised if a line is none of these::

        --hold S = 1.0: a number, with its default
        --marker-s S... float: one or more values, by default none
        --tip X Y Z float: as many values as words
        --storage {mcap,sqlite3} = mcap: one of these
        --gate X float -> estimator.gate: a number with another name in the namespace
        bag BAG? path: an argument that may be left out; of an option, its value
        [physics] the options from here on are in this group, with this description
        (
        --dynamic: flags and options between such lines exclude each other
        )
        [] from here on they are in no group
    """
    place: Any = parser
    groups: dict[str, Any] = {'': parser}
    for entry in re.split(r'\n(?=\S)', text.strip()):
        entry = ' '.join(entry.split())
        if entry.startswith('['):
            title, _, description = entry[1:].partition(']')
            if title not in groups:
                groups[title] = parser.add_argument_group(title, description.strip() or None)
            place = groups[title]
        elif entry == '(':
            outer, place = place, place.add_mutually_exclusive_group()
        elif entry == ')':
            place = outer
        elif _LINE.match(entry):
            _add_one(place, entry)
        else:
            raise ValueError(f'{entry!r} is no option: expected NAME WORDS TYPE = DEFAULT: HELP')


def _add_one(place: Any, entry: str) -> None:
    """Add one option or argument to a parser or a group."""
    head, _, explanation = entry.partition(': ')
    head, _, dest = head.partition(' -> ')
    head, _, default = head.partition(' = ')
    name, *words = head.split(' ')
    how: dict[str, Any] = {'help': explanation.replace('%', '%%')}
    if dest:
        how['dest'] = dest
    if not words:
        place.add_argument(name, action='store_true', **how)
        return
    if words[-1] in _TYPES:
        how['type'] = _TYPES[words.pop()]
    elif words[-1].startswith('{'):
        how['choices'] = words.pop().strip('{}').split(',')
    if default:
        how['help'] += ' (default: %(default)s)'
        how['default'] = yaml.safe_load(default)
        how.setdefault('type', type(how['default']))
    if len(words) > 1:
        how |= {'nargs': len(words), 'metavar': tuple(words)}
    elif words:
        how['metavar'] = words[0].removesuffix('...').removesuffix('?')
        if words[0].endswith('...'):
            how |= {'nargs': '+', 'default': []}
        elif words[0].endswith('?'):
            how |= {'nargs': '?', 'const': True}
    place.add_argument(name, **how)


def choice(values: Iterable[str]) -> str:
    """Return the word of `add` for one of ``values``."""
    return f'{{{",".join(values)}}}'


OF_BAG = f'--config CONFIG: {ARM_FILE} (default: the arm_description in the bag)'


def read_config_option(options: argparse.Namespace) -> dict[str, Any] | None:
    """Return the parameters that ``--config`` names; None if it is not given.

    Raises:
        ConfigError: if there is no such file or preset, or it cannot be read.
    """
    return None if options.config is None else load_parameters(options.config)


# Options for the tendons of a recording.
TENDONS = """\
--tendons NAME...: name of each tendon of the arm, from the tip, in the recording; a number from 0
    on if the recording has no names; - for a slack tendon (default: tension_names of the arm)
--motors NAME...: name or number of the encoder of each tendon, from the tip, in the recording;
    tendons on one motor share its encoder (default: displacement_names of the arm)
--spools M... float: length reeled in per unit of the encoder [m], such as the radius of the spool
    for radians; < 0 if a positive reading lets the tendon out; one number for all tendons or one
    for each (default: displacement_scale of the arm)
"""
MODEL = f'--model {choice(MODELS)}: model, instead of that of the config'
STORAGE = '--storage {mcap,sqlite3} = mcap: storage format of OUT'  # of the bag OUT
JSON = '--json: print one JSON object, in SI units'


def read_calibration(options: argparse.Namespace) -> dict[str, Any]:
    """Return the parameters that the options `TENDONS` set."""
    options_by_name = {
        'tension_names': options.tendons,
        'displacement_names': options.motors,
        'displacement_scale': options.spools,
    }
    return {name: list(values) for name, values in options_by_name.items() if values}


def highest_option(default: str, of: str = '') -> str:
    """Return the option of the upper limits of tensions; ``default`` describes the default."""
    text = 'one number, or rows as for solve --tensions; by default'
    return f'--highest N: largest tension [N]{of}: {text} {default}'


def read_highest(options: argparse.Namespace) -> Any:
    """Return the value of ``--highest``; None if it is not given.

    Raises:
        TensionError: if it is not JSON, or neither a number nor a list.
    """
    text = options.highest
    if text is None:
        return None
    highest = read_json(text, '--highest', "3 or '[[0.5,0.5,0.5,0.5]]'")
    if highest is None or isinstance(highest, (str, dict)):
        raise TensionError(f'--highest is {text}, expected a number or rows of numbers [N]')
    return highest


CONFIG = f'config CONFIG: {ARM_FILE} such as renda2012_table4'
ARM = f"""\
{CONFIG}
{MODEL}
--stations N int: number of stations, instead of that of the config
[physics] instead of what the config says; with --model exact
--material {choice(LAWS)}: elastic law of the cross sections
--gravity X Y Z float: acceleration of gravity in base_frame [m/s^2], e.g. 0 0 -9.81
--density RHO float: density of the arm [kg/m^3]
--fluid-density RHO float: density of the surrounding fluid [kg/m^3]
--tip-force X Y Z float: force on the tip, in base_frame or in the axes of --tip-frame [N]
--tip-moment X Y Z float: moment on the tip, in base_frame or in the axes of --tip-frame [N m]
--tip-frame {choice(TIP_FRAMES)}: axes of force and moment: base, or tip for its t, n and b, which
    turn with it
[]
"""
MOVING_ARM = f"""\
{ARM}
[motion] instead of what the config says
--viscosity ETA float: viscosity of the material [Pa s]
--water {choice(WATERS)}: coefficients of drag and added mass, in a fluid of --fluid-density
[]
"""


def read_config(options: argparse.Namespace, model: str | None = None) -> Config:
    """Return the config that the options `ARM` describe.

    Without --model the model is ``model``, or that of the config if that is None.

    Raises:
        ConfigError: if there is no such file or preset, or it does not describe an arm, or the
            model has no choice of material.
        ArmDefinitionError: if a value given on the command line is impossible.
    """
    return _read(options, options.model or model)[0]


def _read(
    options: argparse.Namespace, model: str | None, motion: dict[str, Any] | None = None
) -> tuple[Config, dict[str, Any]]:
    """Return the config of the options `ARM` for a ``model``, and its parameters.

    An arm that moves has parameters of ``motion``, which replace those of the file; None stands
    for the default.
    """
    file = load_config(options.config)
    model = model or file.model
    if model != 'exact':
        refuse_without_effect(
            options, ('--material', '--density'), f'on {model}, which knows neither: choose exact'
        )
    replacements = {
        'model': model,
        'stations': options.stations,
        'material.law': options.material,
        'material.density': options.density,
        'loads.gravity': options.gravity,
        'loads.fluid_density': options.fluid_density,
        'loads.tip_force': options.tip_force,
        'loads.tip_moment': options.tip_moment,
        'loads.tip_frame': options.tip_frame,
    }
    parameters = load_parameters(options.config)
    if options.fluid_density == 0.0:  # What the file says of its water does not hold then.
        for parameter in PARAMETERS:
            if 'loads.fluid_density' in parameter.needs:
                parameters.pop(parameter.name, None)
    parameters |= {name: value for name, value in replacements.items() if value is not None}
    parameters |= motion or {}
    parameters = {name: value for name, value in parameters.items() if value is not None}
    config = Config.from_parameters(parameters)
    if not any(np.any(parameters.get(f'loads.tip_{part}', 0.0)) for part in ('force', 'moment')):
        refuse_without_effect(options, ('--tip-frame',), 'without --tip-force or --tip-moment')
    if not (any(config.loads.gravity) or motion is not None):
        refuse_without_effect(options, ('--density', '--fluid-density'), 'without --gravity')
    return config, parameters


def read_moving_arm(options: argparse.Namespace) -> tuple[Config, dict[str, Any]]:
    """Return the config that the options `MOVING_ARM` describe, and its parameters.

    Raises:
        OctoArmError: if the config cannot be read, a value is impossible, or the model is another
            one than exact.
    """
    if options.model not in (None, 'exact'):
        raise ConfigError(f'--model is {options.model}, which does not move: expected exact')
    motion: dict[str, Any] = {}
    if options.viscosity is not None:
        motion |= {'motion.viscosity': options.viscosity, 'motion.damping_time': None}
    if options.water is not None:
        motion |= {f'motion.{name}': None for name in WaterCoefficients._fields}
        motion['motion.water'] = options.water
    return _read(options, 'exact', motion)


DYNAMIC = """\
--dynamic: solve the motion of the arm, with inertia, damping and water, instead of equilibria;
    tensions change linearly from one reading to the next
"""
DYNAMIC_STEP = f'--step S = {STEP}: step of the integration with --dynamic [s]'


def read_dynamic(options: argparse.Namespace, moves: bool = False) -> float | None:
    """Return the step of the motion [s]; None without --dynamic, unless the arm ``moves`` anyway.

    Raises:
        OctoArmError: if --step is out of range, or given without --dynamic.
    """
    if not (options.dynamic or moves):
        refuse_without_effect(options, ('--step',), 'without --dynamic')
        return None
    return within('--step', options.step, *STEPS, 's')


def tensions_option(default: str) -> str:
    """Return the option of tensions; its help ends with the ``default`` of other tendons."""
    text = (
        'tensions [N] by name of the tendon, e.g. tendon_1_1=0.4,tendon_1_2=1, or as JSON: by '
        'name, or one row for each section, from the tip to the base, e.g. '
        "'[[0,0,0.5,0],[4,0,0,0],[0,0,13,0]]'"
    )
    return f'--tensions TENSIONS: {text}; {default}'


def read_tensions(text: str, arm: Arm) -> Any:
    """Return the tensions of ``arm`` [N] in the ``text`` of --tensions, zero for others.

    Raises:
        TensionError: if they are not numbers by name or one set in JSON, or a tendon is unknown or
            named twice.
    """
    example = "'[[0,0,0.5,0]]' or tendon_1_1=0.4"
    given = read_by_name(text, '--tensions', example, may_be_rows=True)
    if isinstance(given, dict):
        check_displacements(arm, {}, given)
        row = np.array([given.get(name, 0.0) for name in arm.tendon_names])
        return row.reshape(arm.tension_shape)
    first = given
    for _ in range(2):
        first = first[0] if isinstance(first, list) and first else None
    if isinstance(first, list):
        raise TensionError('--tensions holds several sets, expected one row for each section')
    return given


def read_by_name(text: str, option: str, example: str, may_be_rows: bool = False) -> Any:
    """Return the numbers by name in a ``text`` NAME=NUMBER,..., or in JSON.

    Raises:
        TensionError: if it is neither, or has a name twice, or other values by name than numbers;
            other JSON than names is returned if it ``may_be_rows``.
    """
    if '=' not in text or text.lstrip()[:1] in '{[':
        values = read_json(text, option, example)
    else:
        values = {}
        for name, _, number in (word.strip().partition('=') for word in text.split(',')):
            if name in values:
                raise TensionError(f'{option} is {shown(text)}, expected each name once')
            values[name] = number
            with contextlib.suppress(ValueError):
                values[name] = float(number)
    is_named = isinstance(values, dict)
    numbers = values.values() if is_named else ()
    if not (is_named or may_be_rows) or any(
        isinstance(value, bool) or not isinstance(value, (int, float)) for value in numbers
    ):
        raise TensionError(f'{option} is {shown(values)}, expected numbers by name as {example}')
    return values


def read_json(text: str, option: str, example: str) -> Any:
    """Return the value of a JSON ``option``; an error message shows the ``example``.

    Raises:
        TensionError: if ``text`` is not JSON, or gives a name twice.
    """

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        values = dict(pairs)
        if len(values) < len(pairs):
            raise TensionError(f'{option} is {shown(text)}, expected each name once')
        return values

    try:
        return json.loads(text, object_pairs_hook=unique)
    except TensionError:
        raise
    except (RecursionError, ValueError) as error:
        where = f' at character {error.pos + 1}' if isinstance(error, json.JSONDecodeError) else ''
        raise TensionError(
            f'{option} is not JSON{where}, expected text such as {example}'
        ) from error
