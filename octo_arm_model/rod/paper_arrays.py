"""The node function of the paper's models over whole arrays; `paper_loops` for numba."""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray, Numbers
from octo_arm_model.rod.section_formulas import paper_jump, paper_moments, paper_slope, paper_twist
from octo_arm_model.rod.tables import PaperTables

MOST_PAPER_SWEEPS = 60  # of an element in equation (10)
SWEEPS_A_CHECK = 2  # of these, as a check takes as long as a sweep


def paper_twists(
    tables: PaperTables, sums: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Twists (A, P, 4) in the paper's balance, and how (10) was solved, see `paper_loops`.

    ``sums`` may be complex.
    """
    outcome, rest = np.full((len(sums), 3), (0.0, 0.0, -1.0)), tables.rest[:, np.newaxis]
    if tables.swept:
        rest, outcome = _imbalances(tables, sums, tolerance)
    found = paper_twist(tuple(sums.swapaxes(0, 1)), tuple(tables.stiffness), tuple(rest))
    return np.stack(found, axis=-1), outcome


def _imbalances(
    tables: PaperTables, sums: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Imbalance p (3, A, P) [N m] at nodes and stations, and how it was found, (A, 3)."""
    (stations, nodes), points = tables.stations.between.shape, tables.backwards.shape[1]
    p = np.zeros((3, len(sums), sums.shape[2]), sums.dtype)
    residual, sweeps, stuck = outcome = np.zeros((3, len(sums)))
    stuck[:] = -1.0
    largest = np.abs(sums[:, 1:3, :nodes]).max(axis=(1, 2), initial=1e-300)
    end = np.zeros((3, len(sums)), sums.dtype)
    for e in range(tables.swept - 1, -1, -1):
        own, at = slice(e * points, (e + 1) * points), tables.anchorage[e]
        if at >= 0:
            sides = _moments(sums[..., at]), _moments(sums[..., at + 1])
            end = paper_jump(tables.stiffness[[1, 2, 2], at, np.newaxis], *sides, end)
        coefficients = paper_slope(
            tuple(tables.stiffness[:, own]), tuple(sums[..., own].swapaxes(0, 1))
        )
        backwards = -tables.lengths[e] * tables.backwards.T
        found, change, count = _sweep(coefficients, backwards, end, tolerance * largest)
        stuck[(stuck < 0.0) & ~(change <= tolerance * largest)] = e
        np.maximum(residual, change / largest, out=residual)
        np.maximum(sweeps, count, out=sweeps)
        p[..., own], end = found[..., :points], found[..., points]
    p[..., nodes : nodes + stations] = p[..., :nodes] @ tables.stations.between.T
    return p, outcome.T


def _moments(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """F and the diagonal of D of ``sums`` (A, 7), (3, A)."""
    f, d = paper_moments(tuple(sums.T))
    return np.stack(f), np.stack(d)


def _sweep(
    coefficients: Numbers, backwards: FloatArray, end: FloatArray,
    allowed: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Imbalance (3, A, p + 1) from that at the ``end``, its last change and sweeps, (A,)."""
    xi, k, product = coefficients[:3]
    linear, aside = np.stack(coefficients[3:5]), np.stack(coefficients[5:])
    end = end[..., np.newaxis]
    p = np.repeat(end, len(backwards) + 1, axis=2)
    n, b, others = p[1, :, :-1], p[2, :, :-1], p[:0:-1, :, :-1]
    settled: tuple[FloatArray, FloatArray, FloatArray] | None = None
    for count in range(1, MOST_PAPER_SWEEPS + 1):
        last = p.copy() if count % SWEEPS_A_CHECK == 0 else None
        np.add(((product * b + k) * n - xi * b) @ backwards, end[0], out=p[0])
        np.add(((aside * others + linear) * p[0, :, :-1]) @ backwards, end[1:], out=p[1:])
        if last is None:
            continue
        change = np.abs(last - p).max(axis=(0, 2))
        if settled is None:
            settled = p.copy(), change, np.full(len(change), float(count))
        else:
            # A converged arm is swept no further, so that it does not depend on the others.
            left = ~(settled[1] <= allowed)
            np.copyto(settled[0], p, where=left[:, np.newaxis])
            np.copyto(settled[1], change, where=left)
            settled[2][left] = count
        if (settled[1] <= allowed).all():
            break
    assert settled is not None
    return settled
