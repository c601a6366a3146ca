"""LU factors of the Jacobian, and what its symmetric part says of stability.

Under loads that have an energy w_i J is its second variation at an equilibrium: the arm is stable
where that is positive definite. Under others (a moment fixed in base_frame) a positive symmetric
part suffices; where it is not positive the sign of the determinant tells, which changes where a
branch of equilibria turns or another crosses it.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import NamedTuple, Protocol

import numpy as np
from scipy.linalg import eigh
from scipy.linalg.lapack import dgetrf, dgetrs, dpotrf

from octo_arm_model.arm.errors import ConvergenceError
from octo_arm_model.arm.hints import FloatArray, IntArray

# Part of the stiffness of the sections that the second variation has to exceed, for an equilibrium
# that stays stable under small changes.
FIRM = 0.3
# The same, as far as a neutral equilibrium is one to rounding: an arm that may turn about the
# vertical.
NEUTRAL = 1e-7


class Linear(Protocol):
    """What solves the linearised balance at tensions that are held."""

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution (n,) or (n, k) of the system with the ``right`` sides."""


class Factors(NamedTuple):
    """LU factors of a Jacobian.

    Attributes:
        factors: as of LAPACK's getrf, of the transposed matrix.
        pivots: of the same.
        sign: of the determinant, 1 or -1.
    """

    factors: FloatArray
    pivots: IntArray
    sign: int

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution (n,) or (n, k) of the system with the ``right`` sides."""
        found, _ = dgetrs(self.factors, self.pivots, right, trans=1)
        return np.asarray(found)


class BlockFactors(NamedTuple):
    """As `Factors`, of a Jacobian that is one block for each node: of an arm without loads.

    Attributes:
        inverse: of the blocks, (N, m, m).
    """

    inverse: FloatArray

    @classmethod
    def of(cls, hessian: FloatArray) -> BlockFactors:
        """Of the sections' ``hessian`` (N, m, m).

        Raises:
            ConvergenceError: if one is singular or not finite.
        """
        try:
            inverse = np.linalg.inv(hessian)
        except np.linalg.LinAlgError:
            inverse = np.array(np.nan)
        if not np.isfinite(inverse).all():
            raise ConvergenceError('the balance of the cross sections', np.inf, 0)
        return cls(np.asarray(inverse, dtype=np.float64))

    def solve(self, right: FloatArray) -> FloatArray:
        """See `Factors.solve`."""
        nodes, strains = self.inverse.shape[:2]
        return np.asarray(self.inverse @ right.reshape(nodes, strains, -1)).reshape(right.shape)


class RecentFactors:
    """Factors of the last few shapes that were found, or that a solve began with.

    They take a hundred times the memory of a shape, of which there may be thousands.
    """

    def __init__(self, most: int, numbers: int) -> None:
        """Of so many shapes, and of matrices of so many ``numbers`` in all, at ``most``."""
        self._most, self._numbers = most, numbers
        self._factors, self._sizes = OrderedDict[object, Linear](), dict[object, int]()

    def find(self, key: object) -> Linear | None:
        """The factors of the shape of this ``key``; None where others have replaced them."""
        if key in self._factors:
            self._factors.move_to_end(key)
        return self._factors.get(key)

    def add(self, key: object, factors: Linear, rows: int) -> None:
        """Keep the ``factors`` of the shape of this ``key``, of a matrix of so many ``rows``."""
        self._factors[key], self._sizes[key] = factors, rows * rows
        while len(self._factors) > self._most or (
            sum(self._sizes.values()) > self._numbers and len(self._factors) > 1
        ):
            oldest, _ = self._factors.popitem(last=False)
            del self._sizes[oldest]


class LazyFactors:
    """As `Factors`, of a Jacobian that is factorised when a solution is first asked for."""

    def __init__(self, jacobian: FloatArray) -> None:
        """Of a ``jacobian`` (n, n) that nobody changes."""
        self._jacobian: FloatArray | None = jacobian
        self._factors: Factors | None = None

    def solve(self, right: FloatArray) -> FloatArray:
        """See `Factors.solve`; raises ConvergenceError as `factors`."""
        return self.factors().solve(right)

    def factors(self) -> Factors:
        """LU factors.

        Raises:
            ConvergenceError: if the Jacobian is singular or not finite.
        """
        if self._factors is None:
            assert self._jacobian is not None
            self._factors, self._jacobian = factorise(self._jacobian), None
        return self._factors


def factorise(jacobian: FloatArray) -> Factors:
    """Factors of a ``jacobian`` (n, n) in rows, which is overwritten.

    Raises:
        ConvergenceError: if it is singular or not finite.
    """
    # Rows of the matrix are columns of its transpose, as LAPACK reads it.
    factors, pivots, problem = dgetrf(jacobian.T, overwrite_a=1)
    diagonal = factors.diagonal()
    if problem or not np.isfinite(diagonal).all():
        raise ConvergenceError('the balance under load', np.inf, 0)
    swaps = np.count_nonzero(pivots != np.arange(pivots.size))
    negative = np.count_nonzero(diagonal < 0.0)
    return Factors(factors, pivots, -1 if (swaps + negative) % 2 else 1)


class Stability(NamedTuple):
    """What the system at an equilibrium says of it.

    Attributes:
        is_stable: whether it is stable.
        is_firm: whether it is by the margin `FIRM`.
    """

    is_stable: bool
    is_firm: bool


class Variation:
    """The second variation of the energy at an equilibrium, as a form of the twists."""

    def __init__(self, jacobian: FloatArray, hessian: FloatArray, weights: FloatArray) -> None:
        """Of a ``jacobian`` (N m, N m) with the sections' ``hessian`` (N, m, m).

        ``weights`` (N,) are those of the integral along the arm.
        """
        half = jacobian * (0.5 * np.repeat(weights, hessian.shape[1]))[:, np.newaxis]
        self.form = half + half.T
        self._sections = hessian * weights[:, np.newaxis, np.newaxis]
        self._is_soft = not (np.diagonal(hessian, axis1=1, axis2=2) > 0.0).all()

    def add(self, rows: FloatArray) -> None:
        """Add the squares of ``rows`` (k, N m) of the twists: of springs of stiffness one."""
        self.form += rows.T @ rows

    def stability(self) -> Stability:
        """Whether it is positive, and by what margin."""
        if self._is_soft:
            return Stability(False, False)
        if self._exceeds(FIRM):
            return Stability(True, True)
        return Stability(self._exceeds(-NEUTRAL), False)

    def is_positive(self) -> bool:
        """Whether it is positive definite."""
        return not self._is_soft and self._exceeds(0.0)

    def softest(self) -> tuple[float, FloatArray]:
        """Least eigenvalue [-], in parts of the sections' stiffness, and its twists (N m,).

        Raises:
            ConvergenceError: if a section has no stiffness.
        """
        if self._is_soft:
            raise ConvergenceError('the balance of a cross section', np.inf, 0)
        sections = np.zeros_like(self.form)
        _diagonal(sections, self._sections)[...] = self._sections
        try:
            values, vectors = eigh(self.form, sections, subset_by_index=[0, 0])
        except np.linalg.LinAlgError as error:
            raise ConvergenceError('the balance of a cross section', np.inf, 0) from error
        return float(values[0]), np.asarray(vectors[:, 0])

    def _exceeds(self, part: float) -> bool:
        """Whether it exceeds ``part`` of the form of the sections alone."""
        form = self.form.copy()
        _diagonal(form, self._sections)[...] -= part * self._sections
        _, problem = dpotrf(form.T, overwrite_a=1, clean=0)
        return problem == 0


def _diagonal(form: FloatArray, blocks: FloatArray) -> FloatArray:
    """View of the ``blocks`` (N, m, m) on the diagonal of a ``form`` (N m, N m)."""
    nodes, strains = blocks.shape[:2]
    view: FloatArray = np.einsum('iaic->iac', form.reshape(nodes, strains, nodes, strains))
    return view
