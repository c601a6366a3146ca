"""The fitted parameter file reproduces the fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from experiments import PARAMETERS, midline, one_tendon, shapes

from octo_arm_model.config.config import load_config
from octo_arm_model.experiment.fit import shape_residuals
from octo_arm_model.experiment.identification import as_config
from octo_arm_model.experiment.identify import identify
from octo_arm_model.experiment.uncertainty import misfit_of

PULLED = (0.0, 0.9, 1.7, 2.4, 3.1, 3.9)


@pytest.mark.parametrize('offset', [0.06, pytest.param(-0.04, marks=pytest.mark.endurance)])
def test_the_steps_solved_by_the_fitted_file_have_the_misfit_of_the_fit(
    tmp_path: Path, offset: float
) -> None:
    # What the cells read: the tendon that is slack reads nothing.
    pulls = [one_tendon(tension) for tension in PULLED]
    read = [np.where(pull > 0.0, (pull - offset) / 1.15, 0.0) for pull in pulls]
    lines = [midline('closed_form', pull) for pull in pulls]
    steps = shapes(lines, read, np.random.default_rng(0), 3e-4)
    fitted = identify(steps, PARAMETERS, 'closed_form', ('tension_scale', 'tension_offset'))
    path = tmp_path / 'fitted.yaml'
    path.write_text(as_config(fitted, 'a test'), encoding='utf-8')

    config = load_config(path)
    assert config.load_cells.scale == pytest.approx(4 * (1.15,), rel=0.01)
    assert config.load_cells.offset == pytest.approx((offset, 0.0, 0.0, 0.0), abs=5e-3)
    assert config.uncertainty.model_position == fitted.tip_stddev * config.arm.length
    solver = config.solver(stations=201)
    away = [
        shape_residuals(step, step.points, solver.solve(config.load_cells.tensions(
            config.arm, step.window.tensions.reshape(config.arm.tension_shape)
        )))
        for step in steps
    ]  # fmt: skip
    misfit = misfit_of(away, config.arm.length)
    assert misfit.rms == pytest.approx(fitted.after.rms, rel=1e-6)
    assert misfit.tip_error == pytest.approx(fitted.after.tip_error, rel=1e-6)
    read = np.array([step.window.tensions for step in steps])
    known = config.load_cells.scale_and_offset(read)
    np.testing.assert_allclose(fitted.tensions, known, rtol=1e-12)
    # Without the calibration it is another.
    wrong = [
        shape_residuals(step, step.points, solver.solve(step.window.tensions[np.newaxis]))
        for step in steps
    ]
    assert misfit_of(wrong, config.arm.length).rms > 3.0 * misfit.rms
