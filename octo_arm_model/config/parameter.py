"""A parameter: its name, type, default and meaning; and groups of them as dataclasses."""

import ast
import dataclasses
import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

from octo_arm_model.arm import validation
from octo_arm_model.arm.errors import ConfigError, listed, shown
from octo_arm_model.arm.limits import MAX_NAME, MAX_TABLE_POINTS

Values = Mapping[str, Any]  # of all parameters, by their names

_KINDS = {'double': float, 'integer': int, 'string': str, 'bool': bool}
_UNIT = re.compile(r'\[([^]]*)\]')
_WITHIN = re.compile(r'in \[([-\d.]+), ([-\d.]+)\]')
_WORDS = re.compile(', or |, | or ')


@dataclass(frozen=True)
class Parameter:
    """One parameter.

    Attributes:
        name: dotted name, as in ROS.
        description: what it is, with its unit in brackets.
        default: value where none is given; None means it must be given.
        range: allowed values, in words; the core checks them.
        is_choice: whether the range lists them all, as 'pchip or linear' or 'one of a, b, c'.
        unless: names of parameters that replace it; if one is given it may be missing.
        most: number of values that a list has at most, whether they are used or not.
        what: what errors call a value.
        kind: type of a value, or of those of a list.
        is_array: whether it is a list.
    """

    name: str
    description: str
    default: Any = None
    range: str = ''
    is_choice: bool = False
    unless: tuple[str, ...] = ()
    most: int = MAX_TABLE_POINTS
    what: str = 'number'
    kind: type = float
    is_array: bool = False

    @property
    def type_name(self) -> str:
        """Name of the type in ROS, e.g. ``double[]``."""
        word = next(name for name, kind in _KINDS.items() if kind is self.kind)
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

        Numbers are finite, and in the range where that is '>= 0', '> 0' or between two numbers;
        texts are one of those that a choice has.

        Raises:
            ArmDefinitionError: if a number is not.
            ConfigError: if a text is not.
        """
        if not self.is_array:
            self._check_one(self.name, value)
            return
        for number, element in enumerate(value):
            self._check_one(f'{self.name}[{number}]', element)

    def _check_one(self, name: str, value: Any) -> None:
        unit = ''.join(_UNIT.findall(self.description)[:1])
        words = self.range.removeprefix('one of ').removesuffix(', or empty')
        choices = _WORDS.split(words) if self.is_choice else []
        if self.range == '>= 0' and self.kind is int:
            validation.whole(name, value)
        elif self.range == '>= 0':
            validation.not_negative(name, value, self.what, unit)
        elif self.range == '> 0':
            validation.positive(name, value, unit)
        elif ends := _WITHIN.fullmatch(self.range):
            validation.within(name, value, float(ends[1]), float(ends[2]), unit)
        elif self.kind is float:
            validation.finite(name, value)
        elif choices and value not in (*choices, self.default):
            raise ConfigError(f'{name} is {shown(value)}, expected {self.range}')

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


def read_table(text: str) -> tuple[Parameter, ...]:
    """The parameters in a table.

    Each has a line ``name | type | default | range | more``, and below it, indented, what it is.
    More, as far as there is more, is ``choice``, ``unless`` with names, ``what`` with a word, or
    ``most`` with a number, see `Parameter`.
    """
    rows = re.findall(r'^(\S.*)\n((?: .*\n)+)', text, re.MULTILINE)
    return tuple(_read_row(head.split('|'), ' '.join(words.split())) for head, words in rows)


def _read_row(head: list[str], description: str) -> Parameter:
    name, kind, default, allowed, *more = (*map(str.strip, head), *(4 - len(head)) * [''])
    options = dict(option.partition(' ')[::2] for option in more)
    value = ast.literal_eval(default) if default else None
    return Parameter(
        name,
        description + (f'; at most {options["most"]}' if 'most' in options else ''),
        tuple(value) if isinstance(value, list) else value,
        allowed,
        'choice' in options,
        tuple(options.get('unless', '').split()),
        int(options.get('most', MAX_TABLE_POINTS)),
        options.get('what', 'number'),
        _KINDS[kind.removesuffix('[]')],
        kind.endswith('[]'),
    )


def check_length(name: str, column: Sequence[Any], count: int, what: str) -> None:
    """Check that the list ``name`` has ``count`` values.

    Raises:
        ConfigError: if not; ``what`` ends the message.
    """
    if len(column) != count:
        raise ConfigError(f'{name} has {len(column)} values, expected {count}{what}')


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
    is_array = isinstance(default, tuple)
    kind = type((default or (0.0,))[0] if is_array else default)
    options: dict[str, Any] = {'most': most, 'what': what, 'kind': kind, 'is_array': is_array}
    parameter = Parameter('', description, default, allowed, **options)
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
