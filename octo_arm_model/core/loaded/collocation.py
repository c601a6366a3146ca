"""Where the loaded rod is solved: Gauss points in elements between anchorages, loads and knots.

A panel is what lies between two neighbouring anchorages or loads; an element is a panel or a part
of it, with Gauss points of its own. Within an element everything is smooth, so that a few points
resolve strains to many digits. Arrays over points go from the base to the tip, element by element.
"""

from __future__ import annotations

import itertools
import math
import sys
from typing import NamedTuple

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.numerics.gauss import GaussRule, gauss_rule
from octo_arm_model.core.rod.grid import StationGrid, apart

# Points in each element; where tendons have friction and there are few elements, and so long ones,
# in which kinks of the tensions lie that no points resolve; and in each of more elements than
# `_MANY`, as of an arm of many sections.
_POINTS, _WITH_FRICTION, _FEWEST = 8, 10, 6
_FEW = 6
_MANY = 24
_LONGEST = 0.27  # of the length of the arm
# Ratio of the radii at the ends of an element: compliances go with the fourth power of the radius,
# and what changes more within an element takes many more points.
_TAPER = 1.4
_ROUNDING = 1e-12  # of the length of the arm
# Points in all, up to which one product with a full matrix is quicker than one in each element.
_FEW_IN_ALL = 256


class _Integrals(NamedTuple):
    """Weights of the integrals from one end of the arm to every point.

    Attributes:
        within: those of the values in its element of length one, (each, each of the point).
        others: those of the values in other elements, (points, elements).
        full: both, (points, points); None where there are many points.
    """

    within: FloatArray
    others: FloatArray
    full: FloatArray | None


class Collocation:
    """Elements and points of one arm.

    Attributes:
        rule: points within an element.
        start: arc coordinate of the ends of elements towards the base [m], (elements,).
        step: their lengths [m], (elements,).
        s: arc coordinate of the points [m], (points,).
        section: section of each point, (points,).
        steps: length of the element of each point [m], (points,).
        weights: of the integral along the arm, (points,).
        before: weights of the integrals from the base to the start of each element, (points,
            elements).
        twice: double integrals within an element: contracted with values f at its points it is the
            matrix from values g at its points to the integrals, from each point to the end, of
            f(s) times the integral of g from the start to s, (each, each x each).
        at_end: weights w by which a collocated function y at the end of an element follows from
            its values at the points: y(end) - y(start) = sum w_i (y_i - y(start)), (each,).
        at_start: (1 - sum w) times the identity, the factor of y(start) in y(end), (2, 2).
        length: of the arm [m].
    """

    def __init__(
        self, arm: Arm, grid: StationGrid, knots: tuple[float, ...], cuts: int,
        most_points: int = sys.maxsize,
    ) -> None:  # fmt: skip
        """Cut the panels of ``grid`` into elements.

        They are cut at ``knots`` and where they are long or taper, then each part into ``cuts``
        elements of at most ``most_points`` points.
        """
        ends, section = [0.0], []
        for panel in grid.panels:
            inside = [s for s in knots if panel.start < s < panel.stop]
            inside = apart(inside, [panel.start, panel.stop], arm.length)
            for start, stop in itertools.pairwise([panel.start, *inside, panel.stop]):
                parts = _parts(arm, start, stop)
                ends += _cut(np.concatenate([[start], parts]), cuts)
                section += [panel.section] * (parts.size * cuts)
        self.start, self.step = np.array(ends[:-1]), np.diff(ends)
        # Finer elements have as many points each as those they are cut from.
        count = len(section) // cuts
        points = _WITH_FRICTION if arm.friction and count <= _FEW else _POINTS
        points = min(points if count <= _MANY else _FEWEST, most_points)
        self.rule: GaussRule = gauss_rule(points)
        places = self.start[:, np.newaxis] + self.step[:, np.newaxis] * self.rule.points
        self.s = places.ravel()
        self.section = np.repeat(section, points)
        self.steps = np.repeat(self.step, points)
        self.weights = (self.step[:, np.newaxis] * self.rule.weights).ravel()
        self.length = arm.length
        number = np.arange(self.step.size)
        element, weights = np.repeat(number, points)[:, np.newaxis], self.weights[:, np.newaxis]
        self.before = weights * (element < number)
        self._from_base = self._integrals(self.rule.from_start.T, self.before)
        self._to_tip = self._integrals(self.rule.to_end.T, weights * (element > number))
        twice = self.rule.to_end.T[:, :, np.newaxis] * self.rule.from_start[:, np.newaxis]
        self.twice = twice.reshape(points, -1)
        self.at_end = np.linalg.solve(self.rule.from_start.T, self.rule.weights)
        self.at_start = (1.0 - self.at_end.sum()) * np.eye(2)

    def by_element(self, values: FloatArray) -> FloatArray:
        """``values`` (..., points) as (..., elements, points of each)."""
        return values.reshape(*values.shape[:-1], self.start.size, self.rule.points.size)

    def integrate_from_base(self, values: FloatArray) -> FloatArray:
        """Integral of ``values`` (..., points) from the base to each point."""
        return self._integrate(values, self._from_base)

    def integrate_from_tip(self, values: FloatArray) -> FloatArray:
        """Integral of ``values`` (..., points) from each point to the tip."""
        return self._integrate(values, self._to_tip)

    def _integrate(self, values: FloatArray, integrals: _Integrals) -> FloatArray:
        if integrals.full is not None:
            return np.asarray(values @ integrals.full)
        total: FloatArray = self.by_element(values * self.steps) @ integrals.within
        total += (values @ integrals.others)[..., np.newaxis]
        return total.reshape(values.shape)

    def _integrals(self, within: FloatArray, others: FloatArray) -> _Integrals:
        if self.s.size > _FEW_IN_ALL:
            return _Integrals(within, others, None)
        each = within.shape[0]
        full = np.repeat(others, each, axis=1)
        by_element = full.reshape(self.start.size, each, self.start.size, each)
        for element, step in enumerate(self.step):
            by_element[element, :, element] += step * within
        return _Integrals(within, others, full)

    def readout(self, s: FloatArray, stop: FloatArray) -> Readout:
        """Interpolation and integration from values at the points to the places ``s`` (n,) [m].

        ``stop`` (n,) [m] is the end of the panel that each place belongs to: a place at the border
        of two elements is read from the one in that panel.
        """
        element = np.searchsorted(self.start, s, side='right') - 1
        at_border = np.abs(self.start[element] - s) <= _ROUNDING * self.length
        element[at_border & (stop <= s + _ROUNDING * self.length) & (element > 0)] -= 1
        return Readout(self, s, element)


def _parts(arm: Arm, start: float, stop: float) -> FloatArray:
    """Where the elements between ``start`` and ``stop`` end, shorter where the arm is thinner."""
    first, last = arm.body.radius(np.array([start, stop])).tolist()
    long = (stop - start) / (_LONGEST * arm.length)
    count = math.ceil(max(long, abs(math.log(last / first)) / math.log(_TAPER)))
    lengths = (last / first) ** (np.arange(count) / count)
    parts = start + (stop - start) * np.cumsum(lengths) / lengths.sum()
    parts[-1] = stop
    return np.asarray(parts)


def _cut(ends: FloatArray, cuts: int) -> list[float]:
    """Ends of all elements but the first, between ``ends``, each cut in ``cuts``."""
    parts = np.linspace(ends[:-1], ends[1:], cuts + 1, axis=1)[:, 1:]
    return np.asarray(parts).ravel().tolist()


class Readout:
    """Values and integrals at any places, from values at the points of a `Collocation`.

    Attributes:
        element: number of the element that each place lies in, (n,).
        values: weights that interpolate the points of that element, (n, points of each).
        within: weights of the integral from the start of that element to the place [m], (n,
            points of each).
    """

    def __init__(self, collocation: Collocation, s: FloatArray, element: IntArray) -> None:
        """Read out at ``s`` (n,), each in its ``element`` (n,)."""
        self._collocation, self.element = collocation, element
        rule, start, step = collocation.rule, collocation.start, collocation.step
        places = (s - start[element]) / step[element]
        self.values = rule.interpolate(places)
        self.within = rule.integrate(places) * step[element, np.newaxis]
        self.within[places == 0.0] = 0.0  # but for rounding it is
        # Each place has a column in its element's part of one product for all elements.
        counts = np.bincount(element, minlength=step.size)
        most, order = int(counts.max()), np.argsort(element, kind='stable')
        column = np.empty_like(element)
        column[order] = np.arange(s.size) - np.repeat(np.cumsum(counts) - counts, counts)
        self._most, self._columns = most, element * most + column
        self._by_element = [self._spread(matrix) for matrix in (self.values, self.within)]

    def interpolate(self, values: FloatArray) -> FloatArray:
        """Values (..., n) from those at the points (..., points)."""
        return self._apply(self._by_element[0], values)

    def integrate_from_base(self, values: FloatArray) -> FloatArray:
        """Integrals (..., n) from the base to each place, of ``values`` (..., points)."""
        own = self._collocation
        found = self._apply(self._by_element[1], values)
        found += (values @ own.before).take(self.element, axis=-1)
        return found

    def _spread(self, matrix: FloatArray) -> FloatArray:
        """The rows of a ``matrix`` (n, points of each), sorted by the elements of the places.

        Returns:
            (elements, points of each, places in the fullest element), padded with zeros.
        """
        elements = self._collocation.step.size
        spread = np.zeros((elements * self._most, matrix.shape[1]))
        spread[self._columns] = matrix
        return spread.reshape(elements, self._most, -1).transpose(0, 2, 1).copy()

    def _apply(self, by_element: FloatArray, values: FloatArray) -> FloatArray:
        """Product (..., n) of a matrix of `_spread` with ``values`` (..., points)."""
        own = self._collocation.by_element(values.reshape(-1, values.shape[-1]))
        found = np.empty((len(own), len(by_element), self._most))
        np.matmul(own.swapaxes(0, 1), by_element, out=found.swapaxes(0, 1))
        places = found.reshape(len(own), -1).take(self._columns, axis=1)
        return places.reshape(*values.shape[:-1], -1)
