"""What is known of an arm at one time."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.gating.updated import Innovation, Updated
from octo_arm_model.estimation.observability import Unlearnt, unlearnt
from octo_arm_model.estimation.state.prediction import Prediction
from octo_arm_model.estimation.state.unknowns import State
from octo_arm_model.rod.backbone import Backbone


@dataclass(frozen=True)
class Estimate:
    """Normal distribution of the state and of the shape at one time.

    Attributes:
        time: [s].
        state: what the vector of the state holds.
        mean: of the state, (n,).
        root: root of its covariance, (n, n).
        innovations: of the measurements of this time.
        normalised_square: of all measurements of this time that were accepted, and of how many
            numbers; see `Innovation`.
        log_likelihood: of all of them, a refused one as if it were at the gate.
        elapsed: since the first time of all [s].
    """

    time: float
    state: State
    mean: FloatArray
    root: FloatArray
    innovations: tuple[Innovation, ...]
    normalised_square: tuple[float, int]
    log_likelihood: float
    elapsed: float
    _at: Prediction = field(repr=False)

    @functools.cached_property
    def prior_stddev(self) -> FloatArray:
        """Of the state had nothing been measured, (n,)."""
        return self.state.prior_stddev(self.elapsed)

    @functools.cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the state, (n, n)."""
        return self.root @ self.root.T

    @functools.cached_property
    def backbone(self) -> Backbone:
        """Shape in the mean, with the tensions and the wrench on the tip estimated.

        To first order from a state nearby: a tenth of a standard deviation off at most.
        """
        at = self._at
        if at.x is self.mean:
            return at.model.real(self.mean, at.solved)
        return at.change.moved(at.solved, self.mean - at.x, at.model.acting(self.mean))

    @functools.cached_property
    def pose_covariance(self) -> FloatArray:
        """Of position [m] and rotation vector [rad] of every station, (stations, 6, 6)."""
        pose = self._at.change.pose
        # As one product: of many small ones calls take most of the time.
        root = (pose.reshape(-1, pose.shape[-1]) @ self.root).reshape(pose.shape)
        return root @ root.transpose(0, 2, 1)

    @property
    def refused(self) -> tuple[str, ...]:
        """Names of the measurements of this time that were not used: they contradict the rest."""
        return tuple(one.name for one in self.innovations if not one.is_accepted)

    @property
    def tensions(self) -> FloatArray:
        """True tensions [N], (tendons,)."""
        return self.mean[self.state.tension]

    @property
    def tension_bias(self) -> FloatArray:
        """What the load cells show too much [N], (tendons,); empty where not estimated."""
        return self.mean[self.state.tension_bias]

    @property
    def tip_wrench(self) -> FloatArray:
        """Force and moment on the tip, known ones included, in base_frame, (6,) [N, N m]."""
        return self.backbone.tip_wrench

    @property
    def tip_wrench_covariance(self) -> FloatArray:
        """Covariance of `tip_wrench`, zero of what is not estimated, (6, 6)."""
        covariance = np.zeros((6, 6))
        parts = (slice(0, 3), self.state.tip_force), (slice(3, 6), self.state.tip_moment)
        for row, of_row in parts:
            for column, of_column in parts:
                found = self.covariance[of_row, of_column]
                if found.size:
                    covariance[row, column] = found
        return covariance

    @property
    def point_forces(self) -> FloatArray:
        """Forces at the cross sections of `Unknowns.point_forces`, (forces, 3) [N]."""
        return self.mean[self.state.point_forces].reshape(-1, 3)

    @functools.cached_property
    def unlearnt(self) -> tuple[Unlearnt, ...]:
        """Directions of the state that the measurements so far have told nothing of."""
        return unlearnt(self.root, self.prior_stddev, self.state.names)


def estimate_of(time: float, elapsed: float, updated: Updated) -> Estimate:
    """The `Estimate` that ``updated`` is."""
    at, belief = updated.at, updated.belief
    return Estimate(
        time,
        at.model.state,
        belief.mean,
        belief.root,
        updated.innovations,
        updated.normalised_square,
        updated.log_likelihood,
        elapsed,
        at,
    )
