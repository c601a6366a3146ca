"""From which time on the diagnostics of a node warn."""

from __future__ import annotations

from dataclasses import dataclass

from octo_arm_model.config.parameter_group import ParameterGroup, stated


@dataclass(frozen=True)
class DiagnosticLimits(ParameterGroup):
    """Thresholds of the node's diagnostics."""

    GROUP = 'diagnostics'

    silence_limit: float = stated(
        'time without messages after which an input is called silent [s]', 2.0, '>= 0', 'time'
    )
    age_limit: float = stated(
        'age on arrival from which stamps of tensions are called old [s]', 1.0, '>= 0', 'time'
    )
    ahead_limit: float = stated(
        'how far stamps of tensions may be ahead of the clock, beside twice the last step of a '
        'simulated one [s]', 0.1, '>= 0', 'time',
    )  # fmt: skip
