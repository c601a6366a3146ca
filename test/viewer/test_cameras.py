"""From where an arm is seen at first, and where cameras point when windows change."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.simulation.movements import figures, tendon_limits
from octo_arm_model.viewer.scene import ASPECT, FIELD, framing, reached, tangent_of

PRESETS = ('renda2012_prototype', 'renda2012_table2', 'renda2012_table4', 'rao2021')
HANGING = (0.0, 0.5**0.5, 0.0, 0.5**0.5)


def seen(view, points, aspect=ASPECT):
    """Where ``points`` are in the picture, from -1 to 1 across it and upwards."""
    forward = (view.look_at - view.position) / np.linalg.norm(view.look_at - view.position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    offset = points - view.position
    depth = offset @ forward
    assert (depth > 0.0).all()
    across = np.stack([offset @ right / aspect, offset @ np.cross(right, forward)], axis=1)
    return across / (depth * np.tan(0.5 * FIELD))[:, np.newaxis]


@pytest.mark.parametrize('aspect', [0.5, ASPECT, 2.0])
@pytest.mark.parametrize('quaternion', [(0.0, 0.0, 0.0, 1.0), HANGING])
@pytest.mark.parametrize('name', PRESETS)
def test_all_of_the_arm_is_in_the_middle_of_the_picture_and_fills_it(name, quaternion, aspect):
    config = Config.from_parameters({**load_parameters(name), 'base.quaternion': quaternion})
    points = reached(config, tendon_limits(config))
    view = framing(points, tangent_of(config), aspect)
    places = seen(view, points, aspect)
    low, high = places.min(axis=0), places.max(axis=0)
    assert (np.abs(places) < 0.95).all()
    assert_allclose(low + high, 0.0, atol=0.2)
    assert (high - low).max() > 1.7
    # So is the arm at rest, which is what is seen at first.
    rest = np.array([points[0], points[30]])
    assert np.linalg.norm(points[30] - points[0]) == pytest.approx(config.arm.length)
    ends = seen(view, rest, aspect) * [aspect, 1.0]
    assert np.linalg.norm(ends[1] - ends[0]) > 1.0 * min(aspect, 1.0)
    solver = config.solver()
    for tensions in figures(config.arm).values() if aspect == ASPECT else ():
        for part in (0.4, 0.52, 0.6, 1.0):
            shape = solver.solve((part * tensions).reshape(config.arm.tension_shape))
            assert (np.abs(seen(view, shape.position)) < 1.0).all()


def test_an_arm_that_closed_form_does_not_cover_is_seen_at_rest():
    parameters = load_parameters('renda2012_table4')
    twisted = Config.from_parameters({**parameters, 'model': 'exact', 'tendons.twist': [0.5] * 12})
    points = reached(twisted, tendon_limits(twisted))
    assert np.isfinite(points).all()
    assert_allclose(points[30], [0.45, 0.0, 0.0], atol=1e-12)
