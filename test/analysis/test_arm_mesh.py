"""The colours of tendons by their tension."""

import numpy as np

from octo_arm_model.analysis.drawing import tension_colours


def test_colours_rise_from_grey_to_red_with_tension():
    tensions = np.array([0.0, 1.0, 2.0, 4.0, 8.0])
    colours = tension_colours(tensions, 4.0)
    assert len(set(colours[0, :3])) == 1
    np.testing.assert_array_equal(colours[3:], [[1.0, 0.0, 0.0, 1.0]] * 2)
    assert (np.diff(colours[:4, 0]) > 0.0).all()
    assert (np.diff(colours[:4, 1]) < 0.0).all()
    np.testing.assert_array_equal(colours[:, 1], colours[:, 2])
    np.testing.assert_array_equal(tension_colours(tensions)[-1], [1.0, 0.0, 0.0, 1.0])
    slack = tension_colours(np.zeros(3))
    assert np.isfinite(slack).all()
    np.testing.assert_array_equal(slack, colours[[0, 0, 0]])
