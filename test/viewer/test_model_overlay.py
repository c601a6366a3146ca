"""Another model beside the arm."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('viser', reason='needs viser')

from octo_arm_model import load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.rod.forms import is_available
from octo_arm_model.viewer.controls import ModelOverlay

CONFIG = load_config(preset_path('renda2012_prototype'))


def test_the_model_that_is_chosen_is_solved_in_machine_code_where_there_is(server):
    overlay = ModelOverlay(server, CONFIG, lambda do: do())
    overlay.choose('exact')
    tensions = np.array([1.0, 0.0, 0.0, 0.0])
    overlay.show(tensions, np.zeros(4), np.zeros(3))
    solver = CONFIG.solver('exact')
    np.testing.assert_allclose(overlay.backbone.tip, solver.solve([tensions]).tip)
    assert overlay._solver.is_compiled == is_available()


def test_tendons_with_friction_slide_on_from_the_tensions_before(server):
    rough = replace(CONFIG, arm=replace(CONFIG.arm, friction=(0.2,) * 4))
    overlay = ModelOverlay(server, rough, lambda do: do())
    overlay.choose('exact')
    solver, last = rough.solver('exact'), None
    for pull in (1.0, 3.0, 2.0):
        tensions = np.array([pull, 0.0, 0.0, 0.0])
        overlay.show(tensions, np.zeros(4), np.zeros(3))
        last = solver.follow([tensions], last)
        np.testing.assert_allclose(overlay.backbone.tip, last.tip)
    # On the way back the friction holds the arm more bent than a pull from slack leaves it.
    apart = np.linalg.norm(overlay.backbone.tip - solver.solve([tensions]).tip)
    assert apart > 0.01 * rough.arm.length
