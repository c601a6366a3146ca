"""Kernels for the places of tendons with friction in compliant sheaths.

They are the compiled counterpart of `sheaths.sheath`, with the tensions at the points given as the
``transmission`` of the sections. Offsets of the tendons from their paths are stored by blocks of
sections, (blocks, pulled, 2 `LANES`) as in `sheath_kernels`, and have size 0 where all sheaths are
rigid.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.friction.turning_kernels import STRAIN, set_strain
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.compiled.section.section_rows import FREE, WIDTH, T
from octo_arm_model.core.compiled.section.section_tables import LANES, SectionTables
from octo_arm_model.core.compiled.section.sheath_kernels import (
    MOST_OFFSET_STEPS,
    OFFSET_TOLERANCE,
    step_offset,
)
from octo_arm_model.core.hints import FloatArray, IntArray


def no_offsets(sections: SectionTables, pulled: int) -> FloatArray:
    """Make zero offsets of a number of ``pulled`` tendons, which stand on their paths."""
    each = 2 * LANES if sections.sheath_compliance.size else 0
    return np.zeros((len(sections.blocks), pulled, each))


def place_tendons(
    sections: SectionTables, twist: FloatArray, pulled: IntArray, offsets: FloatArray,
    place: FloatArray,
) -> None:  # fmt: skip
    """Fill in the ``place`` (2, pulled, points) of tendons in compliant sheaths [m].

    It is the position along n and b at which a tendon is in equilibrium with its sheath under
    ``twist`` (4, points). Newton's method for the ``offsets`` begins at the given ones and
    overwrites them.
    """
    strain = np.empty((STRAIN, twist.shape[1]))
    set_strain(sections.widens, twist, strain)
    rows = np.zeros(FREE)
    for block in range(len(sections.blocks)):
        first, count = sections.blocks[block]
        last = first + count
        for k in range(4):
            rows[T + k * LANES : T + k * LANES + count] = strain[k, first:last]
        rows[WIDTH : WIDTH + count] = strain[4, first:last]
        for number in range(pulled.size):
            tendon = pulled[number]
            for _ in range(MOST_OFFSET_STEPS):
                if not step_offset(
                    sections.acting[tendon, block], 1.0,
                    sections.transmission[tendon, first:last],
                    sections.x[tendon, first:last], sections.y[tendon, first:last],
                    sections.dx[tendon, first:last], sections.dy[tendon, first:last],
                    sections.sheath_compliance[tendon, first:last],
                    sections.lever_max[first:last], rows, offsets[block, number],
                ) > OFFSET_TOLERANCE:  # fmt: skip
                    break
    set_places(sections.blocks, sections.x, sections.y, pulled, offsets, place)


@borrows
def set_places(
    blocks: IntArray, x: FloatArray, y: FloatArray, pulled: IntArray, offsets: FloatArray,
    place: FloatArray,
) -> None:  # fmt: skip
    """Fill in the ``place`` (2, pulled, points) of tendons along n and b [m].

    It is the sum of the path ``x``, ``y`` (tendons, points) and the ``offsets`` from it.
    """
    for number in range(pulled.size):
        tendon = pulled[number]
        for i in range(place.shape[2]):
            place[0, number, i], place[1, number, i] = x[tendon, i], y[tendon, i]
        if offsets.size:
            for block in range(len(blocks)):
                first, count = blocks[block, 0], blocks[block, 1]
                for i in range(count):
                    place[0, number, first + i] += offsets[block, number, i]
                    place[1, number, first + i] += offsets[block, number, LANES + i]
