"""LU factors of the Jacobian, and the stability of an equilibrium by its symmetric part.

If the loads have an energy, w_i J is the second variation of the energy at an equilibrium, and the
arm is stable where that is positive definite. Under other loads (a moment fixed in base_frame) a
positive symmetric part is sufficient. If it is not positive, the sign of the determinant decides:
it changes where a branch of equilibria turns or where another one crosses it.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import NamedTuple, Protocol

import numpy as np
from scipy.linalg import eigh
from scipy.linalg.lapack import dgetrf, dgetrs, dpotrf

from octo_arm_model.arm.errors import ConvergenceError
from octo_arm_model.arm.hints import FloatArray, IntArray

# An equilibrium is stable by a margin if the second variation exceeds this part of the stiffness
# of the sections: it then stays stable under small changes.
FIRM = 0.3
# Down to minus this part it is neutral to rounding, as of an arm free to turn about the vertical.
NEUTRAL = 1e-7


class Linear(Protocol):
    """A factorised linear system: the balance linearised at fixed tensions."""

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution (n,) or (n, k) for the right-hand sides ``right``."""


class Factors(NamedTuple):
    """LU factors of a Jacobian."""

    factors: FloatArray  #: the factors of the transposed matrix, as LAPACK's getrf returns them
    pivots: IntArray  #: rows of this matrix that were exchanged, as getrf returns them
    sign: int  #: the sign of the determinant, 1 or -1

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution (n,) or (n, k) for the right-hand sides ``right``."""
        solution, _ = dgetrs(self.factors, self.pivots, right, trans=1)
        return np.asarray(solution)


class BlockFactors(NamedTuple):
    """Factors of a block-diagonal Jacobian with a block for each node: an arm without loads."""

    inverse: FloatArray  #: the inverses of the blocks, (N, m, m)

    @classmethod
    def of(cls, hessian: FloatArray) -> BlockFactors:
        """Invert the Hessians ``hessian`` (N, m, m) of the sections.

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
        """Return the solution (n,) or (n, k), block by block, for the sides ``right``."""
        nodes, strains = self.inverse.shape[:2]
        return np.asarray(self.inverse @ right.reshape(nodes, strains, -1)).reshape(right.shape)


class RecentFactors:
    """A cache of the factors of the shapes that were solved, or started from, most recently.

    The factors of a shape take a hundred times its memory, and a caller may keep thousands of
    shapes.
    """

    def __init__(self, shapes: int, numbers: int) -> None:
        """Keep at most so many ``shapes``, with at most ``numbers`` matrix entries in all."""
        self._most, self._numbers = shapes, numbers
        self._factors, self._sizes = OrderedDict[object, Linear](), dict[object, int]()

    def find(self, key: object) -> Linear | None:
        """Return the factors of the shape with this ``key``; None if they were dropped."""
        if key in self._factors:
            self._factors.move_to_end(key)
        return self._factors.get(key)

    def add(self, key: object, factors: Linear, rows: int) -> None:
        """Keep the ``factors`` of a matrix with so many ``rows`` under the ``key`` of a shape."""
        self._factors[key], self._sizes[key] = factors, rows * rows
        while len(self._factors) > self._most or (
            sum(self._sizes.values()) > self._numbers and len(self._factors) > 1
        ):
            oldest, _ = self._factors.popitem(last=False)
            del self._sizes[oldest]


class LazyFactors:
    """Factors of a Jacobian that is factorised when a solution is first asked for.

    Attributes:
        z: the twists at which the Jacobian was computed.
    """

    def __init__(self, jacobian: FloatArray, z: FloatArray) -> None:
        """Keep a ``jacobian`` (n, n) at twists ``z``, which must not change any more."""
        self._jacobian: FloatArray | None = jacobian
        self.z = z
        self._factors: Factors | None = None

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution for the sides ``right``; raise ConvergenceError if singular."""
        if self._factors is None:
            assert self._jacobian is not None
            self._factors, self._jacobian = factorise(self._jacobian), None
        return self._factors.solve(right)


def factorise(jacobian: FloatArray) -> Factors:
    """Return the LU factors of a row-major ``jacobian`` (n, n), which is overwritten.

    Raises:
        ConvergenceError: if it is singular or not finite.
    """
    # LAPACK reads columns: the rows of the matrix are the columns of its transpose.
    factors, pivots, problem = dgetrf(jacobian.T, overwrite_a=1)
    diagonal = factors.diagonal()
    if problem or not np.isfinite(diagonal).all():
        raise ConvergenceError('the balance under load', np.inf, 0)
    swaps = np.count_nonzero(pivots != np.arange(pivots.size))
    negative = np.count_nonzero(diagonal < 0.0)
    return Factors(factors, pivots, -1 if (swaps + negative) % 2 else 1)


class Stability(NamedTuple):
    """The stability of an equilibrium."""

    is_stable: bool  #: whether it is stable
    is_firm: bool  #: whether it is stable by the margin `FIRM`


class Variation:
    """The second variation of the energy at an equilibrium, as a quadratic form of the twists."""

    def __init__(self, jacobian: FloatArray, hessian: FloatArray, weights: FloatArray) -> None:
        """Symmetrise a ``jacobian`` (N m, N m) with the sections' Hessians ``hessian`` (N, m, m).

        ``weights`` (N,) are those of the integral along the arm.
        """
        half = jacobian * (0.5 * np.repeat(weights, hessian.shape[1]))[:, np.newaxis]
        self.form = half + half.T
        self._sections = hessian * weights[:, np.newaxis, np.newaxis]
        self._is_soft = not (np.diagonal(hessian, axis1=1, axis2=2) > 0.0).all()

    def add(self, rows: FloatArray) -> None:
        """Add springs of stiffness one whose extensions are ``rows`` (k, N m) of the twists."""
        self.form += rows.T @ rows

    def stability(self) -> Stability:
        """Return whether the form is positive, and whether by the margin `FIRM`."""
        if self._is_soft:
            return Stability(False, False)
        if self._exceeds(FIRM):
            return Stability(True, True)
        return Stability(self._exceeds(-NEUTRAL), False)

    def is_positive(self) -> bool:
        """Whether the form is positive definite."""
        return not self._is_soft and self._exceeds(0.0)

    def softest(self) -> tuple[float, FloatArray]:
        """Return the least eigenvalue over the sections' stiffness [-], and its mode (N m,).

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
        """Whether the form exceeds ``part`` times the form of the sections alone."""
        form = self.form.copy()
        _diagonal(form, self._sections)[...] -= part * self._sections
        _, problem = dpotrf(form.T, overwrite_a=1, clean=0)
        return problem == 0


def _diagonal(form: FloatArray, blocks: FloatArray) -> FloatArray:
    """Return a view (N, m, m) of the diagonal blocks of a ``form``, of the size of ``blocks``."""
    nodes, strains = blocks.shape[:2]
    view: FloatArray = np.einsum('iaic->iac', form.reshape(nodes, strains, nodes, strains))
    return view
