"""Stability of equilibria of loaded rods: a local minimum of the energy, where loads have one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.equilibrium import Equilibrium
from octo_arm_model.core.loaded.linearised import Linearised, Response, System, TipAnswer
from octo_arm_model.core.loaded.state import Stability, State
from octo_arm_model.core.numerics.batched_ldlt import are_definite, definite_factors, have_factors

_ONE = np.eye(3)
# Part of an element's stiffness that has to remain after the destabilising stiffness of the arm
# beyond it is subtracted. An equilibrium with this margin stays stable under small changes of
# shape and loads.
FIRM = 0.2
# As much is known of stability where the arm has turned by no more than this since it was judged
# [rad], and while tensions and loads have changed by no more, in a sum of residuals; the latter
# likewise for `Equilibrium.load_change`.
SAME, SAME_LOADS = 0.1, 0.02
# A compliance this many times the others is that of a rigid-body motion.
_FREE = 1e6


def stability_of(
    problem: Equilibrium, state: State, answer: System | TipAnswer | Stability | None = None
) -> Stability:
    """Whether the equilibrium ``state`` of a ``problem`` is stable.

    It is stable where `least_energy` finds the second variation of the energy positive. Elsewhere
    the compliance at the tip decides: that of a stable arm is positive definite, and the
    determinant of its equations has the sign that it has without loads. One unstable mode reverses
    that sign; two at once leave it and show in the compliance alone. ``answer`` saves work where
    it is known: the system linearised about this state, or nearly, its response to wrenches on the
    tip, or the stability itself.

    Raises:
        LoadError: if a load states no tangent stiffness.
    """
    problem.require_tangents('the stability check')
    if isinstance(answer, Stability):
        return answer
    # Without an energy nothing follows from compliance.
    is_known = problem.loads.has_energy(state.condition.tip_wrench)
    if not isinstance(answer, TipAnswer):
        system = answer or problem.linearised(state)
        if is_known and isinstance(system, Linearised):
            if least_energy(system, problem.collocation.rule.weights).are_least.all():
                return Stability(True, 1, None)
        answer = tip_answer(problem, state, system)
    if answer.sign > 0 and (answer.is_definite or not is_known):
        return Stability(True if is_known else None, answer.sign, None)
    compliance = answer.compliance
    values, vectors = np.linalg.eigh(0.5 * (compliance + compliance.T))
    # A direction of unbounded compliance is neutrally stable, such as the rotation of an arm
    # that may turn about the vertical. Rounding gives that any sign.
    size = np.sort(np.abs(values))
    is_free = np.abs(values) > _FREE * 0.5 * (size[2] + size[3])
    is_stable: bool | None = bool(values[~is_free].min(initial=1.0) > 0.0)
    if not is_free.any() and answer.sign < 0:
        is_stable = False
    if not is_known:
        is_stable = None
    if is_stable is not False:
        return Stability(is_stable, answer.sign, None)
    worst = int(np.argmin(values)) if values.min() <= 0.0 else int(np.argmax(values))
    twist = np.einsum('icn,c->in', answer.twist, vectors[:, worst])[:, np.newaxis]
    softest_mode = Response(twist, np.zeros((3, *twist.shape[1:])))
    softest_mode = Response(twist / problem.turn(softest_mode), softest_mode.turn)
    return Stability(is_stable, answer.sign, softest_mode)


def tip_answer(problem: Equilibrium, state: State, system: System) -> TipAnswer:
    """Response of ``state`` to unit wrenches on its tip, from its linearised ``system``."""
    count = len(state.imbalance)
    wrench = problem.tip_wrenches(state)[:count]
    wrench[:, 3:] *= problem.collocation.length
    twist = system.solve(wrench).twist
    compliance = np.tensordot(wrench * problem.collocation.weights, twist, axes=([0, 2], [0, 2]))
    is_definite = bool(np.linalg.eigvalsh(0.5 * (compliance + compliance.T))[0] > 0.0)
    return TipAnswer(compliance, twist, system.sign * problem.unloaded_sign, is_definite)


class LeastEnergy(NamedTuple):
    """Which of several arms are at a minimum of their energy, (arms,) each.

    Attributes:
        are_least: whether they are.
        are_firm: whether they are by the margin `FIRM`.
    """

    are_least: NDArray[np.bool_]
    are_firm: NDArray[np.bool_]


def least_energy(system: Linearised, weights: FloatArray) -> LeastEnergy:
    """Whether the second variation of the energy of each arm is positive, a sufficient test.

    ``system`` is linearised about equilibria under loads that have an energy; ``weights`` are
    those of the integral over an element of length one, (each,).

    The variation is a quadratic form of the bends k at all points. It is positive if two forms are
    (inertia is additive, Haynsworth 1968): that of each element with its end free, and what
    remains, a form of the rotations of the ends of all elements, after the bends are eliminated
    with these rotations held. Eliminated from the tip, its pivots are the stiffness of each
    element at its end, with its start clamped, and that of the arm beyond: as in
    `stability_kernels.is_minimum` they tell of the margin.

    False also where an element with its end free is unstable while the arm may be stable.
    """
    # From the tip to the base.
    ends, axial = system.ends[:, ::-1], system.axial
    arms, elements = ends.shape[:2]
    is_stretched = (axial.diagonal() > 0.0).all(axis=(1, 2))
    # The rows of an element are those of the form over the weights of their points.
    by_row = system.matrix.reshape(arms, elements, 3, weights.size, -1)
    are_free = are_definite((by_row * weights[:, np.newaxis]).reshape(system.matrix.shape))
    try:
        stiffness = np.linalg.inv(ends[..., :3, 3:])
    except np.linalg.LinAlgError:
        return LeastEnergy(np.zeros(arms, bool), np.zeros(arms, bool))
    # Moments at both ends of an element by the rotations of both.
    by_first, by_last = _ONE + ends[..., :3, :3], _ONE + ends[..., 3:, 3:]
    before = by_last @ stiffness
    at_first = before @ by_first - ends[..., 3:, :3]
    # Of its symmetric part, which is asked for alone, the blocks on the diagonal and above.
    form, own = np.zeros((arms, elements, 3, elements, 3)), stiffness.copy()
    own[:, 1:] += at_first[:, :-1]
    _diagonal(form)[:] = own
    beside = before.swapaxes(-1, -2) + stiffness @ by_first
    _diagonal(form[:, :-1, :, 1:])[:] = -beside[:, :-1]
    factors = definite_factors(form.reshape(arms, 3 * elements, -1))
    are_least = is_stretched & are_free & have_factors(factors)
    # The factors are those of twice the symmetric part.
    pivots = _diagonal(factors.reshape(form.shape))
    left = 0.5 * (pivots @ pivots.swapaxes(-1, -2)) - FIRM * stiffness
    return LeastEnergy(are_least, are_least & are_definite(left))


def _diagonal(blocks: FloatArray) -> FloatArray:
    """View (arms, n, 3, 3) of the diagonal blocks of ``blocks`` (arms, n, 3, n, 3)."""
    view: FloatArray = np.einsum('aipiq->aipq', blocks)
    return view
