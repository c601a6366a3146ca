"""The page as a PDF, A4. Needs matplotlib."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import matplotlib
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.lines import Line2D

from octo_arm_model.reproduce.claims.claim import Claim
from octo_arm_model.reproduce.page.document import (
    TITLE,
    WIDTH,
    Block,
    Heading,
    Paragraph,
    Picture,
    Table,
    typeset,
    verdict,
)
from octo_arm_model.reproduce.page.wrapping import SPACE, Run, Type, width_of, wrap
from octo_arm_model.reproduce.plotting import STYLE

# All in points.
_PAGE = (595.28, 841.89)
_TOP, _BOTTOM = 50.0, 52.0
_TEXT_WIDTH = WIDTH * 72.0
_LEFT = (_PAGE[0] - _TEXT_WIDTH) / 2.0
_LEADING = 1.28  # of the size
_VERDICT_COLOURS = {True: '#1b6e3c', False: '#b3261e', None: '0.3'}


_BODY = Type()
_NOTE = Type(8.3, color='0.25')
_CELL = Type(8.0)
_NUMBER = Type(8.0, align='right')


@dataclass(frozen=True)
class _Box:
    """Something of a height that draws itself on a page, below a top."""

    height: float
    draw: Callable[[Figure, float], None]
    is_heading: bool = False


def as_pdf(blocks: Iterable[Block]) -> bytes:
    """The ``blocks`` as a PDF."""
    file = io.BytesIO()
    # Without the date the same page comes out the same.
    metadata = {'Title': TITLE, 'CreationDate': None}
    with matplotlib.rc_context(STYLE), PdfPages(file, metadata=metadata) as pdf:
        for number, content in enumerate(_pages([_box(block) for block in blocks]), start=1):
            page = Figure(figsize=(_PAGE[0] / 72.0, _PAGE[1] / 72.0))
            top = _TOP
            for box in content:
                box.draw(page, top)
                top += box.height
            _write(
                page, _PAGE[0] / 2.0, _PAGE[1] - 30.0, str(number), replace(_NOTE, align='center')
            )
            pdf.savefig(page)
    return file.getvalue()


def _pages(boxes: Sequence[_Box]) -> list[list[_Box]]:
    """Boxes by page; a heading stays with what follows it."""
    pages: list[list[_Box]] = [[]]
    room = _PAGE[1] - _TOP - _BOTTOM
    left = room
    for i, box in enumerate(boxes):
        needed = box.height + (boxes[i + 1].height if box.is_heading else 0.0)
        if needed > left and pages[-1]:
            pages.append([])
            left = room
        pages[-1].append(box)
        left -= box.height
    return pages


def _box(block: Block) -> _Box:
    match block:
        case Heading(text, level):
            size = {1: 17.0, 2: 12.0}[level]
            above = {1: 0.0, 2: 12.0}[level]
            box = _stack([_text([(text, Type(size, weight='bold'))], below=4.0)], above)
            return replace(box, is_heading=True)
        case Paragraph(text):
            return _text([(text, _BODY)], below=5.0)
        case Table():
            return _table(block)
        case Picture():
            return _picture(block)
        case Claim():
            return _claim(block)


def _stack(boxes: Sequence[_Box], above: float = 0.0) -> _Box:
    """One below the other."""

    def draw(page: Figure, top: float) -> None:
        top += above
        for box in boxes:
            box.draw(page, top)
            top += box.height

    return _Box(above + sum(box.height for box in boxes), draw)


def _text(
    runs: Sequence[Run], left: float = 0.0, width: float = _TEXT_WIDTH, below: float = 0.0
) -> _Box:
    """Running text from ``left`` of the text on."""
    lines = wrap(runs, width)
    leading = _LEADING * runs[0][1].size

    def draw(page: Figure, top: float) -> None:
        for i, line in enumerate(lines):
            x = _LEFT + left
            for text, kind in line:
                _write(page, x, top + (i + 0.8) * leading, text, kind)
                x += width_of(text, kind) + SPACE * kind.size

    return _Box(len(lines) * leading + below, draw)


def _write(page: Figure, x: float, baseline: float, text: str, kind: Type) -> None:
    page.text(
        x / _PAGE[0], 1.0 - baseline / _PAGE[1], text, size=kind.size, weight=kind.weight,
        style=kind.style, color=kind.color, ha=kind.align, va='baseline', parse_math=False,
    )  # fmt: skip


def _rule(page: Figure, top: float, left: float = 0.0, width: float = _TEXT_WIDTH) -> None:
    ends = [(_LEFT + left) / _PAGE[0], (_LEFT + left + width) / _PAGE[0]]
    y = 1.0 - top / _PAGE[1]
    page.add_artist(Line2D(ends, [y, y], color='0.3', linewidth=0.5))


def _picture(picture: Picture) -> _Box:
    height = 72.0 * picture.height
    caption = _text([(f'{picture.name}.', replace(_NOTE, weight='bold')),
                     (picture.caption, _NOTE)])  # fmt: skip

    def draw(page: Figure, top: float) -> None:
        grid = GridSpec(
            3, 3, figure=page,
            height_ratios=[top, height, _PAGE[1] - top - height],
            width_ratios=[_LEFT, _TEXT_WIDTH, _LEFT],
        )  # fmt: skip
        picture.draw(page.add_subfigure(grid[1, 1]))
        caption.draw(page, top + height + 3.0)

    return _stack([_Box(height + 3.0 + caption.height + 8.0, draw)], 6.0)


def _claim(claim: Claim) -> _Box:
    gap = 12.0
    column = (_TEXT_WIDTH - 2.0 * gap) / 3.0
    boxes = [
        _text([(claim.says, replace(_BODY, style='italic')), (f'({claim.where})', _BODY)]),
        _text([(claim.check, _NOTE)]),
    ]
    columns = []
    for i, (model, finding) in enumerate(claim.findings.items()):
        said = replace(_NOTE, weight='bold', color=_VERDICT_COLOURS[finding.holds])
        left = i * (column + gap)
        head = _text([(f'{model}:', _NOTE), (verdict(finding.holds), said)], left, column)
        columns.append(_stack([head, _text([(finding.value, _NOTE)], left, column)], 4.0))

    def draw(page: Figure, top: float) -> None:
        for i, box in enumerate(columns):
            _rule(page, top + 3.0, i * (column + gap), column)
            box.draw(page, top)

    boxes.append(_Box(max((box.height for box in columns), default=0.0), draw))
    return _stack(boxes, 8.0)


def _table(table: Table) -> _Box:
    gap, leading = 8.0, _LEADING * _CELL.size
    columns = list(zip(*table.rows, strict=True))
    widths = [
        max(width_of(typeset(text), _CELL) for text in (*cells, *typeset(name).split(' ')))
        for name, cells in zip(table.header, columns, strict=True)
    ]
    spare = (_TEXT_WIDTH - sum(widths) - gap * (len(widths) - 1)) / len(widths)
    widths = [width + spare for width in widths]
    rights = [sum(widths[: i + 1]) + i * gap for i in range(len(widths))]
    header = [wrap([(name, _CELL)], width) for name, width in zip(table.header, widths)]
    depth = max(len(lines) for lines in header)

    def draw(page: Figure, top: float) -> None:
        _rule(page, top)
        for i, lines in enumerate(header):
            for j, line in enumerate(lines, start=depth - len(lines)):
                row(page, top + 2.0 + j * leading, i, ' '.join(text for text, _ in line))
        top += depth * leading + 5.0
        _rule(page, top)
        for cells in table.rows:
            for i, cell in enumerate(cells):
                row(page, top + 2.0, i, typeset(cell))
            top += leading
        _rule(page, top + 4.0)

    def row(page: Figure, top: float, column: int, text: str) -> None:
        x, kind = (rights[column], _NUMBER) if column else (0.0, _CELL)
        _write(page, _LEFT + x, top + 0.8 * leading, text, kind)

    title = _text([(table.title, Type(9.0, weight='bold'))], below=3.0)
    body = _Box((depth + len(table.rows)) * leading + 12.0, draw)
    note = [_text([(table.note, _NOTE)])] if table.note else []
    return _stack([title, body, *note, _Box(6.0, lambda page, top: None)], 8.0)
