"""What the tendons sum to at every node, linear in the tensions.

With tendon j at offset (r_n, r_b) in the axes of the cross section, the models need

    axial    = sum T                    first_n = sum T r_n        first_b = sum T r_b
    second_n = sum T r_n^2              second_b = sum T r_b^2

over the tendons that act at the node. In the letters of the paper's equation (10), for four
tendons a section: A1 = second_n, B1 = second_b, alpha = first_n and beta = -first_b.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm import Arm
from octo_arm_model.errors import TensionError
from octo_arm_model.hints import FloatArray, IntArray


class TendonSums(NamedTuple):
    """Sums over the tendons acting at each node, each (batch, nodes).

    Attributes:
        axial: sum of tensions [N].
        first_n: first moment along n [N m].
        first_b: first moment along b [N m].
        second_n: second moment along n [N m^2].
        second_b: second moment along b [N m^2].
    """

    axial: FloatArray
    first_n: FloatArray
    first_b: FloatArray
    second_n: FloatArray
    second_b: FloatArray


class TendonWeights:
    """The matrix that turns tensions into `TendonSums` at given nodes."""

    def __init__(self, arm: Arm, nodes: FloatArray, section: IntArray) -> None:
        """Tabulate the tendons of ``arm`` at ``nodes`` (n,), each in its ``section`` (n,).

        A section numbered i from the tip is passed by the tendons of sections 1 to i.
        """
        offset_n, offset_b = arm.tendon_offsets(nodes)
        of_section = np.repeat(np.arange(1, len(arm.sections) + 1), arm.tension_shape[1])
        acts = (of_section[:, np.newaxis] <= section).astype(np.float64)
        powers = (acts, acts * offset_n, acts * offset_b, acts * offset_n**2, acts * offset_b**2)
        self._matrices = np.stack(powers)

    def sums(self, tensions: FloatArray) -> TendonSums:
        """Sum ``tensions`` (batch, tendons) [N] at every node."""
        return TendonSums(*(tensions @ self._matrices))


def check_tensions(arm: Arm, tensions: ArrayLike) -> FloatArray:
    """Return ``tensions`` as a float array (..., sections, tendons of a section) [N].

    Raises:
        TensionError: if the shape is not that of the arm, or a tension is negative or not
            finite; the message names the tendon.
    """
    try:
        array = np.asarray(tensions)
    except ValueError:  # rows of different length
        array = np.asarray(None)
    if array.dtype.kind not in 'fiu':
        raise TensionError(
            f'tensions must be numbers in rows of equal length, expected shape '
            f'(..., {arm.tension_shape[0]}, {arm.tension_shape[1]})'
        )
    array = array.astype(np.float64, copy=False)
    if array.shape[-2:] != arm.tension_shape:
        rows, columns = arm.tension_shape
        raise TensionError(
            f'tensions have shape {array.shape}, expected (..., {rows}, {columns}): '
            f'{rows} section(s) from the tip, {columns} tendons each'
        )
    # One pass accepts the ordinary case: NaN fails the first comparison, infinity the second.
    if array.size and not (array.min() >= 0.0 and array.max() < np.inf):
        bad = ~((array >= 0.0) & (array < np.inf))
        index = tuple(int(i) for i in np.argwhere(bad)[0])
        name = arm.tendon_names[index[-2] * arm.tension_shape[1] + index[-1]]
        where = f' in set {index[:-2]}' if len(index) > 2 else ''
        raise TensionError(
            f'tension of {name}{where} is {float(array[index])!r} N, expected a finite number >= 0'
        )
    return array
