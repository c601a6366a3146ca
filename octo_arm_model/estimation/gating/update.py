"""What measurements of one time make of a belief: the step of the filter."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence

import numpy as np

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.estimation.beliefs.belief import Belief, lower_root
from octo_arm_model.estimation.beliefs.curvature import Curvature
from octo_arm_model.estimation.gating.judgement import Judged, judge
from octo_arm_model.estimation.gating.lying_cell import nearby, without_one
from octo_arm_model.estimation.gating.taken import Kinds, Nearby, Taken, kinds_of, volume_of
from octo_arm_model.estimation.gating.updated import Innovation, Updated
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.estimation.state.prediction import ArmModel
from octo_arm_model.rod.sensitivity import chi_square_limit

ITERATIONS = 10_000  # of Newton's method for shapes, of one update
_MOST_KINDS = 8  # of measurements together whose curvature is kept


def update(
    model: ArmModel,
    belief: Belief,
    measurements: Sequence[Measurement],
    last: Updated | None,
    gate: float,
) -> Updated:
    """``belief`` after ``measurements``, from the ``last`` one on.

    ``gate`` is the probability of a right measurement to be accepted.

    Raises:
        SolveError: if the arm has no trustworthy shape, or the iteration does not converge, or
            takes too much, or numbers do not resolve what is known.
        MeasurementError: if a measurement does not fit the arm.
    """
    near = Nearby(None, {}, gate) if last is None else Nearby(last.at, last.curvatures, gate)
    try:
        # What overflows or divides by zero is not finite in the end.
        with np.errstate(all='ignore'), model.within(ITERATIONS) as effort:
            judged = nearby(model, belief, measurements, last, near)
            if judged is None:
                judged = judge(model, belief, measurements, last, near)
                effort.check()  # what is refused may be so for want of iterations
                if judged.refused:
                    with contextlib.suppress(SolveError):
                        judged = without_one(model, belief, judged, last, near) or judged
        with np.errstate(all='ignore'):
            found = _updated(belief, judged, last, gate)
    except np.linalg.LinAlgError as error:
        raise _unresolved(measurements) from error
    state = found.belief
    is_finite = np.isfinite(state.mean).all() and np.isfinite(state.root).all()
    if not (is_finite and math.isfinite(found.log_likelihood)):
        raise _unresolved(measurements)
    return found


def _unresolved(measurements: Sequence[Measurement]) -> SolveError:
    """Why ``measurements`` and what was known before them make no finite belief."""
    noise = ', '.join(
        f'{one.name} to {math.sqrt(one.covariance.diagonal().min()):.3g}' for one in measurements
    )
    return SolveError(
        f'the estimate is not finite: standard deviations of what is measured ({noise}) and of '
        'what was known before differ by more than numbers resolve'
    )


def _updated(belief: Belief, judged: Judged, last: Updated | None, gate: float) -> Updated:
    """``belief`` after measurements as they are ``judged``; perhaps of numbers not finite.

    Raises:
        LinAlgError: if a matrix is singular or not finite.
        SolveError: as `update`.
    """
    linear, found, squares = judged.linear, judged.found, judged.squares
    accepted = {id(one) for one in judged.accepted}
    innovations, size = [], 0
    log_likelihood = -0.5 * (linear.square + linear.volume + found.square + found.volume)
    for one in judged.measurements:
        before, is_accepted = belief if one.is_linear else linear.belief, id(one) in accepted
        jacobian = one.jacobian(found.at)
        value = one.innovation(found.at) + jacobian @ (found.at.x - before.mean)
        told = jacobian @ before.root
        covariance = told @ told.T + one.covariance
        innovations.append(Innovation(one.name, value, covariance, squares[id(one)], is_accepted))
        if is_accepted:
            size += value.size
        else:
            # Not by Cholesky, which fails where directions are known very differently well.
            root = lower_root([told, one.noise_root])
            log_likelihood -= 0.5 * (chi_square_limit(gate, value.size) + volume_of(root))
    return Updated(
        found.belief,
        found.at,
        found.at.solved,
        tuple(innovations),
        tuple(one for one in judged.measurements if id(one) in accepted),
        (judged.square, size),
        log_likelihood,
        _kept(last, found),
        _refused(innovations, judged, last),
    )


def _refused(
    innovations: Sequence[Innovation], judged: Judged, last: Updated | None
) -> frozenset[str]:
    """Names of measurements of which the newest was refused."""
    refused = frozenset(one.name for one in innovations if not one.is_accepted)
    if last is None or not last.refused:
        return refused
    # A load cell is not refused any more where all of its kind are used.
    heard = {one.name for one in innovations}
    for one in judged.linear.accepted:
        heard |= {single.name for _, single in one.each_apart(judged.found.at)}
    return refused | (last.refused - heard)


def _kept(last: Updated | None, found: Taken) -> dict[Kinds, Curvature]:
    """Curvatures of what was measured together last."""
    kept = dict(last.curvatures) if last is not None else {}
    if found.curvature is not None:
        kinds = kinds_of(found.accepted)
        kept.pop(kinds, None)
        kept[kinds] = found.curvature
        if len(kept) > _MOST_KINDS:
            del kept[next(iter(kept))]
    return kept
