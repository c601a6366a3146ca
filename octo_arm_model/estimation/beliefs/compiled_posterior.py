"""A posterior by compiled kernels, which make all of one state in one call."""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import Belief, Gain
from octo_arm_model.estimation.beliefs.local import Bend, Conclusion, Local, Step
from octo_arm_model.estimation.beliefs.posterior import (
    BENT,
    HALVED,
    LAST,
    MOST_BENT,
    MOST_OF_MODEL,
    Posterior,
)
from octo_arm_model.estimation.beliefs.posterior_mean import agreement_by
from octo_arm_model.estimation.state.prediction import ArmModel


def own(array: FloatArray) -> FloatArray:
    """A copy that is writable and C-contiguous: for others numba would compile once more."""
    return np.array(array, order='C')


def posterior_of(prior: Belief, noise: FloatArray, model: ArmModel, weight: float) -> Posterior:
    """The `Posterior` of these, in machine code where that solves the ``model``."""
    kind = CompiledPosterior if model.solver.is_compiled else Posterior
    return kind(prior, noise, model, weight)


class CompiledPosterior(Posterior):
    """A `Posterior`; where a tension would be below zero it is looked for by NumPy."""

    def __init__(self, prior: Belief, noise: FloatArray, model: ArmModel, weight: float) -> None:
        """See `Posterior`."""
        super().__init__(prior, noise, model, weight)
        from octo_arm_model.estimation.beliefs import kernels

        self._kernels = kernels
        self._known = own(prior.mean), own(prior.root)
        self._scattered = own(prior.scattered)
        self._noises = own(noise), own(self._per_noise)
        self._tension = model.state.tension

    def _local(
        self, x: FloatArray, left: FloatArray, jacobian: FloatArray, second: FloatArray
    ) -> Local:
        m, n = jacobian.shape
        by = Gain(np.empty((n, m)), np.empty((m, m)), np.empty((n, n)))
        local = Local(
            x, by, np.empty(n), np.empty(m), np.empty((m, n)), np.empty((m, n, n)), np.empty(n)
        )
        wanted = np.empty(n)
        size, cost, off, turned = self._kernels.find_posterior(
            *self._known, self._scattered, *self._noises, self._weight, own(x), own(left),
            own(jacobian), own(second), BENT, MOST_BENT, *by, *local[2:7], wanted,
        )  # fmt: skip
        if wanted[self._tension].min() < 0.0:
            return local
        return local._replace(own=(Step(x, wanted, size, 0.0, cost), Bend(off, turned)))

    def step(self, local: Local, x: FloatArray) -> Step:
        """See `Posterior`."""
        if local.own is not None and x is local.x:
            return local.own[0]
        wanted = np.empty(x.size)
        size, cost = self._kernels.second_order_step(
            *self._known, own(x), *local[2:7], BENT, MOST_BENT, wanted
        )
        if wanted[self._tension].min() < 0.0:
            return super().step(local, x)
        return Step(x, wanted, size, 0.0, cost)

    def mean(self, local: Local, step: Step) -> FloatArray:
        """See `Posterior`."""
        tension, wanted = self._tension, own(step.x)
        if self._kernels.second_order_mean(
            *self._known, *local[2:7], BENT, MOST_BENT, tension.start, tension.stop,
            MOST_OF_MODEL, LAST, HALVED, own(step.start), step.size, step.cost, wanted,
        ):  # fmt: skip
            return wanted
        return super().mean(local, step)

    def bend(self, local: Local, x: FloatArray) -> Bend:
        """See `Posterior`."""
        if local.own is not None and x is local.own[0].x:
            return local.own[1]
        return super().bend(local, x)

    def conclude(
        self, local: Local, left: FloatArray, jacobian: FloatArray, second: FloatArray
    ) -> Conclusion:
        """See `Posterior`."""
        innovation, scatter = np.empty(left.size), np.empty_like(self._scattered)
        square, drawn, expected, stddev, share = self._kernels.conclude(
            self._known[0], self._scattered, own(local.x), own(left), own(jacobian), own(second),
            *local.by, innovation, scatter,
        )  # fmt: skip
        return Conclusion(
            innovation, square, scatter, agreement_by(drawn, expected, stddev), share
        )
