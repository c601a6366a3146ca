"""An arm ready to be solved, as the parameters of the node describe it."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.limits import MAX_YAML_BYTES
from octo_arm_model.arm.loads import ZERO, FollowingWrench
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.messages import message_class


@dataclass(frozen=True)
class Prepared:
    """An arm ready to be solved, swapped as a whole.

    Attributes:
        description: the parameters it was made from, as a parameter file.
        config: what they say.
        solver: its solver.
    """

    description: str
    config: Config
    solver: Solver

    @functools.cached_property
    def followed(self) -> tuple[Solver, FollowingWrench]:
        """A solver of the arm under a wrench that turns with its tip, and that wrench.

        Raises:
            ConfigError: if the model has no loads.
        """
        tip = FollowingWrench(self.config.arm.length, ZERO)
        loads = replace(self.config.loads, others=(*self.config.loads.others, tip))
        return replace(self.config, loads=loads).node_solver(), tip

    @classmethod
    def of(cls, values: dict[str, Any]) -> Prepared:
        """Prepare the arm that ``values`` describe.

        Raises:
            OctoArmError: if they do not describe one; the message says why.
        """
        config = Config.from_parameters(values)
        for kind in filter(None, (config.tension_type, config.displacement_type)):
            message_class(kind)
        return cls(describe(values), config, config.node_solver())


def describe(values: Mapping[str, Any]) -> str:
    """The parameter file of ``values``; ConfigError if it is larger than those that are read."""
    text = parameters_as_yaml(values)
    if len(text) > MAX_YAML_BYTES:
        raise ConfigError(
            f'the description of the arm has {len(text)} bytes, expected at most {MAX_YAML_BYTES}'
        )
    return text
