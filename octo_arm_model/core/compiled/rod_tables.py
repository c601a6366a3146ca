"""A loaded rod, tabulated for the compiled kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.section_tables import SectionTables, no_exact, section_tables
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.equilibrium import Equilibrium


class RodTables(NamedTuple):
    """A loaded rod, as `Equilibrium` has it.

    Attributes:
        sections: at the points of all elements.
        from_start: matrix of the integrals within an element from its start, (each, each).
        from_start_columns: its columns as rows.
        to_end_columns: likewise of the integrals to its end.
        weights: of the integral over an element of length one, (each,).
        step: lengths of the elements [m], (elements,).
        force: resultant of the loads beyond each point [N], (3, points).
        moment: of the moments of point loads [N m], likewise.
        base: orientation of the base w, x, y, z, (4,).
        length: of the arm [m].
    """

    sections: SectionTables
    from_start: FloatArray
    from_start_columns: FloatArray
    to_end_columns: FloatArray
    weights: FloatArray
    step: FloatArray
    force: FloatArray
    moment: FloatArray
    base: FloatArray
    length: float


def rod_tables(problem: Equilibrium) -> RodTables:
    """The rod of ``problem``."""
    own, rule = problem.collocation, problem.collocation.rule
    a, b = problem.base.a.item(), problem.base.b.item()
    return RodTables(
        sections=section_tables(problem.energy),
        from_start=rule.from_start,
        from_start_columns=rule.from_start.T,
        to_end_columns=rule.to_end.T,
        weights=rule.weights,
        step=own.step,
        force=problem.loads.dead.force,
        moment=problem.loads.dead.moment,
        base=np.array([a.real, a.imag, b.real, b.imag]),
        length=own.length,
    )


def no_rod() -> RodTables:
    """Of no arm."""
    none, table = np.zeros(0), np.zeros((0, 0))
    nothing = np.zeros((3, 0))
    return RodTables(
        no_exact().sections, table, table, table, none, none, nothing, nothing, np.zeros(4), 1.0
    )
