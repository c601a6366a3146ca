"""Arrays and lists of numbers, and values that NumPy alone would convert to numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.validation import LARGEST, SMALLEST, finite, positive, real_numbers

numbers = st.floats(-1e9, 1e9) | st.integers(-1000, 1000)
rows = st.integers(1, 4).flatmap(
    lambda count: st.lists(st.lists(numbers, min_size=count, max_size=count), min_size=1)
)


@given(rows)
def test_lists_tuples_and_arrays_of_numbers_are_the_same_floats(given_rows: list) -> None:
    found = real_numbers(given_rows)
    assert found is not None and found.dtype == np.float64
    for same in (
        np.array(given_rows),
        tuple(map(tuple, given_rows)),
        list(map(np.array, given_rows)),
    ):
        np.testing.assert_array_equal(real_numbers(same), found)


@given(rows, st.sampled_from([True, np.False_, '1', None, 1j]), st.data())
def test_one_element_that_is_none_refuses_all(
    given_rows: list, wrong: object, data: st.DataObject
) -> None:
    row = data.draw(st.sampled_from(given_rows))
    row[data.draw(st.integers(0, len(row) - 1))] = wrong
    assert real_numbers(given_rows) is None


@pytest.mark.parametrize(
    'value',
    [True, np.True_, np.array([True]), [[1.0], [1.0, 2.0]], [1.0, [True]], [np.zeros(2) > 1.0],
     'text', None, [[[True]]], np.ma.array([1.0, 2.0], mask=[False, True])],
)  # fmt: skip
def test_what_is_no_array_of_numbers_is_none(value: object) -> None:
    assert real_numbers(value) is None


def test_an_element_that_only_numpy_takes_for_an_array_is_one() -> None:
    class Pair:
        """Two numbers, to NumPy alone."""

        def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
            return np.array([1.0, 2.0])

    np.testing.assert_array_equal(real_numbers([Pair(), [3, 4.0]]), [[1.0, 2.0], [3.0, 4.0]])
    assert real_numbers([Pair(), [3, True]]) is None


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_number_is_bounded_so_that_its_powers_are_numbers_too(sign: float) -> None:
    assert finite('E', sign * LARGEST) == sign * LARGEST
    with pytest.raises(ArmDefinitionError, match=r'E is -?1e\+31, expected .* of at most 1e\+30'):
        finite('E', 10.0 * sign * LARGEST)
    assert positive('E', SMALLEST, 'Pa') == SMALLEST
    with pytest.raises(ArmDefinitionError, match=r'E is 1e-31, expected .* of at least 1e-30'):
        positive('E', 0.1 * SMALLEST, 'Pa')
