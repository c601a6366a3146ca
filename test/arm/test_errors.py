"""Messages of errors: on one line, bounded, and nothing in them that a terminal obeys."""

from __future__ import annotations

import pytest

from octo_arm_model import TensionError, load_config
from octo_arm_model.arm.errors import in_short, listed, shown
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.rod.displacements import check_displacements
from octo_arm_model.wire.tensions import values_by_name

# Clears the screen, goes on in another line, and writes from right to left.
HOSTILE = 'tendon\x1b[2J\n\u2028\u202e\x07'


def test_names_from_outside_do_not_reach_a_terminal_as_they_are():
    error = TensionError(HOSTILE * 100)
    for text in (shown(HOSTILE), listed([HOSTILE, 'tendon']), in_short(error)):
        assert text.isprintable()
        assert 'tendon' in text
    assert len(in_short(error)) <= 300


def test_what_refuses_a_name_shows_it_printable():
    arm = load_config(preset_path('renda2012_prototype')).arm
    with pytest.raises(TensionError, match='more than once: tendon') as caught:
        values_by_name([HOSTILE, HOSTILE], [1.0, 2.0], 'tension')
    assert str(caught.value).isprintable()
    with pytest.raises(TensionError, match="more than once: ''"):
        values_by_name(['', ''], [1.0, 2.0], 'tension')
    with pytest.raises(TensionError, match='unknown tendon tendon') as caught:
        check_displacements(arm, {HOSTILE: 0.1}, {})
    assert str(caught.value).isprintable()
