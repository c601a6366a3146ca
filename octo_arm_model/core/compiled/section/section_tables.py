"""Tables of cross sections of the model exact for the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.sheaths.sheath import SheathedSections

LANES = 64  # sections in a block, at most


class SectionTables(NamedTuple):
    """Cross sections of the model exact, see `SectionEnergy`.

    Attributes:
        axial: E A of each [N], (sections,).
        torsion: G I [N m^2], likewise.
        squared: square of the radius [m^2], likewise.
        lever_max: see `SectionEnergy`, likewise [m].
        x: offset of each tendon along n [m], (tendons, sections).
        y: along b.
        dx: slope of ``x``.
        dy: slope of ``y``.
        transmission: local tension of each tendon over that at the base, likewise.
        blocks: first section and number of sections of each block, (blocks, 2).
        acting: number of leading sections of a block that include all in which a tendon acts,
            (tendons, blocks).
        sheath_compliance: see `SheathedSections` [1/Pa], (tendons, sections); (0, 0) where all
            sheaths are rigid.
        farthest: largest admissible distance of a tendon from the midline [m], likewise.
        widens: whether the law is neo_hookean; else it is linear.
        planar: see `SectionEnergy`.
    """

    axial: FloatArray
    torsion: FloatArray
    squared: FloatArray
    lever_max: FloatArray
    x: FloatArray
    y: FloatArray
    dx: FloatArray
    dy: FloatArray
    transmission: FloatArray
    blocks: IntArray
    acting: IntArray
    sheath_compliance: FloatArray
    farthest: FloatArray
    widens: bool
    planar: bool


class ExactTables(NamedTuple):
    """`UnloadedExact`: cross sections, and the interpolation from points to nodes.

    Attributes:
        sections: cross sections at the points of all panels.
        at_nodes: cross sections at the nodes, panel by panel.
        node_blocks: first block of ``at_nodes`` in each panel, and that after the last,
            (panels, 2).
        tail: matrix (points of a panel, 2) to the last two Chebyshev coefficients.
        uneven: see `UnloadedExact`, (panels,).
        runs: panel, first node and number of nodes of each run of nodes in one panel, (runs, 3).
        to_nodes: matrices (points, nodes) from the points of a panel to a run, one after another.
    """

    sections: SectionTables
    at_nodes: SectionTables
    node_blocks: IntArray
    tail: FloatArray
    uneven: NDArray[np.bool_]
    runs: IntArray
    to_nodes: FloatArray


def section_tables(
    energy: SectionEnergy, groups: Sequence[IntArray] | None = None
) -> SectionTables:
    """Tables of the cross sections of ``energy``, or of those with the indices in ``groups``.

    In the order of ``groups``; no block extends over two of them.
    """
    if groups is None:
        groups = [np.arange(energy.s.size)]
    order = np.concatenate([np.zeros(0, np.int64), *groups])

    def of_tendons(table: FloatArray) -> FloatArray:
        return table[:, 0, order]

    transmission, blocks = of_tendons(energy.transmission), _blocks(groups)
    sheath_compliance = farthest = np.zeros((0, 0))
    if isinstance(energy, SheathedSections):
        sheath_compliance = of_tendons(energy.sheath_compliance)
        farthest = of_tendons(energy.farthest)
    return SectionTables(
        axial=energy.stiffness.axial[0, order],
        torsion=energy.stiffness.torsion[0, order],
        squared=energy.radius[0, order] ** 2,
        lever_max=energy.lever_max[0, order],
        x=of_tendons(energy.x),
        y=of_tendons(energy.y),
        dx=of_tendons(energy.dx),
        dy=of_tendons(energy.dy),
        transmission=transmission,
        blocks=blocks,
        acting=_acting(transmission, blocks),
        sheath_compliance=sheath_compliance,
        farthest=farthest,
        widens=energy.law.widens,
        planar=energy.planar,
    )


def _blocks(groups: Sequence[IntArray]) -> IntArray:
    """`SectionTables.blocks` of groups of sections."""
    blocks, start = [], 0
    for group in groups:
        stop = start + group.size
        blocks += [(first, min(LANES, stop - first)) for first in range(start, stop, LANES)]
        start = stop
    return np.array(blocks, np.int64).reshape(-1, 2)


def _acting(transmission: FloatArray, blocks: IntArray) -> IntArray:
    """`SectionTables.acting`."""
    acting = np.zeros((len(transmission), len(blocks)), np.int64)
    for number, (first, count) in enumerate(blocks):
        acts = transmission[:, first : first + count] != 0.0
        acting[:, number] = (acts * np.arange(1, count + 1)).max(axis=1)
    return acting


def exact_tables(statics: Exact) -> ExactTables:
    """Tables of the unloaded arm of ``statics``."""
    runs, matrices = [], []
    for panel, (nodes, matrix) in enumerate(statics.unloaded.panels):
        # Nodes of a panel are consecutive but for gaps: ends of intervals, then middles.
        for part in np.split(np.arange(nodes.size), np.flatnonzero(np.diff(nodes) > 1) + 1):
            runs.append((panel, nodes[part[0]], part.size))
            matrices.append(matrix[:, part])
    groups = [nodes for nodes, _ in statics.unloaded.panels]
    counts = np.array([len(_blocks([group])) for group in groups], np.int64)
    stops = np.cumsum(counts)
    return ExactTables(
        sections=section_tables(statics.unloaded.at_points),
        at_nodes=section_tables(statics.sections, groups),
        node_blocks=np.stack([stops - counts, stops], axis=1),
        tail=statics.unloaded.tail,
        uneven=statics.unloaded.uneven,
        runs=np.array(runs, np.int64).reshape(-1, 3),
        to_nodes=np.concatenate([np.zeros(0), *map(np.ravel, matrices)]),
    )


def no_exact() -> ExactTables:
    """Empty tables of the types of `exact_tables`."""
    none, table = np.zeros(0), np.zeros((0, 0))
    numbers, pairs = np.zeros((0, 0), np.int64), np.zeros((0, 2), np.int64)
    sections = SectionTables(
        none, none, none, none, table, table, table, table, table, pairs, numbers, table, table,
        False, False,
    )  # fmt: skip
    return ExactTables(
        sections, sections, pairs, np.zeros((0, 2)), np.zeros(0, bool), np.zeros((0, 3), np.int64),
        none,
    )  # fmt: skip
