"""Arrays and lists of numbers, and values that NumPy alone would convert to numbers."""

from __future__ import annotations

import pytest
from hypothesis import strategies as st

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.validation import LARGEST, SMALLEST, finite, positive

numbers = st.floats(-1e9, 1e9) | st.integers(-1000, 1000)


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_number_is_bounded_so_that_its_powers_are_numbers_too(sign: float) -> None:
    assert finite('E', sign * LARGEST) == sign * LARGEST
    with pytest.raises(ArmDefinitionError, match=r'E is -?1e\+31, expected .* of at most 1e\+30'):
        finite('E', 10.0 * sign * LARGEST)
    assert positive('E', SMALLEST, 'Pa') == SMALLEST
    with pytest.raises(ArmDefinitionError, match=r'E is 1e-31, expected .* of at least 1e-30'):
        positive('E', 0.1 * SMALLEST, 'Pa')
