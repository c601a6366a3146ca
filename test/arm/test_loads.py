"""What is refused as a load, and as an uncertainty, by name."""

from __future__ import annotations

import math

import pytest

from octo_arm_model import Loads, PointLoad
from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.loads import DistributedLoad, ScaledLoads
from octo_arm_model.rod.sensitivity import Uncertainty

POINT = PointLoad(0.1, (0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ('given', 'complaint'),
    [
        ({'points': POINT}, r'loads.points is PointLoad.*, expected a list of PointLoad'),
        ({'points': [(0.1, (0.0, 0.0, 1.0))]}, 'loads.points is .*, expected a list of PointLoad'),
        ({'distributed': [POINT]}, 'loads.distributed is .*, expected a list of DistributedLoad'),
        ({'others': [POINT]}, 'loads.others is .*, expected a list of Load'),
        ({'scaled': [Loads()]}, 'loads.scaled is .*, expected ScaledLoads or None'),
    ],
)
def test_what_is_no_load_of_its_kind_is_refused(given, complaint):
    with pytest.raises(ArmDefinitionError, match=complaint):
        Loads(**given)


@pytest.mark.parametrize(
    ('s', 'force'), [(0.1, (0.0, 0.0, 1.0)), ('ab', ((0.0, 0.0, 1.0),)), ((0.0, 0.1), 1.0)]
)
def test_a_distributed_load_needs_lists(s, force):
    with pytest.raises(ArmDefinitionError, match='expected lists of s and of force'):
        DistributedLoad(s, force)


@pytest.mark.parametrize(
    'load',
    [
        Loads(tip_force=(0.0, 0.0, 1.0)),
        Loads(tip_moment=(0.0, 0.0, 1.0)),
        Loads(scaled=ScaledLoads([Loads(points=(POINT,))])),
        POINT,
    ],
)
def test_what_would_be_left_out_of_scaled_loads_is_refused(load):
    with pytest.raises(ArmDefinitionError, match='expected dead Loads without a tip wrench'):
        ScaledLoads([load])


@pytest.mark.parametrize('value', [math.nan, -0.1, 'much', True])
@pytest.mark.parametrize('name', ['tension', 'model_rotation', 'displacement'])
def test_an_uncertainty_is_a_standard_deviation(name, value):
    with pytest.raises(
        ArmDefinitionError, match=f'uncertainty.{name} is .*, expected a finite st'
    ):
        Uncertainty(**{name: value})
