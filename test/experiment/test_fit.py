"""The fit of an alignment to measured shapes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from experiments import FAR, HELD, PARAMETERS, midline, one_tendon, shapes
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.experiment.fit import fit_alignment


def test_the_camera_is_found_despite_outliers_and_midlines_that_begin_late() -> None:
    rng = np.random.default_rng(5)
    pulls = [one_tendon(tension) for tension in HELD]
    lines = [FAR.to_camera(midline('closed_form', pull)[3:]) for pull in pulls]
    seen = shapes(lines, pulls, rng, noise=2e-4)
    # A third of one midline is far from the arm.
    lost = seen[4].points.copy()
    lost[-15:] += [0.04, -0.03, 0.02]
    seen[4] = dataclasses.replace(seen[4], points=lost)
    found = fit_alignment(seen, PARAMETERS, 'closed_form')
    away = Rotation.from_matrix(found.rotation @ FAR.rotation.T).magnitude()
    assert away < 2e-3
    points = midline('closed_form', one_tendon(2.0))
    assert np.abs(found.to_base(FAR.to_camera(points)) - points).max() < 5e-4


def test_too_few_points_align_nothing() -> None:
    (tip,) = shapes([np.zeros((1, 3))], [one_tendon(1.0)])
    with pytest.raises(MeasurementError, match=r'1 measured point\(s\), expected at least 3'):
        fit_alignment([tip], PARAMETERS, 'closed_form')
