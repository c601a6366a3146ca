"""A parameter: its name, type, default and meaning; and groups of them as dataclasses."""

import dataclasses
import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

from octo_arm_model.arm import validation
from octo_arm_model.arm.errors import ConfigError, listed, shown
from octo_arm_model.arm.hints import Vector
from octo_arm_model.arm.limits import MAX_NAME, MAX_TABLE_POINTS

Values = Mapping[str, Any]  # of all parameters, by their names

# The end of the meaning of arc coordinates of a table.
TABLE_BOUND = f'; at most {MAX_TABLE_POINTS}'
_UNIT = re.compile(r'\[([^]]*)\]')


@dataclass(frozen=True)
class Parameter:
    """One parameter.

    Attributes:
        name: dotted name, as in ROS.
        description: what it is, with its unit in brackets.
        default: value where none is given; None means it must be given.
        range: allowed values, in words; the core checks them.
        unless: names of parameters that replace it; if one is given it may be missing.
        most: number of values that a list has at most, whether they are used or not.
        what: what errors call a value.
        kind: type of a value, or of those of a list: that of the default, where this tells.
        is_array: whether it is a list, as any that has one for default.
    """

    name: str
    description: str
    default: Any = None
    range: str = ''
    unless: tuple[str, ...] = ()
    most: int = MAX_TABLE_POINTS
    what: str = 'number'
    kind: type = float
    is_array: bool = False

    def __post_init__(self) -> None:
        """Take kind and form from the default."""
        if isinstance(self.default, tuple):
            object.__setattr__(self, 'is_array', True)
        if self.default not in (None, ()):
            element = self.default[0] if self.is_array else self.default
            object.__setattr__(self, 'kind', type(element))

    @property
    def type_name(self) -> str:
        """Name of the type in ROS, e.g. ``double[]``."""
        word = {float: 'double', int: 'integer', str: 'string', bool: 'bool'}[self.kind]
        return word + '[]' if self.is_array else word

    @property
    def default_or_none_given(self) -> Any:
        """Value declared in ROS, where every parameter has one.

        The default, or zero or an empty list for a parameter without default.
        """
        if self.default is not None:
            return self.default
        return () if self.is_array else self.kind()

    def convert(self, value: object) -> Any:
        """Return ``value`` as this parameter's type; an integer is accepted for a double.

        Raises:
            ConfigError: if the type is another, or a list has too many values.
        """
        if self.is_array and isinstance(value, (list, tuple)):
            if len(value) > self.most:
                raise ConfigError(
                    f'{self.name} has {len(value)} values, expected at most {self.most}'
                )
            return tuple(self._convert_one(element, value) for element in value)
        return self._convert_one(value, value) if not self.is_array else self._refuse(value)

    def check(self, value: Any) -> None:
        """Check a converted ``value``, or each of a list.

        Numbers are finite, and in the range where that is '>= 0', '> 0' or 'in [0, 1]'.

        Raises:
            ArmDefinitionError: if one is not.
        """
        if self.is_array:
            for element in value:
                self._check_one(element)
        else:
            self._check_one(value)

    def _check_one(self, value: Any) -> None:
        unit = ''.join(_UNIT.findall(self.description)[:1])
        if self.range == '>= 0' and self.kind is int:
            validation.whole(self.name, value)
        elif self.range == '>= 0':
            validation.not_negative(self.name, value, self.what, unit)
        elif self.range == '> 0':
            validation.positive(self.name, value, unit)
        elif self.range == 'in [0, 1]':
            validation.within(self.name, value, 0.0, 1.0, unit)
        elif self.kind is float:
            validation.finite(self.name, value)

    def _convert_one(self, element: object, value: object) -> Any:
        if self.kind is float and isinstance(element, int) and not isinstance(element, bool):
            try:
                return float(element)
            except OverflowError:
                return self._refuse(value)
        if isinstance(element, self.kind) and (self.kind is bool or not isinstance(element, bool)):
            if self.kind is str and not validation.is_text(element):
                return self._refuse(value, f' of at most {MAX_NAME} characters, without NUL')
            return element
        return self._refuse(value)

    def _refuse(self, value: object, what: str = '') -> Any:
        raise ConfigError(f'{self.name} is {shown(value)}, expected {self.type_name}{what}')


def check_length(name: str, column: Sequence[Any], count: int, what: str) -> None:
    """Check that the list ``name`` has ``count`` values.

    Raises:
        ConfigError: if not; ``what`` ends the message.
    """
    if len(column) != count:
        raise ConfigError(f'{name} has {len(column)} values, expected {count}{what}')


def vectors_of(name: str, flat: Sequence[float], count: int, of: str) -> tuple[Vector, ...]:
    """The vectors that the list ``name`` has, as many as ``count``, one after the other.

    Raises:
        ConfigError: if it has not three numbers for each of the list ``of``.
    """
    check_length(name, flat, 3 * count, f', three for each of {of}')
    return tuple((flat[i], flat[i + 1], flat[i + 2]) for i in range(0, 3 * count, 3))


def refuse_unknown(values: Mapping[str, Any], known: Sequence[str], owner: str) -> None:
    """Check that all names in ``values`` are ``known`` parameters of ``owner``.

    Raises:
        ConfigError: if one is not; the message suggests a similar name.
    """
    for name in values:
        if name not in known:
            close = difflib.get_close_matches(str(name), known, n=1)
            hint = f'did you mean {close[0]}?' if close else f'known are {listed(known)}'
            raise ConfigError(f'{shown(name)[1:-1]} is no parameter of {owner}; {hint}')


Group = TypeVar('Group', bound='ParameterGroup')


def stated(
    description: str,
    default: Any,
    allowed: str = '',
    what: str = 'number',
    most: int = MAX_TABLE_POINTS,
) -> Any:
    """A field of a `ParameterGroup`, an array where its ``default`` is a tuple.

    The ``description`` has its unit in brackets. Values that are not ``allowed``, in words, are
    refused by `Parameter.check`, whose error says ``what`` they are. An array has ``most`` values
    at most.
    """
    parameter = Parameter('', description, default, allowed, most=most, what=what)
    return dataclasses.field(default=default, metadata={'stated': parameter})


@dataclass(frozen=True)
class ParameterGroup:
    """Base of the dataclasses of one group of parameters, each a field that is `stated`.

    Attributes:
        GROUP: what their names begin with, before a dot; '' for nothing.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    GROUP: ClassVar[str]

    def __post_init__(self) -> None:
        """Validate."""
        for parameter, field in zip(self.table(), dataclasses.fields(self), strict=True):
            parameter.check(getattr(self, field.name))

    @classmethod
    def table(cls) -> tuple[Parameter, ...]:
        """The parameters, in the order of the fields."""
        return tuple(
            dataclasses.replace(
                field.metadata['stated'], name='.'.join(filter(None, (cls.GROUP, field.name)))
            )
            for field in dataclasses.fields(cls)
        )

    @classmethod
    def of(cls: type[Group], values: Mapping[str, Any]) -> Group:
        """From ``values`` of its parameters by their names, among others.

        Raises:
            ArmDefinitionError: if a value is outside its range.
        """
        return cls(*(values[parameter.name] for parameter in cls.table()))
