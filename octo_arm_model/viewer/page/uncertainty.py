"""How well an estimated arm is known: a tube about it, the force on it as an arrow in a cone."""

from __future__ import annotations

import viser

from octo_arm_model.analysis.geometry.uncertainty_mesh import (
    ARROW_TRIANGLES,
    CONE_TRIANGLES,
    UncertaintyDrawing,
)
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.rod.solver import Solver
from octo_arm_model.viewer.page.scene import Colour, show_mesh
from octo_arm_model.wire.cdr.covariance import BackboneCovariance

TUBE_COLOUR: Colour = (90, 140, 215)
FORCE_COLOUR: Colour = (25, 110, 50)
TUBE_OPACITY, CONE_OPACITY = 0.22, 0.35
_SIDES = 24


class UncertaintyScene:
    """The tube and the arrow in the scene, redrawn with every estimate."""

    def __init__(self, scene: viser.SceneApi, solver: Solver) -> None:
        """Prepare for the arm of ``solver``; nothing is seen before `show`."""
        self._scene = scene
        self._drawing = UncertaintyDrawing(solver.arm, solver.grid.s, sides=_SIDES)
        self._stations = solver.grid.s.size
        self._meshes: dict[str, viser.MeshHandle] = {}

    def hide(self) -> None:
        """Show nothing."""
        for mesh in self._meshes.values():
            mesh.visible = False

    def show(
        self,
        position: FloatArray,
        quaternion: FloatArray,
        known: BackboneCovariance,
        force: FloatArray | None,
    ) -> None:
        """Draw how well a shape and the ``force`` (3,) [N] on it are ``known``.

        ``position`` (stations, 3) [m] and ``quaternion`` (stations, 4) are those of the shape.
        """
        self.hide()
        if not len(known.s) == len(position) == self._stations:
            return  # of another arm, whose description has not arrived yet
        tube = self._drawing.tube(position, quaternion, known.pose[:, :3, :3])
        self._draw('tube', tube, self._drawing.triangles, TUBE_COLOUR, TUBE_OPACITY)
        if force is None:
            return
        start = self._drawing.place(position, known.contact_s)
        arrow = self._drawing.arrow(start, force, known.contact[:3, :3])
        if arrow is not None:
            self._draw('force', arrow.shaft, ARROW_TRIANGLES, FORCE_COLOUR, None)
            self._draw('cone', arrow.cone, CONE_TRIANGLES, FORCE_COLOUR, CONE_OPACITY)

    def _draw(
        self,
        name: str,
        vertices: FloatArray,
        triangles: IntArray,
        colour: Colour,
        opacity: float | None,
    ) -> None:
        mesh = self._meshes[name] = show_mesh(
            self._scene, self._meshes.get(name), f'/estimate/{name}', vertices, triangles,
            color=colour, opacity=opacity, side='double',
        )  # fmt: skip
        mesh.visible = True
