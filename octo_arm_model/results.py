"""From strains at the nodes of a grid to the `Backbone` that users see."""

from __future__ import annotations

import numpy as np

from octo_arm_model.backbone import Backbone
from octo_arm_model.errors import SolveError
from octo_arm_model.grid import StationGrid
from octo_arm_model.hints import FloatArray
from octo_arm_model.kinematics import Frame, backbone_frames
from octo_arm_model.statics import Solution


class Results:
    """Room for the shapes of a batch, filled part by part."""

    def __init__(self, lead: tuple[int, ...], grid: StationGrid, base: Frame) -> None:
        """Make room for arms at the stations of ``grid``, standing on ``base``.

        ``lead`` is (batch,), or () for one arm, which NumPy is quicker with than with (1,).
        """
        self._grid, self._base = grid, base
        count = grid.s.size
        self._position = np.empty((*lead, count, 3))
        self._quaternion = np.empty((*lead, count, 4))
        self._strains = np.empty((4, *lead, count))
        self._residual, self._iterations = np.empty(lead), np.empty(lead, np.int64)
        self._twist = np.empty((4, 0, grid.nodes.size))

    def add(self, part: slice | tuple[()], solution: Solution) -> None:
        """Take the arms ``part`` of the batch, or the one arm, ().

        Raises:
            SolveError: if a cross section is turned inside out.
        """
        twist = solution.twist
        self._check(twist[3])
        position, quaternion = self._position[part], self._quaternion[part]
        backbone_frames(twist, self._grid, self._base, position, quaternion)
        at_stations = self._grid.station_node
        stretch = twist[3][..., at_stations]
        tau, xi, k, q = self._strains
        for angular, strain in zip(twist, (tau, xi, k)):
            np.divide(angular[..., at_stations], stretch, out=strain[part])
        np.subtract(stretch, 1.0, out=q[part])
        self._residual[part], self._iterations[part] = solution.residual, solution.iterations
        self._twist = twist

    def _check(self, stretch: FloatArray) -> None:
        # NaN fails too.
        if not stretch.min(initial=1.0) > 0.0:
            arm, node = divmod(int(np.argmin(stretch)), stretch.shape[-1])
            raise SolveError(
                f'tensions compress the arm to nothing at s = {self._grid.nodes[node]:.4g} m '
                f'(q = {stretch.flat[np.argmin(stretch)] - 1.0:.4g}, must be > -1)',
                arm,
            )

    def backbone(
        self, model: str, tensions: FloatArray, tip_wrench: FloatArray, lead: tuple[int, ...]
    ) -> Backbone:
        """All of it, read-only, in the shape of the leading axes ``lead``."""
        count = self._grid.s.size
        # Of a large batch the nodes would be most of the memory.
        twist = self._twist if lead == () else None
        for array in (
            self._position, self._quaternion, self._strains, self._residual, self._iterations,
            tensions, tip_wrench, twist,
        ):  # fmt: skip
            if array is not None:
                array.setflags(write=False)
        tau, xi, k, q = self._strains.reshape(4, *lead, count)
        return Backbone(
            model=model,
            s=self._grid.s,
            section=self._grid.section,
            position=self._position.reshape(*lead, count, 3),
            quaternion=self._quaternion.reshape(*lead, count, 4),
            tau=tau,
            xi=xi,
            k=k,
            q=q,
            tensions=tensions,
            tip_wrench=tip_wrench,
            residual=self._residual.reshape(lead),
            iterations=self._iterations.reshape(lead),
            twist=twist,
        )
