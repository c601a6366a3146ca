"""Counts of what was left out, by topic and reason."""

from __future__ import annotations

from octo_arm_model.wire.refusals import Refusals


def test_reasons_that_differ_in_numbers_are_one_and_names_tell_apart() -> None:
    found = Refusals()
    for value in (-0.001, -2.5e-07, -3):
        found.count('/a', f'tension of tendon_1_2 is {value!r} N, expected a finite number >= 0')
    found.count('/a', 'tension of tendon_1_3 is nan N, expected a finite number >= 0')
    found.count('/b', 'data has 3 values, expected 4')
    assert found.total == 5
    assert list(found.of('/a').values()) == [3, 1]
    assert found.of('/b') == {'data has 3 values, expected 4': 1}
    first = '/a: 3 left out, as tension of tendon_1_2 is -0.001 N, expected a finite number >= 0'
    assert found.lines()[0] == first
    assert 'tension_deadband' in found.lines()[-1]


def test_what_is_kept_is_bounded_whatever_comes() -> None:
    found = Refusals()
    for number in range(10_000):
        found.count('/a', f'unknown tendon {"x" * number}')
    assert found.total == 10_000
    assert len(found.counts) <= 51
    assert found.of('/a')['other reasons'] == 9_950


def test_what_is_of_no_topic_names_none() -> None:
    found = Refusals()
    found.count('', 'the estimate did not converge')
    assert found.lines() == ['1 left out, as the estimate did not converge']
    assert found.in_short == '; 1 left out, as the estimate did not converge'
