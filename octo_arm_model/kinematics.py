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
from octo_arm_model.hints import FloatArray, IntArray
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
    """Integrate ``twist`` (4 or 6, batch, nodes) from the ``base`` pose to every station.

    Its first three rows are the angular part [1/m], the others the linear part along t (and n and
    b, where the cross section shears). Fills ``position`` (batch, stations, 3) [m] and
    ``quaternion`` (batch, stations, 4), in the order x, y, z, w: the local x axis is the tangent
    t, y is n and z is b.
    """
    position[...], frames = _end_frames(twist, grid, base, grid.station_node)
    frames.part(grid.station_node).write_xyzw(quaternion)


def node_frames(
    twist: FloatArray, grid: StationGrid, base: Frame
) -> tuple[FloatArray, Quaternions]:
    """Position (batch, nodes, 3) [m] and orientation of every node under ``twist``."""
    ends = np.arange(grid.step.size + 1)
    position, frames = _end_frames(twist, grid, base, ends)
    rotation = Quaternions.empty(twist.shape[1], grid.step.size)
    move = _exponential(_half_magnus(twist, grid), rotation)
    start = frames.part(slice(None, -1))
    move = start.rotate(move)
    half = start.times(rotation)
    nodes = Quaternions(*(np.concatenate(pair, axis=-1) for pair in zip(frames, half)))
    step = np.stack([move.a.imag, move.b.real, move.b.imag], axis=-1)
    return np.concatenate([position, position[:, :-1] + step], axis=1), nodes


def _end_frames(
    twist: FloatArray, grid: StationGrid, base: Frame, at: IntArray
) -> tuple[FloatArray, Quaternions]:
    """Position of the interval ends ``at`` (batch, n, 3) [m], and frames of all interval ends."""
    screws = _magnus(twist, grid)
    batch, count = screws.shape[1:]
    # The base and then the motion of each interval, in the axes of its own first frame.
    chain = Quaternions.empty(batch, count + 1)
    chain.a[:, 0], chain.b[:, 0] = base.rotation
    step = _exponential(screws, chain.part(slice(1, None)))
    frames = cumulative_product(chain)
    step = frames.part(slice(None, -1)).rotate(step)

    position = np.empty((batch, at.size, 3))
    position[:, 0] = base.position
    interval = at[1:] - 1
    x, y, z = base.position
    position[:, 1:, 0] = np.add.accumulate(step.a.imag, axis=1)[:, interval] + x
    yz = np.add.accumulate(step.b, axis=1)[:, interval]
    position[:, 1:, 1] = yz.real + y
    position[:, 1:, 2] = yz.imag + z
    return position, frames


def _three(twist: FloatArray, grid: StationGrid) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Twist at the first, the last and the middle node of each interval."""
    count = grid.step.size
    return twist[..., :count], twist[..., 1 : count + 1], twist[..., count + 1 :]


def _magnus(twist: FloatArray, grid: StationGrid) -> FloatArray:
    """Screw of each interval: rotation vector, then translation, (6, batch, intervals)."""
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
    # For v = (v, 0, 0), the n and b components from those of the strains side by side.
    (t, n, b, v), (t_last, n_last, b_last, v_last) = first[:4], last[:4]
    screw[0] += factor * (n * b_last - b * n_last)
    turn = factor * (t * last[1:3] - t_last * first[1:3])
    screw[1] -= turn[1]
    screw[2] += turn[0]
    move = factor * (v_last * first[1:3] - v * last[1:3])
    screw[4] += move[1]
    screw[5] -= move[0]
    if len(first) == 6:
        (v_n, v_b), (w_n, w_b) = first[4:], last[4:]
        screw[3] += factor * (n * w_b - b * w_n - n_last * v_b + b_last * v_n)
        screw[4] -= factor * (t * w_b - t_last * v_b)
        screw[5] += factor * (t * w_n - t_last * v_n)


def _exponential(screw: FloatArray, rotation: Quaternions) -> Quaternions:
    """Exponential of screws (6, ...): fills ``rotation`` and returns the translation.

    Rodrigues' formula for both. Written like this no term loses digits for small angles, so
    that no series is needed; the tiny number only avoids 0 / 0.
    """
    w, v = screw[:3], screw[3:]
    squares = w * w
    squared = squares[0] + squares[1] + squares[2] + 1e-300
    angle = np.sqrt(squared)
    # Sine and cosine of half the angle from the tangent of a quarter: one function instead of
    # two, one that NumPy vectorises, and their squares sum to one whatever it rounds.
    tangent = np.tan(0.25 * angle)
    square = tangent * tangent
    secant = 1.0 + square
    half_sinc = 2.0 * tangent / (secant * angle)
    half_cosine = (1.0 - square) / secant
    imaginary = half_sinc * w
    rotation.a.real, rotation.a.imag = half_cosine, imaginary[0]
    rotation.b.real, rotation.b.imag = imaginary[1], imaginary[2]
    twice = 2.0 * half_sinc
    sinc, versine = twice * half_cosine, twice * half_sinc  # versine is (1 - cos) / angle^2
    products = w * v
    along = (products[0] + products[1] + products[2]) * ((1.0 - sinc) / squared)
    (x, y, z), (p, q, r) = w, v
    move = sinc * v
    move[0] += versine * (y * r - z * q)
    move[1] += versine * (z * p - x * r)
    move[2] += versine * (x * q - y * p)
    move += along * w
    return Quaternions.from_vector(*move)
