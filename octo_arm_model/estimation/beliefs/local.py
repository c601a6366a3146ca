"""What is known of a posterior about one state, and what comes of it."""

from __future__ import annotations

from typing import NamedTuple

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import Gain
from octo_arm_model.estimation.beliefs.posterior_mean import Agreement

_OFF, _TURNED = 0.1, 0.3  # parts of the noise, of what is straight: its values, its spread


class Step(NamedTuple):
    """A step of the iteration from ``start`` to ``x``.

    Attributes:
        size: in standard deviations a component.
        beyond: square of how far the mean is beyond the possible states.
        cost: what is least at the end, in squares of standard deviations, but for a constant.
    """

    start: FloatArray
    x: FloatArray
    size: float
    beyond: float
    cost: float


class Bend(NamedTuple):
    """By how much measurements bend on a step, in parts of their noise.

    Attributes:
        off: of what they predict at its end.
        turned: of the spread of that.
    """

    off: float
    turned: float

    @property
    def is_little(self) -> bool:
        """Whether a step so straight may be the last."""
        return self.off <= _OFF and self.turned <= _TURNED


class Local(NamedTuple):
    """What measurements predict about one state, to second order, in standard deviations.

    Attributes:
        x: the state, in its own units.
        by: what they make of the belief by themselves, linearised there.
        z: its distance from the mean before, (n,).
        left: measured less predicted there, (m,).
        jacobian: of what is predicted, (m, n).
        second: its second derivatives, (m, n, n).
        slope: gradient of what is least, by which the mean is not the most probable state, (n,).
        own: Newton's step from that state and how it bends, if they are found with the rest.
    """

    x: FloatArray
    by: Gain
    z: FloatArray
    left: FloatArray
    jacobian: FloatArray
    second: FloatArray
    slope: FloatArray
    own: tuple[Step, Bend] | None = None

    @property
    def square(self) -> float:
        """Sum of squares of the change of the state and of the noise."""
        return float(self.z @ self.z) + float(self.left @ self.left)

    def about(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Measured less predicted in ``z``, and the Jacobian there."""
        change = z - self.z
        bent = self.second @ change
        return self.left - (self.jacobian + 0.5 * bent) @ change, self.jacobian + bent


class Conclusion(NamedTuple):
    """What measurements are found to tell at the end.

    Attributes:
        innovation: measured less predicted before, linearised about the last state, (m,).
        square: of that, normalised.
        scatter: `Belief.scatter` after them, (n, n).
        agreed: how the innovation draws the mode.
        share: part of the whole shift to the mean, see `share_of`.
    """

    innovation: FloatArray
    square: float
    scatter: FloatArray
    agreed: Agreement
    share: float
