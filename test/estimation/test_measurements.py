"""Predicted measurements and their derivatives; errors of invalid ones."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from differences import jacobian
from estimation_arms import EVERYTHING, LIKELY, RUBBER, TENSIONS, WEIGHT, rubber
from scipy.spatial.transform import Rotation

from octo_arm_model import DistributedLoad, Loads, Material, PointLoad, Solver, displacements_of
from octo_arm_model.arm.errors import ConfigError, MeasurementError
from octo_arm_model.arm.loads import ScaledLoads
from octo_arm_model.estimation.measurements import (
    BaseWrench,
    Curvatures,
    Markers,
    Measurement,
    TendonDisplacements,
    Tensions,
    TipPose,
    TipPosition,
)
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk

SOME_PLACE = np.array([0.03, 0.11, 0.2])
TURNED = Rotation.from_rotvec([0.3, -0.2, 0.5])
MEASUREMENTS: dict[str, Callable[[], Measurement]] = {
    'tensions': lambda: Tensions([0.5, 0.3], 0.1, ('tendon_1_3', 'tendon_1_1')),
    'displacements': lambda: TendonDisplacements(np.zeros(4), 1e-3),
    'tip position': lambda: TipPosition(np.zeros(3), 1e-3),
    'tip pose': lambda: TipPose([0.1, 0.0, 0.0], TURNED.as_quat(), np.full(6, 0.1)),
    'markers': lambda: Markers(SOME_PLACE, np.zeros((3, 3)), 1e-3),
    'curvatures': lambda: Curvatures(SOME_PLACE, np.zeros((3, 2)), 1.0),
    'base wrench': lambda: BaseWrench(np.zeros(6), 0.1),
}


VALUES = {
    'tension': TENSIONS,
    'tension_bias': [0.1, -0.05, 0.02, 0.0],
    'tip_force': [0.004, -0.003, 0.006],
    'tip_moment': [1e-4, 2e-4, -1e-4],
    'point_forces': [0.005, 0.008, -0.004],
    'current': [0.2, -0.3, 0.5],
    'log_modulus': [0.1],
    'tension_loss': [0.02, 0.1, 0.0, 0.05],
}


def state_of(model: ArmModel) -> np.ndarray:
    """Return a state without zeros."""
    x = np.empty(model.state.size)
    for name, value in VALUES.items():
        place = getattr(model.state, name)
        x[place] = value[: place.stop - place.start]
    return x


ELASTIC = dataclasses.replace(
    RUBBER, axial_stiffness=(200.0, 300.0, 0.0, 100.0), free_length=(0.1, 0.2, 0.3, 0.0)
)
AT_TIP = Unknowns(Walk(5.0), tip_force=LIKELY)
PAPERS = Unknowns(Walk(5.0), log_modulus=Walk(0.05))


@pytest.mark.parametrize(
    ('model', 'name'),
    [
        *((rubber(EVERYTHING, loads=WEIGHT), name) for name in MEASUREMENTS),
        *((rubber(PAPERS, model), 'tip pose') for model in ('closed_form', 'renda2012')),
        (ArmModel(ELASTIC, AT_TIP, stations=31), 'displacements'),
    ],
    ids=[*MEASUREMENTS, 'closed_form', 'renda2012', 'elastic tendons'],
)
def test_derivatives_by_the_state_equal_finite_differences(model, name):
    item, scale = MEASUREMENTS[name](), model.state.prior_stddev()
    truth = Prediction(model, state_of(model), None)
    numeric = jacobian(
        lambda y: item.innovation(Prediction(model, y, truth.solved)),
        truth.x,
        3e-3 * np.minimum(scale, 1.0),
    )
    analytic, expected = item.jacobian(truth) * scale, -numeric * scale
    np.testing.assert_allclose(analytic, expected, atol=1e-6 * np.abs(expected).max(), rtol=0)


def test_state_changes_modulus_loads_and_tensions_of_the_solver():
    model = rubber(EVERYTHING, loads=WEIGHT)
    x = state_of(model)
    prediction = Prediction(model, x, None)
    stiffer = Material(1.1e5 * np.exp(0.1), 0.5, 1080.0)
    pressure = np.array([0.2, -0.3, 0.5])
    ends = tuple(tuple(2.0 * radius * pressure) for radius in (0.0075, 0.003))
    loads = dataclasses.replace(
        WEIGHT,
        tip_force=tuple(np.array(WEIGHT.tip_force) + x[model.state.tip_force]),
        tip_moment=tuple(x[model.state.tip_moment]),
        points=(PointLoad(0.12, tuple(x[model.state.point_forces])),),
        distributed=(DistributedLoad((0.0, 0.2), ends),),
    )
    arm = dataclasses.replace(RUBBER, material=stiffer)
    solver = Solver(arm, 'exact', 31, loads=loads)
    expected = solver.solve([TENSIONS * np.exp(-x[model.state.tension_loss])])
    np.testing.assert_allclose(prediction.solved.position, expected.position, atol=1e-9)
    backbone = prediction.backbone_at(x)
    np.testing.assert_allclose(backbone.tensions, [TENSIONS])
    np.testing.assert_allclose(backbone.tip_wrench, [*loads.tip_force, *loads.tip_moment])
    lengths = solver.tendon_lengths(expected).ravel()
    np.testing.assert_allclose(prediction.tendon_lengths, lengths, atol=1e-9)


def test_exact_values_leave_no_innovation():
    model = rubber(EVERYTHING, loads=WEIGHT)
    at = Prediction(model, state_of(model), None)
    shape = at.solved
    lengths = model.solver.rest_lengths.ravel() - at.tendon_lengths
    s = shape.s[[3, 17, 30]]
    for item in (
        Tensions(TENSIONS + [0.1, -0.05, 0.02, 0.0], 0.1),
        TendonDisplacements(lengths[[2]], 1e-3, ('tendon_1_3',)),
        TipPosition(shape.tip, 1e-3),
        TipPose(shape.tip, shape.quaternion[-1], 1e-3),
        Markers(s, shape.position[[3, 17, 30]], 1e-3),
        Curvatures(s, np.stack([shape.xi, shape.k], axis=1)[[3, 17, 30]], 1e-3),
    ):
        np.testing.assert_allclose(item.innovation(at), 0.0, atol=1e-12)


def test_markers_between_stations_are_interpolated():
    coarse, fine = (ArmModel(RUBBER, Unknowns(Walk(5.0)), stations=count) for count in (31, 301))
    x = np.array([1.0, 0.0, 0.3, 0.2])
    at, finer = (Prediction(model, x, None) for model in (coarse, fine))
    between = [155, 203]
    markers = Markers(finer.solved.s[between], finer.solved.position[between], 1e-3)
    np.testing.assert_allclose(markers.innovation(at), 0.0, atol=1e-6)


def test_base_wrench_is_the_sum_of_all_loads():
    model = rubber(EVERYTHING, loads=WEIGHT)
    x = state_of(model)
    at = Prediction(model, x, None)
    wrench_measured = -BaseWrench(np.zeros(6), 1.0).innovation(at)
    # By the trapezoidal rule on a fine grid.
    fine = ArmModel(RUBBER, EVERYTHING, loads=WEIGHT, stations=2001)
    shape = Prediction(fine, x, None).solved
    radius = RUBBER.body.radius(shape.s)
    per_length = np.outer(np.pi * radius**2, 80.0 * np.array(WEIGHT.gravity))
    per_length += np.outer(2.0 * radius, x[fine.state.current])
    steps = np.diff(shape.s)
    weights = np.zeros(shape.s.size)
    weights[1:] += 0.5 * steps
    weights[:-1] += 0.5 * steps
    forces = per_length * weights[:, np.newaxis]
    forces[np.searchsorted(shape.s, 0.12 - 1e-9)] += x[fine.state.point_forces]
    wrench = fine.tip_wrench(x)
    forces[-1] += wrench[:3]
    expected = np.concatenate(
        [forces.sum(axis=0), np.cross(shape.position, forces).sum(axis=0) + wrench[3:]]
    )
    scale = np.repeat([np.abs(expected[:3]).max(), np.abs(expected[3:]).max()], 3)
    np.testing.assert_allclose(wrench_measured / scale, expected / scale, atol=5e-5)


@pytest.mark.parametrize(
    ('make', 'message'),
    [
        (lambda: TipPosition([0.0, 0.0, 0.0], 0.0), r'deviation of 0, expected 1e-30 to 1e\+30'),
        (lambda: TipPosition([0.0, 0.0, 0.0], 1e200), r'standard deviation of 1e\+200, expected'),
        (lambda: TipPosition(np.zeros(3), 1e-300 * np.eye(3)), 'standard deviation of 1e-150'),
        (lambda: TipPosition(np.zeros(3), np.diag([1.0, 1e300, 1.0])), r'deviation of 1e\+150'),
        (lambda: TipPosition([0.0, -1e31, 0.0], 1e-3), r'expected numbers of at most 1e\+30'),
        (lambda: TipPosition([0.0, 0.0, 0.0], [1.0, 1.0]), '3 standard deviations'),
        (lambda: Markers([0.1], np.zeros((2, 3)), 1.0), '6 numbers, expected 3'),
        (lambda: Tensions([1.0], 0.1, ('no_such',)).innovation(_any()), 'unknown tendon no_such'),
        (lambda: Tensions([1.0, 2.0], 0.1).innovation(_any()), 'expected 4: one for each tendon'),
        (lambda: Markers([0.3], [[0, 0, 0]], 1.0).innovation(_any()), r'within \[0, 0.2\]'),
        (lambda: Walk(0.0), 'stddev'),
        (lambda: Walk(1.0, -1.0), 'rate'),
        (lambda: Walk(1.0, 1.0, 0.0), 'correlation_time'),
        (lambda: rubber(Unknowns(Walk(1.0), point_forces=(PointForce(0.3, LIKELY),))), '0.3'),
    ],
)
def test_invalid_measurements_are_refused(make, message):
    with pytest.raises(MeasurementError, match=message):
        make()


def _any() -> Prediction:
    model = rubber(Unknowns(Walk(5.0)))
    return Prediction(model, TENSIONS, None)


def test_arms_that_the_state_does_not_describe_are_refused():
    unknowns = Unknowns(Walk(1.0), log_modulus=Walk(0.1))
    for loaded in (Unknowns(Walk(1.0), tip_force=LIKELY), Unknowns(Walk(1.0), current=LIKELY)):
        with pytest.raises(ConfigError, match='choose exact'):
            rubber(loaded, 'closed_form')
    with pytest.raises(ConfigError, match='friction, expected an unknown tension_loss'):
        ArmModel(dataclasses.replace(RUBBER, friction=(0.1,) * 4), Unknowns(Walk(1.0)))
    with pytest.raises(MeasurementError, match='tension has 2 priors, expected one or 4'):
        rubber(Unknowns((Walk(1.0), Walk(2.0))))
    with pytest.raises(ConfigError, match=r'loads.scaled .*, expected none'):
        rubber(Unknowns(Walk(1.0)), loads=Loads(scaled=ScaledLoads([])))
    with pytest.raises(ConfigError, match='sheath_stiffness'):
        ArmModel(dataclasses.replace(RUBBER, sheath_stiffness=(1e5,) * 4), unknowns)


def test_displacements_include_the_stretch_of_tendons():
    force, solver = [0.004, -0.003, 0.006], Solver(ELASTIC, 'exact', 31)
    truth = Prediction(ArmModel(ELASTIC, AT_TIP, stations=31), np.append(TENSIONS, force), None)
    shape = solver.solve([TENSIONS], [*force, 0.0, 0.0, 0.0])
    item = TendonDisplacements(displacements_of(solver, shape), 1e-3)
    np.testing.assert_allclose(item.innovation(truth), 0.0, atol=1e-11)


def test_second_derivatives_of_the_tip_equal_finite_differences():
    unknowns = Unknowns(
        Walk(0.3), Walk(0.1), tip_force=LIKELY, log_modulus=Walk(0.1), tension_loss=Walk(0.3)
    )
    model = rubber(unknowns, loads=WEIGHT)
    x = np.concatenate([TENSIONS, np.zeros(4), [0.004, -0.003, 0.006], [0.1], 0.2 * TENSIONS])
    at = Prediction(model, x, None)
    tip = TipPosition(at.solved.tip, 1e-3)
    second = tip.second(at)
    stddev = model.state.prior_stddev()
    expected = np.zeros_like(second)
    for component in range(x.size):
        step = 1e-3 * stddev * (np.arange(x.size) == component)
        ends = [tip.jacobian(Prediction(model, x + each, at.solved)) for each in (step, -step)]
        expected[:, :, component] = (ends[0] - ends[1]) / (2.0 * step[component])
    # The second derivatives neglect the change of the sections' stiffness.
    second, expected = (each * stddev * stddev[:, np.newaxis] for each in (second, expected))
    state = model.state
    for block, bound in ((slice(None), 0.1), (state.tip_force, 0.05), (state.tension_loss, 0.1)):
        error = np.linalg.norm((second - expected)[:, block, block])
        assert error < bound * np.linalg.norm(expected[:, block, block])
