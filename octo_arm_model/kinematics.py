"""From strains to the backbone: equation (1) of the paper, on the group of rigid motions.

The frame of the cross section moves along s with the body twist

    angular (1 + q) (tau, xi, k)    linear (1 + q, 0, 0)    in the axes (t, n, b),

so each interval is one rigid motion, the exponential of a fourth-order Magnus expansion built
from the twists X at its first, middle and last node (Blanes, Casas, Oteo and Ros 2009, sec. 5):

    Omega = h/6 (X_first + 4 X_middle + X_last) + h^2/12 [X_first, X_last]

(plus, where the reference has minus, because a body twist multiplies from the right).
Frames stay orthonormal to rounding, however coarse the grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octo_arm_model.errors import ConfigError
from octo_arm_model.grid import StationGrid
from octo_arm_model.hints import ComplexArray, FloatArray
from octo_arm_model.rotation import Quaternions, cumulative_product


@dataclass(frozen=True)
class Pose:
    """Position [m] and orientation (quaternion x, y, z, w) in the base frame.

    Raises:
        ConfigError: if a component is not finite or the quaternion is not of unit length.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        """Validate, and make the quaternion unit to rounding."""
        for name, size in (('position', 3), ('quaternion', 4)):
            values = getattr(self, name)
            try:
                array = np.array(values, dtype=np.float64)
            except (OverflowError, TypeError, ValueError):
                array = np.array(np.nan)
            if array.shape != (size,) or not np.isfinite(array).all():
                raise ConfigError(f'base.{name} is {values!r}, expected {size} finite numbers')
            if name == 'quaternion':
                norm = float(np.linalg.norm(array))
                if abs(norm - 1.0) > 1e-3:
                    raise ConfigError(
                        f'base.quaternion is {values!r} of length {norm:.6g}, '
                        'expected x, y, z, w of length 1'
                    )
                array /= norm
            object.__setattr__(self, name, tuple(array.tolist()))


class Frame(NamedTuple):
    """A pose ready for arithmetic."""

    position: FloatArray
    rotation: Quaternions


def backbone_frames(
    twist: FloatArray,
    grid: StationGrid,
    base: Frame,
    position: FloatArray,
    quaternion: FloatArray,
) -> None:
    """Integrate ``twist`` (4 or 6, ..., nodes) from the ``base`` pose to every station.

    Its first three rows are the angular part [1/m], the others the linear part along t (and n and
    b, where the cross section shears). Fills ``position`` (..., stations, 3) [m] and
    ``quaternion`` (..., stations, 4), in the order x, y, z, w: the local x axis is the tangent
    t, y is n and z is b.
    """
    frames, (along, aside) = _end_frames(twist, grid, base)
    # From the base to the end of the interval before each station.
    interval = grid.station_node[1:] - 1
    position[..., 0, :] = 0.0
    position[..., 1:, 0] = np.add.accumulate(along, axis=-1)[..., interval]
    yz = np.add.accumulate(aside, axis=-1)[..., interval]
    position[..., 1:, 1], position[..., 1:, 2] = yz.real, yz.imag
    position += base.position
    frames.part(grid.station_node).write_xyzw(quaternion)


def node_frames(
    twist: FloatArray, grid: StationGrid, base: Frame
) -> tuple[FloatArray, Quaternions]:
    """Position (..., nodes, 3) [m] and orientation of every node under ``twist``."""
    frames, (along, aside) = _end_frames(twist, grid, base)
    start, count = frames.part(slice(None, -1)), grid.step.size
    turn = Quaternions.empty(*along.shape)
    move = _exponential(_half_magnus(twist, grid), turn)
    half = start.times(turn)
    nodes = Quaternions(*(np.concatenate(pair, axis=-1) for pair in zip(frames, half)))
    position = np.zeros((*nodes.a.shape, 3))
    ends, middles = position[..., : count + 1, :], position[..., count + 1 :, :]
    for steps, out in ((along, 0), (aside.real, 1), (aside.imag, 2)):
        np.add.accumulate(steps, axis=-1, out=ends[..., 1:, out])
    position += base.position
    along, aside = _displacement(start, move, half)
    middles[..., 0] = ends[..., :-1, 0] + along
    middles[..., 1] = ends[..., :-1, 1] + aside.real
    middles[..., 2] = ends[..., :-1, 2] + aside.imag
    return position, nodes


def _end_frames(
    twist: FloatArray, grid: StationGrid, base: Frame
) -> tuple[Quaternions, tuple[FloatArray, ComplexArray]]:
    """Frames of the interval ends, (..., intervals + 1), and `_displacement` of each interval."""
    screw = _magnus(twist, grid)
    # The base and then the rotation of each interval, in the axes of its own first frame.
    chain = Quaternions.empty(*screw.shape[1:-1], screw.shape[-1] + 1)
    chain.a[..., 0], chain.b[..., 0] = base.rotation
    move = _exponential(screw, chain.part(slice(1, None)))
    frames = cumulative_product(chain)
    ends = frames.part(slice(1, None))
    return frames, _displacement(frames.part(slice(None, -1)), move, ends)


def _displacement(
    start: Quaternions, move: Quaternions, end: Quaternions
) -> tuple[FloatArray, ComplexArray]:
    """How far motions go, from frame to frame: along x, and along y and z as real and imaginary.

    ``move`` is that of `_exponential`; the vector is start move end^-1.
    """
    a, b = start.times(move)
    c, d = end
    return (a * c.conj() + b * d.conj()).imag, b * c - a * d


def _three(twist: FloatArray, grid: StationGrid) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Twist at the first, the last and the middle node of each interval."""
    count = grid.step.size
    return twist[..., :count], twist[..., 1 : count + 1], twist[..., count + 1 :]


def _magnus(twist: FloatArray, grid: StationGrid) -> FloatArray:
    """Screw of each interval: rotation vector, then translation, (6, ..., intervals)."""
    h = grid.step
    first, last, middle = _three(twist, grid)
    screw = np.zeros((6, *first.shape[1:]))
    mean = np.multiply(4.0, middle, out=screw[: len(twist)])
    mean += first
    mean += last
    mean *= h / 6.0
    _add_commutator(screw, first, last, h * h / 12.0)
    return screw


def _half_magnus(twist: FloatArray, grid: StationGrid) -> FloatArray:
    """Screw of the first half of each interval, to the order the middles need."""
    h = grid.step
    first, last, middle = _three(twist, grid)
    screw = np.zeros((6, *first.shape[1:]))
    screw[: len(twist)] = (5.0 * first + 8.0 * middle - last) * (h / 24.0)
    _add_commutator(screw, first, middle, h * h / 48.0)
    return screw


def _add_commutator(
    screw: FloatArray, first: FloatArray, last: FloatArray, factor: FloatArray
) -> None:
    """Add ``factor`` [X_first, X_last] with [X, X'] = (w x w', w x v' - w' x v) to ``screw``."""
    (t, n, b, v), (t_last, n_last, b_last, v_last) = first[:4], last[:4]
    x, y, z, p, q, r = screw
    x += factor * (n * b_last - b * n_last)
    y -= factor * (t * b_last - b * t_last)
    z += factor * (t * n_last - n * t_last)
    q -= factor * (v * b_last - b * v_last)
    r += factor * (v * n_last - n * v_last)
    if len(first) == 6:
        (v_n, v_b), (w_n, w_b) = first[4:], last[4:]
        p += factor * (n * w_b - b * w_n - n_last * v_b + b_last * v_n)
        q -= factor * (t * w_b - t_last * v_b)
        r += factor * (t * w_n - t_last * v_n)


def _exponential(screw: FloatArray, rotation: Quaternions) -> Quaternions:
    """Exponential of screws (6, ...): fills ``rotation`` and returns what moves.

    The motion is the dual quaternion rotation + epsilon/2 move, of which the translation is the
    vector move rotation^-1. Written like this no term loses digits for small angles, so that no
    series is needed; the tiny number only avoids 0 / 0.
    """
    x, y, z, p, q, r = screw
    squared = x * x
    squared += y * y
    squared += z * z
    squared += 1e-300
    along = x * p
    along += y * q
    along += z * r
    angle = np.sqrt(squared)
    # Sine and cosine of half the angle from the tangent of a quarter: one function instead of
    # two, one that NumPy vectorises, and their squares sum to one whatever it rounds.
    tangent = np.tan(0.25 * angle)
    square = tangent * tangent
    secant = 1.0 + square
    half_sinc = 2.0 * tangent / (secant * angle)
    cosine = (1.0 - square) / secant
    rotation.a.real = cosine
    np.multiply(half_sinc, x, out=rotation.a.imag)
    np.multiply(half_sinc, y, out=rotation.b.real)
    np.multiply(half_sinc, z, out=rotation.b.imag)
    sinc = half_sinc + half_sinc
    move = Quaternions.empty(*angle.shape)
    np.multiply(-half_sinc, along, out=move.a.real)
    along *= (cosine - sinc) / squared
    np.add(sinc * p, along * x, out=move.a.imag)
    np.add(sinc * q, along * y, out=move.b.real)
    np.add(sinc * r, along * z, out=move.b.imag)
    return move
