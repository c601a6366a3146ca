"""An arm ready to be estimated, as the parameters of the estimator's node describe it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from octo_arm_model.config.config import Config
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurements import Tensions
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.parameters import ESTIMATOR_PARAMETERS, PREFIX
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.ros.messages import message_class
from octo_arm_model.ros.node.prepared_arm import Prepared, describe

TABLE = (*PARAMETERS, *ESTIMATOR_PARAMETERS)
MODEL = 'exact'  # solves whatever the parameter says: it alone has loads


@dataclass(frozen=True)
class PreparedEstimator(Prepared):
    """An arm ready to be estimated, swapped as a whole.

    Its description is that of the arm alone, as it is solved; its solver is that of one
    hypothesis.

    Attributes:
        settings: what is estimated.
        models: of each hypothesis, by its name.
    """

    settings: EstimatorSettings
    models: Mapping[str, ArmModel]

    @classmethod
    def of(cls, values: dict[str, Any]) -> PreparedEstimator:
        """Prepare what ``values`` describe.

        Raises:
            OctoArmError: if they do not describe one; the message says why.
        """
        own = {name: value for name, value in values.items() if name.startswith(PREFIX)}
        arm = {name: value for name, value in values.items() if name not in own}
        arm['model'] = MODEL
        config, description = Config.from_parameters(arm), describe(arm)
        for kind in filter(None, (config.tension_type, config.displacement_type)):
            message_class(kind)
        settings = EstimatorSettings.from_parameters(own, config)
        models = settings.models(config)
        solver = next(iter(models.values())).solver
        prepared = cls(description, config, solver, settings, models)
        # What is compiled or loaded at its first use is so before messages come.
        rest = Tensions(np.zeros(len(config.arm.tendons)), settings.noise.tension)
        prepared.estimator().add(0, [rest]).estimate.pose_covariance  # noqa: B018
        return prepared

    def estimates_as(self, other: PreparedEstimator) -> bool:
        """Whether it makes of measurements what ``other`` does."""
        mine, theirs = (
            (one.settings, one.config.load_cells, one.config.base_frame) for one in (self, other)
        )
        return mine == theirs and self.config.has_balance_of(other.config)

    def estimator(self) -> Estimator:
        """An estimator of the arm that begins with the prior."""
        return Estimator.from_settings(self.settings, self.models, self.settings.window)
