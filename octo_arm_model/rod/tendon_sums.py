"""Sums over the tendons at every node, linear in the tensions.

With tendon j at offset (r_n, r_b) in the axes of the cross section, the paper's models need

    axial    = sum T                    first_n = sum T r_n        first_b = sum T r_b
    second_n = sum T r_n^2              second_b = sum T r_b^2
    mixed    = sum T r_n r_b            routing_torque = sum T (r_n r_b' - r_b r_n')

over the tendons that act at the node. In the letters of the paper's equation (10), for four
tendons a section: A1 = second_n, B1 = second_b, alpha = first_n and beta = -first_b, and the last
two vanish.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import TensionError, shown
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.validation import real_numbers
from octo_arm_model.rod.vectors import times

_FEW = 64  # numbers, up to which Python takes less time than NumPy


class TendonSums(NamedTuple):
    """Sums over the tendons acting at each node, each (batch, nodes).

    Attributes:
        axial: sum of tensions [N].
        first_n: first moment along n [N m].
        first_b: first moment along b [N m].
        second_n: second moment along n [N m^2].
        second_b: second moment along b [N m^2].
        mixed: mixed second moment [N m^2]; None where it vanishes for all tensions.
        routing_torque: moment of the tendons about t by their slopes [N m]; None where it vanishes
            for all tensions.
    """

    axial: FloatArray
    first_n: FloatArray
    first_b: FloatArray
    second_n: FloatArray
    second_b: FloatArray
    mixed: FloatArray | None
    routing_torque: FloatArray | None


def transmission(arm: Arm, s: FloatArray, section: IntArray) -> FloatArray:
    """Local tension of each tendon over that at its base, at ``s`` (n,) in ``section`` (n,).

    1 up to the anchorage of a frictionless tendon and 0 beyond. The only source of local tensions
    for all models and derivatives.

    Returns:
        (tendons, n) [-].
    """
    return (arm.tendon_section[:, np.newaxis] <= section).astype(np.float64)


class TendonWeights:
    """The matrices that turn tensions into `TendonSums` at given nodes.

    Attributes:
        matrices: one for each sum that does not vanish, (5 to 7, tendons, nodes).
    """

    def __init__(self, arm: Arm, nodes: FloatArray, section: IntArray) -> None:
        """Tabulate the tendons of ``arm`` at ``nodes`` (n,), each in its ``section`` (n,).

        In the section numbered i from the tip the tendons of sections 1 to i act.
        """
        n, b = arm.tendon_offsets(nodes)
        slope_n, slope_b = arm.tendon_slopes(nodes)
        part = transmission(arm, nodes, section)
        sums = [part, part * n, part * b, part * n**2, part * b**2]
        scale = max(float(np.max(np.hypot(n, b))), 1e-300)
        mixed, routing_torque = part * n * b, part * (n * slope_b - b * slope_n)
        # Both vanish for the paper's tendons, and are then omitted.
        self._is_mixed = bool(np.any(np.abs(mixed) > 1e-14 * scale**2))
        self._has_routing_torque = bool(np.any(np.abs(routing_torque) > 1e-14 * scale))
        if self._is_mixed:
            sums.append(mixed)
        if self._has_routing_torque:
            sums.append(routing_torque)
        self.matrices = np.stack(sums)

    @property
    def is_plain(self) -> bool:
        """Whether bending about n and b decouples: no mixed second moment, no routing torque."""
        return not (self._is_mixed or self._has_routing_torque)

    def sums(self, tensions: FloatArray) -> TendonSums:
        """Sum ``tensions`` (batch, tendons) [N] at every node."""
        matrices = self.matrices if tensions.ndim == 1 else self.matrices[:, np.newaxis]
        return self._named(list(times(tensions, matrices)))

    def local_sums(self, local_tensions: FloatArray) -> TendonSums:
        """Sum tensions (tendons, batch, nodes) [N] that differ from node to node."""
        return self._named(list(np.einsum('jbn,ijn->ibn', local_tensions, self.matrices)))

    def _named(self, sums: list[FloatArray]) -> TendonSums:
        routing_torque = sums.pop() if self._has_routing_torque else None
        mixed = sums.pop() if self._is_mixed else None
        axial, first_n, first_b, second_n, second_b = sums
        return TendonSums(axial, first_n, first_b, second_n, second_b, mixed, routing_torque)


def check_tensions(arm: Arm, tensions: ArrayLike) -> FloatArray:
    """Return ``tensions`` as a float array that ends in the shape `Arm.tension_shape` [N].

    Where that is flat, one set may also be given in rows, one for each section.

    Raises:
        TensionError: if the shape is not that of the arm, or a tension is negative or not
            finite; the message names the tendon.
    """
    shape = arm.tension_shape
    if len(shape) == 1:
        tensions = _flatten_rows(arm, tensions)
    array = real_numbers(tensions)
    if array is None or array.shape[-len(shape) :] != shape:
        expected = f'(..., {", ".join(str(count) for count in shape)})'
        if array is None:
            raise TensionError(
                f'tensions must be numbers in rows of equal length, expected shape {expected}'
            )
        meaning = f'{len(arm.tendons)} tendons, section by section from the tip'
        if len(shape) == 2:
            meaning = f'{shape[0]} section(s) from the tip, {shape[1]} tendons each'
        raise TensionError(f'tensions have shape {array.shape}, expected {expected}: {meaning}')
    if not _is_fine(array):
        bad = ~((array >= 0.0) & (array < np.inf))
        index = tuple(int(i) for i in np.argwhere(bad)[0])
        tendon = int(np.ravel_multi_index(index[-len(shape) :], shape))
        lead = index[: -len(shape)]
        raise TensionError(
            f'tension of {arm.tendon_names[tendon]}{f" in set {lead}" if lead else ""} is '
            f'{float(array[index])!r} N, expected a finite number >= 0'
        )
    return array


def check_highest(arm: Arm, highest: ArrayLike) -> FloatArray:
    """Return largest tensions, one number or of `Arm.tension_shape`, as (tendons,) [N].

    Raises:
        TensionError: if they have another shape, or one is not finite and > 0.
    """
    given = real_numbers(highest)
    try:
        limits = np.broadcast_to(np.nan if given is None else given, arm.tension_shape).ravel()
    except ValueError:
        given = None
    if given is None:
        raise TensionError(
            f'highest is {shown(highest)}, expected one number or shape {arm.tension_shape}'
        )
    for name, value in zip(arm.tendon_names, limits.tolist(), strict=True):
        if not 0.0 < value < np.inf:
            raise TensionError(
                f'highest tension of {name} is {shown(value)} N, expected a finite number > 0'
            )
    return limits


def _is_fine(array: FloatArray) -> bool:
    """Whether all are finite and >= 0."""
    if 0 < array.size <= _FEW:
        # NaN and an overflow of the sum are decided by NumPy below.
        values = array.ravel().tolist()
        if min(values) >= 0.0 and math.isfinite(sum(values)):
            return True
    # NaN fails the first comparison, infinity the second.
    return not array.size or bool(array.min() >= 0.0 and array.max() < np.inf)


def _flatten_rows(arm: Arm, tensions: ArrayLike) -> ArrayLike:
    """One set of ``tensions`` in rows, one for each section of ``arm``, as one row."""
    if not isinstance(tensions, (list, tuple)) or len(tensions) != len(arm.sections):
        return tensions
    flat: list[float] = []
    for row, section in zip(tensions, arm.sections, strict=True):
        if not isinstance(row, (list, tuple)) or len(row) != len(section.tendons):
            return tensions
        flat += row
    return flat
