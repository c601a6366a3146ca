"""How well measurements agree with estimates: normalised innovations, counted by their kind."""

from __future__ import annotations

import collections
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from octo_arm_model.estimation.rules import Innovation

RECENT = 200  # innovations of a kind that count as recent


@dataclass
class Consistency:
    """Innovations of one kind of measurement.

    Attributes:
        accepted: how many measurements.
        refused: how many the gate refused.
        square: sum of the normalised squares of those accepted; chi-square of `size` where all
            is as told.
        size: of how many numbers.
        recent: square and size of the newest of them.
        refused_from: stamp of the first one refused [ns]; None of none.
        refused_to: of the last.
    """

    accepted: int = 0
    refused: int = 0
    square: float = 0.0
    size: int = 0
    recent: collections.deque[tuple[float, int]] = field(
        default_factory=lambda: collections.deque(maxlen=RECENT)
    )
    refused_from: int | None = None
    refused_to: int | None = None

    @property
    def mean(self) -> float:
        """Mean of the normalised squares per number, 1 where all is as told; NaN of none."""
        return self.square / self.size if self.size else math.nan

    def count(self, stamp_ns: int, one: Innovation) -> None:
        """Count an innovation."""
        if one.is_accepted:
            self.accepted += 1
            self.square += one.normalised_square
            self.size += one.value.size
            self.recent.append((one.normalised_square, one.value.size))
            return
        self.refused += 1
        if self.refused_from is None:
            self.refused_from = stamp_ns
        self.refused_to = stamp_ns


def count_innovations(
    consistency: dict[str, Consistency], stamp_ns: int, innovations: Sequence[Innovation]
) -> None:
    """Count ``innovations`` of one stamp [ns] in the ``consistency`` of their kinds."""
    for one in innovations:
        consistency.setdefault(one.name, Consistency()).count(stamp_ns, one)
