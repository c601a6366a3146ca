"""Claims of the paper: which hold, and how they are counted."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import pytest

from octo_arm_model import MODELS
from octo_arm_model.reproduce.claims import CLAIMS, Claim, Finding, below, count

HELD, BROKEN, OPEN = Finding('1 mm', True), Finding('2 mm', False), Finding('3 mm')


@pytest.fixture(scope='module')
def claims() -> list[Claim]:
    return [make() for make in CLAIMS]


@pytest.mark.parametrize('make', CLAIMS, ids=lambda make: make.__name__)
def test_no_claim_of_the_paper_fails_for_its_own_model(make: Callable[[], Claim]) -> None:
    claim = make()
    assert not claim.fails, claim.findings['renda2012'].value
    # Every model has a finding, or the check says why none can have one.
    assert tuple(claim.findings) == MODELS or claim.check.startswith('Cannot be checked: ')


def test_what_cannot_be_told_is_not_counted() -> None:
    claims = [Claim('', '', '', {'exact': finding}) for finding in (HELD, BROKEN, OPEN, HELD)]
    claims.append(Claim('', '', ''))
    assert count(claims, 'exact') == (2, 3)
    assert count(claims, 'renda2012') == (0, 0)


def test_a_claim_fails_with_the_papers_own_model_alone_and_never_by_the_machine() -> None:
    claim = Claim('', '', '', {'renda2012': BROKEN, 'exact': HELD})
    assert claim.fails
    assert not dataclasses.replace(claim, is_of_machine=True).fails
    for finding in (HELD, OPEN):
        assert not Claim('', '', '', {'renda2012': finding, 'exact': BROKEN}).fails
    assert not Claim('', '', '').fails


def test_only_the_clock_is_of_the_machine(claims: list[Claim]) -> None:
    timed = [claim for claim in claims if claim.is_of_machine]
    assert [claim.where for claim in timed] == ['sections 1 and 7']


def test_small_numbers_are_said_to_be_small() -> None:
    assert [below(value, 2) for value in (0.0, 0.004, 0.005, 1.239)] == [
        'less than 0.01', 'less than 0.01', '0.01', '1.24',
    ]  # fmt: skip
