"""The 3D scene with arms and their uncertainty, and the cameras of all browsers."""

import threading
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray

from octo_arm_model.analysis import drawing
from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.config.config import Config
from octo_arm_model.rod.rotations import axes_of
from octo_arm_model.rod.solver import Solver
from octo_arm_model.simulation.movements import figures
from octo_arm_model.wire.estimate import BackboneCovariance

FIELD = 0.7  # vertical field of view [rad]
ASPECT = 0.9  # width over height of the scene between the panels, in a usual window
_DIRECTION = (0.6, -1.0, 0.6)  # towards the camera: along the arm, across it and up
_MARGIN = 1.12
_STATIONS = 31
_CURLED = 0.2  # extent of a curled arm from its base, over its length
_PULL = 0.15  # tension at which the tip is farthest from the axis, over its limit
_ON_THE_WAY = (0.25, 0.5, 0.75, 1.0)  # fractions of the tensions of a figure


class View(NamedTuple):
    """Position of a camera, and the point that it looks at, each (3,) [m]."""

    position: FloatArray
    look_at: FloatArray


def horizontal_normal(tangent: FloatArray) -> FloatArray:
    """Return the horizontal normal (3,) of ``tangent`` (3,); x if that is vertical."""
    normal = np.cross([0.0, 0.0, 1.0], tangent)
    size = float(np.linalg.norm(normal))
    return np.asarray(normal / size if size > 1e-3 else np.array([1.0, 0.0, 0.0]))


def tangent_of(config: Config) -> FloatArray:
    """Return the direction of the resting arm (3,)."""
    return axes_of(config.base.quaternion)[:, 0]


def reachable_points(config: Config, limits: FloatArray) -> FloatArray:
    """Return points (points, 3) [m] of the arm at rest, curled, and with tensioned tendons.

    The shapes without loads are those for one tendon at a time, and for fractions of the tensions
    of the paper's figures. An arm that closed_form does not cover has only rest and curl.
    """
    base, arm = np.array(config.base.position), config.arm
    rest = np.linspace(base, base + arm.length * tangent_of(config), _STATIONS)
    curled = base + _CURLED * arm.length * np.concatenate([np.eye(3), -np.eye(3)])
    rest = np.concatenate([rest, curled])
    sets = [*_PULL * np.diag(limits)]
    sets += [fraction * tensions for tensions in figures(arm).values() for fraction in _ON_THE_WAY]
    tensions = np.reshape(sets, (-1, *arm.tension_shape))
    try:
        bent = Solver(arm, 'closed_form', _STATIONS + len(arm.sections), config.base)
        return np.concatenate([rest, bent.solve(tensions).position.reshape(-1, 3)])
    except OctoArmError:
        return rest


def framing(points: FloatArray, tangent: FloatArray, aspect: float = ASPECT) -> View:
    """Return the nearest view that shows all ``points`` (points, 3) [m], centred in the picture.

    ``tangent`` (3,) is the direction of the arm, which is seen from the side; ``aspect`` is the
    width of the picture over its height.
    """
    along, side, up = _DIRECTION
    towards = along * tangent + side * horizontal_normal(tangent) + [0.0, 0.0, up]
    towards /= np.linalg.norm(towards)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(towards, right), towards])
    seen = points @ axes.T
    half = np.tan(0.5 * FIELD) * np.array([aspect, 1.0]) / _MARGIN
    # In perspective, a point at depth z is at the edge of the picture if its distance from the
    # middle is half (distance - z).
    low, high = seen[:, :2] + np.outer(seen[:, 2], half), seen[:, :2] - np.outer(seen[:, 2], half)
    most, least = low.max(axis=0), high.min(axis=0)
    middle, distance = 0.5 * (most + least), float(np.max(0.5 * (most - least) / half))
    look_at = np.append(middle, np.mean([seen[:, 2].min(), seen[:, 2].max()]))
    eye = np.append(middle, distance)
    return View(eye @ axes, look_at @ axes)


_SAME = 1e-3  # relative to the distance of the camera; a smaller motion does not count
_RESHAPED = 0.01  # relative change of the aspect of a picture that needs another view


class Cameras:
    """Points the cameras of all browsers at the arms.

    The picture is the part of a window without panels. Each browser sends its aspect when it
    connects, and when windows and panels are moved.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        """Manage the cameras of ``server``, which are not moved before `aim` is called."""
        self._server = server
        self._view_of: Callable[[float], View] | None = None
        self._near = 0.01
        self._shown: dict[int, tuple[View, float]] = {}  # views and their aspects, by client
        self._lock = threading.Lock()  # viser calls back in many threads
        # A window may be closed while its camera is moved, which is not an error.
        warnings.filterwarnings('ignore', 'Queued .* on a closed connection', UserWarning)
        server.on_client_connect(self._on_connect)

    def aim(self, view_of: Callable[[float], View], near: float) -> None:
        """Show in each browser ``view_of`` its aspect, the width of the picture over its height.

        What is nearer to a camera than ``near`` [m] is not drawn.
        """
        with self._lock:
            self._view_of, self._near = view_of, near
            self._shown.clear()
        first = self._server.initial_camera
        first.position, first.look_at = view_of(ASPECT)
        first.near, first.fov = near, FIELD
        for client in self._server.get_clients().values():
            self.show(client)

    def show(self, client: viser.ClientHandle) -> None:
        """Move the camera of one browser back to its view."""
        with self._lock:
            if self._view_of is None:
                return
            camera = client.camera
            aspect = _aspect(camera)
            view = self._view_of(aspect)
            connected = self._server.get_clients()
            self._shown = {key: view for key, view in self._shown.items() if key in connected}
            self._shown[client.client_id] = view, aspect
            with client.atomic():
                camera.up_direction = (0.0, 0.0, 1.0)
                camera.position, camera.look_at = view
                camera.near, camera.fov = self._near, FIELD

    def _on_connect(self, client: viser.ClientHandle) -> None:
        client.camera.on_update(lambda camera: self._follow(client))
        self.show(client)

    def _follow(self, client: viser.ClientHandle) -> None:
        """Show the view for a new aspect of the picture, unless a user has moved the camera."""
        with self._lock:
            view, aspect = self._shown.get(client.client_id, (None, ASPECT))
        camera = client.camera
        if view is None or abs(_aspect(camera) / aspect - 1.0) < _RESHAPED:
            return
        distance = np.abs(np.subtract([camera.position, camera.look_at], view)).max()
        if distance < _SAME * np.linalg.norm(np.subtract(*view)):
            self.show(client)


def _aspect(camera: viser.CameraHandle) -> float:
    """Return the width of the picture over its height; ASPECT while a window has no size."""
    width, height = camera.image_width, camera.image_height
    return width / height if width > 0 and height > 0 else ASPECT


Colour = tuple[int, int, int]
_BRAND: Colour = (200, 85, 61)
BODY_COLOUR: Colour = (222, 140, 126)
OTHER_COLOUR: Colour = (112, 152, 196)
GHOST_COLOUR: Colour = (150, 150, 155)
DISC_COLOUR: Colour = (62, 62, 74)
_SIDES = 24
_THICKER = 1.5  # width of tendons over that in RViz, because the body partly hides them
_BODY_OPACITY = 0.45  # so that tendons inside are visible
GHOST_OPACITY = 0.16
OBSTACLES: dict[str, Any] = {'color': (150, 160, 172), 'opacity': 0.7, 'side': 'double'}


class ArmScene:
    """One arm in the scene, redrawn with every shape.

    Attributes:
        root: the parent frame of all meshes of the arm, which hides and removes them.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        solver: Solver,
        *,
        colour: Colour = BODY_COLOUR,
        opacity: float | None = _BODY_OPACITY,
        has_tendons: bool = True,
        offset: FloatArray | None = None,
    ) -> None:
        """Add the arm of ``solver`` under ``name``; it is visible after the first `show`.

        ``has_tendons`` draws tendons and anchorage discs, ``opacity`` is that of the body (None
        for opaque), and ``offset`` (3,) [m] moves the arm.
        """
        self._scene, self._colour, self._opacity = scene, colour, opacity
        self._has_tendons = has_tendons
        self._drawing = drawing.Drawing(solver.arm, solver.grid.s, solver.law.number, sides=_SIDES)
        self._name = f'/{name}'
        self.root = scene.add_frame(
            self._name, show_axes=False, position=np.zeros(3) if offset is None else offset
        )
        # The vertices (3, vertices) and triangles of a disc of radius 1 normal to z.
        ring = np.concatenate([drawing.unit_circle(_SIDES), np.zeros((1, _SIDES))])
        up = np.array([[0.0], [0.0], [0.5 * self._drawing.disc_thickness]])
        rim = np.stack([ring - up, ring + up], axis=-1).reshape(3, -1)
        self._unit = np.concatenate([rim, -up, up], axis=1)
        self._triangles = drawing.tube_triangles(2, _SIDES)
        self._body: viser.MeshHandle | None = None
        self._discs: viser.MeshHandle | None = None
        self._tendons: viser.LineSegmentsHandle | None = None

    def show(
        self, position: FloatArray, quaternion: FloatArray, q: FloatArray, pull: FloatArray
    ) -> None:
        """Draw a shape with position, quaternion and strain q at the stations of the solver.

        ``pull`` (tendons,) is each tension divided by its limit, 0 to 1.
        """
        drawn = self._drawing.draw(position, quaternion, q)
        self._body = show_mesh(
            self._scene,
            self._body,
            f'{self._name}/body',
            drawn.vertices,
            self._drawing.triangles,
            color=self._colour,
            opacity=self._opacity,
        )
        if not self._has_tendons:
            return
        self._show_discs(drawn)
        parts = [np.stack([path[:-1], path[1:]], axis=1) for path in drawn.tendons]
        points = np.concatenate(parts).astype(np.float32)
        # The square root makes low tensions visible.
        rgb = (255.0 * drawing.tension_colours(np.sqrt(pull), 1.0)[:, :3]).astype(np.uint8)
        segments = np.repeat(rgb, [len(part) for part in parts], axis=0)
        colours = np.repeat(segments[:, np.newaxis], 2, axis=1)
        if self._tendons is None:
            width, name = _THICKER * self._drawing.line_width, f'{self._name}/tendons'
            self._tendons = self._scene.add_line_segments(name, points, colours, thickness=width)
        self._tendons.points, self._tendons.colors = points, colours

    def _show_discs(self, drawn: drawing.ArmGeometry) -> None:
        unit = self._unit
        radius = drawn.disc_radius[:, np.newaxis]
        local = np.stack([radius * unit[0], radius * unit[1], 0.0 * radius + unit[2]])
        rotation = axes_of(drawn.disc_quaternion)
        vertices = drawn.disc_position[:, np.newaxis] + np.einsum('xyd,ydv->dvx', rotation, local)
        first_vertex = unit.shape[1] * np.arange(len(radius))[:, np.newaxis, np.newaxis]
        self._discs = show_mesh(
            self._scene,
            self._discs,
            f'{self._name}/discs',
            vertices.reshape(-1, 3),
            (self._triangles + first_vertex).reshape(-1, 3),
            color=DISC_COLOUR,
            flat_shading=True,
        )


def show_mesh(
    scene: viser.SceneApi,
    mesh: viser.MeshHandle | None,
    name: str,
    vertices: FloatArray,
    triangles: IntArray,
    **options: Any,
) -> viser.MeshHandle:
    """Return ``mesh`` with new ``vertices``, or a new mesh of ``scene`` if it is None."""
    points: NDArray[np.float32] = vertices.astype(np.float32)
    if mesh is None:
        return scene.add_mesh_simple(name, points, triangles.astype(np.uint32), **options)
    mesh.vertices = points
    return mesh


def set_theme(gui: viser.GuiApi, title: str) -> None:
    """Set the colours and the title of the page, and dock the panel at the right edge."""
    gui.configure_theme(show_logo=False, show_share_button=False, brand_color=_BRAND)
    gui.set_panel_label(title)
    gui.main_panel.dock_right()


def set_scene(server: viser.ViserServer, middle: FloatArray, length: float, depth: float) -> None:
    """Set floor and light for arms of a ``length`` [m] around ``middle`` (3,) [m].

    The floor is ``depth`` [m] below ``middle``.
    """
    # Without a graphics card shadows take half of the rendering time.
    server.scene.configure_default_lights(cast_shadow=False)
    cell = 10.0 ** np.floor(np.log10(length)) / 2.0
    server.scene.add_grid(
        '/floor',
        width=60.0 * cell,
        height=60.0 * cell,
        cell_size=cell,
        section_size=5.0 * cell,
        cell_color=(226, 228, 232),
        section_color=(206, 210, 216),
        position=(middle[0], middle[1], middle[2] - depth),
        fade_distance=6.0 * length,
        fade_from='origin',
    )


def set_surroundings(scene: viser.SceneApi, config: Config) -> None:
    """Add the base frame, with t red, n green and b blue, and the obstacles of ``config``."""
    length = config.arm.length
    scene.add_frame(
        '/base',
        wxyz=np.roll(np.array(config.base.quaternion), 1),
        position=np.array(config.base.position),
        axes_length=0.12 * length,
        axes_radius=0.004 * length,
        origin_radius=0.0,
    )
    for number, obstacle in enumerate(config.loads.obstacles):
        shape = drawing.obstacle_mesh(obstacle, middle_of(config), 0.6 * length)
        show_mesh(scene, None, f'/obstacles/{number}', *shape, **OBSTACLES)


def middle_of(config: Config) -> FloatArray:
    """Return the centre of the arm's motion (3,) [m], nearer to the base because the arm curls."""
    return np.array(config.base.position) + 0.38 * config.arm.length * tangent_of(config)


def comparison_offset(config: Config) -> FloatArray:
    """Return the offset (3,) [m] of a second arm from the first, for a comparison."""
    return 0.5 * config.arm.length * horizontal_normal(tangent_of(config))


TUBE: dict[str, Any] = {'color': (90, 140, 215), 'opacity': 0.22}
FORCE: dict[str, Any] = {'color': (25, 110, 50), 'opacity': 0.35}


class UncertaintyScene:
    """The tube and the force arrow of an estimate, redrawn with every estimate."""

    def __init__(self, scene: viser.SceneApi, solver: Solver) -> None:
        """Prepare the meshes for the arm of ``solver``; they are hidden before `show`."""
        self._scene = scene
        self._drawing = drawing.UncertaintyDrawing(solver.arm, solver.grid.s, sides=_SIDES)
        self._stations = solver.grid.s.size
        self._meshes: dict[str, viser.MeshHandle] = {}

    def hide(self) -> None:
        """Hide the tube and the arrow."""
        for mesh in self._meshes.values():
            mesh.visible = False

    def show(
        self,
        position: FloatArray,
        quaternion: FloatArray,
        covariance: BackboneCovariance,
        force: FloatArray | None,
    ) -> None:
        """Draw the ``covariance`` of a shape and of the ``force`` (3,) [N] on it.

        ``position`` (stations, 3) [m] and ``quaternion`` (stations, 4) are those of the shape.
        """
        self.hide()
        if not len(covariance.s) == len(position) == self._stations:
            return  # the estimate of another arm, whose description has not arrived yet
        tube = self._drawing.tube(position, quaternion, covariance.pose[:, :3, :3])
        self._draw('tube', tube, self._drawing.triangles, TUBE)
        if force is None:
            return
        start = self._drawing.place(position, covariance.contact_s)
        arrow = self._drawing.arrow(start, force, covariance.contact[:3, :3])
        if arrow is not None:
            self._draw('force', arrow.shaft, drawing.ARROW_TRIANGLES, FORCE | {'opacity': None})
            self._draw('cone', arrow.cone, drawing.CONE_TRIANGLES, FORCE)

    def _draw(
        self, name: str, vertices: FloatArray, triangles: IntArray, look: dict[str, Any]
    ) -> None:
        previous = self._meshes.get(name)
        path = f'/estimate/{name}'
        mesh = show_mesh(self._scene, previous, path, vertices, triangles, side='double', **look)
        self._meshes[name] = mesh
        mesh.visible = True
