"""Encoders of winches in recordings, of bags and CSV files, beside load cells and alone."""

from pathlib import Path

import numpy as np
import pytest
from experiments import (
    HELD,
    PARAMETERS,
    arm_file,
    bag_of,
    description,
    midline,
    nanoseconds,
    one_tendon,
    path_sample,
    staircase,
    tension_samples,
)
from numpy.testing import assert_allclose
from recordings import displacement_sample

from octo_arm_model import Config, displacements_of
from octo_arm_model.arm.errors import BagError, MeasurementError
from octo_arm_model.arm.pose import Pose
from octo_arm_model.experiment.csv_recording import CsvSources
from octo_arm_model.experiment.observations import RAMP, Pairing, observe
from octo_arm_model.experiment.read_recording import read_recording
from octo_arm_model.experiment.recording import Recording

STRETCHING = {'tendons.axial_stiffness': [500.0], 'model': 'exact'}
ARM = Config.from_parameters({**PARAMETERS, **STRETCHING}).arm
NAMES = ARM.tendon_names
TIME, PULLED = staircase(HELD[:4], hold=2.0)
SEEN = np.arange(0.0, TIME[-1], 0.1)


def reeled_in(tension: float) -> np.ndarray:
    """What the first winch has reeled in under a ``tension`` [N], the others 3 mm short of it."""
    solver = Config.from_parameters({**PARAMETERS, **STRETCHING}).solver()
    backbone = solver.solve(one_tendon(tension).reshape(solver.arm.tension_shape))
    return displacements_of(solver, backbone).ravel() - [0.0, 3e-3, 3e-3, 3e-3]


LEVELS = np.linspace(0.0, max(HELD[:4]), 60)
LENGTHS = np.array([reeled_in(level) for level in LEVELS])


def lengths(pulled: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(pulled, LEVELS, column) for column in LENGTHS.T], axis=1)


def encoder_samples(names: tuple[str, ...] = NAMES, topic: str = '/tendon_displacements') -> list:
    """What encoders of the tendons ``names`` read, at 50 Hz."""
    columns = [NAMES.index(name) if name in NAMES else 0 for name in names]
    return [
        displacement_sample(names, row[columns], nanoseconds(at), topic)
        for at, row in zip(TIME, lengths(PULLED))
    ]


def frames() -> list[tuple[float, np.ndarray]]:
    """Midlines where the arm stands still, and when they were seen."""
    pulled = np.interp(SEEN, TIME, PULLED)
    return [
        (at, midline('exact', one_tendon(tension), 31))
        for at, tension in zip(SEEN.tolist(), pulled.tolist())
        if tension in HELD
    ]


@pytest.fixture(scope='module')
def seen():
    return [path_sample(points, nanoseconds(at)) for at, points in frames()]


def test_encoders_are_read_beside_load_cells(tmp_path, seen):
    loads = [one._replace(topic='/daq/cells') for one in tension_samples(TIME, PULLED)]
    encoders = encoder_samples(NAMES[1::-1])
    wrong = encoder_samples(('somebody',))[:3]
    bag = bag_of(tmp_path / 'bag', [description(), *seen, *loads, *encoders, *wrong])
    recording = read_recording(bag)
    assert recording.tensions.shape == (TIME.size, 4)
    assert_allclose(recording.displacement_time, recording.tension_time)
    expected = lengths(PULLED)
    assert_allclose(recording.displacements[:, :2], expected[:, :2], atol=1e-12)
    assert np.isnan(recording.displacements[:, 2:]).all()
    (line,) = recording.refusals.lines()
    assert 'unknown tendon somebody' in line
    assert not recording.is_driven
    for shape in observe(recording, known=Pose()).shapes:
        held = lengths(np.array([shape.tension]))[0]
        assert_allclose(shape.window.displacements[:2], held[:2], atol=1e-6)
        assert not shape.window.is_driven


def check_driven(recording: Recording) -> None:
    """Tensions of steps follow from lengths."""
    assert recording.is_driven
    observations = observe(recording, Pairing(offset=0.0), Pose())
    found = np.array([shape.window.tensions for shape in observations.shapes])
    assert_allclose(found[:, 0], HELD[:4], atol=2e-3)
    assert (found[:, 1:] == 0.0).all()
    assert all(shape.window.is_driven for shape in observations.shapes)
    assert any('no load cells' in note for note in observations.notes)


def test_without_load_cells_tensions_follow_from_lengths(tmp_path, seen, cli):
    encoders = encoder_samples(topic='/winches')
    bag = bag_of(tmp_path / 'bag', [description(**STRETCHING), *seen, *encoders])
    check_driven(read_recording(bag, displacements='/winches'))
    out = tmp_path / 'out'
    arguments = ['compare', str(bag), '--displacements', 'winches', '--out', str(out), '--json']
    said = cli.json(*arguments)
    assert [step['tensions'][0] for step in said['steps']] == pytest.approx(HELD[:4], abs=2e-3)
    assert max(step['tip_error_percent'] for step in said['steps']) < 0.05


def test_readings_that_leave_all_tendons_slack_are_noted(tmp_path, cli):
    table, config = tmp_path / 'counts.csv', arm_file(tmp_path, {**PARAMETERS, **STRETCHING})
    table.write_text('m,x,y,z\n2048,0.27,0,0\n2100,0.26,0.05,0\n')
    words = f'compare --config {config} --pose-csv {table} --align none --spools -1.5e-05 --motors'
    said = cli.json(*words.split(), 'm', 'm', 'm', 'm', '--json')
    assert any('no tendon is taut in any step: the sign' in note for note in said['notes'])


def test_encoders_may_publish_in_messages_of_their_own(tmp_path, seen):
    """Each at its own times, the first one only until its tendon moves no more."""
    encoders = [
        displacement_sample([name], [row[NAMES.index(name)]], nanoseconds(at) + 10**6 * number)
        for at, row in zip(TIME, lengths(PULLED))
        for number, name in enumerate(NAMES)
        if name != NAMES[0] or at < TIME[-1] - 1.9
    ]
    bag = bag_of(tmp_path / 'bag', [description(**STRETCHING), *seen, *encoders])
    recording = read_recording(bag)
    check_driven(recording)
    ramp = observe(recording, Pairing(offset=0.0, kind=RAMP), Pose()).shapes
    assert max(shape.tension for shape in ramp) == pytest.approx(max(HELD[:4]), abs=2e-3)
    assert all(np.isfinite(shape.window.displacements).all() for shape in ramp)


def midline_csv(path: Path) -> Path:
    rows = [f'{at!r},{x!r},{y!r},{z!r}' for at, points in frames() for x, y, z in points.tolist()]
    path.write_text('\n'.join(['time,x,y,z', *rows]) + '\n')
    return path


def test_what_is_wrong_with_encoders_is_said(tmp_path, seen):
    table = tmp_path / 'winches.csv'
    table.write_text('time,a\n0,1\n')
    files = CsvSources(midlines=midline_csv(tmp_path / 'track.csv'), displacements=table)
    with pytest.raises(MeasurementError, match='no column displacement_tendon_1_1, nor that of'):
        read_recording(None, 'renda2012_prototype', files=files)
    bag = bag_of(tmp_path / 'bag', [description(), *seen, *encoder_samples(('x',))])
    with pytest.raises(BagError, match='no encoder readings for this arm on /tendon_displacem'):
        read_recording(bag)
    with pytest.raises(MeasurementError, match='--displacements and --displacement-csv are given'):
        read_recording(bag, displacements='/x', files=CsvSources(displacements=table))
    both = [*encoder_samples(), *encoder_samples(topic='/other/tendon_displacements')]
    bag = bag_of(tmp_path / 'both', [description(), *seen, *both])
    with pytest.raises(BagError, match='several topics of displacements, name one of'):
        read_recording(bag)
