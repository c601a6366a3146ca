"""The pages in a real browser: what is pulled there, and what is seen."""

import contextlib
import io
import re
import socket
import time

import numpy as np
import pytest

pytest.importorskip('selenium', reason='needs selenium')
image = pytest.importorskip('PIL.Image', reason='needs pillow')

from browser import CHROMEDRIVER, CHROMIUM, Browser
from estimator_nodes import estimating_here
from live_nodes import CONFIG, new_domain, start, stop
from selenium.webdriver.common.keys import Keys
from viewer_setup import Setup

from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.ros.estimator.main import EstimatorNode

if not (CHROMIUM and CHROMEDRIVER):
    pytest.skip('needs chromium and chromedriver (apt: chromium chromium-driver)', True)

REST = [450.0, 0.0, 0.0]
SOLVER = CONFIG.solver()


@pytest.fixture(scope='module')
def setup():
    """The node and the viewer, which ends without a complaint."""
    with contextlib.closing(Setup()) as setup:
        yield setup
        assert setup.close() == ''


@pytest.fixture(scope='module')
def browser(setup):
    """A page without errors on its console."""
    with contextlib.closing(Browser(setup.url, 700, 560)) as browser:
        yield browser
        assert browser.complaints() == []


def shows_what_is_published(setup, browser):
    tensions = setup.tensions().reshape(SOLVER.arm.tension_shape)
    return np.allclose(browser.tip(), 1e3 * SOLVER.solve(tensions).tip, atol=0.006)


def colours(png):
    """Red, green and blue of the pixels of a picture, (rows, columns, 3)."""
    return np.asarray(image.open(io.BytesIO(png)).convert('RGB'), float)


def body_pixels(png):
    """Where a picture has the colour of the body: clearly redder than it is blue."""
    pixels = colours(png)
    return (pixels[..., 0] - pixels[..., 2] > 15.0) & (pixels[..., 0] > 100.0)


def test_the_arm_is_pulled_and_seen(setup, browser):
    assert f'port {setup.port} is in use' in setup.said
    assert int(setup.url.rpartition(':')[2]) > setup.port
    browser.until(lambda: browser.tip() == REST, 'the tip of the unloaded arm')
    assert browser.text('problem') == ''
    for word in ('Tendons', 'Profile', 'Target', 'Models', 'torsion τ [1/m]'):
        assert browser.shown(word)
    assert len([s for s in browser.sliders() if s.is_displayed()]) == 12
    for _ in range(3):
        browser.sliders()[4].send_keys(Keys.ARROW_RIGHT)
    setup.wait_for(lambda: setup.tensions()[4] == pytest.approx(3 * 4.0 / 200), 'the tension')
    assert np.count_nonzero(setup.tensions()) == 1
    browser.until(lambda: shows_what_is_published(setup, browser), 'the tip')
    assert np.linalg.norm(np.subtract(browser.tip(), REST)) > 1.0
    browser.press('Let all go slack')
    browser.until(lambda: browser.tip() == REST and not setup.tensions().any(), 'rest')
    # Drawn a moment after the numbers, where no graphics card helps.
    browser.until(lambda: body_pixels(browser.picture()).mean() > 0.005, 'a body')
    straight = browser.picture()
    assert len(np.unique(colours(straight).reshape(-1, 3), axis=0)) > 100  # lit, not flat
    browser.press('15')
    expected = np.ravel(FETCHING_IN_SPACE)
    setup.wait_for(lambda: np.allclose(setup.tensions(), expected), 'the figure')
    browser.until(lambda: shows_what_is_published(setup, browser), 'the tip')

    def has_moved():
        before, after = body_pixels(straight), body_pixels(browser.picture())
        return (before ^ after).sum() > 0.35 * before.sum() and after.mean() > 0.003

    browser.until(has_moved, 'another picture')

    def curves():
        """Pixels of the node's curve in each of the plots."""
        return browser.driver.execute_script("""
            return [...document.querySelectorAll('.uplot canvas')].map(canvas => {
              const size = [canvas.width, canvas.height];
              const pixels = canvas.getContext('2d').getImageData(0, 0, ...size).data;
              const is_node = i => pixels[i] === 0xc8 && pixels[i + 1] === 0x55;
              return [...pixels.keys()].filter(i => i % 4 === 0 && is_node(i)).length;
            });
        """)

    browser.until(lambda: len(curves()) == 4 and min(curves()) > 50, 'four curves')
    # Another model beside it, and an arm that passes through itself.
    browser.press('Models')
    browser.choose('none', 'exact')
    exact = CONFIG.solver('exact').solve(FETCHING_IN_SPACE)
    apart = 1e3 * np.linalg.norm(exact.tip - SOLVER.solve(FETCHING_IN_SPACE).tip)
    browser.until(lambda: browser.text('apart') == f'{apart:.2f}', 'the distance of the tips')
    setup.client.command([0, 0, 0.42, 0, 0, 0, 3.7, 0, 0, 0, 13, 0])
    browser.until(lambda: 'passes through itself' in browser.text('overlap'), 'the note')


def test_the_page_shows_what_pushes_an_estimated_arm_and_how_well_that_is_known():
    domain = new_domain()
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    with estimating_here(EstimatorNode, domain=domain) as client:
        viewer = start('viewer.main', '--port', port, domain=domain, PYTHONUNBUFFERED='1')
        try:
            url = re.search(r'http://\S+', viewer.stdout.readline())[0]
            client.connect()
            with contextlib.closing(Browser(url, 500, 400)) as browser:
                is_push_seen(client, browser)
                assert not browser.complaints()
        finally:
            stop(viewer)


def is_push_seen(client, browser):
    def told():
        """Measured once more; the numbers of the force on the page, [mN]."""
        client.measure([time.time() - 0.05], ['tendon_tensions', 'measured/tip_pose'])
        return [float(one) for one in re.findall(r'-?\d+\.\d', browser.text('force'))]

    def shows(force):
        numbers = told()
        if len(numbers) != 6:
            return False
        mean, stddev = np.array(numbers[0::2]), np.array(numbers[1::2])
        return (np.abs(mean - 1e3 * force) < 5.0 * stddev + 0.1).all() and stddev[2] < 3.0

    def green():
        """How many pixels have the colour of a force."""
        pixels = colours(browser.picture())
        return int(((pixels[..., 1] - pixels[..., [0, 2]].max(axis=-1)) > 25.0).sum())

    browser.until(lambda: shows(np.zeros(3)), 'no force')
    browser.leave()
    before = green()
    client.force = np.array([0.0, -0.006, 0.012])
    browser.until(lambda: shows(client.force), 'the force')
    browser.until(lambda: told() and green() > before + 100, 'the arrow')
