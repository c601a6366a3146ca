"""Compare the solver with frozen reference values: a selection always, all as endurance tests.

Every case of `truth.json.gz` has the parameters of an arm, steps, and reference values at arc
coordinates with their errors, or an expected exception. The values are from an earlier solver
(commit dfd4d63a) with ends of elements at L / 24 and L / 48 and 4 and 8 times as many stations: a
value is that of the finer run, its error the difference of both. Of several equilibria only those
were kept that a cold start, growing loads and both forms of the node functions find. Four errors
were raised by hand, because later solvers agree at accuracies of 1e-8 to 1e-12: of by_tension of
random_13_metal/25, strain and tension of random_17_thin/29, and tension of random_19_stout/31.
"""

import gzip
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octo_arm_model import (
    Config,
    OctoArmError,
    SolveError,
    Wound,
    displacements_of,
    solve_displacements,
    wound_sensitivity,
)

# Tolerances of positions over the length; of angles [rad]; of strains over the largest one and 1 /
# length (curvatures) or 1; of tensions over the largest one; of derivatives and covariances over
# the largest value of their block.
SHAPE, STRAIN, TENSION, DERIVATIVE = 1e-6, 1e-5, 1e-6, 1e-4
# Derivatives by inputs without effect, as nu without torsion, are rounding: below these fractions
# of the length and of a radian per unit they count as zero.
NOTHING = {'by_youngs_modulus': 1e-3, 'by_poisson_ratio': 1e-3, 'by_friction': 1e-3}
# Rounding of the values in the file, over the largest one.
ROUNDED = 1e-9
# The first derivative, of an arm with friction, has an error of 1.4e-4, because nodes are chosen
# for positions; at an accuracy of 1e-10 it is 1e-6. The file has the error of the second one to
# two digits: 4.9e-5 instead of 4.925e-5.
EXPLAINED = {('random_13_metal/21', 'by_tension'): 1.4, ('random_12_table/24', 'by_tension'): 1.01}


@dataclass(frozen=True)
class Case:
    """An arm, the steps of a test, and reference values."""

    name: str
    kind: str  # subject of the case
    parameters: dict[str, Any]  # of the arm, by their dotted names
    steps: list[dict[str, Any]]  # see `solve`
    expected: dict[str, np.ndarray]  # reference values of the last step
    s: list[float] = field(default_factory=list)  # stations of values along the arm [m]
    error: dict[str, float] = field(default_factory=dict)  # largest one of each reference value
    # Error of the solver that made the file, where it exceeds the tolerance.
    today: dict[str, float] = field(default_factory=dict)
    refused: list[str] | None = None  # the expected exception and a part of its message
    fault: str = ''  # of the solver that made the file

    def solve(self) -> dict[str, np.ndarray]:
        """Return the quantities in `expected` after the last step.

        A step has 'tensions' and optionally a 'tip_wrench'. It is solved from the unloaded arm,
        follows the last step if 'follow' is true, or starts from it if 'start' is true. A step
        with 'displacements' by tendon has 'tensions' by tendon, and starts from the last step.
        """
        config, last, tips = Config.from_parameters(self.parameters), None, []
        solver = config.solver()
        for step in self.steps:
            wrench, tensions = step.get('tip_wrench'), step.get('tensions')
            if 'displacements' in step:
                args = step['displacements'], tensions
                last = solve_displacements(solver, *args, start=last, tip_wrench=wrench)
            elif step.get('follow'):
                last = solver.follow(tensions, last, wrench)
            else:
                last = solver.solve(tensions, wrench, start=last if step.get('start') else None)
            tips.append((last.backbone if isinstance(last, Wound) else last).tip)
        shape = last.backbone if isinstance(last, Wound) else last
        near = np.abs(shape.s - np.array(self.s)[:, np.newaxis])
        assert (near.min(axis=1) <= 1e-9 * shape.s[-1]).all()
        at = near.argmin(axis=1)
        values = {
            'position': shape.position[at],
            'quaternion': shape.quaternion[at],
            'strain': np.stack([shape.tau, shape.xi, shape.k, shape.q], -1)[at],
            'tension': shape.tendon_tensions[at],
            'base_tension': shape.tensions.ravel(),
            'length': solver.tendon_lengths(shape).ravel(),
            'displacement': displacements_of(solver, shape).ravel(),
            'tips': np.array(tips),
        }
        if set(self.expected) <= set(values):
            return values
        if isinstance(last, Wound):
            wound = wound_sensitivity(solver, last)
            sensitivity, values['by_displacement'] = wound.held, wound.by_displacement.tip
            values['covariance'] = wound.tip_covariance(config.uncertainty)
        else:
            sensitivity = solver.sensitivity(shape)
            if 'covariance' in self.expected:
                values['covariance'] = solver.tip_covariance(shape, config.uncertainty)
        values['length_by_tension'] = sensitivity.by_tension.tendon_length
        for name in set(self.expected) - set(values):
            change = getattr(sensitivity, name)
            values[name] = change if name == 'compliance' else change.tip
        return values

    def tolerance(self, quantity: str) -> np.ndarray:
        """Return the tolerance of each value of a ``quantity``."""
        expected, length = self.expected[quantity], float(self.parameters['body.length'])
        ones, size = np.ones(expected.shape), np.abs(expected)
        if quantity in ('position', 'tips', 'length', 'displacement'):
            return SHAPE * length * ones
        if quantity == 'quaternion':
            return 2.0 * SHAPE * ones
        if quantity == 'strain':
            curvature = max(float(size[..., :3].max()), 1.0 / length)
            return STRAIN * np.array([curvature, curvature, curvature, 1.0]) * ones
        if quantity in ('tension', 'base_tension'):
            return TENSION * size.max() * ones
        blocks, nothing = (slice(0, 3), slice(3, 6)), NOTHING.get(quantity, 0.0)
        if quantity == 'length_by_tension':
            ones *= size.max()
        elif quantity in ('compliance', 'covariance'):
            for rows, columns in ((one, other) for one in blocks for other in blocks):
                ones[rows, columns] = size[rows, columns].max()
        else:
            for rows, least in zip(blocks, (nothing * length, nothing)):
                ones[rows] = max(size[rows].max(), least)
        return DERIVATIVE * ones


def read_cases() -> list[Case]:
    """Read all cases."""
    with gzip.open(Path(__file__).parent / 'truth.json.gz', 'rt', encoding='utf-8') as file:
        content = json.load(file)
    cases = []
    for case in content['cases']:
        arm = content['arms'].get(case.pop('arm'), {}) | case.pop('changes')
        # None removes a parameter.
        case['parameters'] = {name: value for name, value in arm.items() if value is not None}
        expected = case.pop('expected', {}).items()
        case['expected'] = {name: np.array(values, dtype=float) for name, values in expected}
        cases.append(Case(**case))
    return cases


CASES = read_cases()
SOLVED = [case for case in CASES if case.expected and not case.fault]
FAULTS = [case for case in CASES if case.fault]


def check(cases: list[Case]) -> None:
    """Fail with the names and errors of all quantities beyond their tolerances."""
    wrong = []
    for case in cases:
        results = case.solve()
        for quantity, expected in case.expected.items():
            allowed = np.maximum(case.tolerance(quantity), case.error.get(quantity, 0.0))
            allowed = allowed + ROUNDED * np.abs(expected).max(initial=0.0)
            allowed = np.maximum(allowed, 1.2 * case.today.get(quantity, 0.0))
            allowed = allowed * EXPLAINED.get((case.name, quantity), 1.0)
            values = results[quantity]
            if quantity == 'quaternion':  # its sign is free
                values = values * np.sign((values * expected).sum(axis=-1, keepdims=True))
            error = np.abs(values - expected)
            if not (error <= allowed).all():
                detail = f'{error.max():.1e}, expected {allowed.min():.1e}'
                wrong.append(f'{case.name} {quantity}: {detail}')
    assert not wrong, '\n'.join(wrong)


def selection() -> list[Case]:
    """Return a case of every kind, each of another arm."""
    kinds = sorted({case.kind for case in SOLVED})
    groups = [[case for case in SOLVED if case.kind == kind] for kind in kinds]
    return [group[(7 * number) % len(group)] for number, group in enumerate(groups)]


def test_cases_are_complete():
    assert len(SOLVED) >= 600
    assert len({case.name for case in CASES}) == len(CASES)
    for case in SOLVED:
        assert all(np.isfinite(values).all() for values in case.expected.values()), case.name


@pytest.mark.parametrize('part', range(3))
def test_selection_of_cases_equals_the_reference(part):
    check(selection()[part::3])


@pytest.mark.endurance
@pytest.mark.parametrize('arm', sorted({case.name.split('/')[0] for case in SOLVED}))
def test_all_cases_of_an_arm_equal_the_reference(arm):
    check([case for case in SOLVED if case.name.startswith(f'{arm}/')])


def test_invalid_cases_raise_their_errors():
    for case in (case for case in CASES if not case.expected):
        kind, names = case.refused
        with pytest.raises(OctoArmError) as refusal:
            case.solve()
        assert kind in [one.__name__ for one in type(refusal.value).__mro__], case.name
        assert names in str(refusal.value), case.name


@pytest.mark.parametrize('case', FAULTS, ids=[case.name for case in FAULTS])
def test_earlier_faults_are_correct_or_refused(case):
    try:
        check([case])
    except SolveError:
        if case.refused is None:
            raise
