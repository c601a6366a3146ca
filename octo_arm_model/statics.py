"""What every model of the statics takes and gives."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from octo_arm_model.hints import FloatArray, IntArray


class Solution(NamedTuple):
    """Solved statics of a batch of arms.

    Attributes:
        twist: motion of the frame per reference length, in its own axes: angular (1 + q) (tau,
            xi, k) [1/m], then linear 1 + q [-] along t (and shear along n and b, if any),
            (4 or 6, batch, nodes).
        residual: what is left of the model's equations, relative, (batch,).
        iterations: steps it took, (batch,).
    """

    twist: FloatArray
    residual: FloatArray
    iterations: IntArray


class Statics(Protocol):
    """A model of the arm's statics, prepared for certain nodes."""

    def solve(self, tensions: FloatArray) -> Solution:
        """Solve for ``tensions`` (batch, tendons) [N].

        The paper's models take complex tensions too: their derivatives are the imaginary part.

        Raises:
            ConvergenceError: if the model's equations were not solved.
        """
