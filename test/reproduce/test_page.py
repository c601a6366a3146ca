"""The paper's figures, tables and claims, and the page that the command writes."""

import base64
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose

pytest.importorskip('matplotlib')
from matplotlib.figure import Figure

from octo_arm_model import MODELS, load_config
from octo_arm_model.cli import reproduce
from octo_arm_model.cli.main import main
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_PLANE, PROTOTYPE_ERRORS
from octo_arm_model.reproduce import figures, tables
from octo_arm_model.reproduce.claims import CLAIMS, Claim

FIGURES = [f'Figure {number}' for number in (8, 9, 10, 11, 12, 14, 15)]


@pytest.fixture(scope='module')
def file(tmp_path_factory):
    """Return the page that the command writes."""
    folder = tmp_path_factory.mktemp('reproduce') / 'new' / 'folder'
    assert main(['reproduce', str(folder)]) == 0
    return folder / 'renda2012.html'


def test_page_has_all_sections_figures_tables_and_claims_in_order(file):
    root = ElementTree.fromstring(file.read_text(encoding='utf-8'))
    assert [''.join(element.itertext()) for element in root.iter('h2')] == [
        'What the text claims',
        'The arms',
        '5.1 Analytical versus FEM model',
        '5.2 Analytical model versus real prototype',
        '6.1 Bending',
        '6.2 Fetching',
        'What the paper does not give',
    ]
    assert [element.get('alt') for element in root.iter('img')] == FIGURES
    assert len(list(root.iter('table'))) == 6
    said = [e.text for e in root.iter('span') if e.get('class') == 'says']
    assert [text[:9] for text in said] == [claim.says[:9] for claim in CLAIMS]
    text = ''.join(root.itertext())
    assert f'renda2012 {len(CLAIMS)} of {len(CLAIMS)}' in text
    assert re.search('turns by \N{MINUS SIGN}?\\d+°', text.replace('+', ''))


def test_page_has_no_external_resources(file):
    text = file.read_text(encoding='utf-8')
    root = ElementTree.fromstring(text)
    assert not {element.tag for element in root.iter()} & {'script', 'link', 'iframe', 'object'}
    assert not re.search(r'https?:|url\(|@import|\ssrc="(?!data:)', text)
    for image in root.iter('img'):
        kind, data = image.attrib['src'].split(',', 1)
        assert kind == 'data:image/svg+xml;base64'
        svg = base64.b64decode(data)
        assert ElementTree.fromstring(svg).tag == '{http://www.w3.org/2000/svg}svg'


@pytest.mark.parametrize('name', FIGURES)
def test_figures_show_all_models_within_the_axes(name):
    figure = Figure(figsize=(6.7, 4.0))
    getattr(figures, name.lower().replace(' ', '_'))(figure)
    figure.draw_without_rendering()
    for axes in figure.axes:
        colours = [line.get_color() for line in axes.lines if len(line.get_xdata()) > 100]
        # Each model has the same number of curves.
        assert len({colours.count(style['color']) for style in figures.LINES.values()}) == 1
        assert colours
        for line in axes.lines:
            # The limits of 3D axes contain all points by construction.
            if axes.name != '3d':
                points = axes.transData.transform(line.get_xydata())
                assert axes.bbox.padded(1.0).count_contains(points) == len(points)


def test_figures_draw_the_backbones_of_the_solver(model):
    figure = Figure()
    figures.figure_14(figure)
    curves = [line for line in figure.axes[0].lines if len(line.get_xdata()) > 100]
    expected = tables.solve('table4', model, FETCHING_IN_PLANE).position[:, :2] * 1e3
    drawn = curves[MODELS.index(model)].get_xydata()
    assert_allclose(drawn, expected, atol=1e-12)
    assert np.abs(tables.solve('table2', model, BENDING['A']).tau).max() < 1e-9


def test_tables_have_the_papers_arms_and_tensions():
    assert [' '.join(row[1:]) for row in tables.arms().rows] == [
        '110 0.5 310 6.5 15 1 7.5 3.5 3.5 217 6 6 93',
        '110 0.5 450 2 15 1 7.5 3.5 3.5 315 6 6 135',
        '110 0.5 300 1.5 10 1 0.66 – – – – – –',
        '110 0.5 270 7.4 15 2.5 5 – – – – – –',
    ]
    table = tables.tensions()
    assert table.header[1:] == ('T11', 'T12', 'T13', 'T14', 'T21', 'T32', 'T33')
    assert {row[0]: ' '.join(row[1:]) for row in table.rows} == {
        'Figure 11(A)': '0 0 1 1 0 0 0',
        'Figure 11(B)': '1 1.732 0 0 0 0 0',
        'Figure 11(C)': '0 1 1.732 0 0 0 0',
        'Figure 14': '0 0 0.5 0 4 0 13',
        'Figure 15': '0 0 0.5 0 4 13 0',
    }


def test_table_1_has_tips_of_the_solver_and_the_papers_errors():
    config = load_config('renda2012_prototype')
    *rows, last = tables.tip_errors().rows
    assert last[:2] == ('average', '5.4')
    for row, (tension, error) in zip(rows, PROTOTYPE_ERRORS.items(), strict=True):
        assert row[:2] == (f'{tension:.2f}', f'{error:.1f}')
        for cell, model in zip(row[2:5], MODELS, strict=True):
            tip = config.solver(model).solve([[tension, 0.0, 0.0, 0.0]]).tip
            printed = [float(value) for value in cell.split(', ')]
            assert_allclose(printed, tip[:2] * 1e3, atol=0.06)


def test_failing_claim_is_reported_with_status_1(tmp_path, capsys, monkeypatch):
    claim = Claim('The arm is straight.', 'section 8', '', lambda model: ('2 mm < 3', False))
    monkeypatch.setattr(reproduce, 'CLAIMS', [claim])
    assert main(['reproduce', str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert err.endswith('octo-arm: does not hold: The arm is straight. (section 8)\n')
    assert 'renda2012 0 of 1' in out
    # The page shows the failure.
    text = (tmp_path / 'renda2012.html').read_text(encoding='utf-8')
    assert text.count('<b class="fails">fails</b>') == text.count('2\u00a0mm &lt; 3') == 3


# Claims and their quantities ---------------------------------------------------------------------


@pytest.mark.parametrize('claim', CLAIMS, ids=lambda claim: claim.where)
def test_claims_of_the_paper_hold_for_renda2012(claim):
    assert tuple(claim.findings) == MODELS
    assert not claim.fails, claim.findings['renda2012']


def test_law_of_the_bending_plane_gives_the_captions_of_figure_11():
    planes = [tables.law(tensions) for tensions in BENDING.values()]
    assert_allclose(planes, [135.0, -30.0, 60.0])


def test_turns_of_sections_equal_integrals_of_the_curvature(model):
    shape = tables.solve('table4', model, FETCHING_IN_PLANE)
    turns = tables.turns(shape)
    assert tuple(turns) == (3, 2, 1)
    rate = np.rad2deg(shape.k * (1.0 + shape.q))
    for section, turn in turns.items():
        at = shape.section == section
        # Excludes the interval after the anchorage, where the curvature jumps.
        assert turn == pytest.approx(np.sum(rate[at]) * shape.s[1], rel=0.03)
