"""Pictures of the viewer in a real browser: the paper's bends, both fetchings, an octopus.

Takes them of the page as anyone sees it, so they show what the node published.

    tools/with_ros python docs/screenshots.py docs/images
"""

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / 'test'))
from browser import Browser  # noqa: E402 - what drives the browser is with the tests of it
from ros_domains import new_domain  # noqa: E402

from octo_arm_model import load_config  # noqa: E402
from octo_arm_model.config.parameter_files import preset_path  # noqa: E402
from octo_arm_model.ros.processes import children  # noqa: E402
from octo_arm_model.simulation.movements import figures  # noqa: E402
from octo_arm_model.viewer.address import LOOPBACK, PORT  # noqa: E402
from octo_arm_model.viewer.server import free_port, url  # noqa: E402

WIDTH, HEIGHT = 1280, 860  # of the window; the page is a little less high
_ROUND = 165  # pixels
COLOURS = 255  # of a picture, which is plenty, and a third of its size


@contextlib.contextmanager
def page_of(preset: str) -> Iterator[Browser]:
    """The page of an arm of the paper, with node and simulator behind it."""
    port = free_port(LOOPBACK, PORT)
    arm = ('--ros-args', '--log-level', 'error', '--params-file', str(preset_path(preset)))
    commands = (
        ('octo_arm_model.ros.node.main', *arm),
        ('octo_arm_model.ros.simulator.main', *arm),
        ('octo_arm_model.viewer.main', '--port', str(port)),
    )
    with children(commands), opened(port) as browser:
        yield browser


@contextlib.contextmanager
def opened(port: int) -> Iterator[Browser]:
    """A browser on what is served at ``port``, when it is."""
    browser = Browser('about:blank', WIDTH, HEIGHT, wait=60.0)
    try:
        browser.until(lambda: free_port(LOOPBACK, port) != port, 'the page being served')
        browser.driver.get(url(LOOPBACK, port))
        yield browser
    finally:
        browser.close()


def tidy(browser: Browser) -> None:
    """Close the hints and the notice about rendering without a graphics card."""
    browser.leave()
    browser.driver.execute_script(
        'document.querySelectorAll(".mantine-Notifications-root").forEach(e => e.remove())'
    )


def settled(browser: Browser) -> Image.Image:
    """The whole page, once it stays as it is."""
    tidy(browser)
    before = None

    def is_still() -> bool:
        nonlocal before
        last, before = before, browser.picture()
        return last == before

    browser.until(is_still, 'a still picture')
    return Image.open(io.BytesIO(browser.driver.get_screenshot_as_png())).convert('RGB')


def scene_of(browser: Browser) -> Image.Image:
    """The scene alone, once it stays as it is."""
    settled(browser)
    return Image.open(io.BytesIO(browser.picture())).convert('RGB')


def pull(browser: Browser, preset: str, figure: str) -> None:
    """Let the arm take the posture of a figure of the paper."""
    solver = load_config(preset_path(preset)).solver()
    tensions = figures(solver.arm)[figure].reshape(solver.arm.tension_shape)
    browser.press(figure)
    expected = 1e3 * solver.solve(tensions).tip
    browser.until(
        lambda: browser.tip() and np.allclose(browser.tip(), expected, atol=0.006),
        f'the tip of Figure {figure}',
    )


def save(picture: Image.Image, path: Path) -> None:
    """Write a picture and say how large it is."""
    # Few pixels have the colours of the axes, which are to stay.
    picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)
    print(f'{path}  {picture.width} x {picture.height}, {path.stat().st_size / 1e3:.0f} kB')


def bends(folder: Path) -> None:
    """The three bends of Figure 11, side by side."""
    preset = 'renda2012_table2'
    with page_of(preset) as browser:
        scenes = []
        for figure in ('11 A', '11 B', '11 C'):
            pull(browser, preset, figure)
            scenes.append(scene_of(browser))
    width, height = scenes[0].size
    strip = Image.new('RGB', (3 * width, height), 'white')
    for place, scene in enumerate(scenes):
        strip.paste(scene, (place * width, 0))
    save(strip.resize((WIDTH, WIDTH * height // (3 * width))), folder / 'bends.png')


def fetching(folder: Path) -> None:
    """Both fetching movements, and two models beside each other."""
    preset = 'renda2012_table4'
    with page_of(preset) as browser:
        pull(browser, preset, '14')
        save(settled(browser), folder / 'fetching_in_plane.png')
        pull(browser, preset, '15')
        browser.turn(_ROUND)  # to where its coil is seen
        save(settled(browser), folder / 'fetching_in_space.png')
        browser.turn(-_ROUND)
        browser.press('Models')
        browser.choose('none', 'exact')
        browser.until(lambda: browser.text('apart'), 'another model')
        save(settled(browser), folder / 'two_models.png')


def octopus(folder: Path) -> None:
    """Eight arms in the middle of a movement."""
    port = free_port(LOOPBACK, PORT)
    with children([('octo_arm_model.apps.octopus', '--port', str(port))]), opened(port) as browser:
        browser.until(lambda: 'the slowest' in browser.driver.page_source, 'the octopus')
        tidy(browser)
        shot = browser.driver.get_screenshot_as_png()
    save(Image.open(io.BytesIO(shot)).convert('RGB'), folder / 'octopus.png')


def main() -> int:
    """Take all pictures into the folder given; returns the exit status."""
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    # No other arm is in the picture.
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ['ROS_DOMAIN_ID'] = str(new_domain())
    for take in (bends, fetching, octopus):
        take(folder)
    return 0


if __name__ == '__main__':
    sys.exit(main())
