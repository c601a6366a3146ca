"""An arm is prepared, and answers, or its parameters are refused, whatever numbers they are."""

from typing import Any

import numpy as np
import pytest

from octo_arm_model.analysis.driven_arm import DrivenArm
from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.config.parameter import Parameter
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.estimation.settings import ESTIMATOR_PARAMETERS
from octo_arm_model.ros.estimator.main import PreparedEstimator
from octo_arm_model.ros.node.server import Prepared

EXTREMES = (1e300, 1e160, 1e-160, 1e-300)
LOADED = {
    **load_parameters(preset_path('renda2012_prototype')), 'stations': 11, 'model': 'exact',
    'loads.gravity': [0.0, 0.0, -9.81],
}  # fmt: skip


def with_extreme(parameter: Parameter, value: float) -> dict[str, Any]:
    """The parameters of an arm, one of them ``value``."""
    before = LOADED.get(parameter.name) or [0.0]
    return {**LOADED, parameter.name: [value] * len(before) if parameter.is_array else value}


def numbers(table: tuple[Parameter, ...]) -> list[Any]:
    return [pytest.param(one, id=one.name) for one in table if one.kind is float]


@pytest.mark.filterwarnings('ignore::RuntimeWarning')
@pytest.mark.parametrize('parameter', numbers(PARAMETERS))
def test_an_arm_answers_in_numbers_or_is_refused(parameter):
    for value in EXTREMES:
        try:
            arm = Prepared.of(with_extreme(parameter, value))
            tensions = np.full(arm.config.arm.tension_shape, 0.3)
            answer = DrivenArm().answer(arm.solver, arm.config, None, 0, tensions)
        except OctoArmError as error:
            assert str(error)
        else:
            assert np.isfinite(answer.backbone.position).all()
            assert np.isfinite(answer.covariance).all()


@pytest.mark.filterwarnings('ignore::RuntimeWarning')
@pytest.mark.parametrize('parameter', numbers((*PARAMETERS, *ESTIMATOR_PARAMETERS)))
def test_an_estimator_is_prepared_or_refused(parameter):
    for value in EXTREMES:
        try:
            PreparedEstimator.of(with_extreme(parameter, value))
        except OctoArmError as error:
            assert str(error)
