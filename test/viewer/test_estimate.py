"""An estimated arm in a real browser: how well it is known, and what pushes it."""

import re
import socket
import time

import numpy as np
from browser_or_skip import Browser, colours
from estimator_nodes import estimating_here
from live_nodes import new_domain, start, stop

from octo_arm_model.ros.estimator.main import EstimatorNode


def green(png):
    """How many pixels have the colour of a force."""
    pixels = colours(png)
    return int(((pixels[:, 1] - pixels[:, [0, 2]].max(axis=1)) > 25.0).sum())


def test_the_page_shows_what_pushes_the_arm_and_how_well_that_is_known():
    domain = new_domain()
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    with estimating_here(EstimatorNode, domain=domain) as client:
        viewer = start('viewer.main', '--port', port, domain=domain, PYTHONUNBUFFERED='1')
        try:
            url = re.search(r'http://\S+', viewer.stdout.readline())[0]
            client.connect()
            browser = Browser(url, 500, 400)
            try:
                is_seen(client, browser)
                assert not browser.complaints()
            finally:
                browser.close()
        finally:
            stop(viewer)


def is_seen(client, browser):
    def told():
        """Measured once more; the numbers of the force on the page, [mN]."""
        client.measure([time.time() - 0.05], ['tendon_tensions', 'measured/tip_pose'])
        return [float(one) for one in re.findall(r'-?\d+\.\d', browser.text('force'))]

    def shows(force):
        def check():
            numbers = told()
            if len(numbers) != 6:
                return False
            mean, stddev = np.array(numbers[0::2]), np.array(numbers[1::2])
            return (np.abs(mean - 1e3 * force) < 5.0 * stddev + 0.1).all() and stddev[2] < 3.0

        browser.until(check, f'a force of {force} N')

    shows(np.zeros(3))
    browser.leave()
    before = green(browser.picture())
    client.force = np.array([0.0, -0.006, 0.012])
    shows(client.force)
    browser.until(lambda: told() and green(browser.picture()) > before + 100, 'the arrow')
