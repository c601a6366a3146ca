"""Markers as frames of TF whose transforms form chains, static ones and moving ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import printed
from experiments import bag_of, description, nanoseconds, tension_samples
from labs import MARKER_S, TIP_ERRORS, seen, staircase_of, tf_message, transform
from recordings import Sample
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import ConfigError, MeasurementError
from octo_arm_model.cli.main import main
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


def test_chains_lead_to_the_base_of_the_arm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = printed(capsys, 'compare', str(chain_bag(tmp_path / 'bag')), *OPTIONS, '--json')
    errors = [step['tip_error_percent'] for step in said['steps']]
    assert errors == pytest.approx(TIP_ERRORS, abs=0.03)
    assert any('midlines are in base_frame' in note for note in said['notes'])


def test_without_the_base_markers_are_in_the_root_and_aligned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = str(chain_bag(tmp_path / 'bag', has_base=False))
    said = printed(capsys, 'compare', bag, *OPTIONS, '--json')
    assert any("midlines are in 'world'" in note for note in said['notes'])
    (model,) = said['models'].values()
    found = model['alignment_camera_to_base']
    # The model is not the truth, so that the fit turns the camera a little.
    turn = Rotation.from_quat(found['quaternion']) * WORLD_TO_BASE[0]
    assert turn.magnitude() < 0.05
    assert model['average_tip_error_percent'] < np.mean(TIP_ERRORS)


def test_before_and_after_its_stamps_a_transform_is_unknown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = str(chain_bag(tmp_path / 'bag', last_pan=12.0))
    said = printed(capsys, 'compare', bag, *OPTIONS, '--json')
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
def test_frames_that_lead_nowhere_are_refused_in_one_line(
    frames: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = str(chain_bag(tmp_path / 'bag'))
    words = ['--marker-s', *map(str, MARKER_S), '--marker-frames', *frames]
    assert main(['compare', bag, *words]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count('\n') == 1


def test_how_many_transforms_are_kept_is_bounded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bag_recording, 'MOST_TRANSFORMS', 10)
    assert main(['compare', str(chain_bag(tmp_path / 'bag')), *OPTIONS]) == 2
    assert 'more than 10 transforms' in capsys.readouterr().err


def add(tree: TransformTree, parent: str, child: str, stamp: int, *numbers: float) -> None:
    tree.add(parent, child, stamp, np.array(numbers[:3]), np.array(numbers[3:]), False)


def test_between_stamps_a_transform_moves_evenly_and_turns_evenly() -> None:
    tree, half = TransformTree(), np.sqrt(0.5)
    add(tree, 'world', 'camera', 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    add(tree, 'world', 'camera', 10**9, 2.0, 0.0, 0.0, 0.0, 0.0, half, half)  # a quarter turn
    for stamp in (0, 500_000_000, 10**9):
        add(tree, 'camera', 'marker', stamp, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    skipped: list[str] = []
    stamps, points = tree.origins('marker', 'world', skipped.append)
    assert (stamps.tolist(), skipped) == ([0, 500_000_000, 10**9], [])
    expected = [[1.0, 0.0, 0.0], [1.0 + half, half, 0.0], [2.0, 1.0, 0.0]]
    np.testing.assert_allclose(points, expected, atol=1e-12)


@pytest.mark.parametrize(
    ('quaternion', 'message'),
    [((0.0, 0.0, 0.0, 0.0), 'a quaternion of norm 1'), ((np.nan, 0.0, 0.0, 1.0), 'finite num')],
)
def test_a_transform_on_the_way_that_is_no_rotation_is_refused(
    quaternion: tuple[float, ...], message: str
) -> None:
    tree = TransformTree()
    add(tree, 'world', 'camera', 0, 0.0, 0.0, 0.0, *quaternion)
    add(tree, 'camera', 'marker', 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    with pytest.raises(MeasurementError, match=message):
        tree.origins('marker', 'world', lambda why: None)


def test_a_static_marker_needs_no_rotation() -> None:
    tree = TransformTree()
    # An orientation that nobody set.
    tree.add('tracker', 'marker', 0, np.array([1.0, 0.0, 0.0]), np.zeros(4), True)
    add(tree, 'world', 'tracker', 5, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    stamps, points = tree.origins('marker', 'world', lambda why: None)
    assert (stamps.tolist(), points.tolist()) == ([5], [[1.0, 2.0, 0.0]])


def test_circles_and_second_parents_are_refused() -> None:
    level = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    tree = TransformTree()
    add(tree, 'a', 'b', 0, *level)
    add(tree, 'b', 'a', 0, *level)
    with pytest.raises(MeasurementError, match='parents of frames form a cycle: b < a < b'):
        tree.chain('b')
    with pytest.raises(MeasurementError, match="the parent of 'b' is 'c', expected 'a' as before"):
        add(tree, 'c', 'b', 1, *level)
    add(tree, 'x', 'y', 0, *level)
    with pytest.raises(MeasurementError, match="no transforms connect 'y' and 'z'"):
        add(tree, 'z', 'w', 0, *level)
        tree.origins('y', 'z', lambda why: None)


def test_a_pose_in_another_frame_is_that_of_the_transforms_between() -> None:
    tree = TransformTree()
    for child, parent, (turn, shift) in (
        ('camera', 'world', WORLD_TO_CAMERA),
        ('arm_base', 'world', WORLD_TO_BASE),
    ):
        tree.add(parent, child, 0, shift, turn.as_quat(), True)
    for stamp in (0, 10):
        shift = np.array([0.0, 0.1 * stamp, 0.0])
        tree.add('camera', 'tracker', stamp, shift, pan(stamp).as_quat(), False)
    pose = tree.pose('tracker', 'arm_base', 4)
    point = np.array([0.1, 0.2, 0.3])
    world = WORLD_TO_CAMERA[0].apply(pan(4).apply(point) + [0.0, 0.4, 0.0]) + WORLD_TO_CAMERA[1]
    expected = WORLD_TO_BASE[0].inv().apply(world - WORLD_TO_BASE[1])
    found = Rotation.from_quat(pose.quaternion).apply(point) + pose.position
    np.testing.assert_allclose(found, expected, atol=1e-12)
    with pytest.raises(MeasurementError, match="'tracker' to 'camera' is not known at"):
        tree.pose('tracker', 'arm_base', 11)
    with pytest.raises(MeasurementError, match="no frame 'elbow'"):
        tree.pose('elbow', 'arm_base', 0)
    tree.add('tracker', 'moon', 0, np.array([2e9, 0.0, 0.0]), np.eye(4)[3], True)
    with pytest.raises(ConfigError, match=r"the position of 'moon' is .*, expected 3 finite"):
        tree.pose('moon', 'tracker', 0)


def moving(*stamps: int, child: str = 'b', tree: TransformTree | None = None) -> TransformTree:
    """A frame that is as far from 'a' [m] as it is late [ns]."""
    tree = tree or TransformTree()
    for stamp in stamps:
        shift, turn = np.array([stamp, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])
        tree.add('a', child, stamp, shift, turn, False)
    return tree


def place(tree: TransformTree, stamp: int, child: str = 'b') -> float:
    return tree.pose(child, 'a', stamp).position[0]


def test_what_is_forgotten_is_older_than_the_newest_by_the_history() -> None:
    tree = moving(30, 10, 20)
    tree.forget(10)
    assert place(tree, 25) == 25.0
    with pytest.raises(MeasurementError, match='is not known'):
        place(tree, 15)
    tree.forget(0)
    assert place(tree, 30) == 30.0


def test_a_clock_that_began_anew_is_followed() -> None:
    tree = moving(1000, 1010, 1020)
    for stamp in (5, 15):
        moving(stamp, tree=tree)
        tree.forget(100)
    assert place(tree, 10) == 10.0
    with pytest.raises(MeasurementError, match='is not known'):
        place(tree, 1010)


def test_one_stamp_far_ahead_is_soon_forgotten() -> None:
    tree = moving(10, 20)
    for stamp in (10**18, 30, 40):
        moving(stamp, tree=tree)
        tree.forget(100)
    assert place(tree, 35) == 35.0
    with pytest.raises(MeasurementError, match='is not known'):
        place(tree, 41)
