"""Arms with friction that are the same, or are followed alike by two solvers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from helical_arm import PULL

from octo_arm_model import Backbone, Solver


def assert_same(found: Backbone, expected: Backbone, length: float) -> None:
    np.testing.assert_allclose(found.position, expected.position, rtol=0.0, atol=1e-9 * length)
    scale = max(float(expected.tensions.max()), 1e-9)
    for name in ('tendon_tensions', 'point_tensions'):
        one, other = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-8 * scale)


def assert_pulled_alike(machine: Solver, plain: Solver, parts: Sequence[float]) -> None:
    """Check that machine code follows a helical arm under ``parts`` of `PULL` as NumPy does."""
    assert machine.is_compiled and not plain.is_compiled
    one = other = None
    for part in parts:
        one, other = machine.follow(part * PULL, one), plain.follow(part * PULL, other)
        assert_same(one, other, machine.arm.length)
        # Each may go on from what the other has found.
        one, other = other, one
