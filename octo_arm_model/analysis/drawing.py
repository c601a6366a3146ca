"""The geometry of solved arms: triangles, discs, lines, uncertainty, and self-intersection."""

import math
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.material import LINEAR
from octo_arm_model.arm.obstacles import Cylinder, Obstacle, Plane, Sphere
from octo_arm_model.arm.stiffness import bending_force
from octo_arm_model.rod.rotations import axes_of, quaternion_product
from octo_arm_model.rod.section_formulas import widening
from octo_arm_model.rod.sensitivity import chi_square_limit
from octo_arm_model.rod.stations import interpolated, nearest


def in_millimetres(axis: Any, label: str) -> None:
    """Show numbers in mm at an ``axis`` of a figure with data in m."""
    axis.set_major_formatter(lambda metres, _: f'{1e3 * metres:g}')
    axis.set_label_text(f'{label} [mm]')


def set_limits(space: Any, limits: FloatArray) -> None:
    """Set the ``limits`` (3, 2) [m] of a figure in space, and show numbers in mm."""
    for name, ends in zip('xyz', limits):
        space.set(**{f'{name}lim': ends})
        in_millimetres(getattr(space, f'{name}axis'), name)


def equal_axes(points: FloatArray, half: float = 0.53) -> FloatArray:
    """Return ends (3, 2) of axes about ``points`` (..., 3), twice ``half`` their extent long."""
    low, high = (end(points.reshape(-1, 3), axis=0) for end in (np.min, np.max))
    reach = half * (high - low).max()
    return np.stack([0.5 * (low + high) - reach, 0.5 * (low + high) + reach], axis=1)


class Overlap(NamedTuple):
    """Two points of the backbone that are nearer to each other than the sum of their radii."""

    depth: float  #: sum of the radii less the distance of the points [m]
    s: tuple[float, float]  #: arc coordinates of both points, the one nearer to the base first [m]


def deepest_overlap(s: FloatArray, position: FloatArray, radius: FloatArray) -> Overlap | None:
    """Return the deepest overlap of the body around a backbone with itself; None without one.

    Two segments between stations overlap if their centre lines are nearer to each other than the
    sum of their radii. Pairs are excluded if their distance along the backbone is less than half
    the circumference of the body. At that distance the tightest possible bend, with the radius of
    the body, has turned back and is one diameter away; so a wider bend never overlaps, and a
    tighter one does if it turns as far.

    Args:
        s: arc coordinate of the stations [m], (stations,).
        position: positions of the stations [m], (stations, 3).
        radius: radius of the body at the stations [m], (stations,).
    """
    start, along = position[:-1], np.diff(position, axis=0)
    reached = np.append(0.0, np.cumsum(np.linalg.norm(along, axis=1)))
    first, second = np.triu_indices(len(along), 2)
    # Bounding spheres come first, as few pairs are near enough.
    middle, half = start + 0.5 * along, 0.5 * np.diff(reached)
    thick = np.maximum(radius[:-1], radius[1:])
    distance = np.linalg.norm(middle[second] - middle[first], axis=1)
    is_near = distance < (thick + half)[first] + (thick + half)[second]
    first, second = first[is_near], second[is_near]
    if not first.size:
        return None
    at_first, at_second = _nearest(start[first], along[first], start[second], along[second])
    between = start[second] + at_second[:, np.newaxis] * along[second]
    between -= start[first] + at_first[:, np.newaxis] * along[first]
    radii = _within(radius, first, at_first) + _within(radius, second, at_second)
    separation = _within(reached, second, at_second) - _within(reached, first, at_first)
    depth = radii - np.linalg.norm(between, axis=1)
    depth[separation < 0.5 * np.pi * radii] = -np.inf
    worst = int(np.argmax(depth))
    if depth[worst] <= 0.0:
        return None
    ends = (_within(s, first, at_first)[worst], _within(s, second, at_second)[worst])
    return Overlap(float(depth[worst]), (float(ends[0]), float(ends[1])))


def _within(values: FloatArray, segment: FloatArray, part: FloatArray) -> FloatArray:
    """Return ``values`` (stations,) interpolated at a ``part`` (pairs,) of each ``segment``."""
    return np.asarray((1.0 - part) * values[segment] + part * values[segment + 1])


def _nearest(
    a: FloatArray, u: FloatArray, b: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return x and y (pairs,) of the nearest points of segments a + x u and b + y v (pairs, 3).

    Ericson, Real-Time Collision Detection (2005), section 5.1.9.
    """
    offset = a - b
    uu, vv, uv = (np.sum(p * q, axis=1) for p, q in ((u, u), (v, v), (u, v)))
    uo, vo = np.sum(u * offset, axis=1), np.sum(v * offset, axis=1)
    uu, vv = (np.maximum(square, np.finfo(float).tiny) for square in (uu, vv))
    determinant = uu * vv - uv * uv
    is_skew = determinant > 1e-12 * uu * vv
    x = np.where(is_skew, (uv * vo - uo * vv) / np.where(is_skew, determinant, 1.0), 0.0)
    x = np.clip(x, 0.0, 1.0)
    y = np.clip((uv * x + vo) / vv, 0.0, 1.0)
    # Return the x nearest to the clipped y.
    return np.clip((uv * y - uo) / uu, 0.0, 1.0), y


SIDES = 12
MOST_RINGS = 101  # a screen does not resolve more
SLACK_COLOUR = (0.6, 0.6, 0.6, 1.0)
TAUT_COLOUR = (1.0, 0.0, 0.0, 1.0)

# Sizes are relative to the length of the arm, and the rim of discs to the radius.
LINE_WIDTH = 0.002
DISC_THICKNESS = 0.004
_DISC_RIM = 1.05  # discs are wider than the body, as coincident surfaces flicker

# The axis of a cylinder is z, and that of a cross section is x: this is a quarter turn about y.
_UPRIGHT = np.array([0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)])


class ArmGeometry(NamedTuple):
    """The geometry of one shape in the frame of its backbone."""

    vertices: FloatArray  #: vertices of the body, joined by `Drawing.triangles`, (vertices, 3) [m]
    #: centres of the discs at anchorages, from the tip, (sections, 3) [m]
    disc_position: FloatArray
    #: orientations x, y, z, w of these discs, whose axis is z, (sections, 4)
    disc_quaternion: FloatArray
    disc_radius: FloatArray  #: radii of these discs, (sections,) [m]
    #: points from the base to the anchorage of each tendon, each (points, 3) [m]
    tendons: list[FloatArray]


class Drawing:
    """The geometry of shapes of one arm, by tables that do not depend on the shape.

    Attributes:
        triangles: vertices of each triangle of the body, anticlockwise seen from outside,
            (triangles, 3).
        disc_count: number of discs.
        disc_thickness: thickness of a disc [m].
        tendon_points: number of points of each tendon.
        line_width: width of the line of a tendon [m].
    """

    def __init__(self, arm: Arm, s: FloatArray, law: int = LINEAR, *, sides: int = SIDES) -> None:
        """Prepare to draw ``arm``.

        Args:
            arm: the arm.
            s: stations of the backbones to draw [m], (stations,), those of `Solver.grid`.
            law: number of the elastic law, by which cross sections and the offsets of tendons
                widen.
            sides: number of corners of the polygons for circles.
        """
        self._law = law
        self._anchorages = anchorage_stations(arm, s)
        self._rings = np.union1d(ring_stations(s.size), self._anchorages)
        ends = np.searchsorted(self._rings, self._anchorages)
        self._tendon_ends = ends[arm.tendon_section - 1]
        radius = arm.body.radius(s[self._rings])
        corners = unit_circle(sides) if arm.body.is_round else unit_square(sides)
        half_sizes = arm.body.half_sizes(s[self._rings])
        self._outline = corners[:, :, np.newaxis] * half_sizes[:, np.newaxis]
        self._offsets = np.array(arm.tendon_offsets(s[self._rings]))
        self._straight = _between_faces(s[self._rings], arm) if arm.discs.s else None
        self._disc_radius = _DISC_RIM * np.maximum(radius, arm.body.disc_radius)[ends]
        self.triangles = tube_triangles(self._rings.size, sides)
        self.disc_count = self._anchorages.size
        self.tendon_points = [int(end) + 1 for end in self._tendon_ends]
        self.disc_thickness = DISC_THICKNESS * arm.length
        self.line_width = LINE_WIDTH * arm.length

    def draw(self, position: FloatArray, quaternion: FloatArray, q: FloatArray) -> ArmGeometry:
        """Return the geometry of one shape.

        Args:
            position: positions of the stations [m], (stations, 3).
            quaternion: orientations x, y, z, w of the stations, (stations, 4).
            q: longitudinal strains of the stations [-], (stations,).
        """
        width, _, _ = widening(self._law, 1.0 + q)
        centre = position[self._rings]
        frame = axes_of(quaternion[self._rings])
        # Rows are x, y, z in the frame of the backbone, columns the axes n and b.
        across = frame[:, 1:] * width[self._rings]
        surface = _place(centre, across, self._outline).reshape(-1, 3)
        paths = _place(centre, across, self._offsets)
        if self._straight is not None:
            paths = self._straight @ paths
        return ArmGeometry(
            vertices=np.concatenate([surface, centre[[0, -1]]]),
            disc_position=position[self._anchorages],
            disc_quaternion=quaternion_product(quaternion[self._anchorages], _UPRIGHT),
            disc_radius=self._disc_radius * width[self._anchorages],
            tendons=[path[: end + 1] for path, end in zip(paths, self._tendon_ends, strict=True)],
        )


def _between_faces(s: FloatArray, arm: Arm) -> FloatArray:
    """Return the matrix that moves points at ``s`` (rings,) to the lines between disc faces."""
    faces = np.array([0.0, *arm.discs.faces])
    spread = [np.interp(faces, s, unit) for unit in np.eye(s.size)]
    return np.stack(
        [np.interp(s, faces, unit) for unit in np.eye(faces.size)], axis=1
    ) @ np.transpose(spread)


def ring_stations(stations: int) -> IntArray:
    """Return the indices of at most `MOST_RINGS` of ``stations`` stations, those with rings."""
    rings = np.linspace(0.0, stations - 1.0, min(stations, MOST_RINGS))
    return np.unique(rings.round().astype(np.int64))


def unit_circle(sides: int) -> FloatArray:
    """Return the corners (2, sides) of the polygon for a circle of radius 1."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    return np.array([np.cos(angle), np.sin(angle)])


def unit_square(sides: int) -> FloatArray:
    """Return points (2, sides) along a square of size 2; 4, 8, ... points have all corners."""
    along = np.arange(sides) * 8.0 / sides - np.array([[0.0], [2.0]])
    return np.clip(np.abs(along % 8.0 - 3.0) - 2.0, -1.0, 1.0)


def anchorage_stations(arm: Arm, s: FloatArray) -> IntArray:
    """Return the index of the station at each anchorage, from the tip, (sections,).

    ``s`` (stations,) [m] are the stations of a solver of ``arm``, one at every anchorage.
    """
    anchorages = np.array([section.anchorage for section in arm.sections])
    return nearest(anchorages, s)


def tension_colours(tensions: FloatArray, largest: float | None = None) -> FloatArray:
    """Return red, green, blue, alpha (n, 4) for ``tensions`` (n,) [N], from grey to red.

    The ``largest`` tension [N] is full red; by default the largest of ``tensions``.
    """
    scale = tensions.max(initial=0.0) if largest is None else largest
    share = np.clip(tensions / scale, 0.0, 1.0) if scale > 0.0 else np.zeros(tensions.shape)
    slack, taut = np.array(SLACK_COLOUR), np.array(TAUT_COLOUR)
    return slack + share[:, np.newaxis] * (taut - slack)


def _place(position: FloatArray, across: FloatArray, places: FloatArray) -> FloatArray:
    """Return points (k, rings, 3) [m] at ``places`` (2, k, rings) [m] along n and b of rings."""
    return position + np.einsum('xar,akr->krx', across, places)


def tube_triangles(rings: int, sides: int) -> IntArray:
    """Return vertices of each triangle of a closed tube (triangles, 3), anticlockwise outside.

    The vertices of the tube are those of the rings, all along one side, then along the next side
    anticlockwise about the axis, and so on; the centres of both ends come last.
    """
    number = np.arange(sides * rings).reshape(sides, rings)
    beside = np.roll(number, -1, axis=0)
    near, far = number[:, :-1], number[:, 1:]
    near_beside, far_beside = beside[:, :-1], beside[:, 1:]
    base, tip = np.full((2, sides), [[sides * rings], [sides * rings + 1]])
    parts = (
        (near, near_beside, far),
        (near_beside, far_beside, far),
        (base, beside[:, 0], number[:, 0]),
        (tip, number[:, -1], beside[:, -1]),
    )
    return np.concatenate([np.stack(part, axis=-1).reshape(-1, 3) for part in parts])


_PARALLELS = 13  # number of circles of latitude of a ball


def obstacle_mesh(
    obstacle: Obstacle, middle: FloatArray, size: float, sides: int = 48
) -> tuple[FloatArray, IntArray]:
    """Return vertices (vertices, 3) [m] of an ``obstacle``, and its triangles (triangles, 3).

    A plane or a cylinder ends at ``size`` [m] from its point nearest to ``middle`` (3,).
    """
    if isinstance(obstacle, Sphere):
        axis, centre = np.array([0.0, 0.0, 1.0]), np.array(obstacle.centre)
        angle = np.linspace(0.0, math.pi, _PARALLELS)
        along, radius = -obstacle.radius * np.cos(angle), obstacle.radius * np.sin(angle)
    elif isinstance(obstacle, Cylinder):
        axis, centre = np.array(obstacle.axis), np.array(obstacle.point)
        centre = centre + axis * ((middle - centre) @ axis)
        along, radius = np.array([-size, size]), np.full(2, obstacle.radius)
    else:
        assert isinstance(obstacle, Plane)
        axis, centre = np.array(obstacle.normal), np.array(obstacle.point)
        centre = middle - axis * ((middle - centre) @ axis)
        along, radius = np.array([-1e-3 * size, 0.0]), np.full(2, size)
    vertices = _revolved(centre + along[:, np.newaxis] * axis, radius, _across(axis), sides)
    return vertices, tube_triangles(along.size, sides)


def _across(axis: FloatArray) -> FloatArray:
    """Return unit vectors (2, 3) that make a right-handed frame with the unit vector ``axis``."""
    first = np.linalg.svd(axis[np.newaxis])[2][1]
    return np.stack([first, np.cross(axis, first)])


def _revolved(
    centres: FloatArray, radius: FloatArray, across: FloatArray, sides: int
) -> FloatArray:
    """Return vertices, joined by `tube_triangles`, of circles (rings,) about ``centres``."""
    around = unit_circle(sides).T @ across
    surface = centres + radius[:, np.newaxis] * around[:, np.newaxis]
    return np.concatenate([surface.reshape(-1, 3), centres[[0, -1]]])


INSIDE = 0.95  # probability that the truth is within a tube or a cone
_ONE, _TWO, _THREE = (chi_square_limit(INSIDE, size) for size in (1, 2, 3))
# A force that moves the tip by _BENT of the length is drawn as _LENGTH of it.
_BENT, _LENGTH = 0.2, 0.3
_LONGEST = 0.6  # longest arrow, relative to the length of the arm
_RIM = 1.03  # tubes are wider than the body, as coincident surfaces flicker
SHAFT = 0.008  # radius of the shaft of an arrow, relative to the length of the arm
_HEAD, _WIDER = 0.25, 2.5  # head of an arrow: length over the arrow's, radius over the shaft's
CORNERS = 24  # number of corners of cones and arrows


class Arrow(NamedTuple):
    """The arrow of a force, and the cone of its uncertainty.

    Attributes:
        start, end: ends of the arrow [m], (3,).
        shaft: vertices of the arrow, joined by `ARROW_TRIANGLES`, (vertices, 3) [m].
        cone: vertices of the cone, from ``start``, of the directions that the force may have,
            joined by `CONE_TRIANGLES`, (vertices, 3) [m].
    """

    start: FloatArray
    end: FloatArray
    shaft: FloatArray
    cone: FloatArray


class UncertaintyDrawing:
    """The tubes around uncertain shapes of one arm, and the arrows of forces on it.

    Attributes:
        triangles: vertices of each triangle of a tube, (triangles, 3).
    """

    def __init__(self, arm: Arm, s: FloatArray, *, sides: int = SIDES) -> None:
        """Prepare for ``arm``, stations ``s`` (stations,) [m], polygons with ``sides`` corners."""
        self._rings = ring_stations(s.size)
        self._s = s
        self._radius = _RIM * arm.body.radius(s[self._rings])
        self._circle = unit_circle(sides)
        self.triangles = tube_triangles(self._rings.size, sides)
        self._scale = _LENGTH * arm.length / bending_force(arm, _BENT)
        self._longest, self._shaft = _LONGEST * arm.length, SHAFT * arm.length

    def tube(
        self, position: FloatArray, quaternion: FloatArray, covariance: FloatArray
    ) -> FloatArray:
        """Return vertices (vertices, 3) [m] of the tube that probably holds the body.

        In each direction across the arm a cross section ends within the tube with a probability
        of `INSIDE`.

        Args:
            position: positions of the stations [m], (stations, 3).
            quaternion: orientations x, y, z, w of the stations, (stations, 4).
            covariance: covariances of the positions [m^2], (stations, 3, 3).
        """
        centre = position[self._rings]
        frame = axes_of(quaternion[self._rings])
        out = np.einsum('xar,ak->krx', frame[:, 1:], self._circle)
        variance = np.einsum('krx,rxy,kry->kr', out, covariance[self._rings], out)
        reach = self._radius + np.sqrt(_ONE * np.maximum(variance, 0.0))
        surface = centre + reach[..., np.newaxis] * out
        return np.concatenate([surface.reshape(-1, 3), centre[[0, -1]]])

    def place(self, position: FloatArray, s: float) -> FloatArray:
        """Return the point (3,) [m] at which to draw a force at ``s`` [m].

        ``position`` (stations, 3) [m] are the stations. A current, with NaN as ``s``, acts all
        along the arm; its resultant is drawn at the middle.
        """
        return interpolated(0.5 * self._s[-1] if np.isnan(s) else s, self._s, position)

    def arrow(self, start: FloatArray, force: FloatArray, covariance: FloatArray) -> Arrow | None:
        """Return the arrow of a ``force`` (3,) [N] of ``covariance`` (3, 3) at ``start`` (3,) [m].

        Return None if zero is within the region that holds the force with probability `INSIDE`.
        """
        size = float(np.linalg.norm(force))
        if not size or force @ np.linalg.pinv(covariance) @ force <= _THREE:
            return None
        scale = min(self._scale, self._longest / size)
        along = force / size
        across = _across(along)
        values, axes = np.linalg.eigh(across @ covariance @ across.T)
        axes[:, 1] *= np.linalg.det(axes)  # right-handed too, as the triangles face outwards
        reach = scale * np.sqrt(_TWO * np.maximum(values, 0.0))
        end = start + scale * force
        rim = end + (axes @ (reach[:, np.newaxis] * unit_circle(CORNERS))).T @ across
        cone = np.concatenate([rim, [start, end]])
        neck = end - _HEAD * (end - start)
        radius = self._shaft * np.array([1.0, 1.0, _WIDER, 0.0])
        shaft = _revolved(np.array([start, neck, neck, end]), radius, across, CORNERS)
        return Arrow(start, end, shaft, cone)


ARROW_TRIANGLES: IntArray = tube_triangles(4, CORNERS)
CONE_TRIANGLES: IntArray = tube_triangles(1, CORNERS)


ARMS = 8
RADIUS = 0.05  # radius of the circle of the bases [m]


def base_pose(number: int, radius: float = RADIUS) -> tuple[list[float], list[float]]:
    """Return position [m] and quaternion x, y, z, w of the base of arm ``number``, from 1 on.

    The bases are on a circle in the plane x, y of the body, the first on the x axis. Every arm
    points outwards; n of the arm is along the circle and b along z of the body.
    """
    angle = 2.0 * math.pi * (number - 1) / ARMS
    position = [radius * math.cos(angle), radius * math.sin(angle), 0.0]
    return position, [0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)]
