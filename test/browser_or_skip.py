"""The viewer in a real browser; a module that imports this is skipped where a part is missing."""

import io

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('viser', reason='needs viser')
pytest.importorskip('selenium', reason='needs selenium')
image = pytest.importorskip('PIL.Image', reason='needs pillow')

from browser import CHROMEDRIVER, CHROMIUM, Browser

if not (CHROMIUM and CHROMEDRIVER):
    pytest.skip('needs chromium and chromedriver (apt: chromium chromium-driver)', True)


__all__ = ['Browser', 'colours']


def colours(png):
    """Red, green and blue of the pixels of a picture, (rows, columns, 3)."""
    return np.asarray(image.open(io.BytesIO(png)).convert('RGB'), float)
