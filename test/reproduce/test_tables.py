"""The paper's tables, and the models' numbers beside them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from octo_arm_model import MODELS, load_config
from octo_arm_model.config.paper_data import PROTOTYPE_ERRORS
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.reproduce import tables


def test_the_arms_are_those_printed() -> None:
    rows = [' '.join(row[1:]) for row in tables.arms().rows]
    assert rows == [
        '110 0.5 310 6.5 15 1 7.5 3.5 3.5 217 6 6 93',
        '110 0.5 450 2 15 1 7.5 3.5 3.5 315 6 6 135',
        '110 0.5 300 1.5 10 1 0.66 – – – – – –',
        '110 0.5 270 7.4 15 2.5 5 – – – – – –',
    ]


def test_the_tensions_are_those_printed() -> None:
    table = tables.tensions()
    assert table.header[1:] == ('T11', 'T12', 'T13', 'T14', 'T21', 'T32', 'T33')
    assert {row[0]: ' '.join(row[1:]) for row in table.rows} == {
        'Figure 11(A)': '0 0 1 1 0 0 0',
        'Figure 11(B)': '1 1.732 0 0 0 0 0',
        'Figure 11(C)': '0 1 1.732 0 0 0 0',
        'Figure 14': '0 0 0.5 0 4 0 13',
        'Figure 15': '0 0 0.5 0 4 13 0',
    }


def test_tips_in_table_1_are_those_of_the_solver_beside_the_papers_errors() -> None:
    config = load_config(preset_path('renda2012_prototype'))
    *rows, last = tables.tip_errors().rows
    assert last[:2] == ('average', '5.4')
    for row, (tension, error) in zip(rows, PROTOTYPE_ERRORS.items(), strict=True):
        assert row[:2] == (f'{tension:.2f}', f'{error:.1f}')
        for cell, model in zip(row[2:5], MODELS, strict=True):
            tip = config.solver(model).solve([[tension, 0.0, 0.0, 0.0]]).tip
            printed = [float(value) for value in cell.split(', ')]
            np.testing.assert_allclose(printed, tip[:2] * 1e3, atol=0.06)


@pytest.mark.parametrize(
    'make', [tables.arms, tables.finite_elements, tables.tip_errors, tables.tensions,
             tables.bending, tables.fetching]
)  # fmt: skip
def test_rows_are_as_long_as_the_header(make: Callable[[], tables.DataTable]) -> None:
    table = make()
    assert {len(row) for row in table.rows} == {len(table.header)}
