"""An arm ready to be solved, as the parameters of the node describe it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from octo_arm_model.config.config import Config
from octo_arm_model.core.solver import Solver
from octo_arm_model.ros.messages import message_class


@dataclass(frozen=True)
class Prepared:
    """An arm ready to be solved, swapped as a whole.

    Attributes:
        values: the parameters it was made from.
        config: what they say.
        solver: its solver.
    """

    values: dict[str, Any]
    config: Config
    solver: Solver

    @classmethod
    def of(cls, values: dict[str, Any]) -> Prepared:
        """Prepare the arm that ``values`` describe.

        Raises:
            OctoArmError: if they do not describe one; the message says why.
        """
        config = Config.from_parameters(values)
        if config.tension_type:
            message_class(config.tension_type)
        return cls(values, config, config.node_solver())
