"""The loop of the viewer: draw published shapes, and publish the commands of the page."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable

import viser

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.config.config import Config
from octo_arm_model.ros.client.client import DETAILS, POSES, ArmClient
from octo_arm_model.viewer.guard import RefusalLog
from octo_arm_model.viewer.options import TITLE
from octo_arm_model.viewer.page import numbers
from octo_arm_model.viewer.page.cameras import Cameras
from octo_arm_model.viewer.page.page import Page
from octo_arm_model.viewer.page.scene import set_theme

FRAME = 1.0 / 30.0  # [s] between pictures
_IDLE = 0.2  # [s] between polls of the node while no browser is connected


class Viewer:
    """Shows one arm and commands it, in the thread that calls `step`.

    Attributes:
        pictures: number of pictures drawn.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        client: ArmClient,
        *,
        always: bool = False,
        title: str = TITLE,
    ) -> None:
        """Show on ``server`` what ``client`` receives, under ``title``.

        It subscribes to shapes while a browser is connected, or ``always``.
        """
        self._always, self._title = always, title
        self._cameras = Cameras(server)
        self._server, self._client = server, client
        self._todo: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._page: Page | None = None
        self._config: Config | None = None
        self._due = time.monotonic()
        self.pictures = 0
        self._refusals = RefusalLog()
        self._clear()
        server.gui.add_html(numbers.waiting(client.command_topic))
        # Draw at once for a new browser.
        server.on_client_connect(lambda client: self._todo.put(self._refresh))

    def step(self) -> None:
        """Handle requests of the page until the next picture is due; then draw it."""
        while (wait := self._due - time.monotonic()) > 0.0:
            try:
                action = self._todo.get(timeout=wait)
            except queue.Empty:
                break
            self._do(action)
            self._command()
        has_changed = self._listen()
        self._command()
        page = self._page
        if page is not None and self._is_watched and (has_changed or page.is_stale):
            page.draw()
            self.pictures += 1
        is_busy = self._is_watched or (page is not None and page.commander.is_moving)
        now = time.monotonic()
        self._due = max(self._due + (FRAME if is_busy else _IDLE), now)

    def _do(self, action: Callable[[], None]) -> None:
        """Run ``action``; an error is logged and shown on the page."""
        try:
            action()
        except OctoArmError as error:
            self._refusals.add(str(error))
            if self._page is not None:
                self._page.refuse(error)

    def _command(self) -> None:
        if self._page is not None:
            self._do(self._page.command)

    @property
    def _is_watched(self) -> bool:
        return bool(self._server.get_clients())

    def _refresh(self) -> None:
        if self._page is not None:
            self._page.draw()

    def _listen(self) -> bool:
        """Poll the client, build a page for a new arm; returns whether there is a new shape."""
        self._client.listen({**POSES, **DETAILS} if self._always or self._is_watched else {})
        try:
            has_shape = self._client.poll()
            config = self._client.config
            if config is not self._config and config is not None:
                self._clear()
                self._config = config
                self._page = Page(
                    self._server, self._cameras, self._client, config, self._todo.put
                )
        except OctoArmError as error:
            self._clear()
            self._server.gui.add_html(numbers.failed(error))
            return False
        return has_shape

    def _clear(self) -> None:
        if self._page is not None:
            self._page.close()
            self._page = None
        server = self._server
        server.scene.reset()
        server.gui.reset()
        set_theme(server.gui, self._title)
