"""What dead loads do to a shape, against differences and against the wrench on the tip."""

from __future__ import annotations

import numpy as np
import pytest
from differences import jacobian

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    Body,
    ConfigError,
    DistributedLoad,
    Loads,
    Material,
    PointLoad,
    Section,
    Solver,
)

ARM = Arm(Material(1.1e5, 0.4, 1080.0), Body(0.4, 0.015, 0.006), (Section(0.4, 0.008, 0.004),))
TENSIONS = [[0.4, 0.6, 0.1, 0.2]]
ACTING = Loads(gravity=(0.0, 2.0, -3.0), points=(PointLoad(0.15, (0.0, 0.01, 0.01)),))
# Each of a magnitude that bends the arm visibly.
EACH = (
    Loads(points=(PointLoad(0.15, (0.01, 0.02, 0.0), (0.0, 1e-3, 0.0)),)),
    Loads(gravity=(0.0, 1.0, 1.0), fluid_density=400.0),
    Loads(distributed=(DistributedLoad((0.15, 0.4), ((0, 0.1, 0), (0, 0, 0.1))),)),
)


def with_magnitudes(magnitudes: np.ndarray) -> Loads:
    point, weight, distributed = magnitudes
    more = EACH[0].points[0]
    points = PointLoad(
        more.s, tuple(point * np.array(more.force)), tuple(point * np.array(more.moment))
    )
    spread = EACH[2].distributed[0]
    # Weight in a fluid of 400 kg/m^3 is that of a density less by this.
    part = weight * (1080.0 - 400.0) / 1080.0
    gravity = np.array(ACTING.gravity) + part * np.array(EACH[1].gravity)
    return Loads(
        gravity=tuple(gravity),
        points=(*ACTING.points, points),
        distributed=(DistributedLoad(spread.s, tuple(
            tuple(distributed * np.array(force)) for force in spread.force
        )),),
    )  # fmt: skip


@pytest.mark.parametrize(('law', 'shear'), [('neo_hookean', False), ('linear', True)])
def test_by_differences(law: str, shear: bool) -> None:
    def solver(magnitudes: np.ndarray) -> Solver:
        return Solver(
            ARM, 'exact', 41, material=law, shear=shear, loads=with_magnitudes(magnitudes)
        )

    def outcome(magnitudes: np.ndarray) -> np.ndarray:
        own = solver(magnitudes)
        shape = own.solve(TENSIONS)
        strain = np.stack([shape.tau, shape.xi, shape.k, shape.q], axis=1)
        lengths = own.tendon_lengths(shape)
        return np.concatenate([shape.position.ravel(), strain.ravel(), lengths.ravel()])

    own = solver(np.zeros(3))
    change = own.sensitivity_to_loads(own.solve(TENSIONS), EACH)
    found = np.concatenate([
        change.pose[:, :3].reshape(-1, 3), change.strain.reshape(-1, 3), change.tendon_length
    ])  # fmt: skip
    expected = jacobian(outcome, np.zeros(3), 0.05)
    positions = 3 * 41
    parts = slice(0, positions), slice(positions, 7 * 41), slice(7 * 41, None)
    for part, rough in zip(parts, (2e-5, 1e-4, 2e-5), strict=True):
        atol = rough * np.abs(expected[part]).max()
        np.testing.assert_allclose(found[part], expected[part], atol=atol, rtol=0)


def test_what_has_no_such_derivative_is_refused() -> None:
    papers = Solver(ARM, 'closed_form', 41)
    with pytest.raises(ConfigError, match='choose exact'):
        papers.sensitivity_to_loads(papers.solve(TENSIONS), EACH)
    exact = Solver(ARM, 'exact', 41)
    shape = exact.solve(TENSIONS)
    with pytest.raises(ArmDefinitionError, match='loads: s'):
        exact.sensitivity_to_loads(shape, [Loads(points=(PointLoad(0.5, (1.0, 0.0, 0.0)),))])
