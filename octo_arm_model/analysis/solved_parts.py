"""Batches of tensions some of which have no answer: solved in parts that have one each."""

from __future__ import annotations

from collections.abc import Iterator

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import Solver


def solve_parts(
    solver: Solver, tensions: FloatArray, first: int = 0
) -> Iterator[tuple[slice, Backbone | SolveError]]:
    """Shapes of all sets of ``tensions`` (n, ...), which are numbered from ``first`` on.

    A batch with a set that has none is halved, down to that set, which has its error.
    """
    part = slice(first, first + len(tensions))
    try:
        yield part, solver.solve(tensions)
    except SolveError as error:
        half = len(tensions) // 2
        if not half:
            yield part, error
            return
        yield from solve_parts(solver, tensions[:half], first)
        yield from solve_parts(solver, tensions[half:], first + half)
