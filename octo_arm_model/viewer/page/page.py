"""The page of one arm: scene, controls, plots, numbers and the dragged target."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
import viser

from octo_arm_model.analysis.geometry.self_intersection import deepest_overlap
from octo_arm_model.analysis.inverse import Inverse
from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.ros.client.client import ArmClient
from octo_arm_model.ros.client.published import PublishedShape, PublishedStrains
from octo_arm_model.simulation.profiles.limits import tendon_limits
from octo_arm_model.viewer.commander import Commander
from octo_arm_model.viewer.page import numbers
from octo_arm_model.viewer.page.cameras import Cameras
from octo_arm_model.viewer.page.controls import Controls, Later
from octo_arm_model.viewer.page.model_overlay import ModelOverlay
from octo_arm_model.viewer.page.plots import StrainPlots
from octo_arm_model.viewer.page.scene import (
    GHOST_COLOUR,
    GHOST_OPACITY,
    ArmScene,
    LiveShape,
    middle_of,
    set_base,
    set_scene,
)
from octo_arm_model.viewer.page.target import Answer, TargetSearch
from octo_arm_model.viewer.page.uncertainty import UncertaintyScene
from octo_arm_model.viewer.page.view import framing, reached, tangent_of

_READING = 0.2  # [s] between updates of the numbers
_PLOTTING = 0.1  # [s] between updates of the plots
_APPROACH = 0.3  # [s] of the transition to tensions that were found


class Page:
    """The page of one arm, drawn and read by one thread.

    Attributes:
        commander: the commanded tensions.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        cameras: Cameras,
        client: ArmClient,
        config: Config,
        later: Later,
    ) -> None:
        """Build it for the arm that ``config`` describes."""
        self._server, self._client = server, client
        self._queue, self._is_closed = later, False
        self._solver = config.solver()
        self.commander = Commander(np.zeros(len(config.arm.tendons)))
        self._is_ours = False
        self._read = self._plotted = -np.inf
        self._config = config
        length = config.arm.length
        points = reached(config, tendon_limits(config))
        set_scene(server, middle_of(config), length, 0.55 * length)
        cameras.aim(partial(framing, points, tangent_of(config)), 0.01 * length)
        set_base(server.scene, config)
        self._arm = ArmScene(server.scene, 'arm', self._solver)
        self._uncertainty = UncertaintyScene(server.scene, self._solver)
        self._add_ghost()
        gui = server.gui
        self._text = gui.add_html(numbers.live(client))
        self._overlap = gui.add_html('')
        whole = gui.add_button('Show the whole arm', color='gray', icon=viser.Icon.FOCUS_CENTERED)

        @whole.on_click
        def _(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            if event.client is not None:
                cameras.show(event.client)

        tabs = gui.add_tab_group()
        with tabs.add_tab('Tendons'):
            self._controls = Controls(
                server, config, self.commander, client.command_topic, self._later
            )
        with tabs.add_tab('Profile'):
            self._controls.add_profiles()
        with tabs.add_tab('Target'):
            self._add_target(config)
        with tabs.add_tab('Models'):
            self._comparison = ModelOverlay(server, config, self._later)
        panel = gui.add_panel()
        with panel.add_tab('Strains over s [mm]'):
            self._plots = StrainPlots(gui, self._solver.grid.s)
        panel.dock_left()

    def close(self) -> None:
        """End the thread of the search; queued actions are dropped."""
        self._is_closed = True
        self._search.close()
        self._controls.close()

    def _later(self, action: Callable[[], None]) -> None:
        self._queue(lambda: None if self._is_closed else action())

    def command(self) -> None:
        """Publish the commanded tensions if they have changed."""
        tensions = self.commander.advance(time.monotonic())
        if tensions is not None:
            self._is_ours = True
            self._client.command(tensions)

    def refuse(self, problem: object) -> None:
        """Hold the tensions and show ``problem``."""
        self.commander.stop()
        self._controls.complain(problem)

    @property
    def is_stale(self) -> bool:
        """Whether the numbers are to be updated without a new shape."""
        return time.monotonic() - self._read > 1.0

    def draw(self) -> None:
        """Draw the newest shape, its strains and its numbers."""
        now = time.monotonic()
        client, shape, strains = self._client, self._client.shape, self._client.strains
        count = self._solver.grid.s.size
        with self._server.atomic():
            if shape is not None and strains is not None:
                if len(shape.position) == len(strains.s) == count:
                    self._draw_arm(shape, strains, now)
            self._arm.root.visible = client.age() < numbers.STALE
            if not self._arm.root.visible:
                self._uncertainty.hide()
            if now - self._read > _READING:
                self._read = now
                self._text.content = numbers.live(client)
                self._controls.follow()

    def _draw_arm(self, shape: PublishedShape, strains: PublishedStrains, now: float) -> None:
        tensions = self._client.tensions
        if tensions is None:
            tensions = np.zeros(self._controls.highest.size)
        pull = tensions / self._controls.highest
        self._arm.show(LiveShape(shape.position, shape.quaternion, strains.q), pull)
        self._comparison.show(tensions, pull, shape.position[-1])
        if (known := self._client.covariance) is not None:
            self._uncertainty.show(shape.position, shape.quaternion, known, self._client.force)
        if not self._is_ours and not self.commander.is_moving:
            # Another node commands: commands start from its tensions.
            self.commander.tensions = tensions.copy()
        if now - self._plotted > _PLOTTING:
            self._plotted = now
            self._plots.show(strains, self._comparison.backbone)
            found = deepest_overlap(strains.s, shape.position, self._radius(strains.q))
            self._overlap.content = numbers.overlapping(found)

    def _radius(self, q: FloatArray) -> FloatArray:
        radius = self._config.arm.body.radius(self._solver.grid.s)
        return radius * (1.0 + q) ** -0.5 if self._solver.law.widens else radius

    def _add_ghost(self) -> None:
        rest = np.zeros(self._solver.arm.tension_shape)
        try:
            unloaded = self._solver.solve(rest)
        except OctoArmError:
            return  # no equilibrium under the loads alone
        ghost = ArmScene(
            self._server.scene,
            'ghost',
            self._solver,
            colour=GHOST_COLOUR,
            opacity=GHOST_OPACITY,
            has_tendons=False,
        )
        ghost.show(unloaded, rest.ravel())

    def _add_target(self, config: Config) -> None:
        gui = self._server.gui
        shown = gui.add_checkbox('Show target', initial_value=False)
        self._found = gui.add_html(
            numbers.note('Drag it: tensions that bring the tip there are searched in this viewer.')
        )
        self._search = TargetSearch(self._solver, self._controls.highest, self._deliver)
        target = self._server.scene.add_transform_controls(
            '/target',
            scale=0.18 * config.arm.length,
            disable_rotations=True,
            depth_test=False,
            visible=False,
        )

        def show() -> None:
            if self._client.shape is not None:
                target.position = self._client.shape.position[-1]
            target.visible = shown.value

        def look() -> None:
            self._found.content = numbers.searching()
            self._search.request(target.position, self.commander.tensions)

        shown.on_update(lambda event: self._later(show))

        @target.on_update
        def _(event: viser.TransformControlsEvent) -> None:
            self._later(look)

    def _deliver(self, answer: Answer) -> None:
        self._later(lambda: self._take(answer))

    def _take(self, answer: Answer) -> None:
        if isinstance(answer, Inverse):
            self._found.content = numbers.found(answer)
            self.commander.move(answer.backbone.tensions, time.monotonic(), _APPROACH)
        else:
            self._found.content = numbers.failed(answer)
