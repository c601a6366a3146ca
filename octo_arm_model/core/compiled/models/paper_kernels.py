"""Kernels of the paper's models: loops over nodes.

The formulas are imported from the modules in which NumPy evaluates them for whole arrays, so that
each is written once. The kernels also run as plain Python, a thousand times slower.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.models.arm_tables import (
    GridTables,
    IntegrationTables,
    PapersTables,
    Weights,
)
from octo_arm_model.core.compiled.models.frame_kernels import read_out
from octo_arm_model.core.compiled.numerics.products import add_products
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.models.picard import (
    MAX_SWEEPS,
    SWEEPS_BETWEEN_CHECKS,
    TOLERANCE,
    slope_along,
    slope_aside,
    slope_coefficients,
)
from octo_arm_model.core.section.paper_balance import (
    added_curvature,
    curvatures,
    imbalance_of,
    stretch,
)


def sums_of(weights: Weights, tensions: FloatArray) -> FloatArray:
    """Weighted sums (sums, nodes) of ``tensions`` (tendons,)."""
    sums = np.zeros(weights.shape)
    place = 0
    for number, tendon, first, count in weights.runs:
        if tensions[tendon] != 0.0:
            out, values = sums[number, first : first + count], weights.values[place:]
            for i in range(count):
                out[i] += tensions[tendon] * values[i]
        place += count
    return sums


@borrows
def largest_change(p: FloatArray, previous: FloatArray, limit: float) -> float:
    """Largest of |p - previous|; infinity if it exceeds ``limit`` or an element is NaN."""
    beyond, total = 0, 0.0
    # Counting is vectorised, unlike a maximum; most checks end here.
    for k in range(3):
        for i in range(p.shape[1]):
            beyond += abs(p[k, i] - previous[k, i]) > limit
    if beyond:
        return np.inf
    largest = 0.0
    for k in range(3):
        for i in range(p.shape[1]):
            largest = max(largest, abs(p[k, i] - previous[k, i]))
            total += p[k, i]
    return largest if np.isfinite(total) else np.inf


def converge(
    p: FloatArray, constant: FloatArray, integrate: FloatArray, moment: float
) -> tuple[float, int]:
    """Solve for p (3, points) in one element by sweeps, from a constant p, its initial value.

    ``constant`` (7, points) are its `slope_coefficients`, ``integrate`` is that of `Element` and
    ``moment`` the scale of p [N m].

    Returns:
        Last change relative to ``moment`` and number of sweeps; 0 where it does not converge.
    """
    points = p.shape[1]
    start, slope, previous = p[:, 0].copy(), np.empty((2, points)), np.empty_like(p)
    for sweep in range(1, MAX_SWEEPS + 1):
        is_checked = sweep % SWEEPS_BETWEEN_CHECKS == 0
        if is_checked:
            previous[:] = p
        for i in range(points):
            slope[0, i] = slope_along(
                p[1, i], p[2, i], constant[0, i], constant[1, i], constant[2, i]
            )
        p[0] = start[0]
        add_products(slope[0], integrate, p[0])
        for i in range(points):
            slope[0, i] = slope_aside(p[0, i], p[2, i], constant[3, i], constant[5, i])
            slope[1, i] = slope_aside(p[0, i], p[1, i], constant[4, i], constant[6, i])
        p[1], p[2] = start[1], start[2]
        add_products(slope[0], integrate, p[1])
        add_products(slope[1], integrate, p[2])
        if is_checked:
            change = largest_change(p, previous, TOLERANCE * moment)
            if change <= TOLERANCE * moment:
                return change / moment, sweep
    return np.inf, 0


def find_imbalance(
    tables: IntegrationTables, tensions: FloatArray, p: FloatArray
) -> tuple[float, int]:
    """Fill in p (3, nodes), initially zero, where it is not zero; as `Integration.imbalance`.

    Returns:
        Largest last relative change and number of sweeps of an element; -1 where one does not
        converge.
    """
    sums = sums_of(tables.weights, tensions)
    torsion, bending = tables.stiffness
    constant = np.empty((7, bending.size))
    largest = 1e-300
    for i in range(bending.size):
        n, b, nn, bb = sums[0, i], sums[1, i], sums[2, i], sums[3, i]
        values = slope_coefficients(n, b, nn, bb, torsion[i], bending[i])
        for k in range(7):
            constant[k, i] = values[k]
        largest = max(largest, abs(n), abs(b))
    jump = np.zeros((2, 2, tables.jump_bending.size))
    for k in range(2):
        for j in range(2):
            add_products(tensions, tables.jump_weights[k, j], jump[k, j])
    # Nothing lies beyond the first anchorage: there (11) is the closed form, and p is zero.
    tau, xi, k_b = curvatures(
        0.0, 0.0, 0.0, sums[0, 1], sums[1, 1], sums[2, 1], sums[3, 1], torsion[1], bending[1]
    )
    residual, sweeps, run, done = 0.0, 0, 0, 0
    points = tables.integrate.shape[1]
    here = np.empty((3, points))
    for number in range(len(tables.elements)):
        section, is_anchorage, first = tables.elements[number]
        if is_anchorage:
            at = section - 1
            xi += added_curvature(jump[0, 0, at], jump[0, 1, at], tables.jump_bending[at])
            k_b += added_curvature(jump[1, 0, at], jump[1, 1, at], tables.jump_bending[at])
        start = imbalance_of(
            tau, xi, k_b, sums[0, first], sums[1, first], sums[2, first], sums[3, first],
            torsion[first], bending[first],
        )  # fmt: skip
        for k in range(3):
            here[k] = start[k]
        last = first + points - 1
        own = np.ascontiguousarray(constant[:, first : last + 1])
        change, count = converge(here, own, tables.integrate[number], largest)
        if count == 0:
            return change, -1
        residual, sweeps = max(residual, change), max(sweeps, count)
        while run < len(tables.runs) and tables.runs[run, 0] == number:
            node, nodes = tables.runs[run, 1], tables.runs[run, 2]
            matrix = tables.to_nodes[done : done + points * nodes].reshape(points, nodes)
            for k in range(3):
                add_products(here[k], matrix, p[k, node : node + nodes])
            run, done = run + 1, done + points * nodes
        tau, xi, k_b = curvatures(
            here[0, -1], here[1, -1], here[2, -1], sums[0, last], sums[1, last], sums[2, last],
            sums[3, last], torsion[last], bending[last],
        )  # fmt: skip
    return residual, sweeps


def find_twist(tables: PapersTables, tensions: FloatArray, twist: FloatArray) -> tuple[float, int]:
    """Fill in the ``twist`` (4, nodes); returns as `find_imbalance`, -1 also for stretch <= 0."""
    twist[:] = 0.0
    residual, sweeps = 0.0, 0
    if len(tables.integration.elements):
        residual, sweeps = find_imbalance(tables.integration, tensions, twist[:3])
    sums = sums_of(tables.weights, tensions)
    axial, torsion, bending = tables.stiffness
    pull, n, b, nn, bb = sums
    for i in range(axial.size):
        tau, xi, k_b = curvatures(
            twist[0, i], twist[1, i], twist[2, i], n[i], b[i], nn[i], bb[i], torsion[i], bending[i]
        )
        stretched = stretch(xi, k_b, pull[i], n[i], b[i], axial[i])
        twist[0, i], twist[1, i], twist[2, i] = stretched * tau, stretched * xi, stretched * k_b
        twist[3, i] = stretched
    for i in range(axial.size):
        if not twist[3, i] > 0.0:  # also for NaN
            sweeps = -1
    return residual, sweeps


def find_shapes(
    tables: PapersTables, grid: GridTables, tensions: FloatArray, twist: FloatArray,
    strains: FloatArray, position: FloatArray, quaternion: FloatArray, residual: FloatArray,
    iterations: IntArray,
) -> int:  # fmt: skip
    """Fill in the shapes of arms under ``tensions`` (batch, tendons), as `Results` has them.

    Returns:
        Number of arms without solution: their ``iterations`` are -1, and their other results are
        not to be used.
    """
    failures = 0
    for arm in range(len(tensions)):
        residual[arm], iterations[arm] = find_twist(tables, tensions[arm], twist)
        if iterations[arm] < 0:
            failures += 1
            continue
        read_out(grid, twist, strains[:, arm], position[arm], quaternion[arm])
    return failures
