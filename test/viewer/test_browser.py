"""The viewer in a real browser: what is pulled there, and what is seen."""

import contextlib
import socket

import numpy as np
import pytest
from browser_or_skip import Browser, colours
from live_nodes import CONFIG, CONFIG_FILE
from selenium.webdriver.common.keys import Keys
from viewer_setup import Setup

from octo_arm_model import load_config
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.viewer.commander import as_shell_line

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


def slacken(setup, browser):
    """Begin at rest, by the button for it."""
    browser.press('Let all go slack')
    browser.until(lambda: browser.tip() == REST and not setup.tensions().any(), 'rest')


def shows_what_is_published(setup, browser):
    tensions = setup.tensions().reshape(SOLVER.arm.tension_shape)
    return np.allclose(browser.tip(), 1e3 * SOLVER.solve(tensions).tip, atol=0.006)


def body_pixels(png):
    """Where a picture has the colour of the body: clearly redder than it is blue."""
    pixels = colours(png)
    return (pixels[:, 0] - pixels[:, 2] > 15.0) & (pixels[:, 0] > 100.0)


def test_a_port_in_use_is_said_aloud_and_the_next_free_one_taken(setup):
    assert f'port {setup.port} is in use' in setup.said
    assert int(setup.url.rpartition(':')[2]) > setup.port


def test_the_page_shows_the_arm_and_its_tip(setup, browser):
    browser.until(lambda: browser.tip() == REST, 'the tip of the unloaded arm')
    assert browser.text('problem') == ''
    for word in ('Tendons', 'Profile', 'Target', 'Models', 'torsion τ [1/m]'):
        assert browser.shown(word)
    assert len([s for s in browser.sliders() if s.is_displayed()]) == 12


def test_a_slider_moved_changes_the_published_tension_and_the_tip_on_the_page(setup, browser):
    slacken(setup, browser)
    for _ in range(3):
        browser.sliders()[4].send_keys(Keys.ARROW_RIGHT)
    step = 4.0 / 200
    setup.wait_for(lambda: setup.tensions()[4] == pytest.approx(3 * step), 'the tension')
    assert np.count_nonzero(setup.tensions()) == 1
    browser.until(lambda: shows_what_is_published(setup, browser), 'the tip')
    assert np.linalg.norm(np.subtract(browser.tip(), REST)) > 1.0


def test_the_picture_is_the_arm_and_moves_with_it(setup, browser):
    slacken(setup, browser)
    # Drawn a moment after the numbers, where no graphics card helps.
    browser.until(lambda: body_pixels(browser.picture()).mean() > 0.005, 'a body')
    straight = browser.picture()
    assert len(np.unique(colours(straight), axis=0)) > 100  # lit, not flat
    browser.press('15')
    expected = np.ravel(FETCHING_IN_SPACE)
    setup.wait_for(lambda: np.allclose(setup.tensions(), expected), 'the figure')
    browser.until(lambda: shows_what_is_published(setup, browser), 'the tip')

    def has_moved():
        before, after = body_pixels(straight), body_pixels(browser.picture())
        return (before ^ after).sum() > 0.35 * before.sum() and after.mean() > 0.003

    browser.until(has_moved, 'another picture')


def test_the_strains_are_drawn(setup, browser):
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


@pytest.mark.endurance
def test_tensions_can_be_copied_as_a_line_for_a_shell(setup, browser, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(setup.domain))
    slacken(setup, browser)
    browser.sliders()[3].send_keys(Keys.ARROW_RIGHT)
    setup.wait_for(lambda: setup.tensions()[3] > 0.0, 'a tension')
    browser.press('ros2 line')
    expected = as_shell_line(SOLVER.arm, setup.tensions(), '/tendon_commands')
    browser.until(
        lambda: ''.join(browser.text('copied').split()) == ''.join(expected.split()), 'it'
    )
    browser.press('Close')
    browser.until(lambda: not browser.text('copied'), 'the window going away')


@pytest.mark.endurance
def test_another_model_stands_beside_and_says_how_far_apart_it_is(setup, browser):
    browser.press('15')
    setup.wait_for(lambda: np.allclose(setup.tensions(), np.ravel(FETCHING_IN_SPACE)), 'Figure 15')
    browser.press('Models')
    browser.choose('none', 'exact')
    exact = load_config(CONFIG_FILE).solver('exact').solve(FETCHING_IN_SPACE)
    apart = 1e3 * np.linalg.norm(exact.tip - SOLVER.solve(FETCHING_IN_SPACE).tip)
    browser.until(lambda: browser.text('apart') == f'{apart:.2f}', 'the distance of the tips')
    browser.press('Tendons')


@pytest.mark.endurance
def test_two_browsers_see_and_pull_the_same_arm(setup, browser):
    slacken(setup, browser)
    other = Browser(setup.url)
    try:
        other.until(lambda: other.tip() == REST, 'the second page')
        other.sliders()[0].send_keys(Keys.ARROW_RIGHT)
        setup.wait_for(lambda: setup.tensions()[0] > 0.0, 'a tension from the second page')
        for page in (browser, other):
            page.until(lambda page=page: shows_what_is_published(setup, page), 'the same tip')
        # A slider that one moved stands there for both.
        value = other.sliders()[0].get_attribute('aria-valuenow')
        assert float(value) > 0.0
        browser.until(
            lambda: browser.sliders()[0].get_attribute('aria-valuenow') == value, 'the slider'
        )
        # Closed, it leaves the first one alone; opened again, it shows what is.
        other.driver.get('about:blank')
        browser.sliders()[0].send_keys(Keys.ARROW_RIGHT)
        browser.until(lambda: shows_what_is_published(setup, browser), 'the tip')
        other.driver.get(setup.url)
        other.until(lambda: other.tip() == browser.tip(), 'the page opened again')
        assert other.complaints() == []
    finally:
        other.close()


@pytest.mark.endurance
def test_a_node_that_is_gone_is_missed_and_one_that_comes_back_is_shown(setup, browser):
    slacken(setup, browser)
    setup.node.close()
    browser.until(lambda: 'no shape for' in browser.text('problem'), 'the page missing the node')
    setup.node = setup.start_node()
    browser.until(lambda: 'no shape' not in browser.text('problem'), 'the node on the page')
    browser.sliders()[8].send_keys(Keys.ARROW_RIGHT)
    setup.wait_for(lambda: setup.tensions()[8] > 0.0, 'a tension')
    browser.until(lambda: shows_what_is_published(setup, browser), 'the tip')


@pytest.mark.endurance
def test_the_first_view_is_brought_back_by_its_button(setup, browser):
    slacken(setup, browser)

    def still():
        before = None
        while before != (before := body_pixels(browser.picture()).tobytes()):
            pass
        return np.frombuffer(before, bool)

    browser.press('Show the whole arm')
    browser.leave()
    first = still()
    browser.turn(-250)
    browser.until(lambda: (first & ~still()).sum() > 0.2 * first.sum(), 'another view')
    browser.press('Show the whole arm')
    browser.leave()
    browser.until(lambda: (first ^ still()).sum() < 0.1 * first.sum(), 'the first view')


@pytest.mark.endurance
def test_an_arm_that_passes_through_itself_is_told_of(setup, browser):
    slacken(setup, browser)
    assert browser.text('overlap') == ''
    setup.client.command([0, 0, 0.42, 0, 0, 0, 3.7, 0, 0, 0, 13, 0])
    browser.until(lambda: 'passes through itself' in browser.text('overlap'), 'the note')
    setup.client.command(np.zeros(12))
    browser.until(lambda: browser.text('overlap') == '', 'the note going away')


@pytest.mark.endurance
def test_a_link_does_not_have_the_page_take_orders_from_elsewhere(setup):
    heard = []
    elsewhere = socket.create_server(('127.0.0.1', 0))
    elsewhere.settimeout(0.0)
    browser = Browser('about:blank')
    try:
        for parameter in ('websocket=ws', 'playbackPath=http'):
            address = f'{parameter}://127.0.0.1:{elsewhere.getsockname()[1]}/'
            browser.driver.get(f'{setup.url}/?{address}')
            browser.until(
                lambda: any('Content Security Policy' in c for c in browser.complaints()),
                'the browser refusing to connect',
            )
            with contextlib.suppress(BlockingIOError):
                heard.append(elsewhere.accept())
    finally:
        browser.close()
        elsewhere.close()
    assert heard == []


@pytest.mark.parametrize(('width', 'height'), [(390, 844), (1000, 700)])
def test_the_arm_is_in_what_the_panels_leave_free(setup, browser, width, height):
    slacken(setup, browser)
    browser.driver.refresh()
    browser.resize(width, height)
    browser.until(lambda: browser.tip() == REST, 'rest')
    assert browser.driver.title == 'octo_arm'

    def is_framed():
        """Whether the resting arm goes from left to right of the picture, with room about it."""
        picture = browser.picture()
        right, bottom = browser.driver.execute_script("""
            const panel = [...document.querySelectorAll('button')]
              .find(e => e.innerText.includes('whole arm')).getBoundingClientRect();
            const scene = document.querySelector('canvas').getBoundingClientRect();
            return [scene.right - panel.left, scene.bottom - panel.top];
        """)
        columns = body_pixels(picture).reshape(-1, browser.scene_width()).sum(axis=0) > 2
        low, high = np.flatnonzero(columns)[[0, -1]] / columns.size if columns.any() else (0, 0)
        return min(right, bottom) < 0.0 and 0.04 < low < 0.4 and 0.6 < high < 0.98

    browser.until(is_framed, 'the whole arm in the picture')
