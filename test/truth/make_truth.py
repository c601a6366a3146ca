#!/usr/bin/env python3
"""Makes truth.json.gz: what the solver of commit dfd4d63a says, each value with its error.

    tools/with_ros python test/truth/make_truth.py PIECES FIELD [ARM ...]

writes PIECES/ARM.json for every arm that has none there yet (some minutes each), then the
faults, of files in FIELD, and the refusals, and joins them to truth.json.gz. It was run once,
before the core was rewritten, and needs that core: what it says of finer runs holds for it
alone.

How a value came about: the solver has no setting for its accuracy, but it puts the ends of its
elements and intervals at every place where the arm is not smooth. So the arm is described again
with such places at L / 24 and L / 48 (of a modulus that does not change there), and with 4 and 8
times as many stations, `refined`. The value is that of the finest run, and its error the
distance of the two finest ones: an upper bound wherever the runs converge, as they do. What the
file holds as `today` is how far the solver as it is, by default, was off, where that is more
than is tolerated. Four errors were raised by hand: of by_tension of
random_13_metal/25, of strain and tension of random_17_thin/29 and of tension of
random_19_stout/31, which the rod that replaced that core gives alike at accuracies of 1e-8 to
1e-12.

Of several equilibria under loads that may exist only those cases are kept that are found from
nothing, by Newton's method, and along the whole way of loads that grow from nothing, tensions
held, alike; and by NumPy and machine code alike. What was left out is in PIECES/ARM.log.
"""

from __future__ import annotations

import argparse
import dataclasses
import gzip
import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from truth_arms import SEED, Parameters, all_arms
from truth_cases import FILE, Answer, answer_of, distance, tolerance
from truth_faults import faults
from truth_finer import DIGITS, refined, stations_for, wanted_places
from truth_plans import SHAPE, Plan, makers
from truth_refusals import refusals

from octo_arm_model import Config, Loads, OctoArmError, PointLoad

# Parts between knots, and times as many stations, of the two finest runs; and of arms that tendons
# with friction have a history in, whose tensions have kinks where they begin to stick.
FINE, FINEST = (24, 4), (48, 8)
FINE_HISTORY, FINEST_HISTORY = (48, 4), (96, 8)
STATIONS = (31, 61, 101)
ATTEMPTS = 6


# Loads that grow -------------------------------------------------------------------------------


def scaled(loads: Loads, factor: float) -> Loads:
    """So much of the ``loads``."""

    def times(vector: Any) -> Any:
        return tuple(factor * part for part in vector)

    return dataclasses.replace(
        loads,
        gravity=times(loads.gravity), tip_force=times(loads.tip_force),
        tip_moment=times(loads.tip_moment),
        points=tuple(
            PointLoad(one.s, times(one.force), times(one.moment)) for one in loads.points
        ),
        distributed=tuple(
            dataclasses.replace(one, force=tuple(times(force) for force in one.force))
            for one in loads.distributed
        ),
    )  # fmt: skip


def along_the_way(config: Config, step: Mapping[str, Any], parts: int = 12) -> np.ndarray:
    """Tip of an arm under tensions, its loads growing from nothing."""
    shape = None
    wrench = np.array(step.get('tip_wrench', np.zeros(6)))
    for factor in np.linspace(0.0, 1.0, parts + 1)[1:]:
        solver = dataclasses.replace(config, loads=scaled(config.loads, factor)).solver()
        shape = solver.solve(step['tensions'], factor * wrench, start=shape)
    return shape.tip


# One case ---------------------------------------------------------------------------------------


class LeftOutError(Exception):
    """A case that is not kept, and why."""


def case_of(name: str, given: Parameters, number: int, plan: Plan, stations: int) -> Any:
    """The case of a ``plan`` as the file has it."""
    changes = plan.changes | {'stations': stations}
    config = Config.from_parameters(given | changes)
    changes['stations'] = stations_for(config, stations)
    config = Config.from_parameters(given | changes)
    steps = tuple(json.loads(json.dumps(plan.steps)))

    quantities = plan.quantities

    def run(what: str, config: Config, compiled: bool | None = None) -> Answer:
        solver = config.solver(compiled=compiled)
        places = wanted_places(config)
        try:
            return answer_of(solver, config.uncertainty, steps, places, quantities)
        except OctoArmError as error:
            raise LeftOutError(f'{what}: {type(error).__name__}: {error}') from error

    places = wanted_places(config)
    try:
        numpy = run('NumPy', config, False)
    except LeftOutError as error:
        # Where tendons stick this solver has no derivatives, but shapes.
        if 'no derivatives' not in str(error):
            raise
        quantities = tuple(
            one for one in quantities if one in ('tips', 'base_tension', 'displacement', *SHAPE)
        )
        numpy = run('NumPy', config, False)
    machine = run('machine code', config)
    length = config.arm.length

    def far(one: np.ndarray, other: np.ndarray) -> float:
        return float(np.abs(one - other).max()) / length

    if (off := far(numpy['position'], machine['position'])) > 1e-5:
        raise LeftOutError(f'NumPy and machine code differ by {off:.1e}')
    sticks = bool(config.arm.friction) and len(steps) > 1
    fine = run('fine', refined(config, FINE_HISTORY if sticks else FINE))
    finest = run('finest', refined(config, FINEST_HISTORY if sticks else FINEST))
    if (off := far(fine['position'], finest['position'])) > 1e-3:
        raise LeftOutError(f'finer runs differ by {off:.1e}')
    if (off := far(machine['position'], finest['position'])) > 1e-3:
        raise LeftOutError(f'a finer run differs by {off:.1e}')
    first = steps[0]
    if config.model == 'exact' and 'displacements' not in first and len(steps) == 1:
        if config.loads.any or 'tip_wrench' in first:
            off = far(along_the_way(config, first), machine['position'][-1])
            if off > 1e-5:
                raise LeftOutError(f'loads that grow lead to another shape, {off:.1e} away')
    expected, error, today, beyond = {}, {}, {}, {}
    for quantity in quantities:
        right = finest[quantity]
        size = float(np.abs(right).max(initial=0.0))
        decimals = DIGITS - 1 - int(np.floor(np.log10(size))) if size > 0.0 else 0
        expected[quantity] = np.round(right, decimals).tolist()
        error[quantity] = float(f'{distance(quantity, fine[quantity], right).max():.1e}')
        allowed = tolerance(quantity, right, length)
        if (part := float((distance(quantity, fine[quantity], right) / allowed).max())) > 0.1:
            beyond[quantity] = round(part, 1)
        allowed = np.maximum(allowed, error[quantity])
        off = np.maximum(*(
            distance(quantity, one[quantity], right) for one in (numpy, machine)
        ))  # fmt: skip
        if (off > allowed).any():
            today[quantity] = float(f'{off.max():.1e}')
    found = {
        'name': f'{name}/{number:02d}', 'kind': plan.kind, 'arm': name, 'changes': changes,
        'steps': steps, 's': places.tolist(), 'expected': expected, 'error': error,
    }  # fmt: skip
    return found | {'beyond': beyond} | ({'today': today} if today else {})


def cases_of(name: str, given: Parameters, log: Any) -> list[Any]:
    """All cases of one arm."""
    found = []
    arm_number = sum(map(ord, name))
    for number, make in enumerate(makers(name, given)):
        began = time.monotonic()
        for attempt in range(ATTEMPTS):
            rng = np.random.default_rng([SEED, arm_number, number, attempt])
            plan = None
            try:
                plan = make(rng)
                stations = STATIONS[int(rng.integers(len(STATIONS)))]
                case = case_of(name, given, number, plan, stations)
            except (OctoArmError, LeftOutError) as error:
                kind = type(error).__name__
                print(f'{name}/{number:02d} attempt {attempt}: {kind}: {error}', file=log)
                print(json.dumps(plan and plan._asdict()), file=log, flush=True)
                continue
            found.append(case)
            took = time.monotonic() - began
            print(
                f'{case["name"]} {case["kind"]}: {took:.1f} s, attempt {attempt}, '
                f'today {case.get("today", "fine")}, errors {case.pop("beyond")}',
                flush=True,
            )
            break
        else:
            print(f'{name}/{number:02d}: none', flush=True)
    return found


def join(pieces: Path, arms: dict[str, Parameters]) -> None:
    """Write the file of all ``pieces``; its bytes depend on what is in it alone."""
    cases = []
    for name in [*arms, 'faults', 'refusals']:
        cases += json.loads((pieces / f'{name}.json').read_text())
    content = {'arms': arms, 'cases': cases}
    text = json.dumps(content, separators=(',', ':'), allow_nan=True)
    FILE.write_bytes(gzip.compress(text.encode(), 9, mtime=0))
    print(f'{len(cases)} cases, {FILE.stat().st_size / 1e6:.2f} MB')


def main() -> None:
    parser = argparse.ArgumentParser(description='Makes test/truth/truth.json.gz.')
    parser.add_argument('pieces', type=Path)
    parser.add_argument('field', type=Path)
    parser.add_argument('arms', nargs='*')
    options = parser.parse_args()
    options.pieces.mkdir(parents=True, exist_ok=True)
    arms = all_arms()
    for name in options.arms or arms:
        path = options.pieces / f'{name}.json'
        if not path.exists():
            with open(options.pieces / f'{name}.log', 'w') as log:
                path.write_text(json.dumps(cases_of(name, arms[name], log)))
    if not options.arms:
        (options.pieces / 'faults.json').write_text(json.dumps(faults(options.field)))
        (options.pieces / 'refusals.json').write_text(json.dumps(list(refusals(arms))))
        join(options.pieces, arms)


if __name__ == '__main__':
    main()
