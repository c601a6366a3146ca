"""Options that several commands of the command line share."""

from __future__ import annotations

import argparse
import dataclasses
import json
from typing import Any

from octo_arm_model.config.config import Config
from octo_arm_model.config.presets import find_config
from octo_arm_model.core.errors import ConfigError, TensionError
from octo_arm_model.core.section.elastic_laws import LAWS
from octo_arm_model.core.solver import MODELS


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add the arm and what may be said otherwise than in its file."""
    parser.add_argument(
        'config',
        metavar='CONFIG',
        help='ROS parameter file of the arm, or the name of a preset such as renda2012_table4',
    )
    parser.add_argument('--model', choices=MODELS, help='model, instead of that of the config')
    parser.add_argument(
        '--stations', type=int, metavar='N', help='stations, instead of those of the config'
    )
    physics = parser.add_argument_group(
        'physics', 'instead of what the config says; with --model exact'
    )
    physics.add_argument('--material', choices=LAWS, help='elastic law of the cross sections')
    physics.add_argument(
        '--gravity',
        nargs=3,
        type=float,
        metavar=('X', 'Y', 'Z'),
        help='acceleration of gravity in base_frame [m/s^2], e.g. 0 0 -9.81',
    )
    physics.add_argument('--density', type=float, metavar='RHO', help='of the arm [kg/m^3]')
    physics.add_argument(
        '--fluid-density', type=float, metavar='RHO', help='of what is around it [kg/m^3]'
    )
    physics.add_argument(
        '--tip-force', nargs=3, type=float, metavar=('X', 'Y', 'Z'), help='in base_frame [N]'
    )
    physics.add_argument(
        '--tip-moment', nargs=3, type=float, metavar=('X', 'Y', 'Z'), help='in base_frame [N m]'
    )


def read_config(options: argparse.Namespace) -> Config:
    """The config that `add_config`'s options ask for.

    Raises:
        ConfigError: if there is no such file or preset, or it does not describe an arm, or the
            model has no choice of material.
        ArmDefinitionError: if a value given on the command line is impossible.
    """
    config = find_config(options.config)
    if options.density is not None:
        arm = config.arm.with_density(options.density)
        config = dataclasses.replace(config, arm=arm)
    if options.material and (options.model or config.model) != 'exact':
        raise ConfigError('--material goes with --model exact; the others are linear')
    names = ('gravity', 'fluid_density', 'tip_force', 'tip_moment')
    given = {name: getattr(options, name) for name in names}
    loads: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in given.items()
        if value is not None
    }
    return dataclasses.replace(
        config,
        model=options.model or config.model,
        stations=config.stations if options.stations is None else options.stations,
        law=options.material or config.law,
        loads=dataclasses.replace(config.loads, **loads),
    )


def read_json(text: str, option: str, example: str) -> Any:
    """Value of a JSON ``option``.

    Raises:
        TensionError: if it is not JSON; the message shows the ``example``.
    """
    try:
        return json.loads(text)
    except (RecursionError, ValueError) as error:
        where = f' at character {error.pos + 1}' if isinstance(error, json.JSONDecodeError) else ''
        raise TensionError(
            f'{option} is not JSON{where}, expected rows of numbers such as {example}'
        ) from error
