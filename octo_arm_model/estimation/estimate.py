"""What is known of an arm at one time, and the external wrench in it."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.bank import Bank
from octo_arm_model.estimation.common_fault import CommonFault
from octo_arm_model.estimation.gaussian import Gaussian
from octo_arm_model.estimation.measurement import Measurement, Rows
from octo_arm_model.estimation.model import Prediction
from octo_arm_model.estimation.rules import Doubts, Innovation
from octo_arm_model.estimation.unknowns import State, facing_area
from octo_arm_model.rod.backbone import Backbone


@dataclass(frozen=True)
class Estimate:
    """Normal distribution of the state and of the shape at one time, and how it came about.

    Attributes:
        time: [s].
        first: time of the first one of all [s].
        measurements: made then.
        bank: all hypotheses after.
        known: the mean of the leader, and a covariance that holds what others think possible.
        at: a prediction nearly of this mean.
        innovations: of every measurement, linear ones first, then of every load cell refused; none
            of what the leader does not use though it may be right.
        accepted: what was used, linear measurements first.
        normalised_square: of all that was used together, and of how many numbers.
        log_likelihood: of all measurements; of one not used as if it were at the gate.
        doubted: names of the sensors that lie more probably than not, see `Rules`.
        suspects: where there are none, names of the fewest of which one more probably lies.
        contradicted_since: since when even the leader is contradicted [s]; None if it is not.
        patience: how many times as long as usual it takes to begin anew.
        common_fault: what may be so where sensors lie together.
        begins_anew: whether it is of the prior and its own measurements alone.
    """

    time: float
    first: float
    measurements: tuple[Measurement, ...]
    bank: Bank
    known: Gaussian
    at: Prediction
    innovations: tuple[Innovation, ...]
    accepted: tuple[Rows, ...]
    normalised_square: tuple[float, int]
    log_likelihood: float
    doubted: Doubts
    suspects: tuple[str, ...]
    contradicted_since: float | None
    patience: int
    common_fault: CommonFault
    begins_anew: bool

    def is_lost(self, time: float, recover_after: float) -> bool:
        """Whether it has been contradicted for so long at ``time`` [s] as to begin anew."""
        since = self.contradicted_since
        if since is None or not recover_after:
            return False
        return time - since >= self.patience * recover_after

    def innovations_after(self, before: Estimate | None) -> tuple[Innovation, ...]:
        """Those that are new after the one ``before``, which is of the same time.

        What was accepted then and is refused now is new too.
        """
        known = {one.name: one.is_accepted for one in before.innovations} if before else {}
        return tuple(
            one
            for one in self.innovations
            if (was := known.get(one.name)) is None or (was and not one.is_accepted)
        )

    @property
    def state(self) -> State:
        """What the vector of the state holds."""
        return self.at.model.state

    @property
    def mean(self) -> FloatArray:
        """Of the state, (n,)."""
        return self.known.mean

    @property
    def root(self) -> FloatArray:
        """Root of the covariance of the state, (n, n)."""
        return self.known.root

    @property
    def elapsed(self) -> float:
        """Since the first one of all [s]."""
        return self.time - self.first

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
        return self.at.backbone_at(self.mean)

    @functools.cached_property
    def pose_covariance(self) -> FloatArray:
        """Of position [m] and rotation vector [rad] of every station, (stations, 6, 6)."""
        pose = self.at.change.pose
        # As one product: of many small ones calls take most of the time.
        root = (pose.reshape(-1, pose.shape[-1]) @ self.root).reshape(pose.shape)
        return root @ root.transpose(0, 2, 1)

    @property
    def refused(self) -> tuple[str, ...]:
        """Names of the measurements of this time that are refused: they contradict the rest."""
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
        by_state = np.zeros((6, self.state.size))
        for first, where in ((0, self.state.tip_force), (3, self.state.tip_moment)):
            np.fill_diagonal(by_state[first : first + 3, where], 1.0)
        return np.asarray(by_state @ self.covariance @ by_state.T)

    @property
    def point_forces(self) -> FloatArray:
        """Forces at the cross sections of `Unknowns.point_forces`, (forces, 3) [N]."""
        return self.mean[self.state.point_forces].reshape(-1, 3)

    @functools.cached_property
    def unobserved(self) -> tuple[UnobservedDirection, ...]:
        """Directions of the state that the measurements so far have told nothing of."""
        prior, names = self.prior_stddev, self.state.names
        _, left, axes = np.linalg.svd((self.root / prior[:, np.newaxis]).T, full_matrices=False)
        return tuple(
            UnobservedDirection(float(part), axis * prior, _in_words(axis, names))
            for part, axis in zip(left, axes, strict=True)
            if part >= _LEFT
        )


# Nothing was learnt where this part of the standard deviation of the prior is left.
_LEFT = 0.99
_PART = 0.1  # of its largest, that a component of a direction has to be mentioned


class UnobservedDirection(NamedTuple):
    """A direction of the state in which nothing was learnt: there it keeps its prior.

    Attributes:
        left: part of the standard deviation of the prior that is left in it [-].
        direction: change of the state in it, of one standard deviation of the prior, (n,).
        reason: the direction in words.
    """

    left: float
    direction: FloatArray
    reason: str


def _in_words(axis: FloatArray, names: Sequence[str]) -> str:
    """A direction in standard deviations of the prior."""
    parts = axis / axis[np.abs(axis).argmax()]
    words = [f'{part:+.2g} {name}' for name, part in zip(names, parts) if abs(part) >= _PART]
    if len(words) == 1:
        return f'{words[0].split(" ", 1)[1]} keeps its prior'
    return f'changed together, {", ".join(words)} keep their prior'


class Contact(NamedTuple):
    """An estimated wrench in base_frame.

    Attributes:
        s: where it acts [m]; NaN of a current, whose force acts along the whole arm.
        wrench: force and moment, (6,) [N, N m].
        covariance: theirs, zero of what is not estimated, (6, 6).
        is_at_tip: whether it is that of `Unknowns.tip_force` or `tip_moment`.
    """

    s: float
    wrench: FloatArray
    covariance: FloatArray
    is_at_tip: bool = False


NO_CONTACT = Contact(math.nan, np.zeros(6), np.zeros((6, 6)))


def contact_of(estimate: Estimate, arm: Arm) -> Contact | None:
    """The wrench on the tip of ``arm``, else the first point force, else the current's resultant.

    None where the state holds none of them. Known loads on the tip are part of a wrench on it.
    """
    state, unknowns = estimate.state, estimate.state.unknowns
    if unknowns.tip_force or unknowns.tip_moment:
        wrench, covariance = estimate.tip_wrench, estimate.tip_wrench_covariance
        return Contact(arm.length, wrench, covariance, is_at_tip=True)
    s, scale = math.nan, 1.0
    if unknowns.point_forces:
        s, where = unknowns.point_forces[0].s, state.point_forces
    elif unknowns.current:
        where, scale = state.current, facing_area(arm)
    else:
        return None
    first = slice(where.start, where.start + 3)
    wrench, covariance = np.zeros(6), np.zeros((6, 6))
    wrench[:3] = scale * estimate.mean[first]
    covariance[:3, :3] = scale**2 * estimate.covariance[first, first]
    return Contact(s, wrench, covariance)
