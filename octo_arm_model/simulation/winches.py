"""Winches: tensions from commands, with limits of force and rate, and lag."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import not_negative
from octo_arm_model.config.parameter import ParameterGroup, stated


@dataclass(frozen=True)
class Winches(ParameterGroup):
    """Parameters of the winches of an arm, the same for all, applied in the order listed here.

    By default all are off.
    """

    GROUP = 'winches'

    slack_floor: float = stated('least tension the winches keep [N]', 0.0, '>= 0', 'tension')
    force_limit: float = stated(
        'largest tension of the winches [N]; 0 for no limit', 0.0,
        '0, or at least winches.slack_floor',
    )  # fmt: skip
    rate_limit: float = stated(
        'largest rate at which their set point changes [N/s]; 0 for no limit', 0.0, '>= 0', 'rate'
    )
    lag: float = stated(
        'time constant with which tensions follow the set point [s]; 0 for at once', 0.0, '>= 0',
        'time',
    )  # fmt: skip
    encoders: bool = stated(
        'whether lengths that the winches have reeled in are published, on '
        'tendon_displacements; an octo_arm_node that hears them is driven by them',
        False,
    )

    def __post_init__(self) -> None:
        """Validate."""
        super().__post_init__()
        not_negative('winches.force_limit', self.force_limit, 'tension', 'N')
        if 0.0 < self.force_limit < self.slack_floor:
            expected = f'0, or at least winches.slack_floor, {self.slack_floor} [N]'
            raise ArmDefinitionError('winches.force_limit', self.force_limit, expected)


class SimulatedWinches:
    """One winch for each tendon, over time.

    Attributes:
        winches: their parameters; may be replaced between two steps.
        tension: tension of every tendon now (tendons,) [N].
        set_point: what they are pulled to, within the limits (tendons,) [N].
    """

    def __init__(self, winches: Winches, tendons: int) -> None:
        """Begin with ``tendons`` slack tendons."""
        self.winches = winches
        self.tension: FloatArray = np.zeros(tendons)
        self.set_point: FloatArray = np.zeros(tendons)

    def step(self, command: FloatArray, dt: float) -> FloatArray:
        """Tensions after ``command`` (tendons,) [N] has been given for ``dt`` [s].

        The set point at the end of the step is used for the whole step, and the lag is integrated
        exactly: stable for any step.
        """
        own = self.winches
        wanted = np.maximum(command, own.slack_floor)
        if own.force_limit:
            wanted = np.minimum(wanted, own.force_limit)
        if own.rate_limit:
            most = own.rate_limit * dt
            wanted = np.clip(wanted, self.set_point - most, self.set_point + most)
        left = math.exp(-dt / own.lag) if own.lag else 0.0
        self.set_point = wanted
        self.tension = (1.0 - left) * wanted + left * self.tension
        return self.tension
