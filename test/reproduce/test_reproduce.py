"""The paper reproduced: claims, tables, figures and the page."""

from __future__ import annotations

import base64
import dataclasses
import re
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from octo_arm_model import MODELS, Config, Pose, Solver, load_config
from octo_arm_model.cli import reproduce as cli
from octo_arm_model.cli.main import main
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_PLANE, PROTOTYPE_ERRORS
from octo_arm_model.config.presets import preset_path
from octo_arm_model.reproduce import cases, tables
from octo_arm_model.reproduce.claims.all_claims import CLAIMS
from octo_arm_model.reproduce.claims.claim import Claim, Finding, below, count
from octo_arm_model.reproduce.claims.results_claims import PLANES
from octo_arm_model.reproduce.page.document import Heading, Picture, Table, typeset

FIGURES = [f'Figure {number}' for number in (8, 9, 10, 11, 12, 14, 15)]
HELD, BROKEN, OPEN = Finding('1 mm', True), Finding('2 mm', False), Finding('3 mm')


@pytest.fixture(scope='module')
def claims() -> list[Claim]:
    return [make() for make in CLAIMS]


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the command makes, with every warning an error."""
    pytest.importorskip('matplotlib')
    folder = tmp_path_factory.mktemp('reproduce') / 'new' / 'folder'
    assert main(['reproduce', str(folder)]) == 0
    return folder


@pytest.fixture(scope='module')
def page(folder: Path) -> ElementTree.Element:
    return ElementTree.fromstring((folder / 'renda2012.html').read_text(encoding='utf-8'))


# Claims


@pytest.mark.parametrize('make', CLAIMS, ids=lambda make: make.__name__)
def test_no_claim_of_the_paper_fails_for_its_own_model(make: Callable[[], Claim]) -> None:
    claim = make()
    assert not claim.fails, claim.findings['renda2012'].value
    # Either every model is asked, or it is said why none can be.
    assert tuple(claim.findings) == MODELS or claim.check.startswith('Cannot be checked: ')


def test_what_cannot_be_told_is_not_counted() -> None:
    claims = [Claim('', '', '', {'exact': finding}) for finding in (HELD, BROKEN, OPEN, HELD)]
    claims.append(Claim('', '', ''))
    assert count(claims, 'exact') == (2, 3)
    assert count(claims, 'renda2012') == (0, 0)


def test_a_claim_fails_with_the_papers_own_model_alone_and_never_by_the_machine() -> None:
    claim = Claim('', '', '', {'renda2012': BROKEN, 'exact': HELD})
    assert claim.fails
    assert not dataclasses.replace(claim, is_of_machine=True).fails
    for finding in (HELD, OPEN):
        assert not Claim('', '', '', {'renda2012': finding, 'exact': BROKEN}).fails
    assert not Claim('', '', '').fails


def test_only_the_clock_is_of_the_machine(claims: list[Claim]) -> None:
    timed = [claim for claim in claims if claim.is_of_machine]
    assert [claim.where for claim in timed] == ['sections 1 and 7']


def test_small_numbers_are_said_to_be_small() -> None:
    assert [below(value, 2) for value in (0.0, 0.004, 0.005, 1.239)] == [
        'less than 0.01', 'less than 0.01', '0.01', '1.24',
    ]  # fmt: skip


# What is measured on shapes


@pytest.mark.parametrize('plane', PLANES)
def test_the_pair_of_a_plane_is_at_most_two_neighbours_of_amplitude_one(plane: int) -> None:
    pair = cases.pair(plane)
    assert cases.angle_between(cases.law((pair,)), plane) < 1e-9
    assert np.hypot(*(pair[j] - pair[j + 2] for j in (0, 1))) == pytest.approx(1.0)
    assert min(pair[0], pair[2]) == min(pair[1], pair[3]) == 0.0


def test_the_law_gives_the_captions_of_figure_11() -> None:
    planes = [cases.law(tensions) for tensions in BENDING.values()]
    np.testing.assert_allclose(planes, [135.0, -30.0, 60.0])


def test_a_plane_is_measured_about_the_base_wherever_that_is(table2: Config) -> None:
    turned = Pose((1.0, 2.0, 3.0), (0.5, -0.5, 0.5, 0.5))
    shapes = [
        Solver(table2.arm, 'exact', base=base).solve(BENDING['C']) for base in (Pose(), turned)
    ]
    for shape in shapes:
        assert cases.bending_plane(shape) == pytest.approx(60.0, abs=1e-3)
        assert cases.out_of_plane(shape) < 1e-6
    distances = [cases.tip_distance(shape) for shape in shapes]
    assert distances[0] == pytest.approx(distances[1])


@pytest.mark.parametrize(
    ('one', 'other', 'apart'), [(179.0, -179.0, 2.0), (-90.0, 90.0, 180.0), (30.0, 10.0, 20.0)]
)
def test_directions_are_compared_the_short_way_round(
    one: float, other: float, apart: float
) -> None:
    assert cases.angle_between(one, other) == cases.angle_between(other, one) == apart


def test_turns_of_sections_are_integrals_of_the_curvature(model: str) -> None:
    shape = cases.solve('table4', model, FETCHING_IN_PLANE)
    turns = cases.turns(shape)
    assert tuple(turns) == (3, 2, 1)
    assert sum(turns.values()) == pytest.approx(cases.headings(shape)[-1])
    rate = np.rad2deg(shape.k * (1.0 + shape.q))
    for section, turn in turns.items():
        at = shape.section == section
        # Without the interval after the anchorage, where the curvature jumps.
        assert turn == pytest.approx(np.sum(rate[at]) * shape.s[1], rel=0.03)


def test_anchorages_are_where_they_are(table4: Config) -> None:
    shape = cases.solve('table4', 'closed_form', FETCHING_IN_PLANE)
    at = [section.anchorage for section in reversed(table4.arm.sections)]
    np.testing.assert_allclose(shape.s[cases.anchorages(shape)], at)


# Tables


def test_the_arms_are_those_printed() -> None:
    rows = [' '.join(row[1:]) for row in tables.arms().rows]
    assert rows == [
        '110 0.5 310 6.5 15 1 7.5 3.5 3.5 217 6 6 93',
        '110 0.5 450 2 15 1 7.5 3.5 3.5 315 6 6 135',
        '110 0.5 300 1.5 10 1 0.66 – – – – – –',
        '110 0.5 270 7.4 15 2.5 5 – – – – – –',
    ]


def test_the_tensions_are_those_printed() -> None:
    table = tables.tensions()
    assert table.header[1:] == ('T11', 'T12', 'T13', 'T14', 'T21', 'T32', 'T33')
    assert {row[0]: ' '.join(row[1:]) for row in table.rows} == {
        'Figure 11(A)': '0 0 1 1 0 0 0',
        'Figure 11(B)': '1 1.732 0 0 0 0 0',
        'Figure 11(C)': '0 1 1.732 0 0 0 0',
        'Figure 14': '0 0 0.5 0 4 0 13',
        'Figure 15': '0 0 0.5 0 4 13 0',
    }


def test_tips_in_table_1_are_those_of_the_solver_beside_the_papers_errors() -> None:
    config = load_config(preset_path('renda2012_prototype'))
    *rows, last = tables.tip_errors().rows
    assert last[:2] == ('average', '5.4')
    for row, (tension, error) in zip(rows, PROTOTYPE_ERRORS.items(), strict=True):
        assert row[:2] == (f'{tension:.2f}', f'{error:.1f}')
        for cell, model in zip(row[2:5], MODELS, strict=True):
            tip = config.solver(model).solve([[tension, 0.0, 0.0, 0.0]]).tip
            printed = [float(value) for value in cell.split(', ')]
            np.testing.assert_allclose(printed, tip[:2] * 1e3, atol=0.06)


@pytest.mark.parametrize(
    'make', [tables.arms, tables.finite_elements, tables.tip_errors, tables.tensions,
             tables.bending, tables.fetching]
)  # fmt: skip
def test_rows_are_as_long_as_the_header(make: Callable[[], Table]) -> None:
    table = make()
    assert {len(row) for row in table.rows} == {len(table.header)}


# The page


def test_the_page_has_every_section_figure_table_and_claim_in_order(
    page: ElementTree.Element, claims: list[Claim]
) -> None:
    headings = [''.join(element.itertext()) for element in page.iter('h2')]
    assert headings == [
        'What the text claims', 'The arms', '5.1 Analytical versus FEM model',
        '5.2 Analytical model versus real prototype', '6.1 Bending', '6.2 Fetching',
        'What the paper does not give', 'Where the paper is at odds with itself',
    ]  # fmt: skip
    assert [element.get('alt') for element in page.iter('img')] == FIGURES
    assert len(list(page.iter('table'))) == 6
    said = [e.text for e in page.iter('span') if e.get('class') == 'says']
    assert said == [typeset(claim.says) for claim in claims]
    text = ''.join(page.itertext())
    for model in MODELS:
        held, judged = count(claims, model)
        assert f'{model} {held} of {judged}' in text


def test_the_page_needs_nothing_else(page: ElementTree.Element, folder: Path) -> None:
    assert not {element.tag for element in page.iter()} & {'script', 'link', 'iframe', 'object'}
    text = (folder / 'renda2012.html').read_text(encoding='utf-8')
    assert not re.search(r'https?:|url\(|@import|\ssrc="(?!data:)', text)
    for image in page.iter('img'):
        kind, data = image.attrib['src'].split(',', 1)
        assert kind == 'data:image/svg+xml;base64'
        svg = base64.b64decode(data)
        assert ElementTree.fromstring(svg).tag == '{http://www.w3.org/2000/svg}svg'


def test_the_same_picture_comes_out_the_same() -> None:
    pytest.importorskip('matplotlib')
    from octo_arm_model.reproduce import figures
    from octo_arm_model.reproduce.page.html_page import as_html

    picture = Picture('Figure 12', 'DOF & "more" <than> that', 3.0, figures.figure_12)
    assert as_html([picture]) == as_html([picture])
    assert 'DOF &amp; &quot;more&quot; &lt;than&gt;' in as_html([picture])


@pytest.mark.parametrize('name', FIGURES)
def test_every_figure_shows_all_models_inside_its_axes(name: str) -> None:
    figure_module = pytest.importorskip('matplotlib.figure')
    from octo_arm_model.reproduce import figures, plotting

    figure = figure_module.Figure(figsize=(6.7, 4.0))
    getattr(figures, name.lower().replace(' ', '_'))(figure)
    figure.draw_without_rendering()
    for axes in figure.axes:
        colours = [line.get_color() for line in axes.lines if len(line.get_xdata()) > 100]
        # The same number of curves by each model.
        assert len({colours.count(style['color']) for style in plotting.LINES.values()}) == 1
        assert colours
        for line in axes.lines:
            # In space the axes are turned; what is drawn there is seen by the limits in turn.
            if axes.name != '3d':
                points = axes.transData.transform(line.get_xydata())
                box = axes.bbox.padded(1.0)
                assert box.count_contains(points) == len(points)


@pytest.mark.parametrize('plane', PLANES)
def test_ratios_of_figure_10_are_those_of_the_tensions(plane: int) -> None:
    pytest.importorskip('matplotlib')
    from octo_arm_model.reproduce.figures import _ratio

    tensions = cases.pair(plane)
    pulled = [int(j) - 1 for j in re.findall(r'T_\{1(\d)\}', _ratio(plane))]
    assert sorted(pulled) == [j for j, tension in enumerate(tensions) if tension > 0.0]
    if len(pulled) == 2:
        one, other = re.search(r'=(.*):(.*)\$', _ratio(plane)).groups()
        value = {'1': 1.0, r'\sqrt{3}': 3.0**0.5}
        ratio = tensions[pulled[0]] / tensions[pulled[1]]
        assert value[one] / value[other] == pytest.approx(ratio)


def test_figure_12_has_no_torsion(model: str) -> None:
    assert np.abs(cases.solve('table2', model, BENDING['A']).tau).max() < 1e-9


def test_a_figure_draws_the_backbone_of_the_solver() -> None:
    figure_module = pytest.importorskip('matplotlib.figure')
    from octo_arm_model.reproduce import figures

    figure = figure_module.Figure()
    figures.figure_14(figure)
    curves = [line for line in figure.axes[0].lines if len(line.get_xdata()) > 100]
    for curve, model in zip(curves, MODELS, strict=True):
        expected = cases.solve('table4', model, FETCHING_IN_PLANE).position[:, :2] * 1e3
        np.testing.assert_array_equal(curve.get_xydata(), expected)


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


# The command


def test_a_claim_that_fails_is_said_and_is_status_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('matplotlib')
    from octo_arm_model.reproduce.page import content

    claim = Claim('The arm is straight.', 'section 8', '', dict.fromkeys(MODELS, BROKEN))
    monkeypatch.setattr(cli, 'CLAIMS', (lambda: claim,))
    monkeypatch.setattr(content, 'blocks', lambda claims: [Heading('Title', 1), *claims])
    assert main(['reproduce', str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert err == 'octo-arm: does not hold: The arm is straight. (section 8)\n'
    assert 'renda2012 0 of 1' in out
    # A finding is shown, not hidden.
    text = (tmp_path / 'renda2012.html').read_text(encoding='utf-8')
    assert text.count('<span class="fails">fails</span>') == 3


@pytest.mark.parametrize('name', ['file', 'file/below'])
def test_a_folder_that_cannot_be_is_one_line_and_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    pytest.importorskip('matplotlib')
    (tmp_path / 'file').write_text('')
    assert main(['reproduce', str(tmp_path / name)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count('\n')) == ('', 1)
    assert err.startswith('octo-arm: error: [Errno ')


def test_without_matplotlib_it_says_what_to_install_and_makes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in list(sys.modules):
        if name.split('.')[0] == 'matplotlib' or name.startswith('octo_arm_model.reproduce.'):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'matplotlib', None)
    assert main(['reproduce', str(tmp_path / 'new')]) == 2
    err = capsys.readouterr().err
    assert re.fullmatch(r'octo-arm: error: needs matplotlib.*; install it with: .*\n', err)
    assert not (tmp_path / 'new').exists()
