"""Small changes of an arm whose tendons have friction.

Tensions change with the angles by which tendons turn, these with the shape, and the shape with the
tensions. The linear equations for the changes are solved by iteration, without a matrix.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.equilibrium import Equilibrium
from octo_arm_model.core.loaded.linearised import Response, System
from octo_arm_model.core.loaded.sliding.friction_changes import FrictionChanges
from octo_arm_model.core.loaded.state import State
from octo_arm_model.core.numerics.fixed_point import fixed_point
from octo_arm_model.core.section.strain_measures import lengthening_by_twist

_EXACT = 1e-12  # tolerance of a small change, relative to it
_ROUGH = 0.1  # tolerance that suffices within Newton's method, which hardly slows down with it
_MOST = 100  # iterations


def newton_step(problem: Equilibrium, system: System, state: State) -> Response:
    """Response of ``system`` to the imbalance of ``state``, exact enough for Newton's method.

    Raises:
        ConvergenceError: if the change of tensions is not found.
    """
    columns = state.imbalance[:, np.newaxis]
    return respond(problem, system, state, columns, tolerance=_ROUGH)[0]


def respond(
    problem: Equilibrium,
    system: System,
    state: State,
    imbalance: FloatArray,
    direct: FloatArray | None = None,
    tolerance: float = _EXACT,
) -> tuple[Response, FloatArray | None]:
    """Response to a small ``imbalance`` (n, columns, points) of an arm near ``state``.

    ``system`` is linearised at constant tensions. With friction the tensions change with the
    shape, and by ``direct`` (tendons, columns, points) [N] at constant shape; ``tolerance`` is
    relative to each column of that change.

    Returns:
        The response, and the change of the tensions at the points (tendons, columns, points) [N];
        None without friction.

    Raises:
        ConvergenceError: if the change of tensions is not found.
    """
    sliding = state.sliding
    if sliding is None:
        return system.solve(imbalance), None
    friction, twist = problem.friction, state.shape.twist
    assert friction is not None
    along = lengthening_by_twist(problem.energy, twist[:, np.newaxis], sliding.tensions)[:, :, 0]
    changes = FrictionChanges(friction, sliding, twist)

    def pulled(change: FloatArray) -> FloatArray:
        return -np.einsum('ijn,jcn->icn', along, change)

    moved = changes.by_twist(system.solve(imbalance).twist)
    change = tension_changes(
        changes,
        lambda change: system.solve(pulled(change)).twist,
        moved if direct is None else moved + direct,
        tolerance,
    )
    return system.solve(imbalance + pulled(change)), change


def tension_changes(
    changes: FrictionChanges,
    respond: Callable[[FloatArray], FloatArray],
    direct: FloatArray,
    tolerance: float = _EXACT,
) -> FloatArray:
    """Small changes of the tensions at the points [N], (tendons, columns, points).

    ``direct`` (tendons, columns, points) is their change at constant shape, and ``respond`` gives
    the change of the twist (n, columns, points) by a change of the tensions; ``tolerance`` is
    relative to each column.

    Raises:
        ConvergenceError: if the iteration does not converge.
    """
    count, columns, points = direct.shape
    scale = np.abs(direct).max(axis=(0, 2), keepdims=True)
    scale = np.where(scale > 0.0, scale, 1.0)

    def step(rows: FloatArray) -> FloatArray:
        change = rows.reshape(columns, count, points).swapaxes(0, 1)
        moved = changes.by_twist(respond(change)) + changes.by_tension(change)
        return (direct / scale + moved).swapaxes(0, 1).reshape(columns, -1)

    start = (direct / scale).swapaxes(0, 1).reshape(columns, -1)
    found, _ = fixed_point(step, start, tolerance, _MOST, "the change of the tendons' tensions")
    return found.reshape(columns, count, points).swapaxes(0, 1) * scale
