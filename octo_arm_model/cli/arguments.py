"""Options that several commands share."""

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model.arm.errors import ConfigError, TensionError, shown
from octo_arm_model.arm.loads import TIP_FRAMES
from octo_arm_model.arm.material import LAWS, WATERS, WaterCoefficients
from octo_arm_model.arm.validation import within
from octo_arm_model.config.config import Config, load_config
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.rod.motion import STEPS
from octo_arm_model.rod.solver import MODELS
from octo_arm_model.simulation.moving_arm import STEP

_CONFIG = 'ROS parameter file of the arm, or the name of a preset'


def refuse_without_effect(options: argparse.Namespace, names: Sequence[str], why: str) -> None:
    """Check that options ``names`` are not given, since they do nothing ``why``.

    Raises:
        ConfigError: if one is.
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
    """Add the option ``name`` for numbers, one for each word of ``metavar``."""
    names = tuple(metavar.split())
    parser.add_argument(name, nargs=len(names), type=float, metavar=names, help=text)


def add_path(parser: Any, name: str, metavar: str, text: str) -> None:
    """Add the option, or the argument, ``name`` for a file or folder."""
    add_value(parser, name, metavar, text, path_of)


def path_of(text: str) -> Path:
    """The path ``text`` is.

    Raises:
        ArgumentTypeError: if it is empty, as of a variable of a shell that is not set: it would
            stand for the folder one is in.
    """
    if not text:
        raise argparse.ArgumentTypeError('empty, expected a path')
    return Path(text)


def add_value(
    parser: Any, name: str, metavar: str, text: str, kind: Callable[[str], Any] = str
) -> None:
    """Add the option ``name`` for a value of a ``kind``; None where it is not given."""
    parser.add_argument(name, type=kind, metavar=metavar, help=text)


def add_values(parser: Any, name: str, metavar: str, text: str, kind: type = str) -> None:
    """Add the option ``name`` for one or more values of a ``kind``; none by default."""
    parser.add_argument(name, nargs='+', type=kind, default=[], metavar=metavar, help=text)


def add_flag(parser: Any, name: str, text: str) -> None:
    """Add the option ``name`` that is given or not."""
    parser.add_argument(name, action='store_true', help=text)


def add_config_option(
    parser: argparse.ArgumentParser, default: str | None, otherwise: str = '', more: str = ''
) -> None:
    """Add ``--config``; its help names the ``default``, or ``otherwise`` where there is none."""
    parser.add_argument(
        '--config',
        default=default,
        metavar='CONFIG',
        help=f'{_CONFIG} (default: {otherwise or "%(default)s"}){more}',
    )


def read_config_option(options: argparse.Namespace) -> dict[str, Any] | None:
    """Parameters that ``--config`` names; None where it is not given.

    Raises:
        ConfigError: if there is no such file or preset, or it cannot be read.
    """
    return None if options.config is None else load_parameters(options.config)


def add_tendons(parser: argparse.ArgumentParser) -> None:
    """Add ``--tendons``, ``--motors`` and ``--spools``."""
    text = (
        'what each tendon of the arm, from the tip, is called in what is read: a name, or a '
        'number from 0 on where there are none, or - for one that is slack (default: '
        'tension_names of the arm)'
    )
    add_values(parser, '--tendons', 'NAME', text)
    text = (
        'what the encoder of each tendon, from the tip, is called in what is read, likewise; '
        'tendons that one motor reels have the same (default: displacement_names of the arm)'
    )
    add_values(parser, '--motors', 'NAME', text)
    text = (
        'length reeled in per unit that encoders read [m], such as the radius of the spool for '
        'radians, < 0 where the motor lets out, for all or for each tendon (default: '
        'displacement_scale of the arm)'
    )
    add_values(parser, '--spools', 'M', text, float)


def read_calibration(options: argparse.Namespace) -> dict[str, Any]:
    """Parameters that the options of `add_tendons` are."""
    given = {
        'tension_names': options.tendons,
        'displacement_names': options.motors,
        'displacement_scale': options.spools,
    }
    return {name: list(values) for name, values in given.items() if values}


def add_model(parser: argparse.ArgumentParser) -> None:
    """Add ``--model``."""
    parser.add_argument('--model', choices=MODELS, help='model, instead of that of the config')


def add_storage(parser: argparse.ArgumentParser) -> None:
    """Add ``--storage`` of a bag to write."""
    parser.add_argument(
        '--storage',
        choices=('mcap', 'sqlite3'),
        default='mcap',
        help='of OUT (default: %(default)s)',
    )


def add_json(parser: argparse.ArgumentParser, more: str = ', in SI units') -> None:
    """Add ``--json``."""
    add_flag(parser, '--json', f'print one JSON object{more}')


def add_highest(parser: argparse.ArgumentParser, default: str, of: str = '') -> None:
    """Add ``--highest``, bounds of the tensions; ``default`` describes the default."""
    text = f'largest tension [N]{of}: one number, or rows as --tensions of solve; by default '
    add_value(parser, '--highest', 'N', text + default)


def read_highest(options: argparse.Namespace) -> Any:
    """Value of ``--highest``; None where it is not given.

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
    """Add the argument ``CONFIG``."""
    parser.add_argument('config', metavar='CONFIG', help=f'{_CONFIG} such as renda2012_table4')


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add the arm, and the options that replace values of its file."""
    add_config_argument(parser)
    add_model(parser)
    add_value(parser, '--stations', 'N', 'stations, instead of those of the config', int)
    physics = parser.add_argument_group(
        'physics', 'instead of what the config says; with --model exact'
    )
    physics.add_argument('--material', choices=LAWS, help='elastic law of the cross sections')
    gravity = 'acceleration of gravity in base_frame [m/s^2], e.g. 0 0 -9.81'
    add_vector(physics, '--gravity', 'X Y Z', gravity)
    add_value(physics, '--density', 'RHO', 'of the arm [kg/m^3]', float)
    add_value(physics, '--fluid-density', 'RHO', 'of the surrounding fluid [kg/m^3]', float)
    add_vector(physics, '--tip-force', 'X Y Z', 'in base_frame, or see --tip-frame [N]')
    add_vector(physics, '--tip-moment', 'X Y Z', 'likewise [N m]')
    physics.add_argument(
        '--tip-frame',
        choices=TIP_FRAMES,
        help='axes of these: tip for t, n and b of the tip, with which they turn, or base',
    )


def read_config(options: argparse.Namespace) -> Config:
    """The config of `add_config`'s options.

    Raises:
        ConfigError: if there is no such file or preset, or it does not describe an arm, or the
            model has no choice of material.
        ArmDefinitionError: if a value given on the command line is impossible.
    """
    return _read(options, moves=False)[0]


def _read(
    options: argparse.Namespace, moves: bool, motion: dict[str, Any] | None = None
) -> tuple[Config, dict[str, Any]]:
    """The config of `add_config`'s options, of an arm that perhaps ``moves``, and its parameters.

    Those of its ``motion`` replace the file's; None stands for the default.
    """
    file = load_config(options.config)
    model = options.model or file.model
    if model != 'exact':
        refuse_without_effect(
            options, ('--material', '--density'), f'on {model}, which knows neither: choose exact'
        )
    given = {
        'model': options.model,
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
    parameters |= {name: value for name, value in given.items() if value is not None}
    parameters |= motion or {}
    parameters = {name: value for name, value in parameters.items() if value is not None}
    config = Config.from_parameters(parameters)
    if not any(np.any(parameters.get(f'loads.tip_{part}', 0.0)) for part in ('force', 'moment')):
        refuse_without_effect(options, ('--tip-frame',), 'without --tip-force or --tip-moment')
    if not (any(config.loads.gravity) or moves):
        refuse_without_effect(options, ('--density', '--fluid-density'), 'without --gravity')
    return config, parameters


def add_moving_arm(parser: argparse.ArgumentParser) -> None:
    """As `add_config`, and the options of its damping."""
    add_config(parser)
    motion = parser.add_argument_group('motion', 'instead of what the config says')
    add_value(motion, '--viscosity', 'ETA', 'of the material [Pa s]', float)
    water = 'coefficients of drag and added mass, in a fluid of --fluid-density'
    motion.add_argument('--water', choices=WATERS, help=water)


def read_moving_arm(options: argparse.Namespace) -> tuple[Config, dict[str, Any]]:
    """The config of the options of `add_moving_arm`, and its parameters; its model is exact.

    Raises:
        OctoArmError: as `read_config`; also if another model is given.
    """
    if options.model not in (None, 'exact'):
        raise ConfigError(f'--model is {options.model}, which does not move: expected exact')
    options.model = 'exact'
    motion: dict[str, Any] = {}
    if options.viscosity is not None:
        motion |= {'motion.viscosity': options.viscosity, 'motion.damping_time': None}
    if options.water is not None:
        motion |= {f'motion.{name}': None for name in WaterCoefficients._fields}
        motion['motion.water'] = options.water
    return _read(options, moves=True, motion=motion)


def add_dynamic(parser: Any, kinds: Any = None) -> None:
    """Add ``--dynamic``, as one of the ``kinds`` of recordings if there are, and ``--step``."""
    text = (
        'the arm moves, with its inertia, damping and water, instead of being in equilibrium all '
        'the time; tensions change linearly from one reading to the next'
    )
    add_flag(kinds or parser, '--dynamic', text)
    add_number(parser, '--step', STEP, 'of the integration of --dynamic [s]', 'S')


def read_dynamic(options: argparse.Namespace) -> float | None:
    """The step of the motion [s]; None where the arm is in equilibrium all the time.

    Raises:
        OctoArmError: if it is no step, or there is nothing that it could be of.
    """
    if not options.dynamic:
        refuse_without_effect(options, ('--step',), 'without --dynamic')
        return None
    return within('--step', options.step, *STEPS, 's')


def read_json(text: str, option: str, example: str) -> Any:
    """Value of a JSON ``option``.

    Raises:
        TensionError: if it is not JSON, of which the message shows the ``example``, or a name is
            given twice.
    """

    def named(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            raise TensionError(f'{option} is {shown(text)}, expected each name once')
        return found

    try:
        return json.loads(text, object_pairs_hook=named)
    except TensionError:
        raise
    except (RecursionError, ValueError) as error:
        where = f' at character {error.pos + 1}' if isinstance(error, json.JSONDecodeError) else ''
        raise TensionError(
            f'{option} is not JSON{where}, expected text such as {example}'
        ) from error
