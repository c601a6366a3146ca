"""Parameters that are the fields of a dataclass."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest

from octo_arm_model import ArmDefinitionError
from octo_arm_model.config.parameter import Parameter, ParameterGroup, stated


@dataclass(frozen=True)
class Pump(ParameterGroup):
    GROUP = 'pump'

    pressure: float = stated('what it holds [Pa]; 0 for off', 0.0, '>= 0', 'pressure')
    time: float = stated('how long it takes [s]', 1.0, '> 0')
    share: float = stated('of the flow [-]', 0.5, 'in [0, 1]')
    places: tuple[float, ...] = stated('of its valves [m]', (), 'on the arm')
    seed: int = stated('of its noise', 0, '>= 0')


def test_fields_are_parameters_of_their_group() -> None:
    assert Pump.table() == (
        Parameter('pump.pressure', float, 'what it holds [Pa]; 0 for off', 0.0, range='>= 0'),
        Parameter('pump.time', float, 'how long it takes [s]', 1.0, range='> 0'),
        Parameter('pump.share', float, 'of the flow [-]', 0.5, range='in [0, 1]'),
        Parameter('pump.places', float, 'of its valves [m]', (), True, range='on the arm'),
        Parameter('pump.seed', int, 'of its noise', 0, range='>= 0'),
    )
    given = {'pump.seed': 3, 'pump.places': (0.1,), 'pump.share': 1.0, 'pump.time': 2.0}
    assert Pump.of({**given, 'pump.pressure': 1.0, 'rate': 5.0}) == Pump(1.0, 2.0, 1.0, (0.1,), 3)


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ({'pressure': -1.0}, 'pump.pressure is -1.0, expected a finite pressure >= 0 [Pa]'),
        ({'pressure': math.nan}, 'pump.pressure is nan, expected a finite pressure >= 0 [Pa]'),
        ({'time': 0.0}, 'pump.time is 0.0, expected a finite number > 0 [s]'),
        ({'share': 1.1}, 'pump.share is 1.1, expected a finite number within [0, 1] [-]'),
        ({'seed': -1}, 'pump.seed is -1, expected an integer >= 0'),
    ],
)
def test_values_outside_their_range_are_refused_by_name(given, message) -> None:
    with pytest.raises(ArmDefinitionError) as caught:
        Pump(**given)
    assert str(caught.value) == message
