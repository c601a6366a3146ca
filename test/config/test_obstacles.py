"""Obstacles of a parameter file."""

from __future__ import annotations

from typing import Any

import pytest

from octo_arm_model import ArmDefinitionError, Config, ConfigError, Cylinder, Plane, Sphere

ARM: dict[str, Any] = {
    'model': 'exact', 'material.youngs_modulus': 1e5, 'body.length': 0.4,
    'body.radius_base': 0.01, 'body.radius_tip': 0.01, 'sections.anchorage': [0.4],
    'sections.offset_base': [0.006], 'sections.offset_anchorage': [0.006],
}  # fmt: skip
THREE = {
    'obstacles.type': ['plane', 'sphere', 'cylinder'],
    'obstacles.position': [0.0, 0.0, -0.1, 0.3, 0.1, 0.0, 0.2, 0.2, 0.2],
    'obstacles.direction': [0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 3.0, 4.0],
    'obstacles.radius': [0.0, 0.03, 0.02],
    'obstacles.stiffness': [1e6],
    'obstacles.friction': [0.0, 0.1, 0.2],
}


def test_obstacles_are_lists_of_what_each_is():
    loads = Config.from_parameters(ARM | THREE).loads
    assert loads.obstacles == (
        Plane((0.0, 0.0, -0.1), (0.0, 0.0, 1.0), stiffness=1e6),
        Sphere((0.3, 0.1, 0.0), 0.03, stiffness=1e6, friction=0.1),
        Cylinder((0.2, 0.2, 0.2), (0.0, 0.6, 0.8), 0.02, stiffness=1e6, friction=0.2),
    )
    floor = {'type': ['plane'], 'position': [0.0, 0.0, -0.1], 'stiffness': [1e6]}
    given = {f'obstacles.{name}': value for name, value in floor.items()}
    assert Config.from_parameters(ARM | given).loads.obstacles == loads.obstacles[:1]
    assert Config.from_parameters(ARM).loads.obstacles == ()


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'type': ['plane', 'cube', 'sphere']}, "obstacles.type has 'cube', expected plane, sph"),
        ({'type': ['plane']}, 'obstacles.position has 9 values, expected 3, three for each of'),
        ({'radius': [0.1]}, 'obstacles.radius has 1 values, expected 3, one per obstacle'),
        ({'radius': [0.0, 0.0, 0.1]}, 'Sphere.radius is 0.0, expected a finite number > 0'),
        (
            {'stiffness': []},
            'obstacles.stiffness has 0 values, expected 3, one for all or one per',
        ),
        ({'direction': [0.0] * 9}, r'Plane.normal is \(0.0, 0.0, 0.0\), expected a direction'),
        ({'type': ['plane'] * 33}, 'obstacles.type has 33 values, expected at most 32'),
        ({'position': [float('nan')] * 9}, 'Plane.point is .* expected three finite numbers'),
    ],
)
def test_obstacles_that_cannot_be_are_refused_by_name(changes, message):
    given = {f'obstacles.{name}': value for name, value in changes.items()}
    with pytest.raises((ConfigError, ArmDefinitionError), match=message):
        Config.from_parameters(ARM | THREE | given)


def test_a_node_of_an_arm_that_rubs_says_that_there_are_no_shapes_at_rest():
    config = Config.from_parameters(ARM | THREE)
    with pytest.raises(ConfigError, match=r'loads.obstacles have friction'):
        config.node_solver()
