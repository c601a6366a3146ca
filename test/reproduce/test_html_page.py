"""The page of the reproduction, as the command writes it."""

from __future__ import annotations

import base64
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

pytest.importorskip('matplotlib')

from octo_arm_model import MODELS
from octo_arm_model.cli.main import main
from octo_arm_model.reproduce.claims import CLAIMS, Claim, count
from octo_arm_model.reproduce.page import Picture, as_html, typeset

FIGURES = [f'Figure {number}' for number in (8, 9, 10, 11, 12, 14, 15)]


@pytest.fixture(scope='module')
def claims() -> list[Claim]:
    return [make() for make in CLAIMS]


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that the command writes; warnings of the package are errors."""
    folder = tmp_path_factory.mktemp('reproduce') / 'new' / 'folder'
    assert main(['reproduce', str(folder)]) == 0
    return folder


@pytest.fixture(scope='module')
def page(folder: Path) -> ElementTree.Element:
    return ElementTree.fromstring((folder / 'renda2012.html').read_text(encoding='utf-8'))


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
    from octo_arm_model.reproduce import figures

    picture = Picture('Figure 12', 'DOF & "more" <than> that', 3.0, figures.figure_12)
    assert as_html([picture]) == as_html([picture])
    assert 'DOF &amp; &quot;more&quot; &lt;than&gt;' in as_html([picture])


def test_a_browser_prints_it_on_a4_with_nothing_cut_off(folder: Path) -> None:
    pytest.importorskip('selenium')
    from browser import CHROMEDRIVER, Browser

    if not CHROMEDRIVER:
        pytest.skip('needs chromedriver')
    browser = Browser((folder / 'renda2012.html').as_uri())
    try:
        command = browser.driver.execute_cdp_cmd
        printed = command('Page.printToPDF', {'preferCSSPageSize': True})
        # The width between the margins, 170 mm, in CSS pixels.
        metrics = {'width': 642, 'height': 971, 'deviceScaleFactor': 1, 'mobile': False}
        command('Emulation.setDeviceMetricsOverride', metrics)
        command('Emulation.setEmulatedMedia', {'media': 'print'})
        widest = browser.driver.execute_script(
            'return Math.max(...[...document.querySelectorAll("*")].map(e => e.scrollWidth))'
        )
    finally:
        browser.close()
    pdf = base64.b64decode(printed['data'])
    sizes = re.findall(rb'/MediaBox \[0 0 (\S+) (\S+)\]', pdf)
    assert len(sizes) > 5
    assert {(round(float(x)), round(float(y))) for x, y in sizes} == {(595, 842)}
    assert widest <= 642


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
