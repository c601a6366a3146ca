"""Messages of tensions and measurements: values, noise, frames and errors."""

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from recordings import header, make, point, pose
from scipy.spatial.transform import Rotation

from octo_arm_model import Config, OctoArmError, Pose, TensionError, load_config
from octo_arm_model.arm.errors import MeasurementError, MessageError
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.estimation.measurement import Measurement
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.estimation.unknowns import Unknowns, Walk
from octo_arm_model.wire.measurements import MEASUREMENT_TOPICS, MeasuredArm, tensions_of
from octo_arm_model.wire.messages import Refusals, Stamp, time_of
from octo_arm_model.wire.tensions import FLOAT64_ARRAY, JOINT_STATE, TENDON_TENSIONS, FieldMessage

PARAMETERS = {
    **load_parameters('renda2012_prototype'),
    'base.position': [0.1, -0.2, 0.3],
    'model': 'exact',
    'stations': 41,
}
CONFIG = Config.from_parameters(PARAMETERS)
FRAME, NAMES = CONFIG.base_frame, list(CONFIG.arm.tendon_names)
MARKERS = (0.0675, 0.135, 0.27)
WRENCH = np.array([0.004, -0.006, 0.008, 1e-4, -2e-4, 3e-4])
TURN = Rotation.from_rotvec([0.4, -1.1, 0.7])
SHIFT = np.array([0.5, -0.3, 0.2])
STAMP = 1_700_000_000 * 10**9 + 5
VALUES = {
    'estimator.marker_s': list(MARKERS),
    'estimator.base_force_stddev': 0.02,
    'estimator.base_moment_stddev': 0.003,
}
VARIANCES = np.array([1e-6, 4e-6, 9e-6, 1e-4, 2e-4, 3e-4])
READERS = {one.type_name: one.read for one in MEASUREMENT_TOPICS.values()}


def arm(values: dict[str, Any] = VALUES, pose_of: Any = None, **changes: Any) -> MeasuredArm:
    config = Config.from_parameters({**PARAMETERS, **changes})
    return MeasuredArm(config, EstimatorSettings.from_parameters(values, config), pose_of)


def pose_of(frame: str, stamp_ns: int) -> Pose:
    assert (frame, stamp_ns) == ('camera', STAMP)
    return Pose(tuple(SHIFT), tuple(TURN.as_quat()))


def read(message: Any, values: dict[str, Any] = VALUES, **changes: Any) -> Measurement:
    """Read the measurement of an arm with ``changes``; only the frame 'camera' is known."""
    frames = pose_of if message.header.frame_id == 'camera' else None
    return READERS[message.__msgtype__](message, arm(values, frames, **changes))


@pytest.fixture(scope='module')
def truth():
    unknowns = Unknowns(Walk(1.0), tip_force=Walk(1.0), tip_moment=Walk(1.0))
    model = ArmModel.of(CONFIG, unknowns, stations=41)
    return Prediction(model, np.concatenate([[1.0, 0.3, 0.0, 0.2], WRENCH]), None)


def tip_pose(
    at: Any = (0, 0, 0),
    turned: Any = (0, 0, 0, 1),
    covariance: Any = np.eye(6),
    frame: str = FRAME,
) -> Any:
    given = {'pose': pose(at, turned), 'covariance': np.ravel(covariance)}
    message = make('geometry_msgs/msg/PoseWithCovariance', **given)
    kind = 'geometry_msgs/msg/PoseWithCovarianceStamped'
    return make(kind, header=header(STAMP, frame), pose=message)


def markers(points: Any, frame: str = FRAME) -> Any:
    poses = [pose(one) for one in points]
    return make('geometry_msgs/msg/PoseArray', header=header(STAMP, frame), poses=poses)


def base_wrench(values: Any, frame: str = FRAME) -> Any:
    force, torque = (point(part, 'Vector3') for part in np.reshape(values, (2, 3)))
    wrench = make('geometry_msgs/msg/Wrench', force=force, torque=torque)
    return make('geometry_msgs/msg/WrenchStamped', header=header(STAMP, frame), wrench=wrench)


def joint_state(names: list[str], values: list[float], field: str) -> Any:
    fields = dict.fromkeys(('position', 'velocity', 'effort'), np.zeros(0))
    fields[field] = np.array(values)
    return make('sensor_msgs/msg/JointState', header=header(STAMP, ''), name=names, **fields)


def messages(truth: Prediction, frame: str) -> tuple[Any, Any, Any]:
    """Return messages of exact sensors in a frame; 'camera' is rotated and shifted."""
    turn, shift = (TURN, SHIFT) if frame == 'camera' else (Rotation.identity(), np.zeros(3))
    back, shape = turn.inv(), truth.solved
    axes = np.kron(np.eye(2), turn.as_matrix())
    turned = (back * Rotation.from_quat(shape.quaternion[-1])).as_quat()
    at = [int(np.argmin(np.abs(shape.s - s))) for s in MARKERS]
    assert_allclose(shape.s[at], MARKERS, atol=1e-12)
    force = WRENCH[:3]
    moment = WRENCH[3:] + np.cross(shape.tip - shift, force)  # about the origin of the frame
    return (
        tip_pose(back.apply(shape.tip - shift), turned, axes.T * VARIANCES @ axes, frame),
        markers(back.apply(shape.position[at] - shift), frame),
        base_wrench([back.apply(force), back.apply(moment)], frame),
    )


@pytest.mark.parametrize('frame', [FRAME, '', 'camera'])
def test_exact_sensors_leave_no_innovation_in_any_frame(truth, frame):
    values = [read(message) for message in messages(truth, frame)]
    for value in values:
        assert_allclose(value.innovation(truth), 0.0, atol=1e-9, err_msg=value.name)
    tip = values[0]
    assert_allclose(tip.covariance, np.diag(VARIANCES), rtol=0.0, atol=1e-9 * VARIANCES.max())


def test_noise_of_a_wrench_is_transformed_with_its_frame(truth):
    *_, message = messages(truth, 'camera')
    errors = np.random.default_rng(0).standard_normal((20000, 6)) * np.repeat([0.02, 0.003], 3)
    force = TURN.apply(errors[:, :3])
    arm_of_force = SHIFT - np.array(CONFIG.base.position)
    moment = TURN.apply(errors[:, 3:]) + np.cross(arm_of_force, force)
    sampled = np.cov(np.concatenate([force, moment], axis=1).T)
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    assert_allclose(read(message).covariance / scale, sampled / scale, atol=0.03)


def test_model_error_is_added_to_the_noise(truth):
    tip, points, _ = messages(truth, FRAME)
    deviation = 0.01 * CONFIG.arm.length
    measurement = read(points, model_error_stddev=0.01)
    assert_allclose(np.diag(measurement.covariance), 1e-6 + deviation**2)
    measurement = read(tip, model_error_stddev=0.01)
    expected = VARIANCES + np.repeat([deviation**2, 0.02**2], 3)
    assert_allclose(np.diag(measurement.covariance), expected)


def test_tip_without_covariance_uses_the_parameters():
    tip, noise = tip_pose(covariance=np.zeros((6, 6))), {'estimator.tip_position_stddev': 2e-3}
    with pytest.raises(MeasurementError, match='tip_position_stddev is 0: its noise is not'):
        read(tip)
    measurement = read(tip, noise)
    assert measurement.name == 'tip position'
    assert_allclose(measurement.covariance, 4e-6 * np.eye(3))
    measurement = read(tip, {**noise, 'estimator.tip_rotation_stddev': 0.1})
    assert measurement.name == 'tip pose'
    assert_allclose(np.diag(measurement.covariance), [4e-6] * 3 + [0.01] * 3)


def test_hidden_markers_are_ignored(truth):
    points = truth.solved.position[[0, 1, -1]].copy()
    points[:2] = np.nan
    measurement = read(markers(points))
    assert_allclose(measurement.innovation(truth), 0.0, atol=1e-9)
    assert measurement.value.size == 3


def test_negative_readings_are_calibrated_measurements():
    message = joint_state(NAMES[::-1], [0.4, -0.1, 0.02, 1.0], 'effort')
    measurement = tensions_of(JOINT_STATE.read(message, CONFIG.arm), arm(tension_scale=[2.0] * 4))
    assert_allclose(measurement.value, [2.0, 0.04, -0.2, 0.8])
    assert_allclose(np.diag(measurement.covariance), 0.02**2)
    field = FieldMessage('sensor_msgs/msg/JointState', 'effort')
    measurement = tensions_of(field.read(message, CONFIG.arm), arm())
    assert measurement.value.tolist() == [1.0, 0.02, -0.1, 0.4]
    with pytest.raises(TensionError, match='3 names but 4 values'):
        field.read(joint_state(NAMES[1:], message.effort, 'effort'), CONFIG.arm)
    message.effort[1] = np.nan
    with pytest.raises(OctoArmError, match='expected finite numbers'):
        tensions_of(JOINT_STATE.read(message, CONFIG.arm), arm())
    with pytest.raises(MeasurementError, match='expected finite numbers'):
        tensions_of(np.full(CONFIG.arm.tension_shape, 1e308), arm(tension_scale=[10.0] * 4))


def test_displacements_belong_to_the_named_tendons(truth):
    lengths = truth.model.solver.rest_lengths.ravel() - truth.tendon_lengths
    measurement = read(joint_state([NAMES[2], NAMES[0]], [lengths[2], lengths[0]], 'position'))
    assert_allclose(measurement.innovation(truth), 0.0, atol=1e-12)


def some(shape: Any, place: Any, value: float) -> np.ndarray:
    """Return an array of a ``shape`` with one ``value``."""
    numbers = np.full(shape, 0.1)
    numbers[place] = value
    return numbers


INDEFINITE = np.ones((6, 6)) + np.eye(6) - 2.0 * (np.eye(6, k=1) + np.eye(6, k=-1))


@pytest.mark.parametrize(
    ('message', 'values', 'words'),
    [
        (joint_state([], [], 'position'), {}, 'it has no displacements'),
        (joint_state(['elbow'], [0.0], 'position'), {}, 'unknown tendon elbow'),
        (markers(np.zeros((2, 3))), VALUES, r'2 marker\(s\), expected 3'),
        (markers(np.zeros((3, 3))), {}, 'marker_s is empty'),
        (markers(np.zeros((3, 3)), 'elsewhere'), VALUES, "'elsewhere', expected 'arm_base'"),
        (markers(np.full((3, 3), np.nan)), VALUES, 'it shows no marker'),
        (base_wrench(np.zeros(6)), {}, 'base_moment_stddev is 0: its noise is not known'),
        (tip_pose(turned=(0, 0, 0, 2)), {}, 'quaternion .* expected length 1'),
        (tip_pose(turned=np.zeros(4)), {}, 'expected length 1'),
        (tip_pose(turned=(0, 0, 0, 1e-320)), {}, 'expected length 1'),
        (tip_pose(turned=(1e200, 0, 0, 1)), {}, 'expected'),
        (
            tip_pose(covariance=-np.eye(6)),
            {},
            'its covariance is -1 at 0, 0, expected a positive definite one$',
        ),
        (
            tip_pose(covariance=np.diag([1.0, 1, 0, 1, 1, 1])),
            {},
            'tip pose: the variance of number 3 of 6 is 0, expected a positive definite covar',
        ),
        (
            tip_pose(covariance=INDEFINITE),
            {},
            'tip pose: some combination of its 6 numbers has a variance of -',
        ),
        (
            tip_pose(covariance=np.eye(6) + 0.5 * np.eye(6, k=1)),
            {},
            'covariance is 0.5 at 0, 1 and 0 at 1, 0, expected a symmetric one',
        ),
        *(
            (tip_pose(covariance=tiny * np.eye(6), frame='camera'), {}, 'tip pose: noise has a st')
            for tiny in (1e-300, 5e-324)
        ),
    ],
)
def test_invalid_measurements_are_refused_in_one_line(message, values, words):
    with pytest.raises(OctoArmError, match=words) as refused:
        read(message, values)
    assert '\n' not in str(refused.value)


@pytest.mark.parametrize('frame', [FRAME, 'camera'])
@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf, 1e200, 1.7e308])
def test_errors_show_invalid_numbers_as_received(frame, value):
    shown = re.escape(f'{value!r}')
    covariance = np.eye(6)
    covariance[4, 4] = value
    for message, words in (
        (
            tip_pose(some(3, 1, value), frame=frame),
            rf'tip pose: position is \[0.1, {shown}, 0.1\], expected ',
        ),
        (
            tip_pose(covariance=covariance, frame=frame),
            rf'is {re.escape(f"{value:g}")} at 4, 4, expected finite numbers of at most 1e\+60',
        ),
        (
            base_wrench(some(6, 3, value), frame),
            rf'base wrench: value is \[0.1, 0.1, 0.1, {shown}, 0.1, 0.1\]',
        ),
        # A marker with NaN is hidden; here all of them are.
        (
            markers(some((3, 3), slice(None) if np.isnan(value) else (1, 0), value), frame),
            'marker',
        ),
    ):
        with pytest.raises(MeasurementError, match=words):
            read(message)


# Tensions in message objects of any library ------------------------------------------------------


TWELVE = load_config('renda2012_table4').arm
VALUES = np.arange(12.0)


def array(data, *sizes, offset=0):
    dimensions = [SimpleNamespace(size=size) for size in sizes]
    return SimpleNamespace(data=data, layout=SimpleNamespace(dim=dimensions, data_offset=offset))


@pytest.mark.parametrize('sizes', [(), (12,), (3, 4)])
def test_array_is_row_major_from_the_tip(sizes):
    message = array(VALUES, *sizes)
    assert_array_equal(FLOAT64_ARRAY.read(message, TWELVE), VALUES.reshape(3, 4))


@pytest.mark.parametrize(
    ('sizes', 'offset', 'count', 'complaint'),
    [
        ((), 0, 11, r'11 values, expected 12'),
        ((), 0, 0, r'0 values, expected 12'),
        ((4, 3), 0, 12, r'layout is \(4, 3\)'),
        ((3, 4), 1, 12, r'data_offset 1'),
    ],
)
def test_arrays_of_other_shapes_are_refused(sizes, offset, count, complaint):
    message = array(np.zeros(count), *sizes, offset=offset)
    with pytest.raises(TensionError, match=complaint):
        FLOAT64_ARRAY.read(message, TWELVE)


# Stamps, and counts of refused messages ----------------------------------------------------------


def test_number_of_counted_reasons_is_bounded():
    refusals = Refusals()
    for number in range(10_000):
        refusals.count('/a', f'unknown tendon {"x" * number}')
    assert refusals.total == 10_000
    assert len(refusals.counts) <= 51
    assert refusals.of('/a')['other reasons'] == 9_950


def test_length_of_errors_is_bounded():
    for names in (['x' * 10**6] * 2, [f'n{i}' for i in range(10**5)], ['a', 'b'] * 10**5):
        with pytest.raises(TensionError) as refusal:
            TENDON_TENSIONS.read(SimpleNamespace(name=names, tension=names), TWELVE)
        assert len(str(refusal.value)) < 1000


def test_unset_stamp_has_no_time():
    assert time_of(None) is None
    assert time_of(Stamp(0, 0)) is None
    for stamp in (Stamp(0, 1), Stamp(3, 999_999_999), Stamp(2**31 - 1, 0)):
        assert time_of(stamp) == stamp
        assert Stamp.from_ns(stamp.ns) == stamp


@pytest.mark.parametrize('stamp', [Stamp(-1, 0), Stamp(-(2**31), 1), Stamp(0, 10**9)])
def test_invalid_stamps_are_refused(stamp):
    with pytest.raises(MessageError, match=f'{stamp.sec} s and {stamp.nanosec} ns, expected'):
        time_of(stamp)
