"""Stamps of messages."""

from __future__ import annotations

import pytest

from octo_arm_model.arm.errors import MessageError
from octo_arm_model.wire.stamp import Stamp, time_of


def test_a_stamp_that_is_not_set_tells_no_time() -> None:
    assert time_of(None) is None
    assert time_of(Stamp(0, 0)) is None
    for stamp in (Stamp(0, 1), Stamp(3, 999_999_999), Stamp(2**31 - 1, 0)):
        assert time_of(stamp) == stamp
        assert Stamp.from_ns(stamp.ns) == stamp


@pytest.mark.parametrize('stamp', [Stamp(-1, 0), Stamp(-(2**31), 1), Stamp(0, 10**9)])
def test_a_stamp_that_is_no_time_is_refused(stamp: Stamp) -> None:
    with pytest.raises(MessageError, match=f'{stamp.sec} s and {stamp.nanosec} ns, expected'):
        time_of(stamp)
