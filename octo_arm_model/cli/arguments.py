"""Options that several commands share."""

import argparse
import contextlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

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

_CONFIG = 'ROS parameter file of the arm, or the name of a preset'


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


def add_number(
    parser: Any, name: str, default: float, text: str, metavar: str | None = None
) -> None:
    """Add the option ``name`` for a number of the type of its ``default``."""
    parser.add_argument(
        name,
        type=type(default),
        default=default,
        metavar=metavar,
        help=text if '%(default)s' in text else f'{text} (default: %(default)s)',
    )


def add_vector(parser: Any, name: str, metavar: str, text: str) -> None:
    """Add the option ``name`` for a vector; ``metavar`` has a word for each component."""
    names = tuple(metavar.split())
    parser.add_argument(name, nargs=len(names), type=float, metavar=names, help=text)


def add_path(parser: Any, name: str, metavar: str, text: str) -> None:
    """Add the option, or the argument, ``name`` for a file or folder."""
    add_value(parser, name, metavar, text, path_of)


def path_of(text: str) -> Path:
    """Return ``text`` as a path.

    Raises:
        ArgumentTypeError: if it is empty, for example from a shell variable that is not set: an
            empty path would be the current folder.
    """
    if not text:
        raise argparse.ArgumentTypeError('empty, expected a path')
    return Path(text)


def add_value(
    parser: Any, name: str, metavar: str, text: str, kind: Callable[[str], Any] = str
) -> None:
    """Add the option ``name`` for a value of type ``kind``; its default is None."""
    parser.add_argument(name, type=kind, metavar=metavar, help=text)


def add_values(parser: Any, name: str, metavar: str, text: str, kind: type = str) -> None:
    """Add the option ``name`` for one or more values of type ``kind``; its default is []."""
    parser.add_argument(name, nargs='+', type=kind, default=[], metavar=metavar, help=text)


def add_flag(parser: Any, name: str, text: str) -> None:
    """Add the option ``name``, which takes no value."""
    parser.add_argument(name, action='store_true', help=text)


def add_config_option(
    parser: argparse.ArgumentParser, default: str | None, otherwise: str = '', more: str = ''
) -> None:
    """Add ``--config``; its help names the ``default``, or ``otherwise`` if that is None."""
    parser.add_argument(
        '--config',
        default=default,
        metavar='CONFIG',
        help=f'{_CONFIG} (default: {otherwise or "%(default)s"}){more}',
    )


def read_config_option(options: argparse.Namespace) -> dict[str, Any] | None:
    """Return the parameters that ``--config`` names; None if it is not given.

    Raises:
        ConfigError: if there is no such file or preset, or it cannot be read.
    """
    return None if options.config is None else load_parameters(options.config)


def add_tendons(parser: argparse.ArgumentParser) -> None:
    """Add ``--tendons``, ``--motors`` and ``--spools``."""
    text = (
        'name of each tendon of the arm, from the tip, in the recording; a number from 0 on if '
        'the recording has no names; - for a slack tendon (default: tension_names of the arm)'
    )
    add_values(parser, '--tendons', 'NAME', text)
    text = (
        'name or number of the encoder of each tendon, from the tip, in the recording; tendons '
        'on one motor share its encoder (default: displacement_names of the arm)'
    )
    add_values(parser, '--motors', 'NAME', text)
    text = (
        'length reeled in per unit of the encoder [m], such as the radius of the spool for '
        'radians; < 0 if a positive reading lets the tendon out; one number for all tendons or '
        'one for each (default: displacement_scale of the arm)'
    )
    add_values(parser, '--spools', 'M', text, float)


def read_calibration(options: argparse.Namespace) -> dict[str, Any]:
    """Return the parameters that the options of `add_tendons` set."""
    options_by_name = {
        'tension_names': options.tendons,
        'displacement_names': options.motors,
        'displacement_scale': options.spools,
    }
    return {name: list(values) for name, values in options_by_name.items() if values}


def add_model(parser: argparse.ArgumentParser) -> None:
    """Add ``--model``."""
    parser.add_argument('--model', choices=MODELS, help='model, instead of that of the config')


def add_storage(parser: argparse.ArgumentParser) -> None:
    """Add ``--storage``, the format of the bag OUT."""
    parser.add_argument(
        '--storage',
        choices=('mcap', 'sqlite3'),
        default='mcap',
        help='storage format of OUT (default: %(default)s)',
    )


def add_json(parser: argparse.ArgumentParser, more: str = ', in SI units') -> None:
    """Add ``--json``; ``more`` continues its help."""
    add_flag(parser, '--json', f'print one JSON object{more}')


def add_highest(parser: argparse.ArgumentParser, default: str, of: str = '') -> None:
    """Add ``--highest``, the upper limits of tensions; ``default`` describes the default."""
    text = f'largest tension [N]{of}: one number, or rows as for solve --tensions; by default '
    add_value(parser, '--highest', 'N', text + default)


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


def add_config_argument(parser: argparse.ArgumentParser) -> None:
    """Add the positional argument ``CONFIG``."""
    parser.add_argument('config', metavar='CONFIG', help=f'{_CONFIG} such as renda2012_table4')


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add the argument for the arm, and the options that replace values of its file."""
    add_config_argument(parser)
    add_model(parser)
    add_value(parser, '--stations', 'N', 'number of stations, instead of that of the config', int)
    physics = parser.add_argument_group(
        'physics', 'instead of what the config says; with --model exact'
    )
    physics.add_argument('--material', choices=LAWS, help='elastic law of the cross sections')
    gravity = 'acceleration of gravity in base_frame [m/s^2], e.g. 0 0 -9.81'
    add_vector(physics, '--gravity', 'X Y Z', gravity)
    add_value(physics, '--density', 'RHO', 'density of the arm [kg/m^3]', float)
    text = 'density of the surrounding fluid [kg/m^3]'
    add_value(physics, '--fluid-density', 'RHO', text, float)
    text = 'on the tip, in base_frame or in the axes of --tip-frame'
    add_vector(physics, '--tip-force', 'X Y Z', f'force {text} [N]')
    add_vector(physics, '--tip-moment', 'X Y Z', f'moment {text} [N m]')
    physics.add_argument(
        '--tip-frame',
        choices=TIP_FRAMES,
        help='axes of force and moment: base, or tip for its t, n and b, which turn with it',
    )


def read_config(options: argparse.Namespace, model: str | None = None) -> Config:
    """Return the config that the options of `add_config` describe.

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
    """Return the config of `add_config`'s options for a ``model``, and its parameters.

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


def add_moving_arm(parser: argparse.ArgumentParser) -> None:
    """Add the arm of `add_config`, and the options for its damping and the water."""
    add_config(parser)
    motion = parser.add_argument_group('motion', 'instead of what the config says')
    add_value(motion, '--viscosity', 'ETA', 'viscosity of the material [Pa s]', float)
    water = 'coefficients of drag and added mass, in a fluid of --fluid-density'
    motion.add_argument('--water', choices=WATERS, help=water)


def read_moving_arm(options: argparse.Namespace) -> tuple[Config, dict[str, Any]]:
    """Return the config that the options of `add_moving_arm` describe, and its parameters.

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


def add_dynamic(parser: Any, kinds: Any = None) -> None:
    """Add ``--dynamic``, to the group of options ``kinds`` if it is given, and ``--step``."""
    text = (
        'solve the motion of the arm, with inertia, damping and water, instead of equilibria; '
        'tensions change linearly from one reading to the next'
    )
    add_flag(kinds or parser, '--dynamic', text)
    add_number(parser, '--step', STEP, 'step of the integration with --dynamic [s]', 'S')


def read_dynamic(options: argparse.Namespace, moves: bool = False) -> float | None:
    """Return the step of the motion [s]; None without --dynamic, unless the arm ``moves`` anyway.

    Raises:
        OctoArmError: if --step is out of range, or given without --dynamic.
    """
    if not (options.dynamic or moves):
        refuse_without_effect(options, ('--step',), 'without --dynamic')
        return None
    return within('--step', options.step, *STEPS, 's')


def add_tensions(parser: Any, default: str) -> None:
    """Add ``--tensions``; its help ends with the ``default`` of tendons that are not named."""
    text = (
        'tensions [N] by name of the tendon, e.g. tendon_1_1=0.4,tendon_1_2=1, or as JSON: by '
        'name, or one row for each section, from the tip to the base, e.g. '
        f"'[[0,0,0.5,0],[4,0,0,0],[0,0,13,0]]'; {default}"
    )
    add_value(parser, '--tensions', 'TENSIONS', text)


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
