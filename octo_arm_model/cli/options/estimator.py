"""Options for what an estimator takes for unknown, made from the table of its parameters."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Mapping
from typing import Any

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.config.parameter import Parameter
from octo_arm_model.estimation.parameters import CONTACTS, ESTIMATOR_PARAMETERS, PREFIX
from octo_arm_model.estimation.state.unknowns import Unknowns
from octo_arm_model.wire.displacement_messages import DISPLACEMENTS
from octo_arm_model.wire.measurement_messages import BASE_WRENCH, MARKERS, TIP_POSE

# Parameters that say how exact sensors are; the others say what is unknown.
_SENSORS = ('displacement', 'marker', 'tip_', 'base_')
_APART = ('contact', 'contact_s', 'window')  # in options of their own, or for a node alone
TENSIONS = 'tensions'
# What options count for: sensors by the beginnings of their names, and contacts.
_OF_SENSOR = {
    'tendons': TENSIONS,
    'tension_stddev': TENSIONS,
    f'{PREFIX}tension_bias': TENSIONS,
    f'{PREFIX}displacement': DISPLACEMENTS,
    f'{PREFIX}marker': MARKERS,
    f'{PREFIX}tip': TIP_POSE,
    f'{PREFIX}base': BASE_WRENCH,
}
_OF_CONTACT = {
    f'{PREFIX}force_stddev': ('tip', 'at', 'somewhere', 'current'),
    f'{PREFIX}moment_stddev': ('tip',),
    f'{PREFIX}current_stddev': ('current',),
    f'{PREFIX}change_time': ('somewhere',),
}
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
            _option(name),
            dest=parameter.name,
            type=parameter.kind,
            nargs='+' if parameter.is_array else None,
            metavar='S' if name == 'marker_s' else 'X',
            help=f'{parameter.description} (default: {shown})'.replace('%', '%%'),
        )


def _offered() -> list[Parameter]:
    """The parameters that are options of their own name."""
    return [one for one in ESTIMATOR_PARAMETERS if one.name.removeprefix(PREFIX) not in _APART]


def refuse_idle(
    options: argparse.Namespace, sensors: Collection[str], unknowns: Mapping[str, Unknowns]
) -> None:
    """Check that each of the options that are given counts.

    Args:
        options: as they were parsed.
        sensors: what was recorded: `TENSIONS`, and rows of `MEASUREMENT_TOPICS`.
        unknowns: of each hypothesis.

    Raises:
        ConfigError: if one does not.
    """
    (contact, first), *others = unknowns.items()
    contact = 'somewhere' if others else contact
    for name in sorted(options.given):
        why = ''
        for beginning, sensor in _OF_SENSOR.items():
            if name.startswith(beginning) and sensor not in sensors:
                why = f'without {sensor}; there are {", ".join(sensors)}'
        if contact not in _OF_CONTACT.get(name, CONTACTS):
            why = f'with --contact {contact}'
        if name == f'{PREFIX}tension_bias_rate' and first.tension_bias is None:
            why = 'without --tension-bias-stddev'
        if why:
            raise ConfigError(f'{_option(name)} has no effect {why}')


def _option(name: str) -> str:
    """The option of the parameter ``name``."""
    return f'--{name.removeprefix(PREFIX).replace("_", "-")}'


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
