"""Batches of which some sets have no answer."""

from __future__ import annotations

import numpy as np

from octo_arm_model import Config, SolveError
from octo_arm_model.analysis.worker_pool import solve_parts


def test_every_set_has_its_shape_or_its_error(table4: Config) -> None:
    solver = table4.solver('closed_form')
    tensions = np.zeros((37, 3, 4))
    tensions[:, 0, 0] = np.linspace(0.0, 0.1, 37)
    refused = [0, 5, 6, 36]
    tensions[refused] = 1e3
    numbers: list[int] = []
    for part, found in solve_parts(solver, tensions):
        numbers += range(part.start, part.stop)
        if isinstance(found, SolveError):
            assert part.stop == part.start + 1 and part.start in refused
            continue
        assert not set(refused) & set(range(part.start, part.stop))
        expected = [solver.solve(one).tip for one in tensions[part]]
        np.testing.assert_allclose(found.tip, expected, rtol=0.0, atol=1e-12)
    assert numbers == list(range(37))


def test_a_batch_without_a_refusal_is_solved_at_once(table4: Config) -> None:
    ((part, found),) = solve_parts(table4.solver('closed_form'), np.zeros((5, 3, 4)))
    assert (part, len(found.tip)) == (slice(0, 5), 5)
