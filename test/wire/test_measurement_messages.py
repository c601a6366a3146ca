"""Messages of what is measured: read as what they say, in whatever frame."""

import re
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

pytest.importorskip('rosbags', reason='needs rosbags')
from recordings import header, make, point, pose
from scipy.spatial.transform import Rotation

from octo_arm_model import Config, OctoArmError, Pose
from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.estimation.unknowns import Unknowns, Walk
from octo_arm_model.wire.measurements import MEASUREMENT_TOPICS, MeasuredArm, tensions_of
from octo_arm_model.wire.tensions import JOINT_STATE, FieldMessage

PARAMETERS = {
    **load_parameters('renda2012_prototype'),
    'base.position': [0.1, -0.2, 0.3],
    'model': 'exact',
    'stations': 41,
}
CONFIG = Config.from_parameters(PARAMETERS)
FRAME = CONFIG.base_frame
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


def arm(values: dict[str, Any] = VALUES, pose_of: Any = None, **changes: Any) -> MeasuredArm:
    config = Config.from_parameters({**PARAMETERS, **changes})
    return MeasuredArm(config, EstimatorSettings.from_parameters(values, config).noise, pose_of)


def pose_of(frame: str, stamp_ns: int) -> Pose:
    assert (frame, stamp_ns) == ('camera', STAMP)
    return Pose(tuple(SHIFT), tuple(TURN.as_quat()))


@pytest.fixture(scope='module')
def truth():
    unknowns = Unknowns(Walk(1.0), tip_force=Walk(1.0), tip_moment=Walk(1.0))
    model = ArmModel.of(CONFIG, unknowns, stations=41)
    return Prediction(model, np.concatenate([[1.0, 0.3, 0.0, 0.2], WRENCH]), None)


def tip_pose(at: FloatArray, turned: FloatArray, covariance: FloatArray, frame: str) -> Any:
    with_covariance = make(
        'geometry_msgs/msg/PoseWithCovariance',
        pose=pose(at, turned),
        covariance=covariance.ravel(),
    )
    name = 'geometry_msgs/msg/PoseWithCovarianceStamped'
    return make(name, header=header(STAMP, frame), pose=with_covariance)


def markers(points: FloatArray, frame: str) -> Any:
    poses = [pose(one) for one in points]
    return make('geometry_msgs/msg/PoseArray', header=header(STAMP, frame), poses=poses)


def base_wrench(values: FloatArray, frame: str) -> Any:
    force, torque = (point(part, 'Vector3') for part in values.reshape(2, 3))
    wrench = make('geometry_msgs/msg/Wrench', force=force, torque=torque)
    return make('geometry_msgs/msg/WrenchStamped', header=header(STAMP, frame), wrench=wrench)


def messages(truth: Prediction, frame: str) -> dict[str, Any]:
    """What exact sensors in a frame say of the truth; 'camera' is turned and shifted."""
    turn, shift = (TURN, SHIFT) if frame == 'camera' else (Rotation.identity(), np.zeros(3))
    back, shape = turn.inv(), truth.solved
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = back.as_matrix() @ np.diag([1e-6, 4e-6, 9e-6]) @ turn.as_matrix()
    covariance[3:, 3:] = back.as_matrix() @ np.diag([1e-4, 2e-4, 3e-4]) @ turn.as_matrix()
    turned = (back * Rotation.from_quat(shape.quaternion[-1])).as_quat()
    at = [int(np.argmin(np.abs(shape.s - s))) for s in MARKERS]
    assert_allclose(shape.s[at], MARKERS, atol=1e-12)
    force = WRENCH[:3]
    moment = WRENCH[3:] + np.cross(shape.tip - shift, force)  # about the origin of the frame
    return {
        'measured/tip_pose': tip_pose(back.apply(shape.tip - shift), turned, covariance, frame),
        'measured/markers': markers(back.apply(shape.position[at] - shift), frame),
        'measured/base_wrench': base_wrench(
            np.concatenate([back.apply(force), back.apply(moment)]), frame
        ),
    }


@pytest.mark.parametrize('frame', [FRAME, '', 'camera'])
def test_exact_sensors_leave_no_innovation_in_any_frame(truth, frame):
    given = messages(truth, frame)
    assert {*given, 'tendon_displacements'} == set(MEASUREMENT_TOPICS)
    for name, message in given.items():
        one = MEASUREMENT_TOPICS[name].read(message, arm(pose_of=pose_of))
        assert_allclose(one.innovation(truth), 0.0, atol=1e-9, err_msg=name)
    tip = MEASUREMENT_TOPICS['measured/tip_pose'].read(
        given['measured/tip_pose'], arm(pose_of=pose_of)
    )
    expected = np.diag([1e-6, 4e-6, 9e-6, 1e-4, 2e-4, 3e-4])
    assert_allclose(tip.covariance, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_noise_of_a_wrench_goes_along_with_its_frame(truth):
    message = messages(truth, 'camera')['measured/base_wrench']
    found = MEASUREMENT_TOPICS['measured/base_wrench'].read(message, arm(pose_of=pose_of))
    rng = np.random.default_rng(0)
    errors = rng.standard_normal((20000, 6)) * np.repeat([0.02, 0.003], 3)
    force = TURN.apply(errors[:, :3])
    arm_of_force = SHIFT - np.array(CONFIG.base.position)
    moment = TURN.apply(errors[:, 3:]) + np.cross(arm_of_force, force)
    sampled = np.cov(np.concatenate([force, moment], axis=1).T)
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    assert_allclose(found.covariance / scale, sampled / scale, atol=0.03)


def test_errors_of_the_model_are_noise_of_what_is_seen(truth):
    wrong = arm(model_error_stddev=0.01)
    given = messages(truth, FRAME)
    deviation = 0.01 * CONFIG.arm.length
    found = MEASUREMENT_TOPICS['measured/markers'].read(given['measured/markers'], wrong)
    assert_allclose(np.diag(found.covariance), 1e-6 + deviation**2)
    found = MEASUREMENT_TOPICS['measured/tip_pose'].read(given['measured/tip_pose'], wrong)
    expected = np.array([1e-6, 4e-6, 9e-6, 1e-4, 2e-4, 3e-4])
    expected += np.repeat([deviation**2, 0.02**2], 3)
    assert_allclose(np.diag(found.covariance), expected)


def test_a_tip_without_a_covariance_has_that_of_the_parameters(truth):
    read, shape = MEASUREMENT_TOPICS['measured/tip_pose'].read, truth.solved
    bare = tip_pose(shape.tip, shape.quaternion[-1], np.zeros((6, 6)), FRAME)
    with pytest.raises(MeasurementError, match='tip_position_stddev is 0: its noise is not'):
        read(bare, arm())
    found = read(bare, arm({'estimator.tip_position_stddev': 2e-3}))
    assert found.name == 'tip position'
    assert_allclose(found.covariance, 4e-6 * np.eye(3))
    both = {'estimator.tip_position_stddev': 2e-3, 'estimator.tip_rotation_stddev': 0.1}
    found = read(bare, arm(both))
    assert found.name == 'tip pose'
    assert_allclose(np.diag(found.covariance), [4e-6] * 3 + [0.01] * 3)


def test_hidden_markers_are_left_out(truth):
    points = truth.solved.position[[0, 1, -1]].copy()
    points[:2] = np.nan
    read = MEASUREMENT_TOPICS['measured/markers'].read
    found = read(markers(points, FRAME), arm())
    assert_allclose(found.innovation(truth), 0.0, atol=1e-9)
    assert found.value.size == 3
    with pytest.raises(MeasurementError, match='it shows no marker'):
        read(markers(np.full((3, 3), np.nan), FRAME), arm())


def joint_state(names: list[str], values: list[float], field: str) -> Any:
    fields = {'position': np.zeros(0), 'velocity': np.zeros(0), 'effort': np.zeros(0)}
    fields[field] = np.array(values)
    return make('sensor_msgs/msg/JointState', header=header(STAMP, ''), name=names, **fields)


def test_readings_below_zero_are_measurements_as_calibrated():
    names = list(CONFIG.arm.tendon_names)
    message = joint_state(names[::-1], [0.4, -0.1, 0.02, 1.0], 'effort')
    twice = arm(tension_scale=[2.0] * 4)
    found = tensions_of(JOINT_STATE.read(message, CONFIG.arm), twice)
    assert_allclose(found.value, [2.0, 0.04, -0.2, 0.8])
    assert_allclose(np.diag(found.covariance), 0.02**2)
    field = FieldMessage('sensor_msgs/msg/JointState', 'effort')
    found = tensions_of(field.read(message, CONFIG.arm), arm())
    assert found.value.tolist() == [1.0, 0.02, -0.1, 0.4]
    message = joint_state(names, [0.4, np.nan, 0.02, 1.0], 'effort')
    with pytest.raises(OctoArmError, match='expected finite numbers'):
        tensions_of(JOINT_STATE.read(message, CONFIG.arm), arm())


def test_displacements_are_of_the_tendons_named(truth):
    read = MEASUREMENT_TOPICS['tendon_displacements'].read
    drawn_in = truth.model.solver.rest_lengths.ravel() - truth.tendon_lengths
    names = list(CONFIG.arm.tendon_names)
    message = joint_state([names[2], names[0]], [drawn_in[2], drawn_in[0]], 'position')
    found = read(message, arm())
    assert_allclose(found.innovation(truth), 0.0, atol=1e-12)
    with pytest.raises(OctoArmError, match='it has no displacements'):
        read(joint_state([], [], 'position'), arm())
    with pytest.raises(OctoArmError, match='unknown tendon elbow'):
        read(joint_state(['elbow'], [0.0], 'position'), arm())


@pytest.mark.parametrize(
    ('name', 'message', 'values', 'words'),
    [
        (
            'measured/markers',
            markers(np.zeros((2, 3)), FRAME),
            VALUES,
            r'2 marker\(s\), expected 3',
        ),
        ('measured/markers', markers(np.zeros((3, 3)), FRAME), {}, 'marker_s is empty'),
        (
            'measured/markers',
            markers(np.zeros((3, 3)), 'camera'),
            VALUES,
            "its frame is 'camera', expected 'arm_base'",
        ),
        ('measured/markers', markers(np.full((3, 3), np.inf), FRAME), VALUES, 'is infinite'),
        (
            'measured/base_wrench',
            base_wrench(np.zeros(6), FRAME),
            {},
            'base_moment_stddev is 0: its noise is not known',
        ),
        (
            'measured/tip_pose',
            tip_pose(np.zeros(3), np.array([0.0, 0, 0, 2]), np.eye(6), FRAME),
            {},
            'quaternion .* expected length 1',
        ),
        (
            'measured/tip_pose',
            tip_pose(np.zeros(3), np.zeros(4), np.eye(6), FRAME),
            {},
            'expected length 1',
        ),
        (
            'measured/tip_pose',
            tip_pose(np.zeros(3), np.array([0.0, 0, 0, 1e-320]), np.eye(6), FRAME),
            {},
            'expected length 1',
        ),
        (
            'measured/tip_pose',
            tip_pose(np.zeros(3), np.array([1e200, 0, 0, 1.0]), np.eye(6), FRAME),
            {},
            'expected',
        ),
        (
            'measured/tip_pose',
            tip_pose(np.zeros(3), np.array([0.0, 0, 0, 1]), -np.eye(6), FRAME),
            {},
            'its covariance is -1 at 0, 0, expected a positive definite one$',
        ),
        (
            'measured/tip_pose',
            tip_pose(np.zeros(3), np.array([0.0, 0, 0, 1]), np.diag([1.0, 1, 0, 1, 1, 1]), FRAME),
            {},
            'tip pose: the variance of number 3 of 6 is 0, expected a positive definite covar',
        ),
        (
            'measured/tip_pose',
            tip_pose(
                np.zeros(3),
                np.array([0.0, 0, 0, 1]),
                np.ones((6, 6)) + np.eye(6) - 2.0 * (np.eye(6, k=1) + np.eye(6, k=-1)),
                FRAME,
            ),
            {},
            'tip pose: some combination of its 6 numbers has a variance of -',
        ),
        (
            'measured/tip_pose',
            tip_pose(
                np.zeros(3), np.array([0.0, 0, 0, 1]), np.eye(6) + 0.5 * np.eye(6, k=1), FRAME
            ),
            {},
            'covariance is 0.5 at 0, 1 and 0 at 1, 0, expected a symmetric one',
        ),
        (
            'measured/tip_pose',
            tip_pose(np.full(3, np.nan), np.array([0.0, 0, 0, 1]), np.eye(6), FRAME),
            {},
            'expected finite numbers',
        ),
    ],
)
def test_what_is_no_measurement_is_refused_in_a_line(name, message, values, words):
    with pytest.raises(OctoArmError, match=words) as refused:
        MEASUREMENT_TOPICS[name].read(message, arm(values))
    assert '\n' not in str(refused.value)


@pytest.mark.parametrize('frame', [FRAME, 'camera'])
@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf, 1e200, 1.7e308])
def test_what_is_no_number_is_refused_as_it_came(frame, value):
    """In a turned frame too, where one wrong number would make several, and without warnings."""
    seen, place, turned = arm(pose_of=pose_of), np.array([0.1, value, 0.2]), np.eye(4)[3]
    covariance = np.eye(6)
    covariance[4, 4] = value
    points, wrench = np.full((3, 3), 0.1), np.array([0.1, 0.2, 0.3, value, 0.0, 0.0])
    points[1, 0] = value
    shown = re.escape(f'{value:g}')
    for name, message, words in (
        (
            'measured/tip_pose',
            tip_pose(place, turned, np.eye(6), frame),
            rf'tip pose: position is \[0.1, {re.escape(repr(value))}, 0.2\], expected ',
        ),
        (
            'measured/tip_pose',
            tip_pose(np.zeros(3), turned, covariance, frame),
            rf'its covariance is {shown} at 4, 4, expected finite numbers of at most 1e\+60',
        ),
        (
            'measured/base_wrench',
            base_wrench(wrench, frame),
            rf'base wrench: value is \[0.1, 0.2, 0.3, {re.escape(repr(value))}, 0.0, 0.0\]',
        ),
    ):
        with pytest.raises(MeasurementError, match=words):
            MEASUREMENT_TOPICS[name].read(message, seen)
    if not np.isnan(value):  # which is a marker that is hidden
        with pytest.raises(MeasurementError, match='marker'):
            MEASUREMENT_TOPICS['measured/markers'].read(markers(points, frame), seen)


@pytest.mark.parametrize('variance', [1e-300, 5e-324])
def test_a_covariance_too_small_for_numbers_is_refused(variance):
    message = tip_pose(np.zeros(3), np.eye(4)[3], variance * np.eye(6), 'camera')
    with pytest.raises(MeasurementError, match='tip pose: noise has a standard deviation of'):
        MEASUREMENT_TOPICS['measured/tip_pose'].read(message, arm(pose_of=pose_of))


def test_readings_that_no_number_holds_once_scaled_are_refused():
    with pytest.raises(MeasurementError, match='expected finite numbers'):
        tensions_of(np.full(CONFIG.arm.tension_shape, 1e308), arm(tension_scale=[10.0] * 4))
