"""Iterations and time that one solve of a loaded arm may take."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from octo_arm_model.core.errors import ConfigError, ContinuationError


@dataclass(frozen=True)
class Budget:
    """What one solve may take; one that would take more is refused.

    Attributes:
        iterations: of Newton's method, of one arm.
        seconds: of one arm [s].

    Raises:
        ConfigError: if either is not positive.
    """

    iterations: int = 1000
    seconds: float = math.inf

    def __post_init__(self) -> None:
        """Validate."""
        for name, value in vars(self).items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
                raise ConfigError(f'solve budget: {name} is {value!r}, expected a number > 0')


class Spending:
    """What one solve has taken of its `Budget` so far.

    Attributes:
        iterations: made.
    """

    def __init__(self, budget: Budget) -> None:
        """Start the clock of a solve that may take ``budget``."""
        self._budget, self._begin = budget, time.monotonic()
        self.iterations = 0

    def add(self, iterations: int, part: float, residual: float, iterate: object) -> None:
        """Count ``iterations`` of Newton's method.

        For the error: ``part`` is the fraction of the path followed so far [-], ``residual`` and
        ``iterate`` are those of the last iterate.

        Raises:
            ContinuationError: if the budget is spent.
        """
        self.iterations += iterations
        spent = ''
        if self.iterations > self._budget.iterations:
            spent = f'{self._budget.iterations} iterations'
        elif time.monotonic() - self._begin > self._budget.seconds:
            spent = f'{self._budget.seconds:g} s'
        if spent:
            raise ContinuationError(spent, part, residual, self.iterations, iterate)
