"""Raw load cells in a bag: noise around zero, a wrong scale and an offset, told and fitted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from experiments import ARM, bag_of, description, nanoseconds, one_tendon
from labs import MARKER_S, TENSIONS, TIP_ERRORS, pose_array, seen, staircase_of
from recordings import TENDON_TENSIONS, Sample, tensions_data

GIVEN = ['--marker-s', *map(str, MARKER_S), '--clock-offset', '0', '--json']
COUNT = len(staircase_of()[0])
FEW = TENSIONS[::2]


def cell_bag(
    path: Path,
    scale: float = 1.0,
    offset: float = 0.0,
    held: Sequence[float] = TENSIONS,
    **changes: Any,
) -> str:
    """Cells of which the true tension is ``scale`` times the reading plus ``offset`` [N]."""
    rng = np.random.default_rng(0)
    time, pulled, times = staircase_of(held)
    samples: list[Sample] = [description(model='exact', **changes)]
    for at, pull in zip(time, pulled):
        true = one_tendon((pull - offset) / scale)
        read = true + 2e-3 * rng.standard_normal(4)
        stamp = nanoseconds(at)
        data = tensions_data(TENDON_TENSIONS, ARM.tendon_names, read, stamp)
        samples.append(Sample('/tendon_tensions', TENDON_TENSIONS, stamp, data))
    for at, pull in zip(times, np.interp(times, time, pulled)):
        samples += pose_array(seen(float(pull), MARKER_S), nanoseconds(at))
    return str(bag_of(path, samples))


def test_readings_below_zero_are_counted_by_reason_and_zero_within_a_deadband(tmp_path, cli):
    bag = cell_bag(tmp_path / 'raw')
    notes = cli.json('compare', bag, *GIVEN)['notes']
    counts = [int(note.split()[1]) for note in notes if 'left out, as tension of tendon_1' in note]
    # Seven of eight messages have one of three slack tendons below zero, by its name.
    assert len(counts) == 3
    assert sum(counts) == pytest.approx(7 / 8 * COUNT, rel=0.05)
    (report,) = cli.json('replay', bag, tmp_path / 'out', '--json')['topics'].values()
    assert sorted(report['reasons'].values()) == sorted(counts)
    quiet = cell_bag(tmp_path / 'quiet', tension_deadband=0.012)
    said = cli.json('compare', quiet, *GIVEN)
    assert not any('left out' in note for note in said['notes'])
    errors = [step['tip_error_percent'] for step in said['steps']]
    assert errors == pytest.approx(TIP_ERRORS, abs=0.05)
    replayed = cli.json('replay', quiet, tmp_path / 'all', '--json')
    (report,) = replayed['topics'].values()
    assert (report['answered'], report['refused']) == (COUNT, 0)


def test_the_fitted_file_reproduces_the_fit(tmp_path, cli):
    bag = cell_bag(tmp_path / 'bag', 1.2, 0.15, FEW, tension_deadband=0.012)
    fitted = str(tmp_path / 'fitted.yaml')
    fits = ['--model', 'exact', '--fit', 'tension_scale', 'tension_offset']
    said = cli.json('identify', bag, *GIVEN, *fits, '--out', fitted)
    scale, offset = (said['estimates'][name] for name in ('tension_scale', 'tension_offset'))
    assert scale['interval95'][0] < 1.2 < scale['interval95'][1]
    assert offset['interval95'][0] < 0.15 < offset['interval95'][1]
    before, after = (said['residuals'][name]['tip_error_percent'] for name in ('before', 'after'))
    assert after < 0.1 * before
    again = cli.json('compare', bag, *GIVEN, '--config', fitted)
    average = again['models']['exact']['average_tip_error_percent']
    assert average == pytest.approx(after, rel=5e-3)
    out = str(tmp_path / 'out')
    report = cli.json('replay', bag, out, '--config', fitted, '--json')['topics']
    assert report['/tendon_tensions']['answered'] == len(staircase_of(FEW)[0])
