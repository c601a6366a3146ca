"""The wrap angles of tendons as loops for numba; `section_arrays` has them for NumPy."""

import numpy as np

from octo_arm_model.arm.hints import BoolArray, FloatArray
from octo_arm_model.rod.compiled import compiled, helper
from octo_arm_model.rod.section_loops import SectionTables, cross, section_tables, tangent
from octo_arm_model.rod.tables import Tables, Work

_ROUGH = 0.5  # cosine between bends of a tendon at the ends of an element, see `angles`


def angles(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
    """Compute the angle by which every taut tendon has turned between the base and every node.

    It is the integral of |e' + kappa x e|, e the unit tangent in the axes of the section, and the
    angles between tangents where strains jump. The norm has a kink where it vanishes, and is taken
    at fine points where it may. ``tensions`` displace tendons in sheaths.
    """
    sizes = tables.lengths, tables.weights, tables.sharp
    rule = (
        tables.to_point,
        tables.differentiation,
        tables.ends,
        tables.to_fine,
        tables.fine_weights,
    )
    own = section_tables(tables)
    _fill_angles(sizes, rule, own, (z, tensions), tables.friction, work.offsets, work.angle)


@compiled
def _fill_angles(
    sizes: tuple[FloatArray, FloatArray, BoolArray],
    rule: tuple[FloatArray, ...],
    of_sections: SectionTables,
    of_nodes: tuple[FloatArray, FloatArray],
    friction: FloatArray,
    offsets: FloatArray,
    angle: FloatArray,
) -> None:
    lengths, weights, sharp = sizes
    to_point, differentiation, ends, to_fine, fine_weights = rule
    active, (z, tensions) = of_sections[4], of_nodes
    points, strain = to_point.shape[0], np.empty(6)
    unit, bend, rate = np.empty((points, 3)), np.empty((points, 3)), np.empty(points)
    last, total = np.zeros((friction.size, 3)), np.zeros(friction.size)
    angle[:] = 0.0
    for e in range(lengths.size):
        start, h = e * points, lengths[e]
        for j in range(active[start]):
            if tensions[start, j] == 0.0 or friction[j] == 0.0:
                continue
            for k in range(points):
                i = start + k
                tangent(of_sections, i, j, z[i], tensions[i, j], strain, offsets[i, j], unit[k])
            kink = _kink(ends, unit, last[j])
            if sharp[e]:
                total[j] += kink
            _bends(differentiation, h, z[start : start + points], unit, bend, rate)
            along, end = 0.0, points - 1
            for c in range(3):
                along += bend[0, c] * bend[end, c]
            own = angle[start : start + points, j]
            if along < _ROUGH * rate[0] * rate[end]:
                total[j] = _turn_finely(to_fine, fine_weights, h, bend, total[j], own)
                continue
            for i in range(points):
                value = 0.0
                for k in range(points):
                    value += to_point[i, k] * rate[k]
                own[i] = total[j] + h * value
            for k in range(points):
                total[j] += weights[start + k] * rate[k]


@helper
def _kink(ends: FloatArray, unit: FloatArray, last: FloatArray) -> float:
    """Angle between the tangents at the start of an element and the ``last``, before it."""
    square = 0.0
    for c in range(3):
        first = end = 0.0
        for k in range(unit.shape[0]):
            first += ends[0, k] * unit[k, c]
            end += ends[1, k] * unit[k, c]
        square += (first - last[c]) ** 2
        last[c] = end
    return 2.0 * np.arcsin(min(0.5 * np.sqrt(square), 1.0))


@helper
def _bends(
    differentiation: FloatArray,
    h: float,
    z: FloatArray,
    unit: FloatArray,
    bend: FloatArray,
    rate: FloatArray,
) -> None:
    """Derivatives of the tangents ``unit`` (p, 3) by s, and their lengths."""
    for k in range(z.shape[0]):
        p = q = r = 0.0
        for n in range(z.shape[0]):
            slope = differentiation[k, n] / h
            p += slope * unit[n, 0]
            q += slope * unit[n, 1]
            r += slope * unit[n, 2]
        cross(z[k], unit[k], bend[k])
        p, q, r = bend[k, 0] + p, bend[k, 1] + q, bend[k, 2] + r
        bend[k, 0], bend[k, 1], bend[k, 2] = p, q, r
        rate[k] = np.sqrt(p * p + q * q + r * r)


@helper
def _turn_finely(
    to_fine: FloatArray,
    weights: FloatArray,
    h: float,
    bend: FloatArray,
    total: float,
    angle: FloatArray,
) -> float:
    """Angles (p,) of a tendon at the points of an element with its ``bend``, by fine points.

    From ``total`` at its start; returns that at its end.
    """
    points = bend.shape[0]
    for i in range(points):
        angle[i] = total
    for f in range(to_fine.shape[0]):
        p = q = r = 0.0
        for k in range(points):
            p += to_fine[f, k] * bend[k, 0]
            q += to_fine[f, k] * bend[k, 1]
            r += to_fine[f, k] * bend[k, 2]
        size = h * np.sqrt(p * p + q * q + r * r)
        for i in range(points):
            angle[i] += weights[i, f] * size
        total += weights[points, f] * size
    return total
