"""The filter on simulated arms: limits, consistency, observability and errors."""

import dataclasses
import math
from functools import partial

import numpy as np
import pytest
from estimation_arms import LIKELY, RUBBER, TENSIONS, WEIGHT, rubber
from scipy.spatial.transform import Rotation
from scipy.stats import binom, chi2

from octo_arm_model import (
    Body,
    Config,
    Discs,
    Loads,
    RectangularBody,
    RestShape,
    Solver,
    Uncertainty,
)
from octo_arm_model.arm.errors import MeasurementError, OctoArmError
from octo_arm_model.arm.loads import ZERO, DistributedLoad, PointLoad
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.estimation.estimate import Estimate, contact_of
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurements import (
    BaseWrench,
    Markers,
    TendonDisplacements,
    Tensions,
    TipPose,
    TipPosition,
)
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.rules import Rules
from octo_arm_model.estimation.smoother import smooth
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk

AT_TIP = Unknowns(Walk(10.0, 5.0), tip_force=LIKELY, tip_moment=Walk(2e-4))
FORCE_AT_TIP = Unknowns(Walk(10.0, 5.0), tip_force=LIKELY)


def truth(model: ArmModel, force: np.ndarray, tensions: np.ndarray = TENSIONS) -> Prediction:
    x = np.zeros(model.state.size)
    x[model.state.tension] = tensions
    x[model.state.tip_force] = force
    return Prediction(model, x, None)


def test_estimate_from_tensions_equals_the_solver_with_its_covariance():
    model = rubber(Unknowns(Walk(1e4)))
    estimate = Estimator({'': model}).add(0, [Tensions(TENSIONS, 0.02)]).estimate
    solver = Solver(RUBBER, 'exact', 31)
    expected = solver.solve([TENSIONS])
    np.testing.assert_allclose(estimate.backbone.position, expected.position, atol=1e-10)
    covariance = solver.tip_covariance(expected, Uncertainty(tension=0.02))
    np.testing.assert_allclose(
        estimate.pose_covariance[-1], covariance, atol=1e-9 * np.abs(covariance).max()
    )
    np.testing.assert_array_equal(estimate.pose_covariance[0], 0.0)
    assert not estimate.unobserved


def test_shape_is_not_extrapolated_to_a_state_that_is_far_away():
    at = truth(rubber(FORCE_AT_TIP), np.zeros(3))
    x = np.where(np.arange(at.x.size) == 6, 1.0, at.x)  # a force of 1 N, that moves the tip by 3 m
    shape = at.backbone_at(x)
    displacement = np.linalg.norm(shape.position - at.solved.position, axis=1).max()
    assert displacement == pytest.approx(0.2 * RUBBER.length)
    assert shape.tip_wrench[2] == 1.0


_ARM = load_parameters('renda2012_prototype') | {'material.density': 1080.0}
_DESCRIBED = {
    'base': {'base.position': [0.1, -0.2, 0.3], 'base.quaternion': [1.0, 0.0, 0.0, 0.0]},
    'weight': {'loads.gravity': [0.0, 0.0, -9.81], 'loads.fluid_density': 1000.0},
    'forces': {
        'loads.tip_force': [0.0, 0.002, 0.0],
        'loads.point_s': [0.1],
        'loads.point_force': [0.0, 0.0, 0.02],
    },
    'law': {'material.law': 'linear', 'material.shear': True},
    'stations': {'stations': 17, 'base.quaternion': [0.5, 0.5, 0.5, 0.5]},
    'load cells': {'tension_scale': [2.0, 0.5, 1.0, 4.0], 'tension_offset': [0.1, 0.0, -0.2, 0.3]},
}


@pytest.mark.parametrize('what', _DESCRIBED)
def test_parameters_of_the_arm_are_used(what):
    config = Config.from_parameters({**_ARM, **_DESCRIBED[what]})
    shape = config.solver('exact').solve([TENSIONS])
    readings = config.load_cells.readings(TENSIONS)
    tensions = Tensions(config.load_cells.scale_and_offset(readings), 0.02)
    unknowns = Unknowns(tension=Walk(5.0), tip_force=Walk(0.01))
    estimator = Estimator({'': ArmModel.of(config, unknowns)})
    estimate = estimator.add(0, [tensions, TipPosition(shape.tip, 1e-4)]).estimate
    assert estimate.refused == ()
    force = np.array(config.loads.tip_force)
    np.testing.assert_allclose(estimate.tip_wrench[:3], force, atol=2e-5)
    np.testing.assert_allclose(estimate.backbone.position, shape.position, atol=1e-5)
    # Without these parameters no force explains the tip, which is refused.
    without_parameters = Estimator({'': ArmModel(config.arm, unknowns)})
    far = TipPosition(shape.tip + [0.24, 0.0, 0.0], 1e-4)
    refused = without_parameters.add(0, [tensions, far]).estimate.refused
    assert refused == ('tip position',)


def test_displacement_longer_than_the_tendon_is_refused():
    estimator = Estimator({'': rubber(Unknowns(Walk(5.0)))})
    before = estimator.add(0, [Tensions(TENSIONS, 1e-2), TendonDisplacements([0] * 4, 1)]).estimate
    assert before.bank.agreement == (0.0, 1.0)  # of which only second derivatives tell
    with pytest.raises(MeasurementError, match='displacement of tendon_1_2 is 25 m, expected les'):
        estimator.add(0, [TendonDisplacements([0.0, 25.0, 0.0, 0.0], 1e-4)])
    np.testing.assert_array_equal(estimator.add(0, []).estimate.mean, before.mean)


STRIP = dataclasses.replace(
    RUBBER, body=RectangularBody(0.2, 0.015, 0.0125), rest=RestShape(-1.0, 3.0, 2.0)
)


@pytest.mark.parametrize(
    ('arm', 'law'), [(RUBBER, 'neo_hookean'), (STRIP, 'neo_hookean'), (STRIP, 'linear')]
)
def test_exact_tip_pose_gives_the_wrench(arm, law):
    # The strip has no weight, because otherwise another wrench gives the same tip.
    loads = WEIGHT if arm is RUBBER else dataclasses.replace(WEIGHT, gravity=ZERO)
    model = ArmModel(arm, AT_TIP, loads=loads, material=law, stations=31)
    x = np.concatenate([TENSIONS, [0.008, -0.006, 0.012], [1e-4, -2e-4, 1.5e-4]])
    exact = Prediction(model, x, None)
    shape = exact.solved
    pose = TipPose(shape.tip, shape.quaternion[-1], np.full(6, 1e-9))
    estimate = Estimator({'': model}).add(0, [Tensions(TENSIONS, 1e-9), pose]).estimate
    force = np.array(WEIGHT.tip_force)
    scale = np.linalg.norm(x[4:7])
    np.testing.assert_allclose(estimate.tip_wrench[:3] - force, x[4:7], atol=1e-6 * scale)
    np.testing.assert_allclose(estimate.tip_wrench[3:], x[7:], atol=1e-6 * 2e-4)
    np.testing.assert_allclose(estimate.backbone.position, shape.position, atol=1e-8)


def test_force_on_a_robot_with_discs_is_found():
    discs = Discs.evenly(4, RUBBER.length, 0.004, 0.002)
    arm = dataclasses.replace(RUBBER, body=Body(0.2, 0.0075, 0.0075), discs=discs)
    model = ArmModel(arm, FORCE_AT_TIP, loads=Loads(gravity=(0.0, 0.0, -9.81)), stations=31)
    at = truth(model, np.array([0.004, 0.012, -0.008]), 0.5 * TENSIONS)
    wrench = -BaseWrench(np.zeros(6), 1.0).innovation(at)
    mass = 1080.0 * np.pi * 0.0075**2 * 0.2 + 5 * 0.002
    assert wrench[2] == pytest.approx(-0.008 - 9.81 * mass, rel=1e-6)
    data = [
        Tensions(0.5 * TENSIONS, 1e-6),
        TipPosition(at.solved.tip, 1e-7),
        BaseWrench(wrench, 1e-5),
    ]
    estimate = Estimator({'': model}, Rules(gate=1.0 - 1e-12)).add(0, data).estimate
    np.testing.assert_allclose(estimate.tip_wrench[:3], [0.004, 0.012, -0.008], atol=1e-5)


def test_effect_of_friction_is_within_the_covariance():
    with_friction = dataclasses.replace(RUBBER, friction=(0.15,) * 4)
    force, tensions = np.array([0.002, -0.006, 0.005]), 2.0 * TENSIONS
    shape = Solver(with_friction, 'exact', 31).solve([tensions], np.append(force, np.zeros(3)))
    data = [Tensions(tensions, 0.005), TipPosition(shape.tip, 1e-3)]
    unknowns = dataclasses.replace(FORCE_AT_TIP, tension_loss=Walk(0.3))
    squares = {}
    for name, model in (
        ('unknown', ArmModel(with_friction, unknowns, stations=31)),
        ('ignored', rubber(FORCE_AT_TIP)),
    ):
        estimate = Estimator({'': model}, Rules(gate=1.0 - 1e-12)).add(0, data).estimate
        error, covariance = estimate.tip_wrench[:3] - force, estimate.tip_wrench_covariance[:3, :3]
        squares[name] = error @ np.linalg.solve(covariance, error)
    limit = chi2.ppf(0.999, 3)
    assert squares['unknown'] < limit < squares['ignored']


def test_axial_force_on_a_straight_arm_is_not_observable():
    unknowns = dataclasses.replace(FORCE_AT_TIP, tip_force=Walk(1e-3))
    model = rubber(unknowns)
    straight = truth(model, np.zeros(3), np.full(4, 0.3))
    data = [Tensions(np.full(4, 0.3), 1e-6), TipPosition(straight.solved.tip, 5e-4)]
    estimate = Estimator({'': model}).add(0, data).estimate
    axial, *across = np.sqrt(np.diag(estimate.tip_wrench_covariance)[:3])
    # The tip moves by F L / EA: hundredths of a millimetre for a force of the prior's size.
    assert axial == pytest.approx(1e-3, rel=0.01)
    assert max(across) < 0.3e-3
    assert estimate.unobserved == ('tip_force x keeps its prior',)


def simulated(seed: int, steps: int) -> list[tuple[Estimate, np.ndarray, Prediction]]:
    """Return estimates, true states and shapes of a run whose noise is as assumed."""
    rng = np.random.default_rng(seed)
    unknowns = Unknowns(
        Walk(1.0, 1.0),
        tension_bias=Walk.stationary(0.01, 1.0),
        tip_force=Walk.stationary(3e-3, 1.0),
        log_modulus=Walk(0.02),
    )
    model = rubber(unknowns, loads=WEIGHT)
    state = model.state
    stddev = state.prior_stddev()
    x = stddev * rng.normal(size=state.size)
    estimator, steps_ = Estimator({'': model}, Rules(gate=1.0 - 1e-9)), []
    pull = 1.0 + rng.uniform(0.0, 1.0, 4)
    for step in range(steps):
        if step:
            x = state.decay(0.1) * x + state.growth(0.1) * rng.normal(size=state.size)
        x[state.tension] = pull + 0.3 * np.sin(step + np.arange(4))
        real = Prediction(model, x, steps_[-1][2].solved if steps_ else None)
        shape = real.solved
        readings = x[state.tension] + x[state.tension_bias] + 2e-3 * rng.normal(size=4)
        position = shape.tip + 5e-4 * rng.normal(size=3)
        lengths = model.solver.rest_lengths.ravel() - real.tendon_lengths
        lengths = lengths + 2e-4 * rng.normal(size=4)
        data = [
            Tensions(readings, 2e-3),
            TipPosition(position, 5e-4),
            TendonDisplacements(lengths, 2e-4),
        ]
        steps_.append((estimator.add(step * 10**8, data).estimate, x.copy(), real))
    return steps_


@pytest.mark.parametrize('runs', [8, pytest.param(60, marks=pytest.mark.endurance)])
def test_errors_are_consistent_with_the_covariance(runs):
    steps = 3
    squares: dict[str, list[float]] = {'state': [], 'force': [], 'tip': [], 'innovation': []}
    covered = []
    for seed in range(runs):
        for estimate, x, real in simulated(seed, steps):
            state, tip = estimate.state, real.solved.tip
            error = estimate.mean - x
            assert estimate.normalised_square[1] == 11
            squares['innovation'].append(estimate.normalised_square[0] / 11)
            # True tensions do not follow the prior, so that only the other states are tested.
            rest = slice(state.tension_bias.start, state.size)
            for name, delta, covariance in (
                ('state', error[rest], estimate.covariance[rest, rest]),
                ('force', error[state.tip_force], estimate.tip_wrench_covariance[:3, :3]),
                ('tip', estimate.backbone.tip - tip, estimate.pose_covariance[-1, :3, :3]),
            ):
                square = delta @ np.linalg.solve(covariance, delta) / delta.size
                squares[name].append(float(square))
            force = np.abs(error[state.tip_force])
            limit = 1.96 * np.sqrt(np.diag(estimate.tip_wrench_covariance)[:3])
            covered.append(force < limit)
    for name, size in (('state', 8), ('force', 3), ('tip', 3)):
        # Errors within a run are correlated, so that a run counts as one sample.
        low, high = chi2.ppf([1e-4, 1.0 - 1e-4], runs * size) / (runs * size)
        mean = np.mean(squares[name])
        assert low < mean < high, (name, mean, low, high)
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], runs * steps * 11) / (runs * steps * 11)
    # In each first step the prior of tensions explains all four readings.
    expected = 1.0 - 4.0 / 11.0 / steps
    assert low * expected < np.mean(squares['innovation']) < high, (low, high)
    # Here too a run counts as one sample.
    low, high = binom.ppf([1e-4, 1.0 - 1e-4], 3 * runs, 0.95) / (3 * runs)
    assert low <= np.mean(covered) <= high


def test_slack_tendon_has_zero_tension():
    model = rubber(Unknowns(Walk(10.0), tension_bias=Walk(0.05)))
    readings = Tensions([1.0, -0.02, 0.5, 0.3], 0.01)
    estimate = Estimator({'': model}).add(0, [readings]).estimate
    assert estimate.tensions[1] == estimate.backbone.tensions[0, 1] == 0.0
    # The reading is bias and noise, in proportion to their variances.
    expected = -0.02 * 0.05**2 / (0.05**2 + 0.01**2)
    assert estimate.tension_bias[1] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize('wrong', ['0.5', True, None])
def test_values_that_are_not_numbers_are_refused(wrong):
    for build, names in (
        (lambda **given: Walk(**{'stddev': 1.0, **given}), ('stddev', 'rate', 'correlation_time')),
        (Rules, ('gate', 'cell_fault', 'sensor_fault', 'recover_after')),
        (partial(Estimator, {'': rubber(FORCE_AT_TIP)}), ('window', 'change_time')),
        (partial(Estimator({'': rubber(FORCE_AT_TIP)}).add, measurements=[]), ('stamp_ns',)),
    ):
        for name in names:
            with pytest.raises(MeasurementError, match=f'{name}.* is {wrong!r}, expected [^\n]*$'):
                build(**{name: wrong})


def test_invalid_arguments_are_refused():
    model = rubber(FORCE_AT_TIP)
    add = Estimator({'': model}).add
    for build, message in (
        (lambda: ArmModel(RUBBER, None), 'unknowns is None, expected an instance of Unknowns'),
        (lambda: ArmModel(RUBBER, Unknowns(5.0)), 'tension is 5.0, expected an instance of Walk'),
        (lambda: ArmModel(RUBBER, FORCE_AT_TIP, loads=5), 'loads is 5, expected an instance of L'),
        (lambda: ArmModel.of('arm.yaml', FORCE_AT_TIP), "config is 'arm.yaml', expected an inst"),
        (lambda: Estimator({'a': RUBBER}), r"'a'\] is Arm\(.*, expected an instance of ArmModel"),
        (lambda: Estimator({'': model}, 0.99), 'rules is 0.99, expected an instance of Rules'),
        (lambda: add(0, [TENSIONS]), r'a measurement is \[.*, expected an instance'),
        (lambda: add(0, Tensions(TENSIONS, 0.1)), 'measurements is <.*, expected an instance of'),
        (lambda: Estimator([model]), r'models is \[.*, expected an instance of Mapping'),
        (lambda: smooth(model, [(math.nan, [])]), 'time nan s comes after -inf s, expected them'),
        (lambda: add(math.nan, []), r'stamp_ns is nan, expected an int64 \[ns\]'),
        (lambda: add(1.5, []), 'stamp_ns is 1.5'),
        (lambda: add(10**400, []), 'stamp_ns is 10000'),
        (lambda: Estimator({'': model}, window=-1.0), 'window is -1'),
        (lambda: Rules(gate=1.0), 'gate is 1.0, expected'),
        (lambda: Rules(cell_fault=-0.1), 'cell_fault is -0.1, expected'),
        (lambda: Rules(recover_after=-1.0), 'recover_after is -1.0, expected'),
        *(
            (partial(Walk.stationary, 1.0, time), 'correlation_time of a walk')
            for time in (0.0, -1.0, math.nan)
        ),
    ):
        with pytest.raises(OctoArmError, match=message):
            build()


# The external wrench -----------------------------------------------------------------------------


TENSION = Walk(5.0, 1.0)
LENGTH = RUBBER.length
AREA = 0.5 * (0.015 + 0.006) * LENGTH  # lateral projection of the cone [m^2]
CURRENT = Walk.stationary(5.0, 1.0)  # [Pa]
KINDS = {
    'tip': Unknowns(TENSION, tip_force=LIKELY),
    'point': Unknowns(TENSION, point_forces=(PointForce(0.12, LIKELY),)),
    'current': Unknowns(TENSION, current=CURRENT),
    'none': Unknowns(TENSION),
}


def estimated(kind, measurements=()):
    data = [Tensions(TENSIONS, 0.01), *measurements]
    return Estimator({'': rubber(KINDS[kind])}).add(0, data).estimate


@pytest.mark.parametrize('kind', ['tip', 'point', 'current'])
def test_force_keeps_its_prior_with_tensions_only(kind):
    contact = contact_of(estimated(kind), RUBBER)
    np.testing.assert_allclose(contact.wrench, 0.0, atol=1e-12)
    scale = CURRENT.stddev * AREA if kind == 'current' else LIKELY.stddev
    deviation = np.sqrt(contact.covariance.diagonal())
    np.testing.assert_allclose(deviation, [scale] * 3 + [0.0] * 3, rtol=1e-9)
    assert contact.is_at_tip == (kind == 'tip')
    expected = {'tip': LENGTH, 'point': 0.12, 'current': math.nan}[kind]
    np.testing.assert_equal(contact.s, expected)
    assert contact_of(estimated('none'), RUBBER) is None


FORCE = np.array([1e-3, -4e-3, 8e-3])  # total force [N]
LOADS = {
    'tip': Loads(tip_force=tuple(FORCE)),
    'point': Loads(points=(PointLoad(0.12, tuple(FORCE)),)),
    # Force per length in proportion to the diameter.
    'current': Loads(
        distributed=(
            DistributedLoad((0.0, LENGTH), tuple(tuple(FORCE * d / AREA) for d in (0.015, 0.006))),
        )
    ),
}


@pytest.mark.parametrize('kind', ['tip', 'point', 'current'])
def test_forces_of_all_kinds_are_found(kind):
    shape = Solver(RUBBER, 'exact', 31, loads=LOADS[kind]).solve([TENSIONS])
    markers = Markers(shape.s[10::10], shape.position[10::10], 1e-5)
    contact = contact_of(estimated(kind, [markers]), RUBBER)
    deviation = np.sqrt(contact.covariance.diagonal()[:3])
    # The axial force is hardly observable.
    assert (np.abs(contact.wrench[:3] - FORCE) < 3.0 * deviation + 1e-4).all()
    assert deviation.min() < 0.1 * LIKELY.stddev


def test_backbone_at_another_state_is_accurate_to_first_order():
    model = rubber(Unknowns(Walk(0.3), tip_force=LIKELY), loads=WEIGHT)
    at = Prediction(model, np.append(TENSIONS, [0.004, -0.003, 0.006]), None)
    errors = []
    for size in (1.0, 0.5):
        change = size * 1e-2 * at.x
        shape = at.backbone_at(at.x + change)
        expected = Prediction(model, at.x + change, at.solved).solved
        rotation = (
            Rotation.from_quat(shape.quaternion) * Rotation.from_quat(expected.quaternion).inv()
        )
        errors.append(
            [
                np.abs(shape.position - expected.position).max(),
                rotation.magnitude().max(),
                np.abs(shape.k - expected.k).max(),
                np.abs(shape.q - expected.q).max(),
            ]
        )
        np.testing.assert_allclose(np.linalg.norm(shape.quaternion, axis=1), 1.0)
        np.testing.assert_allclose(shape.tensions.ravel(), (at.x + change)[:4])
        np.testing.assert_allclose(shape.tip_wrench[:3], (at.x + change)[4:] + WEIGHT.tip_force)
    # The error is of second order.
    np.testing.assert_array_less(errors[1], 0.3 * np.array(errors[0]))
    assert errors[0][0] < 1e-4
