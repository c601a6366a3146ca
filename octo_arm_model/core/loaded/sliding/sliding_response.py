"""Small changes of an arm whose tendons have friction.

Their tensions change with the angles by which they turn, which change with the shape, which
changes with their tensions: what follows is found by iteration, without a matrix.
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
from octo_arm_model.core.section.strain_measures import to_scaled, unscale_gradient

_EXACT = 1e-12  # what is left of a small change, in parts of it
_ROUGH = 1e-2  # likewise where Newton's method needs no more to converge as fast
_MOST = 100  # steps


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
    """Response of ``system`` to small ``imbalance`` (n, columns, points) near ``state``.

    ``system`` is that of tensions that stay. With friction they change with the shape, and by
    ``direct`` (tendons, columns, points) besides [N]; ``tolerance`` is in parts of each change.

    Returns:
        The response, and with friction the change of the tensions at the points, as ``direct``.

    Raises:
        ConvergenceError: if the change of tensions is not found.
    """
    sliding = state.sliding
    if sliding is None:
        return system.solve(imbalance), None
    friction, energy, twist = problem.friction, problem.energy, state.shape.twist
    assert friction is not None
    strain = to_scaled(energy.law, twist[:, np.newaxis])
    along = energy.lengthening(strain, sliding.tensions)[1]
    along = unscale_gradient(energy, twist[:, np.newaxis], along)[:, :, 0]
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

    ``direct`` is how they change while the shape does not, and ``respond`` gives the change
    (n, columns, points) of the twist with that of the tensions; ``tolerance`` is in parts of each
    change.

    Raises:
        ConvergenceError: if they are not found.
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
