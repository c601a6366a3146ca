"""What can go wrong, one class per kind of failure, all under one base."""

from __future__ import annotations

_SHOWN = 200  # characters of a value in a message
_LONGEST = 300  # characters of what went wrong that are worth keeping


def shown(value: object) -> str:
    """``value`` as messages show it: in one line, and of a long one its beginning."""
    text = ' '.join(repr(value).splitlines())
    return text if len(text) <= _SHOWN else f'{text[:_SHOWN]}...'


class OctoArmError(Exception):
    """Base of every error this package raises on purpose."""


class ArmDefinitionError(OctoArmError, ValueError):
    """An arm cannot exist as described.

    Attributes:
        field: name of the offending field, as written in the configuration.
        value: what was given.
    """

    def __init__(self, field: str, value: object, expected: str) -> None:
        """Say which ``field`` holds which ``value`` and what was ``expected``."""
        super().__init__(f'{field} is {shown(value)}, expected {expected}')
        self.field = field
        self.value = value
        self.expected = expected


class ConfigError(OctoArmError, ValueError):
    """A configuration file cannot be read as an arm."""


class TensionError(OctoArmError, ValueError):
    """Tendon tensions have the wrong shape or an impossible value."""


class LoadError(OctoArmError, ValueError):
    """A load given with the tensions is not one."""


class MessageError(OctoArmError, ValueError):
    """What arrived on a topic is no message of its type."""


class TargetError(OctoArmError, ValueError):
    """What the arm is asked to reach is not something it could."""


class BagError(OctoArmError, ValueError):
    """A bag cannot be read or written, or does not hold what is asked of it."""


class MeasurementError(OctoArmError, ValueError):
    """Measurements do not tell what is asked of them."""


class ProfileError(OctoArmError, ValueError):
    """A command profile is not one, or not one for this arm.

    Attributes:
        problem: what is wrong.
        row: the row it is wrong with, from 0; None where it is no single one.
    """

    def __init__(self, problem: str, row: int | None = None) -> None:
        """Say what is wrong, and in which row."""
        super().__init__(problem if row is None else f'row {row + 1}: {problem}')
        self.problem = problem
        self.row = row


class SolveError(OctoArmError, ArithmeticError):
    """The model has no trustworthy answer for these tensions, so none is returned.

    Attributes:
        number: which of the arms solved side by side; the message names it where known.
    """

    def __init__(self, message: str, number: int | None = None) -> None:
        """Say why, and for which one of several arms."""
        super().__init__(message)
        self.number = number

    def in_batch(self, first: int, count: int) -> None:
        """Say which set of a batch it was, or among which ``count`` from ``first`` on."""
        where = f'sets {first} to {first + count - 1}'
        if self.number is not None or count == 1:
            where = f'set {first + (self.number or 0)}'
        self.args = (f'{self} in {where}',)


class ConvergenceError(SolveError):
    """The iteration did not reach its tolerance.

    Attributes:
        residual: what was left of the equations, relative [-].
        iterations: steps made.
        iterate: the last iterate, for whoever wants to look at it; None where there is none.
    """

    def __init__(
        self, what: str, residual: float, iterations: int, iterate: object = None
    ) -> None:
        """Say ``what`` did not converge and how far it got."""
        super().__init__(
            f'{what} did not converge: residual {residual:.2e} after {iterations} iterations'
        )
        self.residual = residual
        self.iterations = iterations
        self.iterate = iterate


class ContinuationError(ConvergenceError):
    """Following equilibria from a known one would take more than the budget of the solve.

    Attributes:
        part: of the way that was gone.
    """

    def __init__(
        self, budget: str, part: float, residual: float, iterations: int, iterate: object = None
    ) -> None:
        """Say which ``budget`` is spent and how far it got."""
        super().__init__('continuation', residual, iterations, iterate)
        self.args = (
            f'continuation has spent its budget of {budget} at {100.0 * part:.3g} % of the way '
            f'from the known equilibrium to the tensions and loads wanted, after {iterations} '
            f'iterations (residual there {residual:.2e})',
        )
        self.part = part


def in_short(error: Exception) -> str:
    """What an ``error`` says, without the middle where that is long, as names from outside are."""
    text = str(error)
    if len(text) <= _LONGEST:
        return text
    half = (_LONGEST - 5) // 2
    return f'{text[:half]} ... {text[-half:]}'
