"""The settings of an estimator: its parameters, the unknowns and the noise of the sensors."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, shown
from octo_arm_model.arm.stiffness import bending_force, default_highest
from octo_arm_model.arm.validation import LARGEST
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter import ParameterGroup, check_together, refuse_unknown, stated
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.rules import GATE, Rules
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk, facing_area, place_names

CONTACTS = ('tip', 'at', 'somewhere', 'current', 'none')
MAX_PLACES = 50  # largest number of places of a contact
MAX_MARKERS = 300  # largest number of markers, whose coordinates are one measurement
PLACES = 5  # default number of places of a contact somewhere, evenly along the arm
BENT = 0.1  # displacement of the tip by the default force, over the length
RECOVER_AFTER = 1.0  # [s]
CELL_FAULT, SENSOR_FAULT = 0.1, 0.005
TURNED = 2.0  # angle by which a tendon turns up to a section whose friction is average [rad]
PREFIX = 'estimator.'
# In a recording a force is significant only where no faulty sensor may explain it.
RECORDING_DEFAULTS = {f'{PREFIX}cell_fault': 0.0, f'{PREFIX}sensor_fault': 0.0}
# The only contact with which a parameter has an effect.
_OF_CONTACT = {'moment_stddev': 'tip', 'current_stddev': 'current', 'change_time': 'somewhere'}
_TENSION = 0.02  # noise of load cells if neither the arm nor the recording states one [N]


@dataclass(frozen=True)
class EstimatorParameters(ParameterGroup):
    """The node's ROS parameters, the command line's options and a table of the manual."""

    GROUP = 'estimator'

    contact: str = stated(
        f"string | 'tip' | one of {', '.join(CONTACTS)} | choice",
        'unknown load on the arm besides its known loads: tip (a force on the tip), at (a '
        'force at contact_s), somewhere (a force at one of contact_s or nowhere, by their '
        'probabilities), current (uniform, of the surrounding fluid) or none',
    )
    contact_s: tuple[float, ...] = stated(
        f'double[] | [] | in (0, body.length], at most {MAX_PLACES} | most {MAX_PLACES}',
        'arc coordinates of the contact [m]; empty, with somewhere, for '
        f'{PLACES} even steps up to the tip',
    )
    force_stddev: float = stated(
        'double | 0.0 | >= 0',
        'standard deviation of each component of the force before anything is measured [N]; '
        f'0 for the force that moves the tip by {BENT:g} of the length',
    )
    force_time: float = stated(
        'double | 1.0 | > 0',
        'correlation time of force, moment and current: how long an estimate of them lasts '
        'without measurements [s]',
    )
    change_time: float = stated(
        'double | 1.0 | > 0',
        'with somewhere, mean time after which the contact is at another place [s]',
    )
    moment_stddev: float = stated(
        'double | 0.0 | >= 0',
        'standard deviation of each component of a moment on the tip before anything is '
        'measured, with tip [N m]; 0 for no moment',
    )
    current_stddev: float = stated(
        'double | 0.0 | >= 0',
        'standard deviation of the pressure of a current before anything is measured [Pa]; 0 '
        'for force_stddev over the area of the arm seen from the side',
    )
    tension_rate: float = stated(
        'double | 0.0 | >= 0',
        'standard deviation of the change of each tension in a second [N]; 0 for the largest '
        'that the arm bears',
    )
    tension_bias_stddev: float = stated(
        'double | 0.0 | >= 0',
        'standard deviation of the constant bias of each load cell [N]; 0 for no bias',
    )
    tension_bias_rate: float = stated(
        'double | 0.0 | >= 0 | with estimator.tension_bias_stddev',
        'standard deviation of the change of this bias in a second [N]',
    )
    tension_loss_stddev: float = stated(
        'double | 0.0 | >= 0',
        'standard deviation of the logarithm of the tension of each tendon at the base over '
        'that along the arm, as friction changes it, with the correlation time force_time '
        f'[-]; 0 for {TURNED:g} rad times tendons.friction',
    )
    displacement_stddev: float = stated(
        'double | 0.0002 | > 0', 'standard deviation of tendon_displacements [m]'
    )
    marker_s: tuple[float, ...] = stated(
        f'double[] | [] | in [0, body.length], at most {MAX_MARKERS} | most {MAX_MARKERS}',
        'arc coordinates of the markers of measured/markers, from the base on [m]',
    )
    marker_stddev: float = stated(
        'double | 0.001 | > 0', 'standard deviation of each coordinate of a marker [m]'
    )
    tip_position_stddev: float = stated(
        'double | 0.0 | >= 0',
        'standard deviation of each coordinate of measured/tip_pose if the message has no '
        'covariance [m]; 0: such a message is refused',
    )
    tip_rotation_stddev: float = stated(
        'double | 0.0 | >= 0',
        'standard deviation of its rotation vector if the message has no covariance [rad]; 0: the '
        'orientation is not used',
    )
    base_force_stddev: float = stated(
        'double | 0.0 | >= 0',
        'standard deviation of each force of measured/base_wrench [N]; 0: its messages are '
        'refused',
    )
    base_moment_stddev: float = stated(
        'double | 0.0 | >= 0', 'standard deviation of its moments [N m]'
    )
    gate: float = stated(
        f'double | {GATE} | in (0, 1)',
        'probability that a right measurement is accepted; one that is less probable is refused',
    )
    cell_fault: float = stated(
        f'double | {CELL_FAULT} | in [0, 1)',
        'probability that a given load cell is faulty, over the probability that all sensors are '
        'right; if the other sensors cannot tell, the covariance covers this case; 0 for load '
        'cells that are never faulty',
    )
    sensor_fault: float = stated(
        f'double | {SENSOR_FAULT} | in [0, 1)', 'the same for each other sensor'
    )
    window: float = stated('double | 0.2 | >= 0', 'largest delay of a measurement [s]')
    recover_after: float = stated(
        f'double | {RECOVER_AFTER} | >= 0',
        'time for which sensors have to contradict the estimate, whichever is doubted, before it '
        'starts again from the prior [s]; 0 for never',
    )


ESTIMATOR_PARAMETERS = EstimatorParameters.table()


class TensionStatistics(NamedTuple):
    """The statistics of the tensions of a recording; 0 if it does not determine them."""

    noise: float = 0.0  #: standard deviation of one reading [N]
    rate: float = 0.0  #: rate of a random walk that follows the tensions [N/s^0.5]


@dataclass(frozen=True)
class EstimatorSettings:
    """The checked settings of an estimator, with defaults from the arm's description."""

    #: unknowns of each place of contact, by its name; one if the place is given
    unknowns: Mapping[str, Unknowns]
    tension_stddev: float  #: standard deviation of readings of load cells [N]
    given: EstimatorParameters  #: all parameters, among them noise and places of other sensors
    rules: Rules  #: assumptions about the sensors
    notes: tuple[str, ...]  #: values of parameters that were not given, in words

    @classmethod
    def from_parameters(
        cls, values: Mapping[str, Any], config: Config, recorded: TensionStatistics | None = None
    ) -> EstimatorSettings:
        """Return the settings by the estimator's ``values`` (dotted names) for a ``config``.

        Parameters of tensions that are not given follow from those ``recorded``, if any.

        Raises:
            ConfigError: if a parameter is unknown, of the wrong type or without effect, or a place
                is not on the arm.
            ArmDefinitionError: if a number is outside its range.
        """
        table, arm = ESTIMATOR_PARAMETERS, config.arm
        refuse_unknown(values, [entry.name for entry in table], 'the estimator')
        given = {row.name: row.convert(values.get(row.name, row.default)) for row in table}
        options = EstimatorParameters.of(given)
        check_together(table, given)
        _check(options, arm)
        # Places beyond the tip by rounding are moved to the tip.
        contact_s, marker_s = (
            tuple(min(s, arm.length) for s in positions)
            for positions in (options.contact_s, options.marker_s)
        )
        options = dataclasses.replace(options, contact_s=contact_s, marker_s=marker_s)
        recorded, notes = recorded or TensionStatistics(), list[str]()
        return cls(
            _unknowns(options, config, recorded, notes),
            _tension_stddev(config, recorded, notes),
            options,
            Rules(options.gate, options.cell_fault, options.sensor_fault, options.recover_after),
            tuple(notes),
        )

    def models(self, config: Config, **options: Any) -> dict[str, ArmModel]:
        """Return a model of the arm of ``config`` for each place of contact, by its name.

        ``options`` are those of `ArmModel.of`.

        Raises:
            ConfigError: if the arm or its loads do not fit the unknowns.
        """
        return {
            name: ArmModel.of(config, unknowns, **options)
            for name, unknowns in self.unknowns.items()
        }


def _check(options: EstimatorParameters, arm: Arm) -> None:
    """Check the places against the arm, and the parameters against each other."""
    contact, positions = options.contact, options.contact_s
    if positions and contact not in ('at', 'somewhere'):
        raise ConfigError(f'estimator.contact_s has no effect with contact {contact}')
    for name, only in _OF_CONTACT.items():
        value = getattr(options, name)
        if contact != only and value != getattr(EstimatorParameters, name):
            raise ConfigError(
                f'estimator.{name} is {value:g}, which has no effect with contact {contact}'
            )
    if contact == 'at' and not positions:
        raise ConfigError('estimator.contact_s is empty, expected where the arm is touched [m]')
    for name, low in (('contact_s', 'over 0'), ('marker_s', 'from 0')):
        for s in getattr(options, name):
            if not 0.0 <= s <= arm.length * (1.0 + 1e-9) or (s == 0.0 and name == 'contact_s'):
                raise ConfigError(
                    f'estimator.{name} has {s:g}, expected {low} to {arm.length:g} m'
                )
    if len({min(s, arm.length) for s in positions}) < len(positions):
        raise ConfigError(
            f'estimator.contact_s is {shown(list(positions))}, expected each place once'
        )


def _unknowns(
    options: EstimatorParameters, config: Config, recorded: TensionStatistics, notes: list[str]
) -> Mapping[str, Unknowns]:
    """Return the unknowns of every place of contact, by its name."""
    arm, time = config.arm, options.force_time
    # Tendons that end near the tip have far lower tensions than those that end near the base.
    highest = default_highest(arm).ravel().tolist()
    rate = options.tension_rate or recorded.rate
    if rate > options.tension_rate:
        notes.append(f'tensions change by {rate:.3g} N in a second (as fast as recorded)')
        _check_recorded('tensions change by', rate, 'N in a second', 'estimator.tension_rate')
    elif not rate:
        largest = f'up to {max(highest):.3g} N'
        notes.append(f'tensions change by {largest} in a second (what each tendon is pulled by)')
    tension = tuple(Walk(max(high, rate), rate or high) for high in highest)
    common: dict[str, Any] = {'tension': tension}
    common |= _slow_unknowns(options, config, notes)
    if options.contact == 'none':
        return {'none': Unknowns(**common)}
    stddev = options.force_stddev or bending_force(arm, BENT)
    if not options.force_stddev:
        notes.append(f'forces of {stddev:.3g} N are expected ({BENT:g} L at the tip)')
    if options.contact == 'current':
        pressure = options.current_stddev or stddev / facing_area(arm)
        return {'current': Unknowns(**common, current=Walk.stationary(pressure, time))}
    force = Walk.stationary(stddev, time)
    if options.contact == 'tip':
        if options.moment_stddev:
            common['tip_moment'] = Walk.stationary(options.moment_stddev, time)
        return {'tip': Unknowns(**common, tip_force=force)}
    positions = options.contact_s
    if options.contact == 'at':
        points = tuple(PointForce(s, force) for s in positions)
        return {'at': Unknowns(**common, point_forces=points)}
    # The quotient comes first, so that the last place is exactly the tip.
    positions = positions or tuple((n + 1) / PLACES * arm.length for n in range(PLACES))
    hypotheses = {'none': Unknowns(**common)}
    for name, s in zip(place_names(positions), positions, strict=True):
        hypotheses[name] = Unknowns(**common, point_forces=(PointForce(s, force),))
    return hypotheses


def _slow_unknowns(
    options: EstimatorParameters, config: Config, notes: list[str]
) -> dict[str, Walk]:
    """Return the unknowns of load cells, friction and material, which change slowly."""
    walks, arm = {}, config.arm
    if options.tension_bias_stddev:
        walks['tension_bias'] = Walk(options.tension_bias_stddev, options.tension_bias_rate)
    loss = options.tension_loss_stddev or TURNED * max(arm.friction, default=0.0)
    if loss:
        walks['tension_loss'] = Walk.stationary(loss, options.force_time)
        if not options.tension_loss_stddev:
            notes.append(f'friction may hold back {loss:.3g} of each tension')
    if config.uncertainty.youngs_modulus:
        if arm.sheath_stiffness:
            raise ConfigError(
                f'material.youngs_modulus_stddev is {config.uncertainty.youngs_modulus:g}, '
                'expected 0 with tendons.sheath_stiffness, which is not in proportion to E'
            )
        walks['log_modulus'] = Walk(config.uncertainty.youngs_modulus)
    return walks


def _check_recorded(quantity: str, value: float, unit: str, name: str) -> None:
    """Check a recorded ``value`` that replaces the parameter ``name``, which is not given."""
    if value > LARGEST:
        raise ConfigError(
            f'{quantity} {value:.3g} {unit} as recorded, expected at most {LARGEST:g}: give {name}'
        )


def _tension_stddev(config: Config, recorded: TensionStatistics, notes: list[str]) -> float:
    """Return the deviation of load cells [N]: that of the arm, or else of the recording."""
    tension = config.uncertainty.tension or recorded.noise
    if tension > config.uncertainty.tension:
        _check_recorded('tensions vary by', tension, 'N', 'tension_stddev')
        notes.append(f'tensions are measured to {tension:.3g} N (as their differences vary)')
    elif not tension:
        tension = _TENSION
        notes.append(f'tensions are measured to {tension:g} N (tension_stddev is not given)')
    return tension
