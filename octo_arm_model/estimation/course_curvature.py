"""How what is measured bends along a course of states, which leads to its mean."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import Belief, solve_lower
from octo_arm_model.estimation.beliefs.curvature import Curvature, renewed, stddev_of
from octo_arm_model.estimation.beliefs.posterior_mean import gradient
from octo_arm_model.estimation.filter import Step
from octo_arm_model.estimation.gating.taken import kinds_of
from octo_arm_model.estimation.measurements import Measurement, jacobians, noise_root
from octo_arm_model.estimation.state.prediction import Prediction

_FAR = 0.5  # standard deviations from where second derivatives are known, to find them anew


class Bent(NamedTuple):
    """Second derivatives (m, n, n) of what is measured, other than linearly, in a state ``x``."""

    x: FloatArray
    second: FloatArray


def _others(step: Step) -> list[Measurement]:
    """What was accepted and is not linear."""
    return [one for one in step.updated.accepted if not one.is_linear]


def weight_of(step: Step) -> float:
    """Weight of what leads from the most probable state to the mean, see `Agreement.weight`."""
    known = step.updated.curvatures.get(kinds_of(_others(step)))
    return known.weight if known is not None else 1.0


def bent_at(step: Step, at: Prediction, belief: Belief, before: Bent | None) -> Bent | None:
    """That of one time, whose ``belief`` is about ``at``; the one ``before`` if it is near."""
    others, stddev = _others(step), stddev_of(belief)
    if not others:
        return None
    if before is not None and np.linalg.norm((at.x - before.x) / stddev) <= _FAR:
        return before
    flat = Curvature.flat(jacobians(others, at))
    return Bent(at.x, renewed(flat, others, at, stddev).second)


def gradient_at(step: Step, at: Prediction, belief: Belief, bent: Bent | None) -> FloatArray:
    """Gradient of ln(det A) / 2 by the state at one time, (n,), with its weight.

    A is the information on the whole course, and ``belief`` what it says of that time.
    """
    if bent is None:
        return np.zeros(at.x.size)
    others = _others(step)
    root = noise_root(others)
    white = solve_lower(root, jacobians(others, at))
    own = solve_lower(root, white @ belief.root @ belief.root.T, is_transposed=True)
    return weight_of(step) * gradient(own.T, bent.second)
