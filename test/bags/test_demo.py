"""The simulated experiment."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from recordings import tensions_in

from octo_arm_model import Config, Solver, displacements_of, load_config
from octo_arm_model.bags.outputs import (
    CAMERA_POSITION,
    CAMERA_QUATERNION,
    Experiment,
    add_demo,
    custom_data,
)
from octo_arm_model.bags.reader import BagReader, stamp_of
from octo_arm_model.bags.writer import BagWriter
from octo_arm_model.config.paper_data import PROTOTYPE_ERRORS
from octo_arm_model.config.parameter_files import load_parameters, parse_parameters, preset_path
from octo_arm_model.rod.rotations import axes_of
from octo_arm_model.wire.tensions import read_displacements

PROTOTYPE = load_parameters('renda2012_prototype')


CLEAN = Experiment(
    clock_offset=0.25,
    hold=1.0,
    ramp=0.5,
    camera_rate=4.0,
    tension_noise=0.0,
    midline_noise=0.0,
    dropped=0.0,
    outliers=0.0,
    encoder_noise=0.0,
)


Seen = dict[int, Any]


def written(path: Path, experiment: Experiment, *topics: str) -> tuple[Seen, list[Seen]]:
    """Tensions of a demo by their stamps [ns], and the messages of ``topics`` by receipt."""
    with BagWriter(path, custom=custom_data(experiment)) as writer:
        add_demo(writer, PROTOTYPE, experiment)
    with BagReader(path) as reader:
        config = Config.from_parameters(PROTOTYPE)
        tensions = {one.stamp.ns: one.tensions for one in tensions_in(reader, config)}
        found = [
            {one.received_ns: reader.decode(one) for one in reader.messages([topic])}
            for topic in topics
        ]
    return tensions, found


def solver_of(experiment: Experiment, **changes: Any) -> Solver:
    """Of the true arm."""
    young = experiment.stiffness * 110000.0
    values = {**PROTOTYPE, 'model': 'exact', 'material.youngs_modulus': young, **changes}
    return Config.from_parameters(values).solver()


def place(point: Any) -> np.ndarray:
    return np.array([point.x, point.y, point.z])


def test_the_demo_without_noise_is_the_exact_arm_seen_by_the_camera(tmp_path):
    tensions, (midlines,) = written(tmp_path / 'bag', CLEAN, '/camera/midline')
    solver, rotation = solver_of(CLEAN), axes_of(CAMERA_QUATERNION)
    assert max(float(np.max(row)) for row in tensions.values()) == max(PROTOTYPE_ERRORS)
    assert len(midlines) > 40
    for received, message in midlines.items():
        assert stamp_of(message, 0).ns == received + 250_000_000
        points = np.array([place(one.pose.position) for one in message.poses])
        points = points @ rotation.T + CAMERA_POSITION
        expected = solver.solve(tensions[received])
        assert_allclose(points[-1], expected.tip, atol=1e-9)
        assert_allclose(points[0], expected.position[0], atol=1e-12)


@pytest.mark.parametrize('softer', [{'sheath': 2.5e5}, {'axial_stiffness': 300.0}])
def test_a_demo_with_softer_tendons_has_what_encoders_read(tmp_path, softer):
    experiment = dataclasses.replace(CLEAN, tension_rate=5.0, **softer)
    tensions, (read,) = written(tmp_path / 'bag', experiment, '/tendon_displacements')
    solver = solver_of(
        experiment,
        **{
            f'tendons.{name.removesuffix("_stiffness")}_stiffness': [value]
            for name, value in softer.items()
        },
    )
    assert len(read) == len(tensions)
    for received, message in read.items():
        expected = displacements_of(solver, solver.solve(tensions[received])).ravel().tolist()
        named = dict(zip(solver.arm.tendon_names, expected, strict=True))
        assert read_displacements(message, solver.arm) == pytest.approx(named, abs=1e-7)


def test_the_demo_says_everywhere_that_it_is_synthetic(cli, tmp_path):
    given = '--seed', '3', '--storage', 'sqlite3'
    assert cli('record-demo', tmp_path / 'bag', *given)[0] == 0
    with BagReader(tmp_path / 'bag') as reader:
        assert 'synthetic' in reader.metadata['note']
        truth = json.loads(reader.metadata['truth'])
        assert truth['seed'] == 3
        assert truth['stiffness'] == 1.1
        (note,) = reader.messages(['/note'])
        assert reader.decode(note).data == reader.metadata['note']
        (description,) = reader.messages(['/arm_description'])
        text = reader.decode(description).data
        assert Config.from_parameters(parse_parameters(text, 'it')) == load_config(
            preset_path('renda2012_prototype')
        )
        midlines = reader.count(['/camera/midline'])
        assert 0.85 * 390 < midlines < 390
        config = load_config('renda2012_prototype')
        assert all(not one.reason for one in tensions_in(reader, config))


def test_the_demo_refuses_nonsense(tmp_path, cli):
    for options, expected in (
        (['--stiffness', '-1'], '--stiffness is -1.0, expected a finite number > 0'),
        (['--clock-offset', 'nan'], '--clock-offset is nan, expected a finite number'),
        (['--clock-offset', '1e10'], '--clock-offset is 10000000000.0, expected a finite number'),
        (['--markers', '0.1', '5'], '--markers is 5.0, expected a finite number within [0, 0.27]'),
        (['--seed', '-1'], '--seed is -1, expected an integer >= 0'),
        (['--sheath', '-1'], '--sheath is -1.0, expected a finite stiffness >= 0 [Pa]'),
        (['--axial-stiffness', '-1'], '--axial-stiffness is -1.0, expected a finite stiffn'),
        (['--friction', '-0.1'], '--friction is -0.1, expected a finite coefficient >= 0'),
        (['--touch', '-1'], '--touch is -1.0, expected a finite force >= 0 [N]'),
        (['--friction', '1e9'], 'expected a finite coefficient >= 0 [-] of at most 10'),
    ):
        assert expected in cli.refused('record-demo', tmp_path / 'bag', *options)
    assert list(tmp_path.iterdir()) == []


def test_with_friction_tensions_rise_and_fall_and_the_arm_remembers(tmp_path):
    rough = dataclasses.replace(CLEAN, friction=0.2, clock_offset=0.0)
    tensions, (midlines,) = written(tmp_path / 'bag', rough, '/camera/midline')
    at = {}
    for received, message in midlines.items():
        tip = place(message.poses[-1].pose.position)
        at.setdefault(float(np.max(tensions[received])), []).append(tip)
    level, *_, top = sorted(PROTOTYPE_ERRORS)
    assert max(at) == top
    # The same tension, on the way up and on the way down.
    assert np.linalg.norm(at[level][0] - at[level][-1]) > 1e-3
    assert_array_equal(at[top][0], at[top][-1])
