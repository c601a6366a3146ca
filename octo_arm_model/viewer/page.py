"""The page of one arm, and the loop that draws published shapes and publishes commands."""

import copy
import queue
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import viser
from viser import uplot

from octo_arm_model.analysis.drawing import deepest_overlap
from octo_arm_model.analysis.inverse import Inverse, find_tensions
from octo_arm_model.analysis.targets import TipPosition
from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.section_formulas import widening
from octo_arm_model.ros.client.client import (
    COMMANDS,
    DETAILS,
    POSES,
    ArmClient,
    PublishedShape,
    PublishedStrains,
)
from octo_arm_model.ros.work import LongCall
from octo_arm_model.simulation.movements import tendon_limits
from octo_arm_model.viewer import numbers, scene
from octo_arm_model.viewer.address import TITLE
from octo_arm_model.viewer.commander import Commander
from octo_arm_model.viewer.controls import Controls, Later, ModelOverlay, MotionControls
from octo_arm_model.viewer.scene import Cameras, framing, reachable_points, tangent_of
from octo_arm_model.viewer.server import refusing

_PLOTS = (
    ('torsion τ [1/m]', 'tau', 1.0),
    ('curvature ξ about n [1/m]', 'xi', 1.0),
    ('curvature k about b [1/m]', 'k', 1.0),
    ('longitudinal strain q [%]', 'q', 100.0),
)
_NODE, _OTHER = '#c8553d', '#4f7cac'
# Smallest range of an axis, so that rounding errors look flat.
_LEAST = 1.0


class StrainPlots:
    """Four plots of strains over s, for the node and for another model if one is chosen."""

    def __init__(self, gui: viser.GuiApi, s: FloatArray) -> None:
        """Add the plots to ``gui``, for the stations ``s`` [m]."""
        self._s = 1e3 * s
        end = {'pad': 0.1, 'mode': 1}
        self._plots = [
            gui.add_uplot(
                (self._s, 0.0 * s, 0.0 * s),
                series=(
                    uplot.Series(label='s [mm]'),
                    uplot.Series(label='other', stroke=_OTHER, width=2),
                    uplot.Series(label='node', stroke=_NODE, width=2),
                ),
                scales={
                    'x': uplot.Scale(time=False),
                    'y': uplot.Scale(
                        range={'min': {**end, 'soft': -_LEAST}, 'max': {**end, 'soft': _LEAST}}
                    ),
                },
                axes=(uplot.Axis(size=30), uplot.Axis(size=44)),
                padding=(8, 16, 0, 0),  # for halves of the last numbers at the axes
                title=label,
                legend=uplot.Legend(show=False),
                height=112,
                # Hidden until there is a shape, because zeros are the strains of a straight arm.
                visible=False,
            )
            for label, _, _ in _PLOTS
        ]

    def show(self, node: PublishedStrains, other: Backbone | None) -> None:
        """Plot the strains of the node, and those of another model if given."""
        for plot, (_, name, scale) in zip(self._plots, _PLOTS, strict=True):
            # Without another model the node's own curve hides the second curve.
            second = other or node
            plot.data = (self._s, scale * getattr(second, name), scale * getattr(node, name))
            if not plot.visible:
                plot.visible = True


_READING = 0.2  # [s] between updates of the numbers
_PLOTTING = 0.1  # [s] between updates of the plots
_APPROACH = 0.3  # [s] of the transition to the tensions that a search has found


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
        """Build the page for the arm that ``config`` describes."""
        self._server, self._client = server, client
        self._queue, self._is_closed = later, False
        self._solver = config.solver()
        self.commander = Commander(np.zeros(len(config.arm.tendons)))
        self._search: LongCall[Inverse] | None = None
        self._asked = 0  # number of commands when the search began
        self._read = self._plotted = -np.inf
        self._config = config
        length = config.arm.length
        points = reachable_points(config, tendon_limits(config))
        scene.set_scene(server, scene.middle_of(config), length, 0.55 * length)
        cameras.aim(partial(framing, points, tangent_of(config)), 0.01 * length)
        scene.set_surroundings(server.scene, config)
        self._arm = scene.ArmScene(server.scene, 'arm', self._solver)
        self._uncertainty = scene.UncertaintyScene(server.scene, self._solver)
        self._add_ghost()
        gui = server.gui
        self._text = gui.add_html(numbers.live(client))
        self._overlap = gui.add_html('')
        refit = gui.add_button('Show the whole arm', color='gray', icon=viser.Icon.FOCUS_CENTERED)

        @refit.on_click
        def _(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            if event.client is not None:
                cameras.show(event.client)

        self._problem, tabs = gui.add_html(''), gui.add_tab_group()
        with tabs.add_tab('Tendons'):
            topic = client.command_topic
            self._controls = Controls(server, config, self.commander, topic, self._later)
        with tabs.add_tab('Profile'):
            self._controls.add_profiles()
        with tabs.add_tab('Target'):
            self._add_target(config)
        with tabs.add_tab('Motion'):
            self._motion = MotionControls(server, config, client.simulator, self._later)
        with tabs.add_tab('Models'):
            self._comparison = ModelOverlay(server, config, self._later)
        panel = gui.add_panel()
        with panel.add_tab('Strains over s [mm]'):
            self._plots = StrainPlots(gui, self._solver.grid.s)
        panel.dock_left()

    def close(self) -> None:
        """End the search and drop queued actions."""
        self._is_closed = True
        if self._search is not None:
            self._search.abandon()
        self._controls.close()

    def _later(self, action: Callable[[], None]) -> None:
        """Queue what somebody does on the page, which clears the problem of an earlier action."""

        def act() -> None:
            if not self._is_closed:
                self._problem.content = ''
                action()

        self._queue(act)

    def command(self) -> None:
        """Go on from what other nodes command and a search finds; publish tensions that change."""
        now = time.monotonic()
        if heard := self._client.take_command():
            present = zip(self._config.arm.tendon_names, self.commander.tensions, strict=True)
            self.commander.follow([heard.get(name, pull) for name, pull in present], now)
        elif self._client.has_no_command:
            self.commander.forget(now)
        self._go_on_searching(now)
        tensions = self.commander.advance(now)
        if tensions is not None:
            self._client.command(tensions)

    def let_go(self) -> None:
        """Stop pulling the tip of a simulated arm."""
        self._motion.let_go()

    def refuse(self, problem: object) -> None:
        """Hold the tensions and show the ``problem``."""
        self.commander.stop()
        self._problem.content = numbers.error_text(problem)

    @property
    def is_stale(self) -> bool:
        """Whether the numbers need an update even without a new shape."""
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
                self._motion.show_pause(client.is_paused)
                self._controls.follow()

    def _draw_arm(self, shape: PublishedShape, strains: PublishedStrains, now: float) -> None:
        tensions = self._client.tensions
        if tensions is None:
            tensions = np.zeros(self._controls.highest.size)
        pull = tensions / self._controls.highest
        self._arm.show(shape.position, shape.quaternion, strains.q, pull)
        self._comparison.show(tensions, pull, shape.position[-1])
        self._motion.follow(shape.position[-1])
        if (covariance := self._client.covariance) is not None:
            force = self._client.force
            self._uncertainty.show(shape.position, shape.quaternion, covariance, force)
        self.commander.measure(np.clip(tensions, 0.0, self._controls.highest))
        if now - self._plotted > _PLOTTING:
            self._plotted = now
            self._plots.show(strains, self._comparison.backbone)
            radius = self._config.arm.body.radius(self._solver.grid.s)
            radius = radius * widening(self._solver.law.number, 1.0 + strains.q)[0]
            overlap = deepest_overlap(strains.s, shape.position, radius)
            self._overlap.content = numbers.overlapping(overlap)

    def _add_ghost(self) -> None:
        rest = np.zeros(self._solver.arm.tension_shape)
        try:
            unloaded = self._solver.solve(rest)
        except OctoArmError:
            return  # no equilibrium under the loads alone
        ghost = scene.ArmScene(
            self._server.scene,
            'ghost',
            self._solver,
            colour=scene.GHOST_COLOUR,
            opacity=scene.GHOST_OPACITY,
            has_tendons=False,
        )
        ghost.show(unloaded.position, unloaded.quaternion, unloaded.q, rest.ravel())

    def _add_target(self, config: Config) -> None:
        gui = self._server.gui
        checkbox = gui.add_checkbox('Show target', initial_value=False)
        self._search_text = gui.add_html(
            numbers.note('Drag it: tensions that bring the tip there are searched in this viewer.')
        )
        highest = self._controls.highest.reshape(config.arm.tension_shape)
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
            target.visible = checkbox.value

        def search() -> None:
            self._search_text.content = numbers.note('searching …')
            self._asked = self.commander.commands
            if self._search is not None:
                self._search.abandon()
            start = self.commander.tensions.reshape(highest.shape).clip(0.0, highest)
            # The thread of the search needs its own solver.
            solver, tip = copy.copy(self._solver), np.array(target.position)

            def find(pause: Callable[[], None]) -> Inverse:
                return find_tensions(solver, TipPosition(tip), highest, start=start, pause=pause)

            self._search = LongCall(find)

        checkbox.on_update(lambda event: self._later(show))
        target.on_update(lambda event: self._later(search))

    def _go_on_searching(self, now: float) -> None:
        """Move to what the search has found, unless a newer command has come meanwhile."""
        if (search := self._search) is None:
            return
        if self._asked != self.commander.commands:
            search.abandon()
            self._search = None
            self._search_text.content = numbers.note('A newer command has replaced the search.')
            return
        if not search.done():
            return
        self._search = None
        try:
            found = search.result()
            self._search_text.content = numbers.search_result(found)
            self.commander.move(found.backbone.tensions, now, _APPROACH)
        except OctoArmError as error:
            self._search_text.content = numbers.error_text(error)


FRAME = 1.0 / 30.0  # [s] between pictures while a browser is connected
_IDLE = 0.2  # [s] between polls of the node while no browser is connected


class Viewer:
    """Shows one arm and commands it, in the thread that calls `step`."""

    def __init__(
        self,
        server: viser.ViserServer,
        client: ArmClient,
        *,
        always: bool = False,
        title: str = TITLE,
    ) -> None:
        """Show on ``server`` what ``client`` receives, with ``title`` above.

        It subscribes to shapes while a browser is connected, or ``always``.
        """
        self._always, self._title = always, title
        self._cameras = Cameras(server)
        self._server, self._client = server, client
        self._actions: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._page: Page | None = None
        self._config: Config | None = None
        self._due = time.monotonic()
        self._refuse = refusing()
        self._clear()
        server.gui.add_html(numbers.waiting(client.command_topic))
        # A new browser gets a picture at once. viser keeps these functions until the server ends,
        # so that a page, which may be replaced, must not be among them.
        server.on_client_connect(lambda client: self._later(Page.draw))
        server.on_client_disconnect(lambda client: self._later(Page.let_go))

    def _later(self, act: Callable[[Page], None]) -> None:
        self._actions.put(lambda: act(self._page) if self._page else None)

    def step(self) -> None:
        """Handle actions of the page until the next picture is due; then draw it."""
        late = self._actions.qsize()  # these are handled even if every picture is late
        while (wait := max(0.0, self._due - time.monotonic())) or late > 0:
            late -= 1
            try:
                action = self._actions.get(timeout=wait)
            except queue.Empty:
                break
            self._do(action)
            self._command()
        has_changed = self._listen()
        self._command()
        page = self._page
        if page is not None and self._is_watched and (has_changed or page.is_stale):
            page.draw()
        is_busy = self._is_watched or (page is not None and page.commander.is_moving)
        now = time.monotonic()
        self._due = max(self._due + (FRAME if is_busy else _IDLE), now)

    def _do(self, action: Callable[[], None]) -> None:
        """Run ``action``; an error is logged and shown on the page."""
        try:
            action()
        except OctoArmError as error:
            self._refuse(str(error))
            if self._page is not None:
                self._page.refuse(error)

    def _command(self) -> None:
        if self._page is not None:
            self._do(self._page.command)

    @property
    def _is_watched(self) -> bool:
        return bool(self._server.get_clients())

    def _listen(self) -> bool:
        """Poll the client, build a page for a new arm; return whether there is a new shape."""
        shapes = {**POSES, **DETAILS} if self._always or self._is_watched else {}
        self._client.listen({**COMMANDS, **shapes})
        try:
            has_shape = self._client.poll()
            config = self._client.config
            if config is not self._config and config is not None:
                self._clear()
                self._config = config
                self._page = Page(
                    self._server, self._cameras, self._client, config, self._actions.put
                )
        except OctoArmError as error:
            self._clear()
            self._server.gui.add_html(numbers.error_text(error))
            return False
        return has_shape

    def _clear(self) -> None:
        if self._page is not None:
            self._page.close()
            self._page = None
        server = self._server
        server.scene.reset()
        server.gui.reset()
        scene.set_theme(server.gui, self._title)
