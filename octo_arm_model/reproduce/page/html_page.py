"""The page as one HTML file that needs nothing else. Needs matplotlib."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import matplotlib
from matplotlib.figure import Figure, FigureBase

from octo_arm_model.reproduce.claims.claim import Claim
from octo_arm_model.reproduce.plotting import STYLE
from octo_arm_model.reproduce.tables import DataTable

TITLE = 'Renda et al. 2012, reproduced'
_WIDTH = 6.7  # of the text [in]: A4 less its margins
_CSS = """
html { font: 17px/1.45 'STIX Two Text', 'Times New Roman', Times, serif; color: #111;
  background: #fff; }
body { max-width: 46rem; margin: 3rem auto; padding: 0 1rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 1rem; }
h2 { font-size: 1.2rem; margin: 2.4rem 0 .6rem; border-bottom: 1px solid #bbb; }
p { margin: .6rem 0; }
figure, .claim, .table { margin: 1.4rem 0; break-inside: avoid; }
h1, h2 { break-after: avoid; }
figure img { display: block; width: 100%; height: auto; }
figcaption, .note { font-size: .85rem; color: #444; margin-top: .3rem; }
.table { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: .8rem; line-height: 1.3;
  font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: bold; font-size: .9rem; padding-bottom: .3rem; }
th, td { padding: .18rem .35rem; text-align: right; vertical-align: bottom; }
td { white-space: nowrap; }
th { font-weight: normal; border-bottom: 1px solid #111; border-top: 1px solid #111; }
th:first-child, td:first-child { text-align: left; }
tr:last-child td { border-bottom: 1px solid #111; }
.claim { margin: .9rem 0; }
.claim p { margin: 0; }
.says { font-style: italic; }
.check { font-size: .85rem; color: #444; }
.findings { display: grid; grid-template-columns: repeat(3, 1fr); gap: 0 1rem; margin: .15rem 0 0;
  font-size: .85rem; }
.findings dt { grid-row: 1; border-top: 1px solid #bbb; }
.findings dd { grid-row: 2; margin: 0; }
.holds, .fails { font-weight: bold; }
.holds { color: #1b6e3c; }
.fails { color: #b3261e; }
@media (max-width: 34rem) { .findings { display: block; } .findings dt { margin-top: .3rem; } }
@media print {
  @page { size: A4; margin: 18mm 20mm; }
  html { font-size: 10.5pt; }
  body { max-width: none; margin: 0; padding: 0; print-color-adjust: exact; }
  .table { overflow: visible; }
  table { font-size: 7.5pt; }
  th, td { padding: .15rem .2rem; }
  p { orphans: 3; widows: 3; }
}
"""


@dataclass(frozen=True)
class Picture:
    """A figure.

    Attributes:
        name: the paper's, such as ``Figure 8``.
        caption: what is shown.
        height: of the picture, which is as wide as the text [in].
        draw: draws it on a matplotlib figure of that size.
    """

    name: str
    caption: str
    height: float
    draw: Callable[[FigureBase], None]


# A part of the page: markup, or what is drawn when the page is made.
Block: TypeAlias = str | DataTable | Picture | Claim


def as_html(
    blocks: Sequence[Block], progress: Callable[[int, int], None] = lambda done, total: None
) -> str:
    """The ``blocks`` as one HTML file, which is well-formed XML too.

    ``progress`` is called with the numbers of pictures drawn and of all.
    """
    drawn, total = 0, sum(isinstance(block, Picture) for block in blocks)
    parts = []
    for block in blocks:
        match block:
            case str():
                parts.append(block)
            case DataTable():
                parts.append(_table(block))
            case Claim():
                parts.append(_claim(block))
            case Picture():
                parts.append(_figure(block))
                drawn += 1
                progress(drawn, total)
    content = '\n'.join(parts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8"/>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1"/>\n'
        f'<title>{TITLE}</title>\n<style>{_CSS}</style>\n</head>\n'
        f'<body>\n{content}\n</body>\n</html>\n'
    )


def heading(text: str, level: int = 2) -> str:
    """A heading, of level 1 for the title."""
    return f'<h{level}>{_text(text)}</h{level}>'


def paragraph(text: str) -> str:
    """Running text."""
    return f'<p>{_text(text)}</p>'


def typeset(text: str) -> str:
    """``text`` with minus signs where numbers have hyphens, and no line broken before a unit."""
    text = re.sub(r'(?<![\w.])-(?=\d)', '\N{MINUS SIGN}', text)
    text = re.sub(r'(?<=\d) (?=(%|N|mm|ms)\b|%)', '\N{NO-BREAK SPACE}', text)
    return text.replace('% of L', '%\N{NO-BREAK SPACE}of\N{NO-BREAK SPACE}L')


def _text(text: str) -> str:
    return html.escape(typeset(text))


def _table(table: DataTable) -> str:
    head = ''.join(f'<th>{_text(name)}</th>' for name in table.header)
    rows = '\n'.join(
        '<tr>' + ''.join(f'<td>{_text(cell)}</td>' for cell in row) + '</tr>' for row in table.rows
    )
    note = f'\n<p class="note">{_text(table.note)}</p>' if table.note else ''
    return (
        f'<div class="table"><table>\n<caption>{_text(table.title)}</caption>\n'
        f'<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody></table>{note}</div>'
    )


def _figure(picture: Picture) -> str:
    svg = base64.b64encode(_svg(picture)).decode()
    return (
        f'<figure id="{_text(picture.name.lower().replace(" ", "-"))}">\n'
        f'<img alt="{_text(picture.name)}" src="data:image/svg+xml;base64,{svg}"/>\n'
        f'<figcaption><b>{_text(picture.name)}.</b> {_text(picture.caption)}</figcaption>\n'
        '</figure>'
    )


def _svg(picture: Picture) -> bytes:
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(_WIDTH, picture.height))
        picture.draw(figure)
        file = io.BytesIO()
        # Without the date, so that the same figure gives the same file.
        figure.savefig(file, format='svg', metadata={'Date': None})
    return file.getvalue()


def _claim(claim: Claim) -> str:
    findings = ''.join(
        '<dt>{}: <span class="{}">{}</span></dt><dd>{}</dd>'.format(
            _text(model), *_VERDICTS[finding.holds], _text(finding.value)
        )
        for model, finding in claim.findings.items()
    )
    return (
        f'<div class="claim"><p><span class="says">{_text(claim.says)}</span> '
        f'({_text(claim.where)})</p>\n<p class="check">{_text(claim.check)}</p>'
        + (f'\n<dl class="findings">{findings}</dl>' if findings else '')
        + '</div>'
    )


# Class and word of what is found.
_VERDICTS = {
    True: ('holds', 'holds'), False: ('fails', 'fails'), None: ('open', 'not judged'),
}  # fmt: skip
