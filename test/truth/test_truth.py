"""The solver against what is known: a spread of the cases always, all with time."""

import numpy as np
import pytest
from truth_cases import Case, distance, read_cases, refusal_of

from octo_arm_model import SolveError

CASES = read_cases()
SOLVED = [case for case in CASES if case.expected and not case.fault]
REFUSED = [case for case in CASES if not case.expected]
FAULTS = [case for case in CASES if case.fault]
# Rounding of the values in the file, in parts of the largest.
ROUNDED = 1e-9
# By default this derivative of an arm with friction is right to 1.4e-4 of the largest, with an
# accuracy of 1e-10 to 1e-6: nodes are chosen for positions.
EXPLAINED = {('random_13_metal/21', 'by_tension'): 1.4}


def differences(case: Case) -> list[str]:
    """Quantities that are further from the truth than is tolerated, and how far."""
    found = case.solve(case.build())
    wrong = []
    for quantity, expected in case.expected.items():
        allowed = case.tolerance(quantity) + ROUNDED * np.abs(expected).max(initial=0.0)
        allowed = np.maximum(allowed, 1.2 * case.today.get(quantity, 0.0))
        allowed = allowed * EXPLAINED.get((case.name, quantity), 1.0)
        off = distance(quantity, found[quantity], expected)
        if not (off <= allowed).all():
            wrong.append(f'{case.name} {quantity}: {off.max():.1e}, expected {allowed.min():.1e}')
    return wrong


def check(cases: list[Case]) -> None:
    wrong = [line for case in cases for line in differences(case)]
    assert not wrong, '\n'.join(wrong)


def spread() -> list[Case]:
    """One case of every kind, each of another arm."""
    kinds = sorted({case.kind for case in SOLVED})
    found = []
    for number, kind in enumerate(kinds):
        of_kind = [case for case in SOLVED if case.kind == kind]
        found.append(of_kind[(7 * number) % len(of_kind)])
    return found


def test_there_are_cases_of_every_kind():
    assert len(SOLVED) >= 600
    assert len({case.name for case in CASES}) == len(CASES)
    for case in SOLVED:
        assert all(np.isfinite(values).all() for values in case.expected.values()), case.name


@pytest.mark.parametrize('part', range(3))
def test_a_spread_of_cases_is_right(part):
    check(spread()[part::3])


@pytest.mark.endurance
@pytest.mark.parametrize('arm', sorted({case.name.split('/')[0] for case in SOLVED}))
def test_all_cases_of_an_arm_are_right(arm):
    check([case for case in SOLVED if case.name.startswith(f'{arm}/')])


def test_what_is_refused_is_named():
    for case in REFUSED:
        assert case.refused is not None
        kind, names = case.refused
        error = refusal_of(case)
        classes = [one.__name__ for one in type(error).__mro__]
        assert kind in classes, f'{case.name}: {error!r}, expected {kind}'
        assert names in str(error), f'{case.name}: {error}, expected {names}'


@pytest.mark.parametrize('case', FAULTS, ids=[case.name for case in FAULTS])
def test_what_was_wrong_before_is_right_or_refused(case):
    try:
        check([case])
    except SolveError:
        if case.refused is None:
            raise
