"""Cross sections of the model exact, tabulated for the compiled kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.sheath import SheathedSections

LANES = 64  # sections in each block that the kernels evaluate at once


class SectionTables(NamedTuple):
    """Cross sections of the model exact, as `SectionEnergy` has them.

    Attributes:
        axial: E A of each [N], (sections,).
        torsion: G I [N m^2], likewise.
        squared: square of the radius [m^2], likewise.
        lever_max: see `SectionEnergy`, likewise [m].
        x: offset of each tendon along n [m], (tendons, sections).
        y: along b.
        dx: slope of ``x``.
        dy: slope of ``y``.
        transmission: part of its tension that each tendon has there.
        acting: how many sections of each block of `LANES` lie before the last one that a tendon
            acts in, (tendons, blocks).
        sheath_compliance: of each tendon's sheath [1/Pa], see `SheathedSections`; of no tendon where all
            are rigid.
        farthest: largest distance of a tendon from the midline there [m], likewise.
        widens: whether the law is neo_hookean; else it is linear.
        planar: whether tendons cannot twist the arm.
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
    acting: IntArray
    sheath_compliance: FloatArray
    farthest: FloatArray
    widens: bool
    planar: bool


class ExactTables(NamedTuple):
    """What `exact` interpolates from.

    Attributes:
        sections: at the points of all panels.
        at_nodes: at the nodes.
        tail: matrix (points of a panel, 2) to the last two Chebyshev coefficients.
        runs: panel, first node and number of nodes of ranges of nodes in it, (runs, 3).
        to_nodes: matrices (points, nodes) from the points of a panel to these, one after another.
    """

    sections: SectionTables
    at_nodes: SectionTables
    tail: FloatArray
    runs: IntArray
    to_nodes: FloatArray


def section_tables(energy: SectionEnergy) -> SectionTables:
    """The cross sections of ``energy``."""
    x, y, dx, dy, transmission = (
        table[:, 0] for table in (energy.x, energy.y, energy.dx, energy.dy, energy.transmission)
    )
    sheath_compliance = farthest = np.zeros((0, 0))
    if isinstance(energy, SheathedSections):
        sheath_compliance, farthest = energy.sheath_compliance[:, 0], energy.farthest[:, 0]
    return SectionTables(
        axial=energy.stiffness.axial,
        torsion=energy.stiffness.torsion,
        squared=energy.radius**2,
        lever_max=energy.lever_max,
        x=x,
        y=y,
        dx=dx,
        dy=dy,
        transmission=transmission,
        acting=_acting(transmission),
        sheath_compliance=sheath_compliance,
        farthest=farthest,
        widens=energy.law.widens,
        planar=energy.planar,
    )


def _acting(transmission: FloatArray) -> IntArray:
    """See `SectionTables`."""
    tendons, sections = transmission.shape
    blocks = -(-sections // LANES)
    numbers = np.zeros((tendons, blocks * LANES), np.int64)
    place = np.arange(sections) % LANES + 1
    numbers[:, :sections] = np.where(transmission != 0.0, place, 0)
    return numbers.reshape(tendons, blocks, LANES).max(axis=2, initial=0)


def exact_tables(statics: Exact) -> ExactTables:
    """What ``statics`` interpolates from."""
    runs, matrices = [], []
    for panel, (nodes, matrix) in enumerate(statics.panels):
        # Nodes of a panel are two ranges: ends of intervals, and their middles.
        for part in np.split(np.arange(nodes.size), np.flatnonzero(np.diff(nodes) > 1) + 1):
            runs.append((panel, nodes[part[0]], part.size))
            matrices.append(matrix[:, part])
    return ExactTables(
        sections=section_tables(statics.at_points),
        at_nodes=section_tables(statics.sections),
        tail=statics.tail,
        runs=np.array(runs, np.int64).reshape(-1, 3),
        to_nodes=np.concatenate([np.zeros(0), *map(np.ravel, matrices)]),
    )


def no_exact() -> ExactTables:
    """Of another model."""
    none, table = np.zeros(0), np.zeros((0, 0))
    sections = SectionTables(
        none, none, none, none, table, table, table, table, table, np.zeros((0, 0), np.int64),
        table, table, False, False,
    )  # fmt: skip
    return ExactTables(sections, sections, np.zeros((0, 2)), np.zeros((0, 3), np.int64), none)
