"""Parameters as the fields of a dataclass: name, default, meaning and range are stated once."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

from octo_arm_model.arm.limits import MAX_TABLE_POINTS
from octo_arm_model.config.parameter import Parameter

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
    refused by `Parameter.check`, whose error calls a value ``what`` it is. An array has ``most``
    values at most.
    """
    is_array = isinstance(default, tuple)
    kind = float if is_array else type(default)
    parameter = Parameter('', kind, description, default, is_array, range=allowed, most=most)
    return dataclasses.field(default=default, metadata={'stated': parameter, 'what': what})


@dataclass(frozen=True)
class ParameterGroup:
    """Base of the dataclasses of one group of parameters, each a field that is `stated`.

    Attributes:
        GROUP: what their names begin with, before a dot.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    GROUP: ClassVar[str]

    def __post_init__(self) -> None:
        """Validate."""
        for parameter, field in zip(self.table(), dataclasses.fields(self), strict=True):
            parameter.check(getattr(self, field.name), field.metadata['what'])

    @classmethod
    def table(cls) -> tuple[Parameter, ...]:
        """The parameters, in the order of the fields."""
        return tuple(
            dataclasses.replace(field.metadata['stated'], name=f'{cls.GROUP}.{field.name}')
            for field in dataclasses.fields(cls)
        )

    @classmethod
    def of(cls: type[Group], values: Mapping[str, Any]) -> Group:
        """From ``values`` of its parameters by their names, among others.

        Raises:
            ArmDefinitionError: if a value is outside its range.
        """
        return cls(*(values[parameter.name] for parameter in cls.table()))
