"""A parameter with its name, type, default and meaning; tables and dataclasses of parameters."""

import ast
import dataclasses
import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

from octo_arm_model.arm import validation
from octo_arm_model.arm.errors import ArmDefinitionError, ConfigError, listed, shown
from octo_arm_model.arm.limits import MAX_NAME, MAX_TABLE_POINTS

Values = Mapping[str, Any]  # the values of all parameters by name

_KINDS = {'double': float, 'integer': int, 'string': str, 'bool': bool}
_UNIT = re.compile(r'\[([^]]*)\]')
_WITHIN = re.compile(r'in ([\[(])([-\d.]+), ([-\d.]+)([\])])')
_WORDS = re.compile(', or |, | or ')


@dataclass(frozen=True)
class Parameter:
    """One parameter."""

    name: str  #: dotted name, as in ROS
    description: str  #: meaning of the parameter, with its unit in brackets
    default: Any = None  #: value if none is given; None if a value must be given
    range: str = ''  #: allowed values in words; `check` enforces those that it can read
    #: whether the range lists all values, as 'pchip or linear' or 'one of a, b, c'
    is_choice: bool = False
    #: names of parameters that replace this one; if one is given this one may not be
    unless: tuple[str, ...] = ()
    #: names of parameters without which this one has no effect; one must be given
    needs: tuple[str, ...] = ()
    #: largest number of values in a list, whether they are used or not
    most: int = MAX_TABLE_POINTS
    what: str = 'number'  #: noun for a value in errors
    kind: type = float  #: Python type of a value, or of the values in a list
    is_array: bool = False  #: whether the value is a list

    @property
    def type_name(self) -> str:
        """The name of the type in ROS, such as ``double[]``."""
        word = next(name for name, kind in _KINDS.items() if kind is self.kind)
        return word + '[]' if self.is_array else word

    @property
    def default_or_none_given(self) -> Any:
        """The value to declare in ROS, where every parameter has a value.

        It is the default, or zero or an empty list for a parameter without a default.
        """
        if self.default is not None:
            return self.default
        return () if self.is_array else self.kind()

    def convert(self, value: object) -> Any:
        """Return ``value`` in the type of this parameter; an integer is accepted for a double.

        Raises:
            ConfigError: if the type is wrong, or a list has too many values.
        """
        if self.is_array and isinstance(value, (list, tuple)):
            if len(value) > self.most:
                raise ConfigError(
                    f'{self.name} has {len(value)} values, expected at most {self.most}'
                )
            return tuple(self._convert_one(element, value) for element in value)
        return self._convert_one(value, value) if not self.is_array else self._refuse(value)

    def check(self, value: Any) -> None:
        """Check a converted ``value``, or each value of a list.

        A number must be finite, and within the range if that is '>= 0', '> 0' or an interval; the
        text of a choice must be one that the range lists.

        Raises:
            ArmDefinitionError: if a number is out of range.
            ConfigError: if a text is not in the list.
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
            low, high = float(ends[2]), float(ends[3])
            within = self.range.replace('in', 'within', 1)
            expected = f'a finite number {within} [{unit}]'.removesuffix(' []')
            number = validation.finite(name, value, expected)
            at_end = (number == low and ends[1] == '[') or (number == high and ends[4] == ']')
            if not (low < number < high or at_end):
                raise ArmDefinitionError(name, value, expected)
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
        if self.is_array and type(value) in (self.kind, *(int,) * (self.kind is float)):
            what = f', as [{shown(value)}]'
        raise ConfigError(f'{self.name} is {shown(value)}, expected {self.type_name}{what}')


def read_table(text: str) -> tuple[Parameter, ...]:
    """Return the parameters in a table of text.

    A row is a line of cells between |, which goes on in indented lines that begin with |, and
    indented lines below it with the description::

        body.radius_tip | double | | > 0 | unless body.table_s body.width
            radius at the tip [m]

    The cells are name, type as in ROS, default as in Python (empty if the parameter must be
    given), range in words (empty or left out for any value) and options: any of ``choice``,
    ``unless`` with names, ``with`` and names that it needs, ``what`` with a noun and ``most``
    with a number, as in `Parameter`.

    Raises:
        ValueError: if a row is malformed; the message quotes it.
    """
    return tuple(map(_read_row, re.split(r'\n(?! )', text.removesuffix('\n'))))


def _read_row(row: str) -> Parameter:
    head, *lines = re.sub(r'\n +\|', ' |', row).splitlines() or ['']
    description = ' '.join(map(str.strip, lines))
    cells = [cell.strip() for cell in head.split('|')]
    name, kind, default, allowed, *options = cells + (4 - len(cells)) * ['']
    for text, pattern, expected in (
        (head, r'\w+(\.\w+)* *\|[^|]*\|.*', 'name | type | default'),
        (kind, rf'({"|".join(_KINDS)})(\[\])?', 'a type'),
        *(
            (one, r'choice|(unless|with)( [\w.]+)+|what [\w ]+|most \d+', 'an option')
            for one in options
        ),
        (description, r'(?!.* \| ).+', 'an indented description'),
    ):
        if not re.fullmatch(pattern, text):
            raise ValueError(f'row {row!r} of parameters: {text!r} is not {expected}')
    values = dict(option.partition(' ')[::2] for option in options)
    parameter = Parameter(
        name,
        description + (f'; at most {values["most"]}' if 'most' in values else ''),
        range=allowed,
        is_choice='choice' in values,
        unless=tuple(values.get('unless', '').split()),
        needs=tuple(values.get('with', '').split()),
        most=int(values.get('most', MAX_TABLE_POINTS)),
        what=values.get('what', 'number'),
        kind=_KINDS[kind.removesuffix('[]')],
        is_array=kind.endswith('[]'),
    )
    try:
        value = parameter.convert(ast.literal_eval(default)) if default else None
    except (ValueError, SyntaxError) as error:
        raise ValueError(f'row {row!r} of parameters: {default} is no default: {error}') from None
    return dataclasses.replace(parameter, default=value)


def check_together(parameters: Sequence[Parameter], values: Values) -> None:
    """Check that no value has no effect beside the others; one as by default is not given.

    Raises:
        ConfigError: if a parameter is given that another one replaces, or without those that it
            needs.
    """
    given = {
        parameter.name
        for parameter in parameters
        if parameter.name in values and values[parameter.name] != parameter.default_or_none_given
    }
    for parameter in parameters:
        why = [f'where {other} is given' for other in parameter.unless if other in given]
        if parameter.needs and given.isdisjoint(parameter.needs):
            why.append(f'without {" or ".join(parameter.needs)}')
        if parameter.name in given and why:
            value, none = shown(values[parameter.name]), parameter.default_or_none_given
            expected = f'{list(none) if parameter.is_array else none!r} or no value {why[0]}'
            raise ConfigError(f'{parameter.name} is {value}, expected {expected}')


def check_length(name: str, column: Sequence[Any], count: int, what: str) -> None:
    """Check that the list ``name`` has ``count`` values.

    Raises:
        ConfigError: if it has another number of values; ``what`` ends the message.
    """
    if len(column) != count:
        raise ConfigError(f'{name} has {len(column)} values, expected {count}{what}')


def refuse_unknown(values: Mapping[str, Any], known: Sequence[str], owner: str) -> None:
    """Check that all names in ``values`` are ``known`` parameters of the ``owner``.

    Raises:
        ConfigError: if a name is unknown; the message suggests a similar one.
    """
    for name in values:
        if name not in known:
            close = difflib.get_close_matches(str(name), known, n=1)
            hint = f'did you mean {close[0]}?' if close else f'known are {listed(known)}'
            raise ConfigError(f'{shown(name)[1:-1]} is no parameter of {owner}; {hint}')


Group = TypeVar('Group', bound='ParameterGroup')


def stated(row: str, description: str) -> Any:
    """Return a field of a `ParameterGroup`: a row of `read_table` but for its name."""
    parameter = _read_row(f'field | {row}\n    {description}')
    return dataclasses.field(default=parameter.default, metadata={'stated': parameter})


@dataclass(frozen=True)
class ParameterGroup:
    """The base class of groups of parameters: dataclasses whose fields are made by `stated`.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    GROUP: ClassVar[str]  #: prefix of the names of the parameters, before a dot; '' for no prefix

    def __post_init__(self) -> None:
        """Check all values."""
        for parameter, field in zip(self.table(), dataclasses.fields(self), strict=True):
            parameter.check(getattr(self, field.name))

    @classmethod
    def table(cls) -> tuple[Parameter, ...]:
        """Return the parameters in the order of the fields."""
        return tuple(
            dataclasses.replace(
                field.metadata['stated'], name='.'.join(filter(None, (cls.GROUP, field.name)))
            )
            for field in dataclasses.fields(cls)
        )

    @classmethod
    def of(cls: type[Group], values: Mapping[str, Any]) -> Group:
        """Return a group with those of ``values`` whose names are parameters of the group.

        Raises:
            ArmDefinitionError: if a value is outside its range.
        """
        return cls(*(values[parameter.name] for parameter in cls.table()))
