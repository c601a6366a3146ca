"""An arm ready to be estimated, as the parameters of the estimator's node describe it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.config.config import Config
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.estimation.measurements import Tensions
from octo_arm_model.estimation.parameters import ESTIMATOR_PARAMETERS, PREFIX
from octo_arm_model.estimation.prediction import ArmModel
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.estimation.tracker import Tracker
from octo_arm_model.ros.node.tension_subscription import message_class

TABLE = (*PARAMETERS, *ESTIMATOR_PARAMETERS)
MODEL = 'exact'  # solves whatever the parameter says: it alone has loads


class PreparedEstimator(NamedTuple):
    """An arm ready to be estimated, swapped as a whole.

    Attributes:
        description: the parameters of the arm as it is solved.
        config: what they say.
        settings: what is estimated.
        models: of each hypothesis, by its name.
    """

    description: dict[str, Any]
    config: Config
    settings: EstimatorSettings
    models: Mapping[str, ArmModel]

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> PreparedEstimator:
        """Prepare what ``values`` describe.

        Raises:
            OctoArmError: if they do not describe one; the message says why.
        """
        own = {name: value for name, value in values.items() if name.startswith(PREFIX)}
        description = {name: value for name, value in values.items() if name not in own}
        description['model'] = MODEL
        config = Config.from_parameters(description)
        if config.tension_type:
            message_class(config.tension_type)
        settings = EstimatorSettings.from_parameters(own, config)
        prepared = cls(description, config, settings, settings.models(config))
        # What is compiled or loaded at its first use is so before messages come.
        rest = Tensions(np.zeros(len(config.arm.tendons)), settings.noise.tension)
        prepared.tracker().add(0, [rest]).estimate.pose_covariance  # noqa: B018
        return prepared

    def tracker(self) -> Tracker:
        """A tracker of the arm that knows nothing but the prior."""
        return Tracker.from_settings(self.settings, self.models, self.settings.window)
