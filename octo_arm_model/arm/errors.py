"""The errors of the package: a class for each kind of failure, and their base class."""

import math
from collections.abc import Sequence
from typing import Any

_SHOWN = 200  # characters of a value or name in a message
_LISTED = 20  # names in a message
_LONGEST = 300  # characters of a message of `in_short`


def printable(text: str) -> str:
    """Return ``text`` with spaces for control characters, which a terminal would obey."""
    return ''.join(letter if letter.isprintable() else ' ' for letter in text)


def shown(value: object) -> str:
    """Return ``value`` on one line for a message: at most `_SHOWN` characters, arrays as lists."""
    text = ' '.join(repr(_plain(value)).splitlines())
    return text if len(text) <= _SHOWN else f'{text[:_SHOWN]}...'


def _plain(value: Any) -> Any:
    """Return arrays and numbers of NumPy, also within lists and tuples, as Python's."""
    if type(value) in (list, tuple):
        return type(value)(map(_plain, value))
    return value.tolist() if hasattr(value, 'tolist') else value


def listed(names: Sequence[str]) -> str:
    """Return ``names`` on one line for a message: at most `_LISTED`, and long names cut."""
    text = printable(', '.join(name[:_SHOWN] or "''" for name in names[:_LISTED]))
    more = len(names) - _LISTED
    return f'{text} and {more} more' if more > 0 else text or 'none'


class OctoArmError(Exception):
    """Base class of all errors that this package raises on purpose."""


class ArmDefinitionError(OctoArmError, ValueError):
    """An arm cannot exist as described, or an argument is of a wrong class.

    Attributes:
        field: name of the wrong field, as written in the configuration.
        value: the given value.
        expected: description of valid values.
    """

    def __init__(self, field: str, value: object, expected: str) -> None:
        """Compose the message from ``field``, ``value`` and the ``expected`` values."""
        super().__init__(f'{field} is {shown(value)}, expected {expected}')
        self.field = field
        self.value = value
        self.expected = expected


class ConfigError(OctoArmError, ValueError):
    """A configuration file cannot be read as an arm."""


class TensionError(OctoArmError, ValueError):
    """Tendon tensions have the wrong shape or an impossible value."""


class LoadError(OctoArmError, ValueError):
    """A load given with the tensions is invalid."""


class MessageError(OctoArmError, ValueError):
    """Data that arrived on a topic are not a message of its type."""


class TargetError(OctoArmError, ValueError):
    """A target of the inverse is invalid."""


class BagError(OctoArmError, ValueError):
    """A bag cannot be read or written, or lacks the required data."""


class MeasurementError(OctoArmError, ValueError):
    """Measurements do not determine the required result."""


class ProfileError(OctoArmError, ValueError):
    """A command profile is invalid, or is for another arm.

    Attributes:
        problem: description of the error.
        row: index of the wrong row, from 0; None if the error is not in a single row.
    """

    def __init__(self, problem: str, row: int | None = None) -> None:
        """Compose the message from ``problem`` and ``row``."""
        super().__init__(problem if row is None else f'row {row + 1}: {problem}')
        self.problem = problem
        self.row = row


class SolveError(OctoArmError, ArithmeticError):
    """The model has no trustworthy solution for these tensions, so no shape is returned."""

    def in_set(self, number: int) -> None:
        """Add the ``number`` of the set of tensions in its batch to the message."""
        self.args = (f'{self} in set {number}',)


class ConvergenceError(SolveError):
    """The iteration did not reach its tolerance.

    Attributes:
        residual: relative residual of the equations [-].
        iterations: number of iterations.
    """

    def __init__(self, what: str, residual: float, iterations: int) -> None:
        """Compose the message; ``what`` is the iteration that did not converge."""
        left = f'residual {residual:.2e}' if math.isfinite(residual) else 'no finite residual'
        super().__init__(f'{what} did not converge: {left} after {iterations} iterations')
        self.residual = residual
        self.iterations = iterations


class ContinuationError(ConvergenceError):
    """Continuation from a known equilibrium would take more than the budget of the solve.

    Attributes:
        part: fraction of the path that was followed [-].
    """

    def __init__(self, budget: str, part: float, residual: float, iterations: int) -> None:
        """Compose the message; ``budget`` is the amount that is spent."""
        super().__init__('continuation', residual, iterations)
        self.args = (
            f'continuation has spent its budget of {budget} at {100.0 * part:.3g} % of the way '
            f'from the known equilibrium to the tensions and loads wanted, after {iterations} '
            f'iterations (residual there {residual:.2e})',
        )
        self.part = part


def in_short(error: Exception) -> str:
    """Return the message of ``error`` on one line; beyond `_LONGEST` its middle is left out."""
    text = str(error)
    if len(text) > _LONGEST:
        half = (_LONGEST - 5) // 2
        text = f'{text[:half]} ... {text[-half:]}'
    return printable(text)
