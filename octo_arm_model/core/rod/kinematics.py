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

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import ComplexArray, FloatArray, Number
from octo_arm_model.core.numerics.quaternion import Quaternions, cumulative_product, displacement
from octo_arm_model.core.rod.grid import StationGrid


class Frame(NamedTuple):
    """A pose as arrays."""

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
    """Position (..., nodes, 3) [m] and orientation (..., nodes) of all nodes.

    Integrates ``twist`` (4 or 6, ..., nodes), see `backbone_frames`, from the pose ``base``.
    """
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
    along, aside = displacement(*start.times(move), *half)
    middles[..., 0] = ends[..., :-1, 0] + along
    middles[..., 1] = ends[..., :-1, 1] + aside.real
    middles[..., 2] = ends[..., :-1, 2] + aside.imag
    return position, nodes


def _end_frames(
    twist: FloatArray, grid: StationGrid, base: Frame
) -> tuple[Quaternions, tuple[FloatArray, ComplexArray]]:
    """Integrate ``twist`` (4 or 6, ..., nodes) from the pose ``base`` over all intervals.

    Returns:
        Frames of the interval ends, (..., intervals + 1), and the `displacement` of each interval.
    """
    screw = _magnus(twist, grid)
    # The base and then the rotation of each interval, in the axes of its own first frame.
    chain = Quaternions.empty(*screw.shape[1:-1], screw.shape[-1] + 1)
    chain.a[..., 0], chain.b[..., 0] = base.rotation
    move = _exponential(screw, chain.part(slice(1, None)))
    frames = cumulative_product(chain)
    ends = frames.part(slice(1, None))
    return frames, displacement(*frames.part(slice(None, -1)).times(move), *ends)


def _three(twist: FloatArray, grid: StationGrid) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Twist at the first, the last and the middle node of each interval."""
    count = grid.step.size
    return twist[..., :count], twist[..., 1 : count + 1], twist[..., count + 1 :]


def _magnus(twist: FloatArray, grid: StationGrid) -> FloatArray:
    """Screw of each interval: rotation vector, then translation, (6, ..., intervals)."""
    h = grid.step
    first, last, middle = _three(twist, grid)
    screw = np.zeros((6, *first.shape[1:]))
    screw[: len(twist)] = mean_twist(first, middle, last, h)
    _add_commutator(screw, first, last, commutator_weight(h))
    return screw


def _half_magnus(twist: FloatArray, grid: StationGrid) -> FloatArray:
    """Screw of the first half of each interval (6, ..., intervals), of lower order.

    Positions and frames of the middles serve derivatives alone.
    """
    h = grid.step
    first, last, middle = _three(twist, grid)
    screw = np.zeros((6, *first.shape[1:]))
    screw[: len(twist)] = (5.0 * first + 8.0 * middle - last) * (h / 24.0)
    _add_commutator(screw, first, middle, h * h / 48.0)
    return screw


def _add_commutator(
    screw: FloatArray, first: FloatArray, last: FloatArray, factor: FloatArray
) -> None:
    """Add ``factor`` [X_first, X_last] to ``screw``."""
    for row, values in zip((0, 1, 2, 4, 5), commutator(*first[:4], *last[:4])):
        screw[row] += factor * values
    if len(first) == 6:
        (_, n, b, _, v_n, v_b), (_, n_last, b_last, _, w_n, w_b) = first, last
        t, t_last = first[0], last[0]
        screw[3] += factor * (n * w_b - b * w_n - n_last * v_b + b_last * v_n)
        screw[4] -= factor * (t * w_b - t_last * v_b)
        screw[5] += factor * (t * w_n - t_last * v_n)


def mean_twist(first: Number, middle: Number, last: Number, step: Number) -> Number:
    """First term of the Magnus expansion, of any component of the twist; Simpson's rule."""
    return (4.0 * middle + first + last) * (step / 6.0)


def commutator_weight(step: Number) -> Number:
    """Factor of the `commutator` of the twists at both ends, in the fourth-order expansion."""
    return step * step / 12.0


def commutator(
    t: Number, n: Number, b: Number, v: Number,
    t_last: Number, n_last: Number, b_last: Number, v_last: Number,
) -> tuple[Number, Number, Number, Number, Number]:  # fmt: skip
    """[X, X'] = (w x w', w x v' - w' x v) of twists without shear.

    Its component along the linear t is zero and left out.
    """
    return (
        n * b_last - b * n_last,
        b * t_last - t * b_last,
        t * n_last - n * t_last,
        b * v_last - v * b_last,
        v * n_last - n * v_last,
    )


def _exponential(screw: FloatArray, rotation: Quaternions) -> Quaternions:
    """Fill in the ``rotation`` (...) of screws (6, ...); returns the move of `exponential`."""
    move = Quaternions.empty(*screw.shape[1:])
    (a, b), (c, d) = rotation, move
    (
        a.real, a.imag, b.real, b.imag, c.real, c.imag, d.real, d.imag,
    ) = exponential(*screw)  # fmt: skip
    return move


def exponential(
    x: Number, y: Number, z: Number, p: Number, q: Number, r: Number
) -> tuple[Number, Number, Number, Number, Number, Number, Number, Number]:
    """Exponential of a screw: the two parts of a dual quaternion, each w, x, y, z.

    The motion is rotation + epsilon/2 move, and its translation is the vector move rotation^-1.
    In this form no term cancels for small angles, so that no series is needed; the small number
    only avoids 0 / 0.
    """
    squared = x * x + y * y + z * z + 1e-300
    along = x * p + y * q + z * r
    angle = np.sqrt(squared)
    # Sine and cosine of half the angle from the tangent of a quarter: one function that NumPy
    # vectorises instead of two, and their squares sum to one whatever its rounding.
    tangent = np.tan(0.25 * angle)
    square = tangent * tangent
    secant = 1.0 + square
    half_sinc = 2.0 * tangent / (secant * angle)
    cosine = (1.0 - square) / secant
    sinc = half_sinc + half_sinc
    aside = along * ((cosine - sinc) / squared)
    return (
        cosine, half_sinc * x, half_sinc * y, half_sinc * z,
        -half_sinc * along, sinc * p + aside * x, sinc * q + aside * y, sinc * r + aside * z,
    )  # fmt: skip
