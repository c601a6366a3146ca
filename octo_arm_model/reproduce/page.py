"""The page as one HTML file that needs nothing else, in the order of the paper.

Needs matplotlib.
"""

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

from octo_arm_model import __version__
from octo_arm_model.config.paper_data import (
    FETCHING_IN_PLANE,
    FETCHING_IN_SPACE,
    PROTOTYPE_AVERAGE_ERROR,
    PROTOTYPE_ERRORS,
)
from octo_arm_model.reproduce import cases, figures, tables
from octo_arm_model.reproduce.claims import Claim, count
from octo_arm_model.reproduce.figures import STYLE
from octo_arm_model.reproduce.tables import DataTable
from octo_arm_model.rod.solver import MODELS

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


_MADE = f"""\
Every number and curve here was computed when the page was made, by octo-arm reproduce of \
octo_arm_model {__version__}, from the parameters and tensions that the paper prints. Sections, \
figures and tables have the paper’s numbers, and its axes: the base at the origin with \
t = (1, 0, 0), n = (0, −1, 0), b = (0, 0, −1)."""
_MODELS = """\
Three models answer. renda2012 is the paper’s: its equations (10), its jump (11) at each \
anchorage, integrated from the tip (12). closed_form is the paper’s moments (8a) and material \
(3a), solved at each cross section without the jump; where one section alone is loaded the two \
are the same, and their lines lie on each other. exact does not take s for the arc length of \
midline and cables, and its material is incompressible rubber (neo-Hookean) instead of linear."""
_READ = """\
The paper’s pictures are to be compared by eye: nothing was read off them. What its text, tables \
and captions say in words and numbers is checked below."""
_MISSING = (
    'Figure 8: the tensions, the output of the finite elements, and E and ν of the arm.',
    'Figure 9 and Table 1: the midlines taken from the camera’s pictures, and ν. The text says '
    '3 N of Figure 9; Table 1 lists 3.06 N and no 3 N. Both are drawn.',
    'Figure 10: the arm and the tensions; here those of Table 2 and 1 N, in the ratios of the '
    'law.',
    'Section 4: the density of the silicone, and so how well weight and buoyancy cancel.',
    'Sections 1 and 7: how fast is fast enough.',
)


def summary(claims: Sequence[Claim]) -> str:
    """A sentence with the number of claims that hold, for each model."""
    counts = [(model, *count(claims, model)) for model in MODELS]
    return (
        'Claims that hold, of those that can be judged: '
        + ', '.join(f'{model} {held} of {judged}' for model, held, judged in counts)
        + '.'
    )


def blocks(claims: Sequence[Claim]) -> list[Block]:
    """Everything on the page, in the order of the paper."""
    return [
        heading(TITLE, 1),
        paragraph(
            'F. Renda, M. Cianchetti, M. Giorelli, A. Arienti, C. Laschi: A 3D steady-state model '
            'of a tendon-driven continuum soft manipulator inspired by the octopus arm. '
            'Bioinspir. Biomim. 7 (2012) 025006.'
        ),
        *(paragraph(text) for text in (_MADE, _MODELS, _READ)),
        heading('What the text claims'),
        paragraph(f'The paper’s words, shortened. {summary(claims)}'),
        *claims,
        heading('The arms'),
        tables.arms(),
        heading('5.1 Analytical versus FEM model'),
        Picture(
            'Figure 8',
            'Arm of section 5.1, one cable; the body is true to scale. The paper shows finite '
            'elements above its model, but neither their output nor a tension: those above the '
            'panels are ours.',
            2.9,
            figures.figure_8,
        ),
        tables.finite_elements(),
        heading('5.2 Analytical model versus real prototype'),
        Picture(
            'Figure 9',
            'Left, the prototype at 3 N; the midline of the real arm, which the paper compares '
            'it with, was not published. Right, at each tension of Table 1.',
            2.75,
            figures.figure_9,
        ),
        tables.tip_errors(),
        heading('6.1 Bending'),
        Picture(
            'Figure 10',
            'Bending planes and the ratios of the cables’ tensions, seen from the tip: the arm of '
            'Table 2, amplitude 1 N, section 1.',
            4.75,
            figures.figure_10,
        ),
        tables.tensions(),
        Picture(
            'Figure 11',
            'Three planes of bending, tensions of Table 3: in space, and seen from the tip.',
            4.4,
            figures.figure_11,
        ),
        tables.bending(),
        Picture(
            'Figure 12',
            'Degrees of freedom along the arm of Figure 11(A). By all models the torsion is 0.',
            3.3,
            figures.figure_12,
        ),
        heading('6.2 Fetching'),
        Picture(
            'Figure 14',
            'Fetching in one plane: the arm of Table 4, tensions of Table 5; the body is true to '
            'scale.',
            4.6,
            figures.figure_14,
        ),
        tables.fetching(),
        Picture(
            'Figure 15',
            'Views of fetching in three dimensions: the arm of Table 4, tensions of Table 5.',
            5.3,
            figures.figure_15,
        ),
        heading('What the paper does not give'),
        *(paragraph(text) for text in _MISSING),
        heading('Where the paper is at odds with itself'),
        *(paragraph(text) for text in _contradictions()),
    ]


def _contradictions() -> tuple[str, ...]:
    mean = sum(PROTOTYPE_ERRORS.values()) / len(PROTOTYPE_ERRORS)
    most = -100.0 * min(
        float(cases.solve('table4', 'renda2012', tensions).q.min())
        for tensions in (FETCHING_IN_PLANE, FETCHING_IN_SPACE)
    )
    return (
        'Section 5.1 says that all material and geometric properties of the real prototype have '
        'been used; the arm that it describes is not that of section 5.2.',
        f'Table 1 prints an average of {PROTOTYPE_AVERAGE_ERROR} %; the mean of its rows is '
        f'{mean:.2f} %.',
        'Section 6.1 says that Figure 12 is of ‘the 45° bending’; its caption says that it is of '
        'Figure 11(A), which is at 135° by its caption and Table 3. The arctangent printed there '
        'gives −45° for it: it cannot tell opposite sides apart, as the two differences with '
        'their signs can.',
        'The jump (11) adds the curvature that a section’s own cables would make alone; the '
        'moments (8a) ask for one balance of all cables. Where several sections are loaded the '
        'two differ, as renda2012 and closed_form do in Figures 14 and 15, and the jump makes '
        'the only torsion there is.',
        'Section 4 takes s for the arc length. The fetching tensions of Table 5 shorten the arm '
        f'by up to {most:.0f} % in places, which is where exact leaves the other two.',
    )
