"""A real browser without a screen, for tests and for the pictures of the documentation."""

import shutil
from collections.abc import Callable
from typing import Any

from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException, TimeoutException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
CHROMEDRIVER = shutil.which('chromedriver')
_FLAGS = (
    '--headless=new',
    '--no-sandbox',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--disable-quic',
    '--hide-scrollbars',
    # WebGL without a graphics card.
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
)


class Browser:
    """One window on a page of the viewer."""

    def __init__(self, url: str, width: int = 900, height: int = 700, wait: float = 120.0) -> None:
        """Open ``url``; whatever is waited for has to happen within ``wait`` [s]."""
        options = webdriver.ChromeOptions()
        options.binary_location = CHROMIUM
        for flag in (*_FLAGS, f'--window-size={width},{height}'):
            options.add_argument(flag)
        options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
        self.driver = webdriver.Chrome(options=options, service=Service(CHROMEDRIVER))
        self._wait = wait
        self.driver.get(url)

    def close(self) -> None:
        """Close the window."""
        self.driver.quit()

    def until(self, condition: Callable[[], Any], what: str) -> Any:
        """Wait for ``condition`` to be true; returns what it returned."""
        # What is found may be replaced before it is looked at.
        patience = WebDriverWait(self.driver, self._wait, 0.1, [StaleElementReferenceException])
        return patience.until(lambda driver: condition(), f'{what} did not happen')

    def text(self, kind: str) -> str:
        """What the page says in its elements of the class octo-arm-``kind``, if anything."""
        # In one go: between finding an element and reading it, it may be replaced.
        return self.driver.execute_script(
            'return [...document.querySelectorAll(arguments[0])].map(e => e.innerText).join(" ")',
            f'.octo-arm-{kind}',
        )

    def tip(self) -> list[float]:
        """Position of the tip [mm] as the page says it; empty before it does."""
        return [float(number) for number in self.text('tip').split()]

    def shown(self, text: str) -> Any:
        """The visible element of this very text."""
        path = f'//*[normalize-space(text())="{text}"]'

        def find() -> Any:
            found = self.driver.find_elements(By.XPATH, path)
            return next((element for element in found if element.is_displayed()), None)

        return self.until(find, f'{text!r} on the page')

    def press(self, text: str) -> None:
        """Click what has this text."""
        element = self.shown(text)
        # As a hand does it: tabs and choices take no notice of clicks without a pointer.
        ActionChains(self.driver).move_to_element(element).click().perform()

    def leave(self) -> None:
        """Move the pointer to where it points at nothing but the scene."""
        scene = self.driver.find_element(By.CSS_SELECTOR, 'canvas')
        ActionChains(self.driver).move_to_element(scene).perform()

    def turn(self, pixels: int) -> None:
        """Look from elsewhere, by dragging the scene to the right."""
        scene = self.driver.find_element(By.CSS_SELECTOR, 'canvas')
        hand = ActionChains(self.driver).move_to_element(scene).click_and_hold()
        hand.move_by_offset(pixels, 0).release().perform()

    def choose(self, now: str, text: str) -> None:
        """Of the choice that stands at ``now``, take ``text``."""

        def find() -> Any:
            found = self.driver.find_elements(By.CSS_SELECTOR, 'input')
            shown = [element for element in found if element.is_displayed()]
            return next((e for e in shown if e.get_attribute('value') == now), None)

        choice = self.until(find, f'a choice of {now!r}')
        ActionChains(self.driver).move_to_element(choice).click().perform()
        self.press(text)

    def sliders(self) -> list[Any]:
        """The thumbs of all sliders, from the top."""
        return self.driver.find_elements(By.CSS_SELECTOR, '[role=slider]')

    def picture(self) -> bytes:
        """The scene as PNG."""
        scene = self.driver.find_element(By.CSS_SELECTOR, 'canvas')
        # Without a graphics card, beside other work, one may take longer than the driver waits.
        patience = WebDriverWait(self.driver, self._wait, 0.1, [TimeoutException])
        return patience.until(lambda driver: scene.screenshot_as_png, 'no picture of the scene')

    def complaints(self) -> list[str]:
        """Errors on the browser's console since the last time."""
        entries = self.driver.get_log('browser')
        return [entry['message'] for entry in entries if entry['level'] == 'SEVERE']
