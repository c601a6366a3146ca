"""Loads of magnitude one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from octo_arm_model import Config, ProfiledBody, Table
from octo_arm_model.arm.limits import MAX_TABLE_POINTS
from octo_arm_model.estimation.unit_loads import unit_loads
from octo_arm_model.estimation.unknowns import Unknowns, Walk


@pytest.mark.parametrize('points', [3, 40, MAX_TABLE_POINTS - 1, MAX_TABLE_POINTS])
def test_a_current_pushes_with_the_diameter_whatever_table_it_is_of(
    prototype: Config, points: int
) -> None:
    length, body = prototype.arm.length, prototype.arm.body
    s = np.linspace(0.0, length, points)
    table = Table(tuple(s), tuple(body.radius(s)))
    arm = dataclasses.replace(prototype.arm, body=ProfiledBody(length, table))
    loads = unit_loads(arm, Unknowns(Walk(0.1), current=Walk(1.0)))
    assert len(loads) == 3
    for axis, load in enumerate(loads):
        (along,) = load.distributed
        force = np.array(along.force)
        np.testing.assert_allclose(force[:, axis], 2.0 * body.radius(np.array(along.s)), rtol=1e-6)
        assert not np.delete(force, axis, axis=1).any()
