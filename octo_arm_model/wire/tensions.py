"""Tensions and displacements as messages carry them: which those are, and how each is read.

A message is an object of whichever library decoded it, ROS or `rosbags`: other classes with the
same fields. For each tendon of the arm there is the name of its value in what comes in, or the
number of the value from 0 on where these have no names, or `NONE`: that tendon has no load cell,
and is slack.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import TensionError, listed, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.build import EncoderCalibration
from octo_arm_model.rod.displacements import check_displacements

NONE = '-'
MAX_VALUES = 100_000  # of one message
_STEP = re.compile(r'^([A-Za-z]\w*)((?:\[\d{1,9}\])*)$')


def field_of(message: Any, path: str) -> Any:
    """The field ``path`` of a ``message``, such as 'wrench.force.x' or 'poses[2].position'.

    Raises:
        TensionError: if there is no such field, or it has too many entries.
    """
    value = message
    for step in path.split('.'):
        match = _STEP.match(step)
        if match is None or not hasattr(value, match[1]):
            raise TensionError(f'no field {shown(path)}')
        value = getattr(value, match[1])
        for number in re.findall(r'\d+', match[2]):
            if not isinstance(value, (list, tuple, np.ndarray)) or int(number) >= len(value):
                raise TensionError(f'no field {shown(path)}: it has no entry {number}')
            value = value[int(number)]
    if isinstance(value, (list, tuple, np.ndarray)) and len(value) > MAX_VALUES:
        raise TensionError(f'{path} has {len(value)} values, expected at most {MAX_VALUES}')
    return value


def field_values(message: Any, path: str) -> FloatArray:
    """Numbers of the field ``path`` of a ``message``, see `field_of`, (n,).

    Raises:
        TensionError: as `field_of`, or if it holds no numbers.
    """
    value = field_of(message, path)
    try:
        array = np.atleast_1d(np.asarray(value))
    except ValueError:
        array = np.array([None])
    if array.dtype.kind not in 'fiu' or array.ndim != 1:
        raise TensionError(f'{path} is {shown(value)}, expected numbers')
    return array.astype(np.float64)


def values_by_name(names: Sequence[str], values: Sequence[float], field: str) -> dict[str, float]:
    """The ``values`` of the ``field`` of a message by the ``names`` of their tendons.

    Raises:
        TensionError: if there are not as many names, or too many, or one is repeated.
    """
    if len(names) > MAX_VALUES:
        raise TensionError(f'name has {len(names)} entries, expected at most {MAX_VALUES}')
    if len(names) != len(values):
        raise TensionError(f'name has {len(names)} entries but {field} has {len(values)}')
    found = dict(zip(names, values))
    if len(found) < len(names):
        repeated = sorted(name for name, count in Counter(names).items() if count > 1)
        raise TensionError(f'tendon named more than once: {listed(repeated)}')
    return found


def tensions_by_names(
    values: FloatArray,
    names: Sequence[str] | None,
    wanted: Sequence[str],
    arm: Arm,
    hint: str = 'tension_names (--tendons)',
) -> FloatArray:
    """Tensions of ``arm``, of `Arm.tension_shape` [N], from ``values`` (n,) of these ``names``.

    ``wanted`` is the name or number of each tendon's value, or `NONE`; empty for the tendons' own
    names, or, where there are no names, the order of the tendons. The ``hint`` is in errors.

    Raises:
        TensionError: if a value is missing, or named more than once, or there are too many.
    """
    if len(values) > MAX_VALUES:
        raise TensionError(f'{len(values)} values, expected at most {MAX_VALUES}')
    if names is not None and len(names) != len(values):
        raise TensionError(f'{len(names)} names but {len(values)} values')
    count = len(arm.tendons)
    if not (wanted or names is not None or len(values) == count):
        raise TensionError(
            f'{len(values)} values, expected {count}, one for each tendon, or {hint} that say '
            'which is which'
        )
    wanted = wanted or (arm.tendon_names if names is not None else list(map(str, range(count))))
    places = {str(n): n for n in range(len(values))}
    places |= {name: n for n, name in enumerate(names or ())}
    repeated = [name for name, times in Counter(names).items() if times > 1 and name in wanted]
    if repeated:
        raise TensionError(f'named more than once: {listed(repeated[:1])}')
    tensions = np.zeros(len(arm.tendons))
    for tendon, name in enumerate(wanted):
        if name == NONE:
            continue
        if name not in places:
            raise TensionError(
                f'no value {shown(name)} for {arm.tendon_names[tendon]}; there are '
                f'{listed(names or list(places))}'
            )
        tensions[tendon] = values[places[name]]
    return tensions.reshape(arm.tension_shape)


def names_of(message: Any, count: int) -> list[str] | None:
    """Names of the values in the field 'name' of a ``message``, if there are ``count``."""
    names = getattr(message, 'name', None)
    if isinstance(names, (list, tuple)) and len(names) == count and count:
        return [str(name) for name in names]
    return None


@dataclass(frozen=True)
class TensionMessage:
    """A type of message that carries the tensions of all tendons.

    Attributes:
        type_name: its name, such as 'sensor_msgs/msg/JointState'.
        tensions: the field of the tensions [N].
        names: the field of the tendons' names in their order; None where tensions are row-major
            and the field 'layout' says of which shape.
    """

    type_name: str
    tensions: str
    names: str | None = None

    def read(self, message: Any, arm: Arm, wanted: Sequence[str] = ()) -> FloatArray:
        """Tensions [N], of `Arm.tension_shape`, of a ``message`` of this type.

        Of the values ``wanted``, see `tensions_by_names`, among others; empty where the message
        has those of all tendons and no others.

        Raises:
            TensionError: if names are unknown, repeated or missing, lengths differ, or the layout
                is neither empty, flat nor that shape.
        """
        values = getattr(message, self.tensions)
        names = None if self.names is None else getattr(message, self.names)
        if wanted:
            given = np.asarray(values, dtype=np.float64)
            return tensions_by_names(given, None if names is None else list(names), wanted, arm)
        shape, count = arm.tension_shape, len(arm.tendons)
        if names is not None:
            tension_of = _of_tendons(names, values, self.tensions, arm)
            if missing := [name for name in arm.tendon_names if name not in tension_of]:
                raise TensionError(f'no tension for tendon {listed(missing)}')
            values = [tension_of[name] for name in arm.tendon_names]
        elif len(values) != count:
            meaning = 'one for each tendon, section by section from the tip'
            if len(shape) == 2:
                meaning = f'{shape[0]} section(s) from the tip, {shape[1]} tendons each'
            raise TensionError(
                f'{self.tensions} has {len(values)} values, expected {count}: {meaning}'
            )
        else:
            offset = message.layout.data_offset
            sizes = tuple(dimension.size for dimension in message.layout.dim)
            if offset != 0 or sizes not in ((), (count,), shape):
                raise TensionError(
                    f'layout is {sizes} with data_offset {offset}, expected an empty one or '
                    f'{shape} with data_offset 0'
                )
        return np.array(values, dtype=np.float64).reshape(shape)


@dataclass(frozen=True)
class FieldMessage:
    """A type of message of which one field holds tensions.

    Attributes:
        type_name: its name.
        field: the field, see `field_values`; the names of its values are those in the field 'name'
            if there are as many.
    """

    type_name: str
    field: str

    def read(self, message: Any, arm: Arm, wanted: Sequence[str] = ()) -> FloatArray:
        """As `TensionMessage.read`, other values may always be there.

        Raises:
            TensionError: if there is no such field of numbers, a value is missing, or named more
                than once.
        """
        values = field_values(message, self.field)
        return tensions_by_names(values, names_of(message, len(values)), wanted, arm)


TENDON_TENSIONS = TensionMessage('octo_arm_msgs/msg/TendonTensions', 'tension', 'name')
FLOAT64_ARRAY = TensionMessage('std_msgs/msg/Float64MultiArray', 'data')
FLOAT32_ARRAY = TensionMessage('std_msgs/msg/Float32MultiArray', 'data')
JOINT_STATE = TensionMessage('sensor_msgs/msg/JointState', 'effort', 'name')

# Every topic of tensions, for the node, the simulator and the bag tools: one row adds one.
TENSION_TOPICS: dict[str, TensionMessage] = {
    'tendon_tensions': TENDON_TENSIONS,
    'tendon_tensions/array': FLOAT64_ARRAY,
    'tendon_tensions/float32_array': FLOAT32_ARRAY,
    'tendon_tensions/joint_state': JOINT_STATE,
}


def _of_tendons(
    names: Sequence[str], values: Sequence[float], field: str, arm: Arm
) -> dict[str, float]:
    found = values_by_name(names, values, field)
    known = set(arm.tendon_names)
    if unknown := [name for name in names if name not in known]:
        raise TensionError(
            f'unknown tendon {listed(unknown)}; this arm has {listed(arm.tendon_names)}'
        )
    return found


def read_joint_commands(message: Any, arm: Arm) -> tuple[dict[str, float], dict[str, float]]:
    """Tensions [N], or lengths to reel in [m], by name of the tendons that a JointState commands.

    One of the two is empty: a controller sends one array, of the interface that it commands.

    Raises:
        TensionError: if not exactly one of effort and position is given, names are unknown or
            repeated, lengths differ, or a position is not finite.
    """
    given = [name for name in ('position', 'velocity', 'effort') if len(getattr(message, name))]
    if given == ['position']:
        return {}, read_displacements(message, arm)
    if given != ['effort']:
        raise TensionError(
            f'a command of {" and ".join(given) or "nothing"}, expected either effort [N] or '
            'position [m]'
        )
    return _of_tendons(message.name, message.effort, 'effort', arm), {}


DISPLACEMENTS = 'tendon_displacements'
DISPLACEMENT_TYPE = 'sensor_msgs/msg/JointState'


def read_displacements(
    message: Any, arm: Arm, encoders: EncoderCalibration = EncoderCalibration(), field: str = ''
) -> dict[str, float]:
    """Length reeled in by tendon name [m], from the readings of ``encoders`` in a ``message``.

    Those are the positions of a JointState by name of the tendon, or else numbers by the names
    that encoders have, or of the ``field`` of any message, see `field_values`.

    Raises:
        TensionError: if names are unknown or repeated, lengths differ, or a position is not
            finite.
    """
    tendons = arm.tendon_names
    if field or encoders.names:
        values = field_values(message, field or 'position')
        names = names_of(message, len(values))
        hint = 'displacement_names (--motors)'
        readings = tensions_by_names(values, names, encoders.names, arm, hint).ravel()
        has = [name != NONE for name in encoders.names or tendons]
    else:
        if len(message.name) > len(tendons):
            raise TensionError(
                f'{len(message.name)} displacements, this arm has {len(tendons)} tendons'
            )
        given = values_by_name(message.name, message.position, 'position')
        check_displacements(arm, {name: float(value) for name, value in given.items()}, {})
        readings = np.array([given.get(name, 0.0) for name in tendons])
        has = [name in given for name in tendons]
    lengths = zip(tendons, encoders.lengths(readings).tolist(), has, strict=True)
    found = {name: length for name, length, is_read in lengths if is_read}
    check_displacements(arm, found, {})
    return found
