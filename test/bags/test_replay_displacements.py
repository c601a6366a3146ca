"""Replay of displacements: by themselves, beside tensions, and beside the node."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.testing import assert_allclose
from recordings import (
    ARM,
    TENDON_TENSIONS,
    Sample,
    displacement_sample,
    tensions_data,
    text_sample,
    write_bag,
)

from octo_arm_model import Config, displacements_of, solve_displacements
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import load_parameters, parameters_as_yaml, preset_path

PARAMETERS = load_parameters(preset_path('renda2012_table4')) | {
    'model': 'exact', 'tendons.axial_stiffness': [800.0],
}  # fmt: skip
FIRST = 10**6  # [ns]
PULL = 0.3 * np.array(FETCHING_IN_SPACE)
HALF = {'tendon_1_1': 0.02, 'tendon_2_2': 0.01}
ESTIMATES = '/tendon_tension_estimates'
Inputs = list[dict[str, float] | np.ndarray]


def content(inputs: Inputs) -> list[Sample]:
    """Messages of displacements by name, and of tensions, 1 ms apart."""
    found = []
    for number, given in enumerate(inputs):
        stamp = FIRST * (1 + number)
        if isinstance(given, dict):
            found.append(displacement_sample(list(given), list(given.values()), stamp, delay=5))
        else:
            data = tensions_data(TENDON_TENSIONS, ARM.tendon_names, given, stamp)
            found.append(Sample('/tendon_tensions', TENDON_TENSIONS, stamp + 5, data))
    return found


def bag_of(path: Path, inputs: Inputs, **changes: Any) -> Path:
    text = text_sample('/arm_description', parameters_as_yaml(PARAMETERS | changes), 1)
    return write_bag(path, [text, *content(inputs)])


def replayed(path: Path, topic: str) -> list[Any]:
    with BagReader(path) as reader:
        return [reader.decode(record) for record in reader.messages([topic])]


def tips(path: Path) -> dict[int, list[float]]:
    """Tip [m] by number of the message that it answers."""
    poses = [(message.header.stamp.nanosec, message.pose.pose.position)
             for message in replayed(path, '/tip_pose')]  # fmt: skip
    return {stamp // FIRST - 1: [tip.x, tip.y, tip.z] for stamp, tip in poses}


def test_displacements_alone_give_back_shapes_and_tensions(cli, tmp_path):
    solver = Config.from_parameters(PARAMETERS).solver()
    shapes = [solver.solve(part * PULL) for part in (0.4, 0.7, 1.0)]
    reeled = [displacements_of(solver, shape).ravel().tolist() for shape in shapes]
    bag = bag_of(tmp_path / 'in', [dict(zip(ARM.tendon_names, row)) for row in reeled])
    table = tmp_path / 'table'
    assert cli('replay', bag, tmp_path / 'out', '--csv', table)[0] == 0
    found = tips(tmp_path / 'out')
    assert_allclose([found[n] for n in range(3)], [one.tip for one in shapes], atol=1e-8)
    estimates = replayed(tmp_path / 'out', ESTIMATES)
    expected = [shape.tensions.ravel() for shape in shapes]
    assert_allclose([one.tension for one in estimates], expected, atol=1e-7)
    assert {tuple(one.name) for one in estimates} == {ARM.tendon_names}
    rows = list(csv.reader((table / 'tensions.csv').open(encoding='utf-8')))[1:]
    assert_allclose(np.array(rows, float)[:, 1:], expected, atol=1e-7)


def test_winches_and_load_cells_drive_different_tendons_until_all_are_let_go(tmp_path, cli):
    inputs = [{}, PULL, HALF, 1.2 * PULL, {'elbow': 0.1}, {}]
    bag = bag_of(tmp_path / 'in', inputs)
    table = ['--csv', str(tmp_path / 'table')]
    report = cli.json('replay', bag, tmp_path / 'out', '--json', *table)['topics']
    assert report['/tendon_tensions']['answered'] == 2
    winches = report['/tendon_displacements']
    assert (winches['answered'], winches['refused']) == (3, 1)
    ((stamp, reason),) = winches['skips']
    assert stamp == 5 * FIRST and reason.startswith('unknown tendon elbow')
    solver = Config.from_parameters(PARAMETERS).solver()
    found = tips(tmp_path / 'out')
    expected = {0: solver.solve(0.0 * PULL), 1: solver.solve(PULL), 5: solver.solve(1.2 * PULL)}
    for number, tensions in ((2, PULL), (3, 1.2 * PULL)):
        named = dict(zip(ARM.tendon_names, tensions.ravel().tolist()))
        others = {name: value for name, value in named.items() if name not in HALF}
        expected[number] = solve_displacements(solver, HALF, others).backbone
    assert found.keys() == expected.keys()
    for number, shape in expected.items():
        assert_allclose(found[number], shape.tip, atol=1e-8)
    # Estimates are those of shapes with tendons driven by length.
    stamps = [one.header.stamp.nanosec for one in replayed(tmp_path / 'out', ESTIMATES)]
    assert stamps == [3 * FIRST, 4 * FIRST]
    rows = {
        name: list(csv.reader((tmp_path / 'table' / f'tensions_{name}.csv').open()))[1:]
        for name in ('tendon_tensions', 'tendon_displacements')
    }
    assert [len(one) for one in rows.values()] == [2, 3]
    assert not np.array(rows['tendon_displacements'][0][1:], float).any()


def test_named_topics_are_all_that_is_read(cli, tmp_path):
    bag = bag_of(tmp_path / 'in', [PULL, HALF, PULL])
    for topic, numbers in (('/tendon_tensions', {0, 2}), ('tendon_displacements', {1})):
        out = tmp_path / topic.strip('/')
        assert cli('replay', bag, out, '--topics', topic)[0] == 0
        assert tips(out).keys() == numbers
