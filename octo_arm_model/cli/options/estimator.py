"""Options for what an estimator takes for unknown, made from the table of its parameters."""

from __future__ import annotations

import argparse
from typing import Any

from octo_arm_model.config.parameter import Parameter
from octo_arm_model.core.errors import ConfigError
from octo_arm_model.estimation.parameters import CONTACTS, ESTIMATOR_PARAMETERS, PREFIX

# Parameters that say how exact sensors are; the others say what is unknown.
_SENSORS = ('displacement', 'marker', 'tip_', 'base_')
_APART = ('contact', 'contact_s', 'window')  # in options of their own, or for a node alone
# Options for standard deviations that are parameters of the arm.
_OF_ARM = {
    '--tension-stddev': ('tension_stddev', 'N', 'standard deviation of the tensions [N] (default: '
                         'tension_stddev of the arm, or else as the recording varies)'),
    '--modulus-stddev': ('material.youngs_modulus_stddev', 'PART', 'standard deviation of E, '
                         'relative to it [-]; 0 where it is known (default: that of the arm)'),
}  # fmt: skip


def add_estimator(parser: argparse.ArgumentParser) -> None:
    """Add the options, whose defaults are those of the arm's file or of the table."""
    unknown = parser.add_argument_group('what is unknown')
    unknown.add_argument(
        '--contact',
        nargs='+',
        metavar='C',
        help=f'{", ".join(CONTACTS)}: what acts on the arm besides its known loads; at S is a '
        'force at the arc coordinate S [m], somewhere one at S ..., or, without these, at five '
        'even steps (default: tip)',
    )
    sensors = parser.add_argument_group('how exact sensors are')
    for option, (name, metavar, text) in _OF_ARM.items():
        group = sensors if option == '--tension-stddev' else unknown
        group.add_argument(option, dest=name, type=float, metavar=metavar, help=text)
    for parameter in _offered():
        name = parameter.name.removeprefix(PREFIX)
        group = sensors if name.startswith(_SENSORS) else unknown
        shown = 'none' if parameter.is_array else f'{parameter.default:g}'
        group.add_argument(
            f'--{name.replace("_", "-")}',
            dest=parameter.name,
            type=parameter.kind,
            nargs='+' if parameter.is_array else None,
            metavar='S' if name == 'marker_s' else 'X',
            help=f'{parameter.description} (default: {shown})'.replace('%', '%%'),
        )


def _offered() -> list[Parameter]:
    """The parameters that are options of their own name."""
    return [one for one in ESTIMATOR_PARAMETERS if one.name.removeprefix(PREFIX) not in _APART]


def read_estimator(options: argparse.Namespace) -> dict[str, Any]:
    """Parameters of the estimator and of the arm that the options give.

    Raises:
        ConfigError: if --contact is none.
    """
    names = [name for name, _, _ in _OF_ARM.values()] + [one.name for one in _offered()]
    values = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    if options.contact is not None:
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
