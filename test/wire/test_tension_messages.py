"""Tensions out of messages, whichever library read them."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from octo_arm_model import TensionError, load_config
from octo_arm_model.arm.errors import MessageError
from octo_arm_model.wire.messages import Refusals, Stamp, time_of
from octo_arm_model.wire.tensions import FLOAT64_ARRAY, TENDON_TENSIONS

ARM = load_config('renda2012_table4').arm
VALUES = np.arange(12.0)


def array(data, *sizes, offset=0):
    dimensions = [SimpleNamespace(size=size) for size in sizes]
    return SimpleNamespace(data=data, layout=SimpleNamespace(dim=dimensions, data_offset=offset))


@pytest.mark.parametrize('sizes', [(), (12,), (3, 4)])
def test_array_is_row_major_from_the_tip(sizes):
    message = array(VALUES, *sizes)
    assert_array_equal(FLOAT64_ARRAY.read(message, ARM), VALUES.reshape(3, 4))


@pytest.mark.parametrize(
    ('sizes', 'offset', 'count', 'complaint'),
    [
        ((), 0, 11, r'data has 11 values, expected 12'),
        ((), 0, 0, r'data has 0 values, expected 12'),
        ((4, 3), 0, 12, r'layout is \(4, 3\)'),
        ((3, 4), 1, 12, r'data_offset 1'),
    ],
)
def test_array_of_another_shape_is_refused(sizes, offset, count, complaint):
    message = array(np.zeros(count), *sizes, offset=offset)
    with pytest.raises(TensionError, match=complaint):
        FLOAT64_ARRAY.read(message, ARM)


def test_a_refusal_does_not_grow_with_the_message():
    for names in (['x' * 10**6] * 2, [f'n{i}' for i in range(10**5)], ['a', 'b'] * 10**5):
        with pytest.raises(TensionError) as refusal:
            TENDON_TENSIONS.read(SimpleNamespace(name=names, tension=names), ARM)
        assert len(str(refusal.value)) < 1000


# Stamps, and counts of what was left out ---------------------------------------------------------


def test_what_is_kept_is_bounded_whatever_comes():
    found = Refusals()
    for number in range(10_000):
        found.count('/a', f'unknown tendon {"x" * number}')
    assert found.total == 10_000
    assert len(found.counts) <= 51
    assert found.of('/a')['other reasons'] == 9_950


def test_a_stamp_that_is_not_set_tells_no_time():
    assert time_of(None) is None
    assert time_of(Stamp(0, 0)) is None
    for stamp in (Stamp(0, 1), Stamp(3, 999_999_999), Stamp(2**31 - 1, 0)):
        assert time_of(stamp) == stamp
        assert Stamp.from_ns(stamp.ns) == stamp


@pytest.mark.parametrize('stamp', [Stamp(-1, 0), Stamp(-(2**31), 1), Stamp(0, 10**9)])
def test_a_stamp_that_is_no_time_is_refused(stamp):
    with pytest.raises(MessageError, match=f'{stamp.sec} s and {stamp.nanosec} ns, expected'):
        time_of(stamp)
