"""The estimate of an arm at one time, and the external wrench in it."""

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
    """The normal distribution of the state and of the shape at one time.

    Attributes:
        time: time of the estimate [s].
        first: time of the first estimate since it began, or began anew [s].
        measurements: measurements at this time.
        bank: all hypotheses after them.
        known: mean of the leader, with a covariance that contains the other hypotheses.
        prediction: a prediction near this mean.
        innovations: of every measurement, linear ones first, then of every refused load cell;
            none of sensors that the leader does not use but that may be right.
        accepted: measurements that were used, linear ones first.
        normalised_square: normalised square of all numbers that were used, and their number.
        log_likelihood: ln of the likelihood of all measurements; unused ones count as at the gate.
        doubted: names of the sensors that are wrong with a probability of over a half.
        suspects: if there are none, names of the smallest set of which one is probably wrong.
        contradicted_since: time since which even the leader is contradicted [s]; None if it isn't.
        patience: factor on the time until a contradicted estimate begins anew.
        common_fault: the possibility of a fault that several sensors have in common.
        begins_anew: whether it depends on the prior and its own measurements alone.
    """

    time: float
    first: float
    measurements: tuple[Measurement, ...]
    bank: Bank
    known: Gaussian
    prediction: Prediction
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
        """Return whether it is contradicted for so long at ``time`` [s] that it begins anew."""
        since = self.contradicted_since
        if since is None or not recover_after:
            return False
        return time - since >= self.patience * recover_after

    def innovations_after(self, previous: Estimate | None) -> tuple[Innovation, ...]:
        """Return the innovations that a ``previous`` estimate, if of the same time, does not have.

        A measurement that was accepted there and is refused here is new too.
        """
        before = previous.innovations if previous and previous.time == self.time else ()
        earlier, new = [(one.name, one.is_accepted) for one in before], []
        for entry in self.innovations:
            same = next((one for one in earlier if one[0] == entry.name), None)
            if same is None or (same[1] and not entry.is_accepted):
                new.append(entry)
            if same is not None:
                earlier.remove(same)
        return tuple(new)

    @property
    def state(self) -> State:
        """The layout of the state vector."""
        return self.prediction.model.state

    @property
    def mean(self) -> FloatArray:
        """Mean of the state, (n,)."""
        return self.known.mean

    @property
    def root(self) -> FloatArray:
        """Lower triangular square root of the covariance of the state, (n, n)."""
        return self.known.root

    @property
    def elapsed(self) -> float:
        """Time since `first` [s]."""
        return self.time - self.first

    @functools.cached_property
    def prior_stddev(self) -> FloatArray:
        """Standard deviation of the state without any measurement, (n,)."""
        return self.state.prior_stddev(self.elapsed)

    @functools.cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the state, (n, n)."""
        return self.root @ self.root.T

    @functools.cached_property
    def backbone(self) -> Backbone:
        """Shape in the mean state, with the estimated tensions and wrench on the tip.

        It is the shape of `prediction`, moved to the mean to first order.
        """
        return self.prediction.backbone_at(self.mean)

    @functools.cached_property
    def pose_covariance(self) -> FloatArray:
        """Covariance of position [m] and rotation [rad] of every station, (stations, 6, 6)."""
        pose = self.prediction.change.pose
        # One large product is faster than many small ones.
        root = (pose.reshape(-1, pose.shape[-1]) @ self.root).reshape(pose.shape)
        return root @ root.transpose(0, 2, 1)

    @property
    def refused(self) -> tuple[str, ...]:
        """Names of the measurements of this time that are refused, as they contradict the rest."""
        return tuple(entry.name for entry in self.innovations if not entry.is_accepted)

    @property
    def heard(self) -> frozenset[str]:
        """Names of the measurements of this time, and of their sensors."""
        names = {name for new in self.measurements for name in new.channels(self.prediction)}
        return frozenset(names | {entry.name for entry in self.innovations})

    @property
    def tensions(self) -> FloatArray:
        """True tensions [N], (tendons,)."""
        return self.mean[self.state.tension]

    @property
    def tension_bias(self) -> FloatArray:
        """Constant errors of the load cells [N], (tendons,); empty if not estimated."""
        return self.mean[self.state.tension_bias]

    @property
    def tip_wrench(self) -> FloatArray:
        """Force and moment on the tip, known ones included, in base_frame, (6,) [N, N m]."""
        return self.backbone.tip_wrench

    @property
    def tip_wrench_covariance(self) -> FloatArray:
        """Covariance of `tip_wrench`, (6, 6); zero for components that are not estimated."""
        by_state = self.state.tip_wrench
        return np.asarray(by_state @ self.covariance @ by_state.T)

    @property
    def point_forces(self) -> FloatArray:
        """Forces at the cross sections of `Unknowns.point_forces`, (forces, 3) [N]."""
        return self.mean[self.state.point_forces].reshape(-1, 3)

    @functools.cached_property
    def unobserved(self) -> tuple[UnobservedDirection, ...]:
        """Directions of the state that no measurement has determined so far."""
        prior, names = self.prior_stddev, self.state.names
        _, ratios, axes = np.linalg.svd((self.root / prior[:, np.newaxis]).T, full_matrices=False)
        return tuple(
            UnobservedDirection(float(ratio), direction * prior, _in_words(direction, names))
            for ratio, direction in zip(ratios, axes, strict=True)
            if ratio >= _UNOBSERVED
        )


_UNOBSERVED = 0.99  # ratio of posterior to prior deviation from which a direction is unobserved
_LEAST = 0.1  # least component of a direction in its words, over the largest one


class UnobservedDirection(NamedTuple):
    """A direction of the state that no measurement has determined, so that it keeps its prior.

    Attributes:
        ratio: ratio of the standard deviation in this direction to that of the prior [-].
        direction: change of the state by one standard deviation of the prior, (n,).
        reason: the direction in words.
    """

    ratio: float
    direction: FloatArray
    reason: str


def _in_words(axis: FloatArray, names: Sequence[str]) -> str:
    """Return the words for a direction ``axis`` (n,) in standard deviations of the prior."""
    parts = axis / axis[np.abs(axis).argmax()]
    words = [f'{part:+.2g} {name}' for name, part in zip(names, parts) if abs(part) >= _LEAST]
    if len(words) == 1:
        return f'{words[0].split(" ", 1)[1]} keeps its prior'
    return f'changed together, {", ".join(words)} keep their prior'


class Contact(NamedTuple):
    """An estimated external wrench in base_frame.

    Attributes:
        s: arc coordinate of the contact [m]; NaN for a current, which acts on the whole arm.
        wrench: force and moment, (6,) [N, N m].
        covariance: covariance of the wrench, (6, 6); zero for components not estimated.
        is_at_tip: whether it is that of `Unknowns.tip_force` or `tip_moment`.
    """

    s: float
    wrench: FloatArray
    covariance: FloatArray
    is_at_tip: bool = False


NO_CONTACT = Contact(math.nan, np.zeros(6), np.zeros((6, 6)))


def contact_of(estimate: Estimate, arm: Arm) -> Contact | None:
    """Return the wrench on the tip of ``arm``, the first point force, or the current's resultant.

    It is the first one that is estimated, else None. A wrench on the tip includes known loads.
    """
    state, unknowns = estimate.state, estimate.state.unknowns
    if unknowns.tip_force or unknowns.tip_moment:
        wrench, covariance = estimate.tip_wrench, estimate.tip_wrench_covariance
        return Contact(arm.length, wrench, covariance, is_at_tip=True)
    s, scale = math.nan, 1.0
    if unknowns.point_forces:
        s, components = unknowns.point_forces[0].s, state.point_forces
    elif unknowns.current:
        components, scale = state.current, facing_area(arm)
    else:
        return None
    force = slice(components.start, components.start + 3)
    wrench, covariance = np.zeros(6), np.zeros((6, 6))
    wrench[:3] = scale * estimate.mean[force]
    covariance[:3, :3] = scale**2 * estimate.covariance[force, force]
    return Contact(s, wrench, covariance)
