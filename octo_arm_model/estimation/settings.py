"""What an estimator takes for unknown and how exact sensors are, from its parameters."""

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
from octo_arm_model.config.parameter import ParameterGroup, refuse_unknown, stated
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.rules import GATE, Rules
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk, facing_area, place_names

CONTACTS = ('tip', 'at', 'somewhere', 'current', 'none')
MAX_PLACES = 50  # of a contact
MAX_MARKERS = 300  # whose coordinates are one measurement
PLACES = 5  # of a contact somewhere, evenly along the arm
BENT = 0.1  # of the length: how far the default of the force moves the tip
RECOVER_AFTER = 1.0  # [s]
CELL_FAULT, SENSOR_FAULT = 0.1, 0.005
TURNED = 2.0  # [rad] by which a tendon turns up to where its friction counts on average
PREFIX = 'estimator.'
_TENSION = 0.02  # [N], where neither the arm nor the recording says how exact load cells are


@dataclass(frozen=True)
class EstimatorParameters(ParameterGroup):
    """The node's ROS parameters, the command line's options and a table of the manual."""

    GROUP = 'estimator'

    contact: str = stated(
        'what acts on the arm besides its known loads: tip (a force on the tip), at (a '
        'force at contact_s), somewhere (a force at one of contact_s or nowhere, by their '
        'probabilities), current (uniform, of the surrounding fluid) or none',
        'tip',
        ', '.join(CONTACTS),
    )
    contact_s: tuple[float, ...] = stated(
        'arc coordinates of the contact [m]; empty, with somewhere, for '
        f'{PLACES} even steps up to the tip',
        (),
        f'in (0, body.length], at most {MAX_PLACES}',
        most=MAX_PLACES,
    )
    force_stddev: float = stated(
        'standard deviation of each component of the force before anything is measured [N]; '
        f'0 for the force that moves the tip by {BENT:g} of the length',
        0.0,
        '>= 0',
    )
    force_time: float = stated(
        'correlation time of force, moment and current: how long what is found is taken to '
        'go on where nothing is measured [s]',
        1.0,
        '> 0',
    )
    change_time: float = stated(
        'with somewhere, mean time after which the contact is at another place [s]', 1.0, '> 0'
    )
    moment_stddev: float = stated(
        'likewise of each component of a moment on the tip, with tip [N m]; 0 for none',
        0.0,
        '>= 0',
    )
    current_stddev: float = stated(
        'likewise of the pressure of a current [Pa]; 0 for that of force_stddev over the '
        'arm seen from the side',
        0.0,
        '>= 0',
    )
    tension_rate: float = stated(
        'standard deviation of the change of each tension in a second [N]; 0 for what the '
        'tendon is pulled by at most',
        0.0,
        '>= 0',
    )
    tension_bias_stddev: float = stated(
        'standard deviation of what each load cell shows too much, constant [N]; 0 for nothing',
        0.0,
        '>= 0',
    )
    tension_bias_rate: float = stated(
        'standard deviation of its change in a second [N]', 0.0, '>= 0'
    )
    tension_loss_stddev: float = stated(
        'standard deviation of the logarithm of the tension of each tendon at the base over '
        'that along the arm, as friction changes it, with the correlation time force_time '
        f'[-]; 0 for {TURNED:g} rad times tendons.friction',
        0.0,
        '>= 0',
    )
    displacement_stddev: float = stated(
        'standard deviation of tendon_displacements [m]', 2e-4, '> 0'
    )
    marker_s: tuple[float, ...] = stated(
        'arc coordinates of the markers of measured/markers, from the base on [m]',
        (),
        f'in [0, body.length], at most {MAX_MARKERS}',
        most=MAX_MARKERS,
    )
    marker_stddev: float = stated(
        'standard deviation of each coordinate of a marker [m]', 1e-3, '> 0'
    )
    tip_position_stddev: float = stated(
        'standard deviation of each coordinate of measured/tip_pose where the message has '
        'no covariance [m]; 0: such a message is refused',
        0.0,
        '>= 0',
    )
    tip_rotation_stddev: float = stated(
        'likewise of its rotation vector [rad]; 0: the orientation is not used', 0.0, '>= 0'
    )
    base_force_stddev: float = stated(
        'standard deviation of each force of measured/base_wrench [N]; 0: its messages are '
        'refused',
        0.0,
        '>= 0',
    )
    base_moment_stddev: float = stated('likewise of each moment [N m]', 0.0, '>= 0')
    gate: float = stated(
        'probability with which a right measurement is accepted; one that lies farther off '
        'is refused',
        GATE,
        'in (0, 1)',
    )
    cell_fault: float = stated(
        'how probable it is that one load cell lies, in parts of the probability that all '
        'sensors are right: where others cannot tell, the covariance holds what would be; 0 '
        'for load cells that never lie',
        CELL_FAULT,
        'in [0, 1)',
    )
    sensor_fault: float = stated('likewise of each other sensor', SENSOR_FAULT, 'in [0, 1)')
    window: float = stated('how late measurements may come [s]', 0.2, '>= 0')
    recover_after: float = stated(
        'for how long sensors have to contradict the estimate, whichever is doubted, for '
        'it to begin anew [s]; 0 for never',
        RECOVER_AFTER,
        '>= 0',
    )


ESTIMATOR_PARAMETERS = EstimatorParameters.table()


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of what is measured; 0 where they are not known.

    Attributes:
        tension: [N].
        model_position: of each coordinate of tip and markers, by the error of the model [m].
        model_rotation: of the rotation vector of the tip, likewise [rad].
        given: all parameters of the estimator: also those of other sensors, and where they are.
    """

    tension: float
    model_position: float
    model_rotation: float
    given: EstimatorParameters


class TensionStatistics(NamedTuple):
    """How tensions of a recording vary; 0 where it does not tell.

    Attributes:
        noise: standard deviation of one reading [N].
        rate: of the change in a second, of a random walk that keeps up with them [N/s^0.5].
    """

    noise: float = 0.0
    rate: float = 0.0


@dataclass(frozen=True)
class EstimatorSettings:
    """An estimator's parameters, checked, with what the arm's description has for defaults.

    Attributes:
        unknowns: of each hypothesis, by its name; one where the place of contact is given.
        noise: of the sensors.
        rules: what is taken for granted of sensors.
        window: how late measurements may come [s].
        change_time: see `Estimator` [s].
        notes: values that were not given, in words.
    """

    unknowns: Mapping[str, Unknowns]
    noise: SensorNoise
    rules: Rules
    window: float
    change_time: float
    notes: tuple[str, ...]

    @classmethod
    def from_parameters(
        cls, values: Mapping[str, Any], config: Config, recorded: TensionStatistics | None = None
    ) -> EstimatorSettings:
        """From dotted names to values, of the estimator alone, for the arm of ``config``.

        What is not given is that of the tensions ``recorded``, where there are any.

        Raises:
            ConfigError: if a parameter is unknown or of the wrong type.
            ArmDefinitionError: if a value is outside its range.
            MeasurementError: if a contact is not on the arm.
        """
        table, arm = ESTIMATOR_PARAMETERS, config.arm
        refuse_unknown(values, [one.name for one in table], 'the estimator')
        given = EstimatorParameters.of(
            {one.name: one.convert(values.get(one.name, one.default)) for one in table}
        )
        _check(given, arm)
        # Up to rounding places are on the arm.
        contact_s, marker_s = (
            tuple(min(s, arm.length) for s in places)
            for places in (given.contact_s, given.marker_s)
        )
        given = dataclasses.replace(given, contact_s=contact_s, marker_s=marker_s)
        recorded, notes = recorded or TensionStatistics(), list[str]()
        return cls(
            _unknowns(given, config, recorded, notes),
            _noise(given, config, recorded, notes),
            Rules(given.gate, given.cell_fault, given.sensor_fault, given.recover_after),
            given.window,
            given.change_time,
            tuple(notes),
        )

    def models(self, config: Config, **options: Any) -> dict[str, ArmModel]:
        """The arm of ``config`` with the unknowns of each hypothesis, solved by the model exact.

        ``options`` are those of `ArmModel.of`.

        Raises:
            ConfigError: as `ArmModel`.
        """
        return {
            name: ArmModel.of(config, unknowns, **options)
            for name, unknowns in self.unknowns.items()
        }


def _check(given: EstimatorParameters, arm: Arm) -> None:
    """Check places against the arm, and what a range alone does not tell."""
    contact, places = given.contact, given.contact_s
    if contact not in CONTACTS:
        raise ConfigError(
            f'estimator.contact is {shown(contact)}, expected one of {", ".join(CONTACTS)}'
        )
    if places and contact not in ('at', 'somewhere'):
        raise ConfigError(f'estimator.contact_s is given, which goes not with contact {contact}')
    if contact == 'at' and not places:
        raise ConfigError('estimator.contact_s is empty, expected where the arm is touched [m]')
    for name, low in (('contact_s', 'over 0'), ('marker_s', 'from 0')):
        for s in getattr(given, name):
            if not 0.0 <= s <= arm.length * (1.0 + 1e-9) or (s == 0.0 and name == 'contact_s'):
                raise ConfigError(
                    f'estimator.{name} has {s:g}, expected {low} to {arm.length:g} m'
                )
    if len({min(s, arm.length) for s in places}) < len(places):
        raise ConfigError(
            f'estimator.contact_s is {shown(list(places))}, expected each place once'
        )
    if not 0.0 < given.gate < 1.0:
        raise ConfigError(f'estimator.gate is {given.gate}, expected within (0, 1)')


def _unknowns(
    given: EstimatorParameters, config: Config, recorded: TensionStatistics, notes: list[str]
) -> Mapping[str, Unknowns]:
    """The unknowns of every hypothesis."""
    arm, time = config.arm, given.force_time
    # Tendons that end near the tip are pulled by far less than those of the base.
    highest = default_highest(arm).ravel().tolist()
    rate = given.tension_rate or recorded.rate
    if rate > given.tension_rate:
        notes.append(f'tensions change by {rate:.3g} N in a second (as fast as recorded)')
        _check_recorded('tensions change by', rate, 'N in a second', 'estimator.tension_rate')
    elif not rate:
        most = f'up to {max(highest):.3g} N'
        notes.append(f'tensions change by {most} in a second (what each tendon is pulled by)')
    fixed: dict[str, Any] = {'tension': tuple(Walk(max(h, rate), rate or h) for h in highest)}
    fixed |= _slow_unknowns(given, config, notes)
    if given.contact == 'none':
        return {'none': Unknowns(**fixed)}
    stddev = given.force_stddev or bending_force(arm, BENT)
    if not given.force_stddev:
        notes.append(f'forces of {stddev:.3g} N are expected ({BENT:g} L at the tip)')
    if given.contact == 'current':
        pressure = given.current_stddev or stddev / facing_area(arm)
        return {'current': Unknowns(**fixed, current=Walk.stationary(pressure, time))}
    force = Walk.stationary(stddev, time)
    if given.contact == 'tip':
        if given.moment_stddev:
            fixed['tip_moment'] = Walk.stationary(given.moment_stddev, time)
        return {'tip': Unknowns(**fixed, tip_force=force)}
    places = given.contact_s
    if given.contact == 'at':
        points = tuple(PointForce(s, force) for s in places)
        return {'at': Unknowns(**fixed, point_forces=points)}
    # The last of them is the tip itself, whatever the length.
    places = places or tuple((n + 1) / PLACES * arm.length for n in range(PLACES))
    hypotheses = {'none': Unknowns(**fixed)}
    for name, s in zip(place_names(places), places, strict=True):
        hypotheses[name] = Unknowns(**fixed, point_forces=(PointForce(s, force),))
    return hypotheses


def _slow_unknowns(
    given: EstimatorParameters, config: Config, notes: list[str]
) -> dict[str, Walk]:
    """Those of load cells, friction and the material, which change slowly."""
    found, arm = {}, config.arm
    if given.tension_bias_stddev:
        found['tension_bias'] = Walk(given.tension_bias_stddev, given.tension_bias_rate)
    loss = given.tension_loss_stddev or TURNED * max(arm.friction, default=0.0)
    if loss:
        found['tension_loss'] = Walk.stationary(loss, given.force_time)
        if not given.tension_loss_stddev:
            notes.append(f'friction may hold back {loss:.3g} of each tension')
    if config.uncertainty.youngs_modulus:
        if arm.sheath_stiffness:
            raise ConfigError(
                f'material.youngs_modulus_stddev is {config.uncertainty.youngs_modulus:g}, '
                'expected 0 with tendons.sheath_stiffness, which is not in proportion to E'
            )
        found['log_modulus'] = Walk(config.uncertainty.youngs_modulus)
    return found


def _check_recorded(what: str, value: float, unit: str, name: str) -> None:
    """Check what is taken from a recording where the parameter ``name`` is not given."""
    if value > LARGEST:
        raise ConfigError(
            f'{what} {value:.3g} {unit} as recorded, expected at most {LARGEST:g}: give {name}'
        )


def _noise(
    given: EstimatorParameters, config: Config, recorded: TensionStatistics, notes: list[str]
) -> SensorNoise:
    """Noise of the sensors; that of the load cells is the arm's, or else of the recording."""
    known, tension = config.uncertainty, config.uncertainty.tension or recorded.noise
    if tension > known.tension:
        _check_recorded('tensions vary by', tension, 'N', 'tension_stddev')
        notes.append(f'tensions are measured to {tension:.3g} N (as their differences vary)')
    elif not tension:
        tension = _TENSION
        notes.append(f'tensions are measured to {tension:g} N (tension_stddev is not given)')
    return SensorNoise(tension, known.model_position, known.model_rotation, given)
