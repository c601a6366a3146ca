"""The page of figures, tables and claims as a self-contained HTML file. This needs matplotlib."""

import base64
import html
import re
from collections.abc import Callable, Sequence

from octo_arm_model import __version__
from octo_arm_model.reproduce import tables
from octo_arm_model.reproduce.claims import Claim
from octo_arm_model.reproduce.figures import FIGURES
from octo_arm_model.reproduce.tables import DataTable
from octo_arm_model.rod.solver import MODELS

_TITLE = 'Renda et al. 2012, reproduced'
_CSS = """
html { font: 17px/1.45 'STIX Two Text', 'Times New Roman', Times, serif; color: #111; }
body { max-width: 46rem; margin: 3rem auto; padding: 0 1rem; }
h2 { font-size: 1.2rem; margin: 2.4rem 0 .6rem; border-bottom: 1px solid #bbb; }
h1, h2 { break-after: avoid; }
figure, .claim, .table { margin: 1.4rem 0; break-inside: avoid; }
figure img { display: block; width: 100%; height: auto; }
figcaption, .note, .check, .findings { font-size: .85rem; color: #444; }
.table { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: .8rem; line-height: 1.3;
  font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: bold; }
th, td { padding: .18rem .35rem; text-align: right; vertical-align: bottom; }
td { white-space: nowrap; }
th { font-weight: normal; border-bottom: 1px solid #111; }
th:first-child, td:first-child { text-align: left; }
.claim p, .findings dd { margin: 0; }
.says { font-style: italic; }
.findings { display: grid; grid-template-columns: repeat(3, 1fr); gap: 0 1rem; margin: .15rem 0; }
.findings dt { grid-row: 1; }
.findings dd { grid-row: 2; }
.holds { color: #1b6e3c; }
.fails { color: #b3261e; }
@media (max-width: 34rem) { .findings { display: block; } }
@media print {
  @page { size: A4; margin: 18mm 20mm; }
  html { font-size: 10.5pt; }
  body { max-width: none; margin: 0; padding: 0; print-color-adjust: exact; }
  .table { overflow: visible; }
  table { font-size: 7.5pt; }
  th, td { padding: .15rem .2rem; }
}
"""
_ABOUT = (
    'F. Renda, M. Cianchetti, M. Giorelli, A. Arienti, C. Laschi: A 3D steady-state model of a '
    'tendon-driven continuum soft manipulator inspired by the octopus arm. Bioinspir. Biomim. 7 '
    '(2012) 025006.',
    'Every number and curve here was computed when the page was made, by octo-arm reproduce of '
    f'octo_arm_model {__version__}, from the parameters and tensions that the paper prints. '
    'Sections, figures and tables have the paper’s numbers, and its axes: the base at the origin '
    'with t = (1, 0, 0), n = (0, −1, 0), b = (0, 0, −1).',
    'Three models answer. renda2012 is the paper’s: its equations (10), its jump (11) at each '
    'anchorage, integrated from the tip (12). closed_form is the paper’s moments (8a) and '
    'material (3a), solved at each cross section without the jump; where one section alone is '
    'loaded the two are the same. exact does not take s for the arc length of midline and '
    'cables, and its material is incompressible rubber (neo-Hookean) instead of linear.',
    'The paper’s pictures are to be compared by eye: nothing was read off them.',
)
_MISSING = (
    'Figure 8: the tensions, the output of the finite elements, and E and ν of the arm.',
    'Figure 9 and Table 1: the midlines taken from the camera’s pictures, and ν. The text says '
    '3 N of Figure 9; Table 1 lists 3.06 N and no 3 N. Both are drawn. The average printed below '
    'Table 1, 5.4 %, is not the mean of its rows, 5.5 %.',
    'Figure 10: the arm and the tensions; here those of Table 2 and 1 N, in the ratios of the '
    'law. Its arctangent cannot tell opposite sides apart, as the two differences with their '
    'signs can.',
    'Section 4: the density of the silicone, and so how well weight and buoyancy cancel.',
    'Sections 1 and 7: how fast is fast enough.',
)
# The figures and tables below each heading.
_SECTIONS: dict[str, tuple[str | Callable[[], DataTable], ...]] = {
    'The arms': (tables.arms,),
    '5.1 Analytical versus FEM model': ('Figure 8', tables.finite_elements),
    '5.2 Analytical model versus real prototype': ('Figure 9', tables.tip_errors),
    '6.1 Bending': ('Figure 10', tables.tensions, 'Figure 11', tables.bending, 'Figure 12'),
    '6.2 Fetching': ('Figure 14', tables.fetching, 'Figure 15'),
}


def summary(claims: Sequence[Claim]) -> str:
    """Return a sentence that says how many ``claims`` hold for each model."""
    holding = {model: sum(claim.findings[model][1] for claim in claims) for model in MODELS}
    counts = (f'{model} {count} of {len(claims)}' for model, count in holding.items())
    return f'Claims that hold: {", ".join(counts)}.'


def as_html(
    claims: Sequence[Claim], progress: Callable[[int, int], None] = lambda done, total: None
) -> str:
    """Return the page in the order of the paper, as HTML that is also well-formed XML.

    ``progress`` is called with the number of figures drawn and the number of all figures.
    """
    parts = [f'<h1>{_TITLE}</h1>', *map(_paragraph, _ABOUT), _heading('What the text claims')]
    parts += [_paragraph(f'The paper’s words, shortened. {summary(claims)}'), *map(_claim, claims)]
    drawn = 0
    for name, blocks in _SECTIONS.items():
        parts.append(_heading(name))
        for block in blocks:
            if isinstance(block, str):
                parts.append(_figure(block))
                drawn += 1
                progress(drawn, len(FIGURES))
            else:
                parts.append(_table(block()))
    parts += [_heading('What the paper does not give'), *map(_paragraph, _MISSING)]
    content = '\n'.join(parts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8"/>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1"/>\n'
        f'<title>{_TITLE}</title>\n<style>{_CSS}</style>\n</head>\n'
        f'<body>\n{content}\n</body>\n</html>\n'
    )


def _text(text: str) -> str:
    """Return ``text`` as HTML, with minus signs in numbers and no line break before a unit."""
    text = re.sub(r'(?<![\w.])-(?=\d)', '\N{MINUS SIGN}', text)
    return html.escape(re.sub(r'(?<=\d) (?=(%|N|mm|ms)\b|%)', '\N{NO-BREAK SPACE}', text))


def _heading(text: str) -> str:
    return f'<h2>{_text(text)}</h2>'


def _paragraph(text: str) -> str:
    return f'<p>{_text(text)}</p>'


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


def _figure(name: str) -> str:
    caption, as_svg = FIGURES[name]
    svg = base64.b64encode(as_svg()).decode()
    return (
        f'<figure>\n<img alt="{name}" src="data:image/svg+xml;base64,{svg}"/>\n'
        f'<figcaption><b>{name}.</b> {_text(caption)}</figcaption>\n</figure>'
    )


def _claim(claim: Claim) -> str:
    findings = ''
    for model, (value, holds) in claim.findings.items():
        word = 'holds' if holds else 'fails'
        findings += f'<dt>{model}: <b class="{word}">{word}</b></dt><dd>{_text(value)}</dd>'
    return (
        f'<div class="claim"><p><span class="says">{_text(claim.says)}</span> '
        f'({_text(claim.where)})</p>\n<p class="check">{_text(claim.check)}</p>\n'
        f'<dl class="findings">{findings}</dl></div>'
    )
