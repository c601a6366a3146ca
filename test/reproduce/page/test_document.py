"""Numbers and units of the page's text."""

from __future__ import annotations

import pytest

from octo_arm_model.reproduce.page.document import typeset


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('-30.26°, -1', '−30.26°, −1'), ('two-fold 3-4', 'two-fold 3-4'), ('T-1', 'T-1'),
        ('5 % of L', '5\u00a0%\u00a0of\u00a0L'), ('3 N more', '3\u00a0N more'),
        ('1 Nm', '1 Nm'),
    ],
)  # fmt: skip
def test_numbers_are_set_as_numbers(text: str, expected: str) -> None:
    assert typeset(text) == expected
