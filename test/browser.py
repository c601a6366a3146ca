"""A headless browser, for tests and for the pictures of the documentation."""

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
    """A window that shows a page of the viewer."""

    def __init__(self, url: str, width: int = 900, height: int = 700, wait: float = 120.0) -> None:
        """Open ``url``; every wait ends after at most ``wait`` [s]."""
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
        """Wait until ``condition`` returns something true, and return it."""
        # The page can replace an element between finding and reading it.
        waiting = WebDriverWait(self.driver, self._wait, 0.1, [StaleElementReferenceException])
        return waiting.until(lambda driver: condition(), f'{what} did not happen')

    def text(self, kind: str) -> str:
        """Return the text of all elements of the class octo-arm-``kind``."""
        # One script, because the page can replace an element between finding and reading it.
        return self.driver.execute_script(
            'return [...document.querySelectorAll(arguments[0])].map(e => e.innerText).join(" ")',
            f'.octo-arm-{kind}',
        )

    def tip(self) -> list[float]:
        """Return the position of the tip that the page shows [mm]; empty before that."""
        return [float(number) for number in self.text('tip').split()]

    def shown(self, text: str) -> Any:
        """Return the visible element with exactly this ``text``."""
        path = f'//*[normalize-space(text())="{text}"]'

        def find() -> Any:
            elements = self.driver.find_elements(By.XPATH, path)
            return next((element for element in elements if element.is_displayed()), None)

        return self.until(find, f'{text!r} on the page')

    def press(self, text: str) -> None:
        """Click the element with this ``text``."""
        element = self.shown(text)
        # Tabs and select boxes ignore clicks without a pointer.
        ActionChains(self.driver).move_to_element(element).click().perform()

    def leave(self) -> None:
        """Move the pointer to the scene."""
        scene = self.driver.find_element(By.CSS_SELECTOR, 'canvas')
        ActionChains(self.driver).move_to_element(scene).perform()

    def turn(self, pixels: int) -> None:
        """Rotate the view by dragging the scene to the right."""
        scene = self.driver.find_element(By.CSS_SELECTOR, 'canvas')
        pointer = ActionChains(self.driver).move_to_element(scene).click_and_hold()
        pointer.move_by_offset(pixels, 0).release().perform()

    def choose(self, current: str, text: str) -> None:
        """In the select box with the value ``current``, select ``text``."""

        def find() -> Any:
            inputs = self.driver.find_elements(By.CSS_SELECTOR, 'input')
            visible = [element for element in inputs if element.is_displayed()]
            return next((e for e in visible if e.get_attribute('value') == current), None)

        choice = self.until(find, f'a select box with {current!r}')
        ActionChains(self.driver).move_to_element(choice).click().perform()
        self.press(text)

    def sliders(self) -> list[Any]:
        """Return the thumbs of all sliders, from the top."""
        return self.driver.find_elements(By.CSS_SELECTOR, '[role=slider]')

    def picture(self) -> bytes:
        """Return the scene as PNG."""
        scene = self.driver.find_element(By.CSS_SELECTOR, 'canvas')
        # Without a graphics card a busy machine can take longer than the driver waits.
        waiting = WebDriverWait(self.driver, self._wait, 0.1, [TimeoutException])
        return waiting.until(lambda driver: scene.screenshot_as_png, 'no picture of the scene')

    def complaints(self) -> list[str]:
        """Return errors on the browser's console since the last call."""
        entries = self.driver.get_log('browser')
        return [entry['message'] for entry in entries if entry['level'] == 'SEVERE']
