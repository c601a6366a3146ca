"""Tensions out of messages, whichever library read them."""

from types import SimpleNamespace

import numpy as np
import pytest
from checkout import ROOT
from numpy.testing import assert_array_equal

from octo_arm_model import TensionError, load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.wire.tensions import FLOAT64_ARRAY, TENDON_TENSIONS, TENSION_TOPICS

ARM = load_config(preset_path('renda2012_table4')).arm
NAMES = list(ARM.tendon_names)
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


@pytest.mark.parametrize('topic', TENSION_TOPICS)
def test_every_topic_is_documented(topic):
    pages = [ROOT / 'README.md', *ROOT.glob('docs/*.md')]
    row = f'| `{topic}` | `{TENSION_TOPICS[topic].type_name}` |'
    assert any(row in page.read_text(encoding='utf-8') for page in pages)
