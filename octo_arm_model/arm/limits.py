"""The bounds on the size of all input, and on the iterations and the time of a solve.

Time and memory of a solve grow in proportion to stations and to nodes times tendons; under loads
they grow with the third and second power of the nodes. Within these bounds every model takes at
most some tens of seconds and some gigabytes. Each bound is checked where the input enters.
"""

import contextlib
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

from octo_arm_model.arm.errors import ConfigError, ContinuationError, shown

MAX_STATIONS = 10_000
MAX_INTERVALS = 20_000  # of an arm, if none is longer than the arm is thick
MAX_NODES = 2_000  # of a loaded arm
MAX_SECTIONS = 64
MAX_TENDONS = 256
MAX_DISCS = 256
MAX_POINT_LOADS = 256
MAX_OBSTACLES = 32
MAX_TABLE_POINTS = 1_000  # of each table along s: radius, modulus, path, distributed force
MAX_TENDON_TABLE = 20_000  # values of a table of the paths of all tendons
MAX_FRICTION = 10.0  # Coulomb's coefficient; rubber on rubber has some 3
MAX_NAME = 255  # characters in the name of a frame, a tendon or a file

MAX_SAMPLES = 2**20  # sets of tensions of a workspace
MAX_SAMPLED_TENSIONS = 2**25  # sets of tensions times tendons of a workspace
MAX_PROCESSES = 1_000
MIN_RATE = 1e-6  # [Hz] > 0: ROS counts the period in nanoseconds of 64 bits

MAX_PROFILE_ROWS = 100_000
MAX_PROFILE_BYTES = 64 * 2**20  # of a CSV file

# CSV files of a laboratory.
MAX_CSV_BYTES = 256 * 2**20
MAX_CSV_ROWS = 1_000_000
MAX_CSV_COLUMNS = 4_000

# YAML files; values are counted with aliases written out.
MAX_YAML_BYTES = 2**20
MAX_YAML_VALUES = 100_000
MAX_YAML_DEPTH = 20


_MOST_RESIDUAL = 1e-6  # a shape with a larger residual is no equilibrium of the arm


@dataclass(frozen=True)
class Budget:
    """The limits of one solve, which is refused if it needs more.

    Attributes:
        iterations: largest number of iterations of Newton's method for one arm.
        seconds: longest time for one arm [s].
        residual: allowed residual of an equilibrium found by continuation from one nearby [-], at
            most 1e-6; others have 1e-11. The error of the tip over the length is about as large,
            or some ten times as large near a limit point.

    Raises:
        ConfigError: if a value is not positive, or the residual is too large.
    """

    iterations: int = 1000
    seconds: float = math.inf
    residual: float = 1e-9

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
                raise ConfigError(f'solve budget: {name} is {shown(value)}, expected a number > 0')
        if self.residual > _MOST_RESIDUAL:
            raise ConfigError(
                f'solve budget: residual is {shown(self.residual)}, expected at most '
                f'{_MOST_RESIDUAL:g}'
            )


class Spending:
    """The iterations and the time that one solve has taken of its `Budget` so far.

    Attributes:
        iterations: number of iterations so far.
        residual: allowed residual [-], that of the `Budget`.
    """

    def __init__(self, budget: Budget, begin: float | None = None) -> None:
        """Start the clock of a solve with a ``budget``, now or at ``begin``."""
        self._budget = budget
        self._begin = time.monotonic() if begin is None else begin
        self.residual = budget.residual
        self.iterations = 0

    def add(self, iterations: int, part: float, residual: float) -> None:
        """Count ``iterations`` of Newton's method.

        The error states ``part``, the fraction of the path that was followed so far [-], and the
        ``residual`` of the last iterate.

        Raises:
            ContinuationError: if the budget is spent.
        """
        self.iterations += iterations
        if self.iterations > self._budget.iterations:
            spent = f'{self._budget.iterations} iterations'
        elif time.monotonic() - self._begin > self._budget.seconds:
            spent = f'{self._budget.seconds:g} s'
        else:
            return
        raise ContinuationError(spent, part, residual, self.iterations)


class Allowance:
    """The budget of the solves of one arm: one for each, or the time of one for several together.

    Attributes:
        budget: the budget of a solve.
    """

    def __init__(self, budget: Budget) -> None:
        """Allow each solve this ``budget``."""
        self.budget = budget
        self._begin: float | None = None

    @contextlib.contextmanager
    def together(self, began: float | None = None) -> Iterator[None]:
        """Give all solves within this context together the time of one budget.

        The clock runs from ``began``, a time of `time.monotonic` [s], or from now on. A context
        within another one has the clock of the outer one.
        """
        outer = self._begin
        if outer is None:
            self._begin = time.monotonic() if began is None else began
        try:
            yield
        finally:
            self._begin = outer

    def spending(self) -> Spending:
        """Start the clock of one solve."""
        return Spending(self.budget, self._begin)
