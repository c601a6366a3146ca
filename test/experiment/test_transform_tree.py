"""Markers as frames of TF whose transforms form chains, static ones and moving ones."""

from pathlib import Path

import numpy as np
import pytest
from experiments import bag_of, description, nanoseconds, tension_samples
from labs import MARKER_S, TIP_ERRORS, seen, staircase_of, tf_message, transform
from numpy.testing import assert_allclose
from recordings import Sample
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import ConfigError, MeasurementError
from octo_arm_model.experiment import bag_recording
from octo_arm_model.experiment.transform_tree import TransformTree

FRAMES = ['m0', 'm1', 'm2', 'm3']
OPTIONS = ['--marker-s', *map(str, MARKER_S), '--marker-frames', *FRAMES, '--clock-offset', '0']
WORLD_TO_CAMERA = Rotation.from_rotvec([0.4, -1.1, 0.7]), np.array([0.3, -0.2, 0.9])
WORLD_TO_BASE = Rotation.from_rotvec([-0.2, 0.5, 1.9]), np.array([1.0, 2.0, -0.5])


def pan(at: float) -> Rotation:
    """How the camera has turned about its vertical axis, at an even rate."""
    return Rotation.from_rotvec([0.0, 0.0, 0.03 * at])


def chain_bag(path: Path, *, has_base: bool = True, last_pan: float = np.inf) -> Path:
    """The world sees the base of the arm and a mount, on which a camera pans, which sees markers.

    Pans have stamps of their own, up to ``last_pan`` [s].
    """
    time, pulled, times = staircase_of()
    samples: list[Sample] = [description(model='exact'), *tension_samples(time, pulled)]
    static = [transform(0, 'mount', WORLD_TO_CAMERA[1], 'world', WORLD_TO_CAMERA[0].as_quat())]
    if has_base:
        quaternion = WORLD_TO_BASE[0].as_quat()
        static.append(transform(0, 'arm_base', WORLD_TO_BASE[1], 'world', quaternion))
    samples.append(tf_message(static, nanoseconds(0.0), '/tf_static'))
    for at in np.arange(0.03, time[-1] + 0.7, 0.7):
        if at <= last_pan:
            stamp, turn = nanoseconds(at), -pan(at).as_quat()  # of either sign
            panned = transform(stamp, 'camera', np.array([0.0, 0.01 * at, 0.0]), 'mount', turn)
            samples.append(tf_message([panned], stamp))
    for at, tension in zip(times, np.interp(times, time, pulled)):
        points = WORLD_TO_BASE[0].apply(seen(float(tension), MARKER_S)) + WORLD_TO_BASE[1]
        points = WORLD_TO_CAMERA[0].apply(points - WORLD_TO_CAMERA[1], inverse=True)
        points = pan(at).apply(points - [0.0, 0.01 * at, 0.0], inverse=True)
        stamp = nanoseconds(at)
        markers = [transform(stamp, name, one, 'camera') for name, one in zip(FRAMES, points)]
        samples.append(tf_message(markers, stamp))
    return bag_of(path, samples)


def test_chains_lead_to_the_base_of_the_arm(tmp_path, cli):
    said = cli.json('compare', chain_bag(tmp_path / 'bag'), *OPTIONS, '--json')
    errors = [step['tip_error_percent'] for step in said['steps']]
    assert errors == pytest.approx(TIP_ERRORS, abs=0.03)
    assert any('midlines are in base_frame' in note for note in said['notes'])


def test_without_the_base_markers_are_in_the_root_and_aligned(tmp_path, cli):
    bag = str(chain_bag(tmp_path / 'bag', has_base=False))
    said = cli.json('compare', bag, *OPTIONS, '--json')
    assert any("midlines are in 'world'" in note for note in said['notes'])
    (model,) = said['models'].values()
    found = model['alignment_camera_to_base']
    # The model is not the truth, so that the fit turns the camera a little.
    turn = Rotation.from_quat(found['quaternion']) * WORLD_TO_BASE[0]
    assert turn.magnitude() < 0.05
    assert model['average_tip_error_percent'] < np.mean(TIP_ERRORS)


def test_before_and_after_its_stamps_a_transform_is_unknown(tmp_path, cli):
    bag = str(chain_bag(tmp_path / 'bag', last_pan=12.0))
    said = cli.json('compare', bag, *OPTIONS, '--json')
    errors = [step['tip_error_percent'] for step in said['steps']]
    assert errors == pytest.approx(TIP_ERRORS[: len(errors)], abs=0.03)
    assert 0 < len(errors) < len(TIP_ERRORS)
    assert any("the transform from 'camera' to 'mount' is not known at" in note
               for note in said['notes'])  # fmt: skip


@pytest.mark.parametrize(
    ('frames', 'message'),
    [
        (['m0', 'm1', 'm2', 'm9'], "no frame 'm9' among the transforms; there are arm_base, cam"),
        (['m0', 'm1', 'm2', 'mount'], "all transforms from 'mount' to 'arm_base' are static"),
        (['m0', 'm1', 'm2', 'm2'], '--marker-frames names m0 m1 m2 m2, expected each once'),
    ],
)
def test_frames_that_lead_nowhere_are_refused_in_one_line(frames, message, tmp_path, cli):
    bag = str(chain_bag(tmp_path / 'bag'))
    words = ['--marker-s', *map(str, MARKER_S), '--marker-frames', *frames]
    assert message in cli.refused('compare', bag, *words)


def test_how_many_transforms_are_kept_is_bounded(tmp_path, cli, monkeypatch):
    monkeypatch.setattr(bag_recording, 'MOST_TRANSFORMS', 10)
    assert 'more than 10 transforms' in cli.refused(
        'compare', str(chain_bag(tmp_path / 'bag')), *OPTIONS
    )


LEVEL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def tree_of(*links: tuple[str, str, tuple[float, ...]], is_static: bool = False) -> TransformTree:
    """Transforms at 0 ns: parent, child, and translation [m] and quaternion."""
    tree = TransformTree()
    for parent, child, numbers in links:
        tree.add(parent, child, 0, np.array(numbers[:3]), np.array(numbers[3:]), is_static)
    return tree


@pytest.mark.parametrize(
    ('quaternion', 'message'),
    [((0.0, 0.0, 0.0, 0.0), 'a quaternion of norm 1'), ((np.nan, 0.0, 0.0, 1.0), 'finite num')],
)
def test_a_rotation_on_the_way_is_one_and_that_of_the_marker_itself_does_not_count(
    quaternion, message
):
    wrong = (0.0, 0.0, 0.0, *quaternion)
    with pytest.raises(MeasurementError, match=message):
        tree_of(('world', 'camera', wrong), ('camera', 'marker', LEVEL)).origins(
            'marker', 'world', lambda why: None
        )
    # An orientation that nobody set.
    tree = tree_of(('tracker', 'marker', (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)), is_static=True)
    tree.add(
        'world', 'tracker', 5, np.array([0.0, 2.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]), False
    )
    stamps, points = tree.origins('marker', 'world', lambda why: None)
    assert (stamps.tolist(), points.tolist()) == ([5], [[1.0, 2.0, 0.0]])


def test_circles_and_second_parents_are_refused():
    tree = tree_of(('a', 'b', LEVEL), ('b', 'a', LEVEL), ('x', 'y', LEVEL), ('z', 'w', LEVEL))
    with pytest.raises(MeasurementError, match='parents of frames form a cycle: b < a < b'):
        tree.chain('b')
    with pytest.raises(MeasurementError, match="no transforms connect 'y' and 'z'"):
        tree.origins('y', 'z', lambda why: None)
    with pytest.raises(MeasurementError, match="the parent of 'b' is 'c', expected 'a' as before"):
        tree.add('c', 'b', 1, np.zeros(3), np.eye(4)[3], False)


def test_a_pose_in_another_frame_is_that_of_the_transforms_between():
    tree = TransformTree()
    for child, (turn, shift) in (('camera', WORLD_TO_CAMERA), ('arm_base', WORLD_TO_BASE)):
        tree.add('world', child, 0, shift, turn.as_quat(), True)
    for stamp in (0, 10):
        shift = np.array([0.0, 0.1 * stamp, 0.0])
        tree.add('camera', 'tracker', stamp, shift, pan(stamp).as_quat(), False)
    pose = tree.pose('tracker', 'arm_base', 4)
    point = np.array([0.1, 0.2, 0.3])
    world = WORLD_TO_CAMERA[0].apply(pan(4).apply(point) + [0.0, 0.4, 0.0]) + WORLD_TO_CAMERA[1]
    expected = WORLD_TO_BASE[0].inv().apply(world - WORLD_TO_BASE[1])
    found = Rotation.from_quat(pose.quaternion).apply(point) + pose.position
    assert_allclose(found, expected, atol=1e-12)
    tree.add('tracker', 'moon', 0, np.array([2e9, 0.0, 0.0]), np.eye(4)[3], True)
    for frames, stamp, message in (
        (('tracker', 'arm_base'), 11, "'tracker' to 'camera' is not known at"),
        (('elbow', 'arm_base'), 0, "no frame 'elbow'"),
        (('moon', 'tracker'), 0, r"the position of 'moon' is .*, expected 3 finite"),
    ):
        with pytest.raises((MeasurementError, ConfigError), match=message):
            tree.pose(*frames, stamp)


@pytest.mark.parametrize(
    ('first', 'later', 'history', 'known', 'forgotten'),
    [
        ([30, 10, 20], [], 10, 25, 15),
        ([1000, 1010, 1020], [5, 15], 100, 10, 1010),  # a clock that began anew
        ([10, 20], [10**18, 30, 40], 100, 35, 41),  # one stamp far ahead
    ],
)
def test_what_is_forgotten_is_older_than_the_newest_by_the_history(
    first, later, history, known, forgotten
):
    """Of a frame that is as far from its parent [m] as it is late [ns]."""
    tree = TransformTree()

    def move(stamp):
        tree.add('a', 'b', stamp, np.array([stamp, 0.0, 0.0]), np.eye(4)[3], False)

    for stamp in first:
        move(stamp)
    for stamp in later or [None]:
        if stamp is not None:
            move(stamp)
        tree.forget(history)
    assert tree.pose('b', 'a', known).position[0] == known
    with pytest.raises(MeasurementError, match='is not known'):
        tree.pose('b', 'a', forgotten)
