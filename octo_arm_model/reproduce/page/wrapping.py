"""Running text broken into lines, in points. Needs matplotlib."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

from octo_arm_model.reproduce.page.document import typeset
from octo_arm_model.reproduce.plotting import STYLE

SPACE = 0.25  # of the size, between words


@dataclass(frozen=True)
class Type:
    """How a run of text looks."""

    size: float = 9.5
    weight: Literal['normal', 'bold'] = 'normal'
    style: Literal['normal', 'italic'] = 'normal'
    color: str = 'black'
    align: Literal['left', 'center', 'right'] = 'left'


Run: TypeAlias = tuple[str, Type]


def wrap(runs: Sequence[Run], width: float) -> list[list[Run]]:
    """Lines of runs no wider than ``width``."""
    lines: list[list[Run]] = [[]]
    used = 0.0
    for text, kind in runs:
        for word in typeset(text).split(' '):
            wide = width_of(word, kind)
            if used + wide > width and lines[-1]:
                lines.append([])
                used = 0.0
            if lines[-1] and lines[-1][-1][1] == kind:
                lines[-1][-1] = (f'{lines[-1][-1][0]} {word}', kind)
            else:
                lines[-1].append((word, kind))
            used += wide + SPACE * kind.size
    return lines


@functools.cache
def width_of(text: str, kind: Type) -> float:
    """Width of a word or line."""
    font = FontProperties(
        family=STYLE['font.family'], size=kind.size, style=kind.style, weight=kind.weight
    )
    return text_to_path.get_text_width_height_descent(text, font, False)[0]
