"""How much updates may ask of the solver: what takes more is refused, and not late."""

from __future__ import annotations

from collections.abc import Callable

from octo_arm_model.arm.errors import SolveError


class Effort:
    """Iterations of Newton's method that are left, which are as many on every machine.

    Derivatives count as one.
    """

    def __init__(
        self,
        iterations: float,
        within: Effort | None = None,
        pause: Callable[[], None] | None = None,
    ) -> None:
        """Of so many ``iterations``, and of no more than are left ``within`` another.

        ``pause`` is called at every `check`, which comes before every solve.
        """
        self._iterations = self._left = iterations
        self._within, self._pause = within, pause

    def take(self, iterations: int) -> None:
        """Note ``iterations`` made."""
        self._left -= iterations
        if self._within is not None:
            self._within.take(iterations)

    def check(self) -> None:
        """Check that any are left.

        Raises:
            SolveError: if there are none.
        """
        if self._pause is not None:
            self._pause()
        if self._left <= 0.0:
            raise SolveError(
                f'the estimate did not converge within {self._iterations:g} iterations of shapes'
            )
        if self._within is not None:
            self._within.check()
