"""How what measurements predict bends: second derivatives, learnt while a filter runs.

Measurements of the tip give theirs by geometry. Where all do, by all that the shape depends on,
nothing is learnt: a step that leads far tells as much of third derivatives as of what geometry
leaves out. Others change slowly: every two Jacobians tell the second derivatives along the way
from one to the other (symmetric secant update, Powell 1970). Where they foretell a Jacobian badly
they are found anew by differences, along what the measurements correct; where nothing is known of
states nearby all are, for which the arm is solved once for each component of the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import Belief, Gain
from octo_arm_model.estimation.beliefs.posterior_mean import Agreement
from octo_arm_model.estimation.measurements import Measurement, jacobians
from octo_arm_model.estimation.state.prediction import Prediction

_STEP = 0.1  # standard deviations, of differences of the Jacobian
_FAR = 0.3  # change of the Jacobian, in parts of it, after which nothing learnt is kept
_OFF = 0.7  # part of a change of the Jacobian that is not as foretold, where they are found anew
_SMALL = 0.01  # likewise of the Jacobian, that need not be foretold
_CORRECTED = 0.1  # standard deviations before, that what is found anew is corrected by at least


class Curvature(NamedTuple):
    """Second derivatives of what some measurements predict.

    Attributes:
        second: by the state, (m, n, n), symmetric.
        jacobian: of what is predicted, where they were learnt last, (m, n).
        given: what measurements themselves say of them there, see `Measurement.second`.
        agreed: how innovations drew the mode so far.
        share: part of the whole shift to the mean, see `share_of`.
        begun: what was given where the last fit began; None before the end of one.
    """

    second: FloatArray
    jacobian: FloatArray
    given: FloatArray
    agreed: Agreement = Agreement()
    share: float = 1.0
    begun: FloatArray | None = None

    @property
    def weight(self) -> float:
        """Of the whole shift to the mean."""
        return self.agreed.weight * self.share

    def of_given(self, jacobian: FloatArray, given: FloatArray) -> Curvature:
        """Those ``given`` alone, where what is predicted has a ``jacobian``."""
        return self._replace(second=given, jacobian=jacobian, given=given)

    @classmethod
    def flat(cls, jacobian: FloatArray, agreed: Agreement = Agreement()) -> Curvature:
        """None, of what is predicted with a ``jacobian``."""
        nothing = np.zeros((*jacobian.shape, jacobian.shape[1]))
        return cls(nothing, jacobian, nothing, agreed)

    def moved(self, given: FloatArray) -> Curvature:
        """The same besides what is ``given``, which is this elsewhere."""
        if given is self.given:
            return self
        return self._replace(second=self.second + (given - self.given), given=given)

    def halfway(self, given: FloatArray) -> Curvature:
        """The same, halfway to where that is ``given``."""
        return self if given is self.given else self.moved(0.5 * (self.given + given))

    def is_near(self, jacobian: FloatArray, stddev: FloatArray) -> bool:
        """Whether they are those about a ``jacobian``; ``stddev`` (n,) is of the state."""
        away = np.linalg.norm((jacobian - self.jacobian) * stddev)
        return bool(away <= _FAR * np.linalg.norm(jacobian * stddev))

    def foretells(self, change: FloatArray, jacobian: FloatArray, stddev: FloatArray) -> bool:
        """Whether a ``change`` (n,) of the state leads to this ``jacobian``, nearly."""
        moved = (jacobian - self.jacobian) * stddev
        off = float(np.linalg.norm(moved - (self.second @ change) * stddev))
        least = _SMALL * float(np.linalg.norm(jacobian * stddev))
        return off <= max(_OFF * float(np.linalg.norm(moved)), least)

    def after(self, change: FloatArray, jacobian: FloatArray, scale: FloatArray) -> Curvature:
        """The nearest ones that make the last Jacobian this one, with a ``change`` of the state.

        Nearest in the Frobenius norm with each component of the state in units of ``scale``.
        """
        along = change / scale**2
        size = float(along @ change)
        if not size:
            return self
        along /= size
        left = jacobian - self.jacobian - self.second @ change
        across = left[:, :, np.newaxis] * along
        both = (left @ change)[:, np.newaxis, np.newaxis] * (along[:, np.newaxis] * along)
        second = self.second + across + across.transpose(0, 2, 1) - both
        return self._replace(second=second, jacobian=jacobian)


def stddev_of(belief: Belief) -> FloatArray:
    """Standard deviation of every component, (n,)."""
    found: FloatArray = np.sqrt((belief.root * belief.root).sum(axis=1))
    return found


def renewed(
    known: Curvature, measurements: Sequence[Measurement], at: Prediction, stddev: FloatArray
) -> Curvature:
    """All second derivatives anew, ``at`` a state of the Jacobian that is ``known``.

    Raises:
        SolveError: if the arm has no trustworthy shape nearby.
    """
    second = known.second.copy()
    for component in at.model.state.shaping:
        moved = at.x.copy()
        # Upwards, as a slack tendon cannot pull less.
        moved[component] += _STEP * stddev[component]
        jacobian = jacobians(measurements, Prediction(at.model, moved, at.shape))
        by_component = (jacobian - known.jacobian) / (moved[component] - at.x[component])
        second[:, component] = second[:, :, component] = by_component
    return known._replace(second=second)


def renewed_along(
    by: Gain,
    known: Curvature,
    measurements: Sequence[Measurement],
    at: Prediction,
    stddev: FloatArray,
    scale: FloatArray,
) -> Curvature:
    """Second derivatives anew along what the measurements correct ``by`` themselves alone.

    Those lead to the mean, and are fewer than all. ``scale`` is that of `Curvature.after`.

    Raises:
        SolveError: if the arm has no trustworthy shape nearby.
    """
    # Not by singular vectors, which rounding turns where they are equally long.
    axes, corrected = np.linalg.qr(by.gain @ by.innovation_root / scale[:, np.newaxis])
    tension, units = at.model.state.tension, np.where(at.model.state.shapes, scale, 0.0)
    found = known
    for axis, size in zip(axes.T, corrected.diagonal(), strict=True):
        if abs(size) < _CORRECTED:
            continue
        change = np.copysign(1.0, size) * axis * units
        change *= _STEP / np.linalg.norm(change / stddev)
        moved = at.x + change
        if moved[tension].min() < 0.0:
            moved = at.x - change
        # A slack tendon cannot pull less.
        moved[tension] = np.maximum(moved[tension], 0.0)
        jacobian = jacobians(measurements, Prediction(at.model, moved, at.shape))
        found = found.after(moved - at.x, jacobian, scale)._replace(jacobian=known.jacobian)
    return found
