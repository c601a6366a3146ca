"""The node function of the paper's models over whole arrays; `paper_loops` for numba."""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.tables import PaperTables

MOST_PAPER_SWEEPS = 60  # of an element in equation (10)
SWEEPS_A_CHECK = 2  # of these, as a check takes as long as a sweep


def paper_twists(
    tables: PaperTables, sums: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Twists (A, P, 4) in the paper's balance, and how (10) was solved, see `paper_loops`.

    ``sums`` may be complex.
    """
    axial, torsion, bending_n, bending_b = tables.stiffness
    pull, n, b, nn, bb, mixed, torque = sums.swapaxes(0, 1)
    outcome = np.full((len(sums), 3), (0.0, 0.0, -1.0))
    rest = tables.rest[:, np.newaxis]
    if tables.swept:
        rest, outcome = _imbalances(tables, sums, tolerance)
    moment_t, moment_n, moment_b = np.stack([-torque, -b, n]) + rest
    about_n, about_b = bending_n + bb, bending_b + nn
    over = 1.0 / (about_n * about_b - mixed * mixed)
    xi = (about_b * moment_n + mixed * moment_b) * over
    k = (about_n * moment_b + mixed * moment_n) * over
    twist = np.empty((*pull.shape, 4), pull.dtype)
    stretch = twist[..., 3] = (k * n - xi * b - pull) / axial + 1.0
    twist[..., 0] = moment_t / (torsion + (nn + bb)) * stretch
    twist[..., 1], twist[..., 2] = xi * stretch, k * stretch
    return twist, outcome


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
            end = _jumped(tables.stiffness[1:3, at], sums[..., at], sums[..., at + 1], end)
        coefficients = _slope_coefficients(tables.stiffness[1:3, own], sums[..., own])
        backwards = -tables.lengths[e] * tables.backwards.T
        found, change, count = _sweep(coefficients, backwards, end, tolerance * largest)
        stuck[(stuck < 0.0) & ~(change <= tolerance * largest)] = e
        np.maximum(residual, change / largest, out=residual)
        np.maximum(sweeps, count, out=sweeps)
        p[..., own], end = found[..., :points], found[..., points]
    p[..., nodes : nodes + stations] = p[..., :nodes] @ tables.stations.between.T
    return p, outcome.T


def _moments(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """F and the diagonal of D, (3, ...), of ``sums`` (A, 7, ...), see `paper_equations`."""
    _, n, b, nn, bb = sums.swapaxes(0, 1)[:5]
    return np.stack([np.zeros_like(n), -b, n]), np.stack([nn + bb, bb, nn])


def _jumped(stiffness: FloatArray, base: FloatArray, tip: FloatArray, p: FloatArray) -> FloatArray:
    """Imbalance (3, A) at the side of an anchorage to the base by (11), from ``p`` at the other.

    From sums (A, 7) at both sides.
    """
    torsion, bending = stiffness
    k = np.array([[torsion], [bending], [bending]])
    (f, d), (f_tip, d_tip) = _moments(base), _moments(tip)
    omega = (f_tip + p) / (k + d_tip) + (f - f_tip) / (k + (d - d_tip))
    return np.asarray(omega * (k + d) - f)


def _slope_coefficients(
    stiffness: FloatArray, sums: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Coefficients of p' in an element: xi_0, k_0, that of p_n p_b, and of p_n' and p_b'.

    Of the last two each has a row: c times k_0 and xi_0, and what is multiplied by p_b and p_n.
    """
    torsion, bending = stiffness
    (_, f_n, f_b), (polar, bb, nn) = _moments(sums)
    c_t, c_n, c_b = 1.0 / (torsion + polar), 1.0 / (bending + bb), 1.0 / (bending + nn)
    xi, k, c = c_n * f_n, c_b * f_b, (bending + polar) * c_t
    aside = np.stack([-c * k, c * xi]), np.stack([-bb * c_t * c_b, nn * c_t * c_n])
    return xi, k, (bb - nn) * c_n * c_b, *aside


def _sweep(
    coefficients: tuple[FloatArray, ...], backwards: FloatArray, end: FloatArray,
    allowed: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Imbalance (3, A, p + 1) at the points and the start of an element from that at its ``end``.

    Returns:
        It, its last change [N m] and the number of sweeps of each arm, (A,).
    """
    xi, k, product, linear, aside = coefficients
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
