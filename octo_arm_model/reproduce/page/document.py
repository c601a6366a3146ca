"""The blocks that the page consists of."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from octo_arm_model.reproduce.claims.claim import Claim

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

TITLE = 'Renda et al. 2012, reproduced'
WIDTH = 6.7  # of the text [in]: A4 less its margins


@dataclass(frozen=True)
class Heading:
    """A heading of ``level`` 1 (title) to 2."""

    text: str
    level: int = 2


@dataclass(frozen=True)
class Paragraph:
    """Running text."""

    text: str


@dataclass(frozen=True)
class DataTable:
    """A table; all columns but the first are numbers.

    Attributes:
        title: text above it.
        header: names of the columns.
        rows: cells, as many to a row as the header has.
        note: text below it.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ''


@dataclass(frozen=True)
class Picture:
    """A figure.

    Attributes:
        name: the paper's, such as ``Figure 8``.
        caption: what is shown.
        height: of the picture `WIDTH` wide [in].
        draw: draws it on a matplotlib figure of that size.
    """

    name: str
    caption: str
    height: float
    draw: Callable[[FigureBase], None]


Block: TypeAlias = Heading | Paragraph | DataTable | Picture | Claim


def verdict(holds: bool | None) -> str:
    """A finding in one word or two."""
    return {True: 'holds', False: 'fails', None: 'not judged'}[holds]


def typeset(text: str) -> str:
    """``text`` with minus signs where numbers have hyphens, and no line broken before a unit."""
    text = re.sub(r'(?<![\w.])-(?=\d)', '\N{MINUS SIGN}', text)
    text = re.sub(r'(?<=\d) (?=(%|N|mm|ms)\b|%)', '\N{NO-BREAK SPACE}', text)
    return text.replace('% of L', '%\N{NO-BREAK SPACE}of\N{NO-BREAK SPACE}L')
