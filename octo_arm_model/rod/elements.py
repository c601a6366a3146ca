"""The elements of a rod, whose Gauss-Legendre points are the nodes.

Strains are smooth within an element, as every anchorage, knot and load is at its edge. They vary
over lengths in proportion to the radius, so elements have lengths in this proportion: a tapered
arm needs no more of them than a cylinder.
"""

from __future__ import annotations

import bisect
import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import BoolArray, FloatArray, IntArray
from octo_arm_model.arm.limits import MAX_INTERVALS, MAX_NODES

# Least number of elements, and the ratio of radii in an element: an arm that tapers has at least
# one for each factor of `_TAPER`.
_FEWEST = 3
_TAPER = 1.5
# Refinement of each level: the number of parts that every element is cut into, and the number of
# points to add to that of `_points`.
LEVELS = ((1, 0), (1, 3), (2, 3), (4, 3), (8, 3))
# Largest number of turns of a tendon about the midline, or of the arm, that an element resolves.
MOST_TURNS = 1.0
COARSE = -1  # level of few nodes, for the continuation of equilibria
_COARSE_POINTS = 4
# Parts of each element, and points of each part, for tensions with friction, which have kinks.
FINE = 12, 4
_SAMPLES = 101  # number of places at which the thickness is checked
# Lengths with a smaller relative difference are equal up to rounding.
SAME_LENGTH = 1e-9
MOST_KNOTS = 48  # largest number of knots of profiles at edges; others only slow convergence


@dataclass(frozen=True, eq=False)
class Elements:
    """The elements and nodes of one arm."""

    edges: FloatArray  #: arc coordinates of the ends of elements [m], (E + 1,)
    rule: GaussRule  #: Gauss rule of each element
    sections: IntArray  #: section of each element, from the tip; 0 beyond the last anchorage, (E,)
    sharp: BoolArray  #: whether strains may jump at the start of each element, (E,)

    @functools.cached_property
    def lengths(self) -> FloatArray:
        """Lengths of the elements [m], (E,)."""
        return np.diff(self.edges)

    @functools.cached_property
    def s(self) -> FloatArray:
        """Arc coordinates of the nodes [m], (N,)."""
        inside = self.lengths[:, np.newaxis] * self.rule.points
        return (self.edges[:-1, np.newaxis] + inside).ravel()

    @functools.cached_property
    def weights(self) -> FloatArray:
        """Weights of the integral along the arm [m], (N,)."""
        return np.outer(self.lengths, self.rule.weights).ravel()

    @property
    def section(self) -> IntArray:
        """Section of each node, (N,)."""
        return np.repeat(self.sections, self.points)

    @functools.cached_property
    def from_base(self) -> FloatArray:
        """Matrix of integrals from the base to each node, (N, N) in columns [m]."""
        return np.asfortranarray(self.integration(self.s))

    @functools.cached_property
    def to_tip(self) -> FloatArray:
        """Matrix of integrals from each node to the tip, (N, N) [m]."""
        return np.asarray(self.weights - self.from_base)

    @functools.cached_property
    def fine(self) -> Elements:
        """Elements that are cut into `FINE` equal parts, whose points resolve kinks."""
        parts, points = FINE
        starts = self.edges[:-1, np.newaxis] + np.outer(self.lengths, np.arange(parts) / parts)
        sharp = np.zeros(starts.shape, np.bool_)
        sharp[:, 0] = self.sharp
        edges, sections = np.append(starts, self.edges[-1]), np.repeat(self.sections, parts)
        return Elements(edges, gauss_rule(points), sections, sharp.ravel())

    def element_at(self, s: FloatArray) -> IntArray:
        """Return the element of each place ``s`` (n,) [m]; at an edge the one towards the base."""
        inner = self.edges[1:-1]
        slack = 1e-12 * self.edges[-1]
        element: IntArray = np.searchsorted(inner, s - slack)
        return element

    def interpolation(self, s: FloatArray) -> FloatArray:
        """Return the matrix (n, N) from values at the nodes to those at places ``s`` (n,) [m]."""
        return self._spread(s, self.rule.interpolate)

    def integration(self, s: FloatArray) -> FloatArray:
        """Return the matrix (n, N) from values at the nodes to integrals from base to ``s``."""
        element = self.element_at(s)
        matrix = self._spread(s, self.rule.integrate) * np.repeat(self.lengths, self.points)
        before = np.arange(self.lengths.size) < element[:, np.newaxis]
        matrix += np.repeat(before, self.points, axis=1) * self.weights
        # Integrals up to the base are exactly zero.
        return matrix * (s > 0.0)[:, np.newaxis]

    @property
    def points(self) -> int:
        """Number of points in each element."""
        return self.rule.points.size

    def _spread(self, s: FloatArray, of: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Put rows of a matrix of the `GaussRule` in the columns of the element of each place."""
        element = self.element_at(s)
        inside = of((s - self.edges[element]) / self.lengths[element])
        matrix = np.zeros((s.size, self.lengths.size, self.points))
        matrix[np.arange(s.size), element] = inside
        return matrix.reshape(s.size, -1)


def build_elements(
    arm: Arm,
    breaks: tuple[float, ...] = (),
    knots: tuple[float, ...] = (),
    level: int = 0,
    added: int = 0,
) -> Elements:
    """Return the elements of ``arm`` on a ``level`` of `LEVELS`, or `COARSE`.

    Loads begin, end or jump at ``breaks`` and are not smooth at ``knots`` [m]. The number
    ``added`` is that of additional points in each element.

    Raises:
        ConfigError: if the arm is too thin for its length, or needs too many nodes.
    """
    cuts, extra = LEVELS[max(level, 0)]
    check_thickness(arm)
    edges = _edges(arm, breaks, knots)
    # Equal parts of this coordinate have lengths in proportion to the radius.
    s, coordinate = _graded(arm, edges)
    at_edges = np.interp(edges, s, coordinate)
    counts = _share(arm, edges, at_edges)
    stops = _stops(edges, at_edges, counts, s, coordinate)
    turns = np.minimum(np.ceil(_turns(arm, stops) / MOST_TURNS), MAX_NODES)
    first = np.append(0, np.cumsum(counts)[:-1])
    counts *= np.maximum(np.maximum.reduceat(turns, first), 1.0).astype(np.int64)
    points = _points(int(counts.sum())) + extra if level >= 0 else _COARSE_POINTS
    if (fewest := int(counts.sum()) * _points(int(counts.sum()))) > MAX_NODES:
        raise ConfigError(
            f'this arm takes {fewest} nodes, at most {MAX_NODES} are allowed: it has too many '
            'sections, loads, tabulated points or turns of tendons'
        )
    stops = _stops(edges, at_edges, counts * cuts, s, coordinate)
    middles = 0.5 * (stops[:-1] + stops[1:])
    anchorages = np.array([section.anchorage for section in arm.sections])
    sections = (anchorages > middles[:, np.newaxis]).sum(axis=1)
    sharp = np.zeros(middles.size, np.bool_)
    sharp[np.cumsum(counts * cuts)[:-1]] = True
    return Elements(stops, gauss_rule(points + added), sections, sharp)


def check_thickness(arm: Arm) -> None:
    """Refuse an ``arm`` that is absurdly thin."""
    s = np.linspace(0.0, arm.length, _SAMPLES)
    acts = np.array([section.anchorage for section in arm.sections])[arm.tendon_section - 1]
    place = np.hypot(*arm.tendon_offsets(s)) * (s <= acts[:, np.newaxis])
    place = place.max(axis=0, initial=0.0)
    thickness = np.maximum(arm.body.radius(s), place)
    with np.errstate(over='ignore'):
        pieces = np.diff(s) / np.minimum(thickness[:-1], thickness[1:])
    if not np.maximum(pieces, 1.0).sum() <= MAX_INTERVALS:
        raise ConfigError(
            f'this arm takes more than {MAX_INTERVALS} intervals, each no longer than thick: it '
            'is too thin for its length'
        )


def _edges(arm: Arm, breaks: tuple[float, ...], knots: tuple[float, ...]) -> FloatArray:
    """Return the places at which elements have to end, (edges,) [m]."""
    edges = panel_ends(arm, breaks, arm.discs.faces)
    smooth = _apart({*arm.knots, *knots}, edges, arm.length)
    if len(smooth) > MOST_KNOTS:
        step = len(smooth) / MOST_KNOTS
        smooth = [smooth[int(step * number)] for number in range(MOST_KNOTS)]
    for knot in smooth:
        bisect.insort(edges, knot)
    return np.array(edges)


def panel_ends(arm: Arm, breaks: tuple[float, ...], others: tuple[float, ...] = ()) -> list[float]:
    """Return ends and anchorages of ``arm``, ``others``, and different ``breaks``, sorted [m]."""
    ends = {0.0, arm.length, *(section.anchorage for section in arm.sections), *others}
    return sorted(ends.union(_apart(breaks, sorted(ends), arm.length)))


def _apart(places: Iterable[float], others: Sequence[float], length: float) -> list[float]:
    """Return those of ``places`` that differ from each other and from ``others``, sorted."""
    taken = sorted(others)
    distinct = []
    for place in sorted(places):
        after = bisect.bisect(taken, place)
        if all(
            abs(near - place) > SAME_LENGTH * length
            for near in taken[max(after - 1, 0) : after + 1]
        ):
            taken.insert(after, place)
            distinct.append(place)
    return distinct


def _graded(arm: Arm, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return places (n,) [m] and the integral of ds / R up to each, (n,) [-]."""
    s = np.unique(np.concatenate([edges, np.linspace(0.0, arm.length, 513)]))
    inverse = 1.0 / arm.body.radius(s)
    parts = 0.5 * np.diff(s) * (inverse[:-1] + inverse[1:])
    return s, np.concatenate([[0.0], np.cumsum(parts)])


def _share(arm: Arm, edges: FloatArray, at_edges: FloatArray) -> IntArray:
    """Return the number of elements between neighbouring ``edges``, at least one."""
    radius = arm.body.radius(edges)
    taper = np.abs(np.diff(np.log(radius))).sum() / math.log(_TAPER)
    total = max(float(_FEWEST), taper + 1.0)
    parts = np.diff(at_edges) / at_edges[-1]
    return np.maximum(np.round(total * parts), 1.0).astype(np.int64)


def _stops(
    edges: FloatArray, at_edges: FloatArray, parts: IntArray, s: FloatArray, coordinate: FloatArray
) -> FloatArray:
    """Return ends of elements [m]: ``parts`` equal parts of the coordinate between ``edges``."""
    inside = [
        np.linspace(first, last, count + 1)[:-1]
        for first, last, count in zip(at_edges[:-1], at_edges[1:], parts)
    ]
    stops = np.interp(np.append(np.concatenate(inside), at_edges[-1]), coordinate, s)
    # Rounding errors are removed, as tendons end exactly at the edges.
    stops[np.append(0, np.cumsum(parts))] = edges
    return np.asarray(stops)


def _turns(arm: Arm, stops: FloatArray) -> FloatArray:
    """Return the largest number of turns, in each element, of a tendon or of the arm, (E,)."""
    s = np.unique(np.concatenate([stops, np.linspace(0.0, arm.length, 513)]))
    wound = np.zeros((len(arm.tendons) + 1, s.size))
    for row, tendon, number in zip(wound, arm.tendons, arm.tendon_section.tolist()):
        until = np.minimum(s, arm.sections[number - 1].anchorage)
        row[1:] = np.abs(np.diff(tendon.angle.value(until))).cumsum()
    bend = np.linalg.norm(arm.rest.at(s), axis=0)
    wound[-1, 1:] = (0.5 * (bend[1:] + bend[:-1]) * np.diff(s)).cumsum()
    between = np.diff(wound[:, np.searchsorted(s, stops)])
    return np.asarray(between.max(axis=0) / (2.0 * math.pi))


def _points(elements: int) -> int:
    """Return the number of points in each of so many ``elements``: fewer if these are short."""
    for most, points in ((6, 8), (12, 7), (24, 6), (48, 5), (96, 4)):
        if elements <= most:
            return points
    return 3


# Collocation within one element, [0, 1] ----------------------------------------------------------

_legendre = np.polynomial.legendre


class GaussRule(NamedTuple):
    """The Gauss points of [0, 1], and matrices that integrate values at them."""

    points: FloatArray  #: c, (n,)
    weights: FloatArray  #: b, quadrature weights over [0, 1], (n,)
    #: a, matrix from a column of values to integrals from 0 to each point, (n, n)
    from_start: FloatArray
    to_end: FloatArray  #: b - a, matrix from values to integrals from each point to 1, (n, n)
    coefficients: FloatArray  #: matrix from values to Legendre coefficients, (n, n)
    #: matrix from values to coefficients of the integral from 0, (n + 1, n)
    antiderivatives: FloatArray

    @property
    def differentiation(self) -> FloatArray:
        """Matrix (n, n) from values at the points to derivatives there."""
        slopes = 2.0 * _legendre.legder(self.coefficients)
        return np.asarray(_legendre.legvander(2.0 * self.points - 1.0, len(slopes) - 1) @ slopes)

    def interpolate(self, targets: FloatArray) -> FloatArray:
        """Return the matrix (m, n) from values at the points to those at ``targets`` (m,)."""
        values = _legendre.legvander(2.0 * targets - 1.0, self.points.size - 1)
        return np.asarray(values @ self.coefficients)

    def integrate(self, targets: FloatArray) -> FloatArray:
        """Return the matrix (m, n) from values at points to integrals from 0 to ``targets``."""
        values = _legendre.legvander(2.0 * targets - 1.0, self.points.size)
        return np.asarray(values @ self.antiderivatives)


@functools.cache
def gauss_rule(count: int) -> GaussRule:
    """Return the rule of ``count`` Gauss-Legendre points."""
    x, weights = _legendre.leggauss(count)
    points, weights = 0.5 * (x + 1.0), np.asarray(0.5 * weights, dtype=np.float64)
    coefficients = np.asarray(np.linalg.inv(_legendre.legvander(x, count - 1)), np.float64)
    antiderivatives = np.asarray(0.5 * _legendre.legint(coefficients, lbnd=-1.0), np.float64)
    from_start = _legendre.legvander(x, count) @ antiderivatives
    return GaussRule(
        points, weights, from_start, weights - from_start, coefficients, antiderivatives
    )
