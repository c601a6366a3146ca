"""Messages of tensions and displacements: their types, and the reading of each.

A message is an object of the library that decoded it, ROS or `rosbags`, whose classes have the
same fields. The value of each tendon of the arm is found by a name, by its number from 0 on if
values have no names, or is `NONE`: that tendon has no load cell, and is slack.
"""

import re
from array import array
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import TensionError, listed, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.calibration import Calibration
from octo_arm_model.rod.displacements import check_displacements

NONE = '-'
MAX_VALUES = 100_000  # in one message
_LISTS = (list, tuple, array, np.ndarray)  # of values, in messages of ROS or `rosbags`
_STEP = re.compile(r'^([A-Za-z]\w*)((?:\[\d{1,9}\])*)$')


def field_of(message: Any, path: str) -> Any:
    """Return the field ``path`` of a ``message``, e.g. 'wrench.force.x', 'poses[2].position'.

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
            if not isinstance(value, _LISTS) or int(number) >= len(value):
                raise TensionError(f'no field {shown(path)}: it has no entry {number}')
            value = value[int(number)]
    if isinstance(value, _LISTS) and len(value) > MAX_VALUES:
        raise TensionError(f'{path} has {len(value)} values, expected at most {MAX_VALUES}')
    return value


def field_values(message: Any, path: str) -> FloatArray:
    """Return the numbers (n,) in the field ``path`` of a ``message``.

    Raises:
        TensionError: if there is no such field, it has too many entries, or holds no numbers.
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
    """Return the ``values`` of the ``field`` of a message by the ``names`` of their tendons.

    Raises:
        TensionError: if the numbers of names and values differ, or a name is repeated.
    """
    if len(names) > MAX_VALUES:
        raise TensionError(f'name has {len(names)} entries, expected at most {MAX_VALUES}')
    if len(names) != len(values):
        raise TensionError(f'name has {len(names)} entries but {field} has {len(values)}')
    by_name = dict(zip(names, values))
    if len(by_name) < len(names):
        repeated = sorted(name for name, count in Counter(names).items() if count > 1)
        raise TensionError(f'tendon named more than once: {listed(repeated)}')
    return by_name


def tensions_by_names(
    values: FloatArray,
    names: Sequence[str] | None,
    chosen: Sequence[str],
    arm: Arm,
    hint: str = 'tension_names (--tendons)',
) -> FloatArray:
    """Return tensions of ``arm``, of `Arm.tension_shape` [N], from ``values`` (n,) by ``names``.

    ``chosen`` is the name of each tendon's value, or its number if there are no ``names``, or
    `NONE`. If it is empty, it is the tendons' own names or their order. Errors name the ``hint``.

    Raises:
        TensionError: if a value is missing, or named more than once, or there are too many.
    """
    if len(values) > MAX_VALUES:
        raise TensionError(f'{len(values)} values, expected at most {MAX_VALUES}')
    if names is not None and len(names) != len(values):
        raise TensionError(f'{len(names)} names but {len(values)} values')
    count = len(arm.tendons)
    if not (chosen or names is not None or len(values) == count):
        raise TensionError(
            f'{len(values)} values, expected {count}, one for each tendon, section by section '
            f'from the tip, or {hint} that say which is which'
        )
    usual: Sequence[str] = arm.tendon_names
    if names is None:
        usual = names = list(map(str, range(len(values))))
    chosen = chosen or usual
    places = {name: number for number, name in enumerate(names)}
    repeated = [name for name, times in Counter(names).items() if times > 1 and name in chosen]
    if repeated:
        raise TensionError(f'named more than once: {listed(repeated[:1])}')
    tensions = np.zeros(len(arm.tendons))
    for tendon, name in enumerate(chosen):
        if name == NONE:
            continue
        if name not in places:
            raise TensionError(
                f'no value {shown(name)} for {arm.tendon_names[tendon]}; there are {listed(names)}'
            )
        tensions[tendon] = values[places[name]]
    return tensions.reshape(arm.tension_shape)


def names_of(message: Any, path: str) -> list[str] | None:
    """Return the names in the field 'name' of a ``message`` of the values in its list ``path``.

    None means that values have no names: ``path`` is a number, or 'name' no list, or empty.
    """
    names, is_list = getattr(message, 'name', None), isinstance(field_of(message, path), _LISTS)
    if is_list and isinstance(names, (list, tuple)) and names:
        return list(map(str, names))
    return None


@dataclass(frozen=True)
class TensionMessage:
    """A type of message that carries the tensions of all tendons."""

    type_name: str  #: name of the type, such as 'sensor_msgs/msg/JointState'
    tensions: str  #: field of the tensions [N]
    #: field of the tendons' names; None if tensions are row-major, with the shape in the field
    #: 'layout'
    names: str | None = None

    def read(self, message: Any, arm: Arm, chosen: Sequence[str] = ()) -> FloatArray:
        """Return the tensions [N], of `Arm.tension_shape`, in a ``message`` of this type.

        ``chosen`` picks values as in `tensions_by_names`. If it is empty, the message must have
        the tensions of all tendons and no others.

        Raises:
            TensionError: if names are unknown, repeated or missing, lengths differ, or the layout
                is neither empty, flat nor that shape.
        """
        values, shape = getattr(message, self.tensions), arm.tension_shape
        names = None if self.names is None else list(getattr(message, self.names))
        if names is not None and not chosen:
            _of_tendons(names, values, self.tensions, arm)
        elif not chosen:
            offset = message.layout.data_offset
            sizes = tuple(dimension.size for dimension in message.layout.dim)
            if offset != 0 or sizes not in ((), (len(arm.tendons),), shape):
                raise TensionError(
                    f'layout is {sizes} with data_offset {offset}, expected an empty one or '
                    f'{shape} with data_offset 0'
                )
        return tensions_by_names(np.asarray(values, np.float64), names, chosen, arm)


@dataclass(frozen=True)
class FieldMessage:
    """A type of message in which one field holds tensions."""

    type_name: str  #: name of the type
    field: str  #: path of the field; if it is a list, names are in the field 'name', if it has any

    def read(self, message: Any, arm: Arm, chosen: Sequence[str] = ()) -> FloatArray:
        """Return the tensions [N], of `Arm.tension_shape`, among the values of the field.

        Raises:
            TensionError: if there is no such field of numbers, a value is missing or named more
                than once, or there is another number of names.
        """
        values = field_values(message, self.field)
        return tensions_by_names(values, names_of(message, self.field), chosen, arm)


TENDON_TENSIONS = TensionMessage('octo_arm_msgs/msg/TendonTensions', 'tension', 'name')
FLOAT64_ARRAY = TensionMessage('std_msgs/msg/Float64MultiArray', 'data')
FLOAT32_ARRAY = TensionMessage('std_msgs/msg/Float32MultiArray', 'data')
JOINT_STATE = TensionMessage('sensor_msgs/msg/JointState', 'effort', 'name')

# All topics of tensions, for the node, the simulator and the bag tools: one row each.
TENSION_TOPICS: dict[str, TensionMessage] = {
    'tendon_tensions': TENDON_TENSIONS,
    'tendon_tensions/array': FLOAT64_ARRAY,
    'tendon_tensions/float32_array': FLOAT32_ARRAY,
    'tendon_tensions/joint_state': JOINT_STATE,
}


def _of_tendons(
    names: Sequence[str], values: Sequence[float], field: str, arm: Arm
) -> dict[str, float]:
    by_name = values_by_name(names, values, field)
    tendons = set(arm.tendon_names)
    if unknown := [name for name in names if name not in tendons]:
        raise TensionError(
            f'unknown tendon {listed(unknown)}; this arm has {listed(arm.tendon_names)}'
        )
    return by_name


def read_joint_commands(message: Any, arm: Arm) -> tuple[dict[str, float], dict[str, float]]:
    """Return tensions [N] and lengths to reel in [m] by tendon that a JointState commands.

    One of the two is empty, because a controller sends the array of the interface it commands.

    Raises:
        TensionError: if not exactly one of effort and position is given, names are unknown or
            repeated, lengths differ, or a position is not finite.
    """
    arrays = [name for name in ('position', 'velocity', 'effort') if len(getattr(message, name))]
    if arrays == ['position']:
        return {}, read_displacements(message, arm)
    if arrays != ['effort']:
        raise TensionError(
            f'a command of {" and ".join(arrays) or "nothing"}, expected either effort [N] or '
            'position [m]'
        )
    return _of_tendons(message.name, message.effort, 'effort', arm), {}


DISPLACEMENTS = 'tendon_displacements'
DISPLACEMENT_TYPE = 'sensor_msgs/msg/JointState'


def read_displacements(
    message: Any, arm: Arm, encoders: Calibration = Calibration(), field: str = ''
) -> dict[str, float]:
    """Return the length reeled in [m] by tendon, from readings of ``encoders`` in a ``message``.

    Readings are the positions of a JointState by name of the tendon, or by name of the encoder if
    ``encoders`` have names, or the values of the ``field`` of any message.

    Raises:
        TensionError: if names are unknown or repeated, lengths differ, or a position is not
            finite.
    """
    tendons, chosen = arm.tendon_names, encoders.names
    if not (field or chosen):  # of some tendons, by their own names
        if len(message.name) > len(tendons):
            raise TensionError(
                f'{len(message.name)} displacements, this arm has {len(tendons)} tendons'
            )
        by_name = values_by_name(message.name, message.position, 'position')
        check_displacements(arm, {name: float(value) for name, value in by_name.items()}, {})
        chosen = tuple(name if name in by_name else NONE for name in tendons)
    field = field or 'position'
    values, names = field_values(message, field), names_of(message, field)
    hint = 'displacement_names (--motors)'
    readings = tensions_by_names(values, names, chosen, arm, hint).ravel()
    has_reading = [name != NONE for name in chosen or tendons]
    lengths = zip(tendons, encoders.scale_and_offset(readings).tolist(), has_reading, strict=True)
    displacements = {name: length for name, length, is_read in lengths if is_read}
    check_displacements(arm, displacements, {})
    return displacements
