"""From strains at the nodes of a grid to a `Backbone`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from octo_arm_model.core.errors import SolveError
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.numerics.memory import keep_freed_memory
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.kinematics import Frame, backbone_frames
from octo_arm_model.core.rod.solution import Shape, Solution, TendonTensions

# From the twist (4, nodes) of one arm, fills in strains (4, stations), position (stations, 3)
# and quaternion (stations, 4).
ReadOut: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], None]


class Results:
    """Arrays of the shapes of a batch of arms, allocated once and filled part by part.

    Attributes:
        position: position of the stations [m], (..., stations, 3).
        quaternion: orientation of the stations x, y, z, w, (..., stations, 4).
        strains: torsion and curvatures [1/m] and longitudinal strain [-], (4, ..., stations).
        residual: relative residual of the model's equations, (...).
        iterations: number of iterations, (...).
        twist: twist at the nodes of the arms added last, or solved last by the kernels,
            (4 or 6, ..., nodes).
    """

    def __init__(
        self,
        lead: tuple[int, ...],
        grid: StationGrid,
        base: Frame,
        read_out: ReadOut | None = None,
    ) -> None:
        """Prepare for arms at the stations of ``grid``, with the base in the pose ``base``.

        ``lead`` is (batch,), or () for one arm, for which NumPy takes less time than for (1,).
        ``read_out``, if given, integrates the twists in machine code.
        """
        self._read_out, self._lead = read_out, lead
        self._grid, self._base = grid, base
        self._is_allocated = False
        self._shape: Shape | None = None
        self._point_tensions: FloatArray | None = None
        self._station_tensions: FloatArray | None = None

    def make_room(self) -> None:
        """Allocate the arrays, which `add` does where it needs them."""
        lead, grid, self._is_allocated = self._lead, self._grid, True
        if lead and lead[0] > 1:
            keep_freed_memory()
        count = grid.s.size
        self.position = np.empty((*lead, count, 3))
        self.quaternion = np.empty((*lead, count, 4))
        self.strains = np.empty((4, *lead, count))
        self.residual, self.iterations = np.empty(lead), np.empty(lead, np.int64)
        self.twist = np.empty((4, grid.nodes.size))

    @property
    def arrays(self) -> tuple[FloatArray | IntArray, ...]:
        """Position, quaternion, residual and iterations."""
        return self.position, self.quaternion, self.residual, self.iterations

    @property
    def batch(self) -> tuple[FloatArray, tuple[Any, ...]]:
        """Strains and `arrays`, with an axis of the batch also where there is one arm."""
        if not self.is_one:
            return self.strains, self.arrays
        return self.strains[:, None], tuple(array[None] for array in self.arrays)

    @property
    def is_one(self) -> bool:
        """Whether there is one arm, without the axis of a batch."""
        return not self._lead

    def add(self, part: slice | tuple[()], solution: Solution) -> None:
        """Store the ``solution`` of the arms ``part`` of the batch, or of the only arm, ().

        Raises:
            SolveError: if a cross section is compressed to nothing (1 + q <= 0).
        """
        twist = solution.twist
        if solution.tendons is not None:
            self._add_tendons(part, solution.tendons)
        if self.is_one and solution.frames is not None:
            # Arrays of one arm are used without a copy.
            self.position, self.quaternion = solution.frames
            self.twist, self._shape = twist, solution.shape
            self.residual, self.iterations = (
                np.array(solution.residual), np.array(solution.iterations)
            )  # fmt: skip
            if solution.strains is not None:
                self.strains = solution.strains
            else:
                self._check(twist[3])
                self.strains = np.empty((4, self._grid.s.size))
                self._write_strains(part, twist)
            return
        if not self._is_allocated:
            self.make_room()
        self.residual[part], self.iterations[part] = solution.residual, solution.iterations
        self.twist, self._shape = twist, solution.shape
        self._check(twist[3])
        if solution.frames is not None:
            self.position[part], self.quaternion[part] = solution.frames
        elif self._read_out is not None:
            self._read_all(self._read_out, part, twist)
            return
        else:
            position, quaternion = self.position[part], self.quaternion[part]
            backbone_frames(twist, self._grid, self._base, position, quaternion)
        self._write_strains(part, twist)

    def _write_strains(self, part: slice | tuple[()], twist: FloatArray) -> None:
        """Store the strains of the arms ``part`` at the stations."""
        at_stations = twist[:4].take(self._grid.station_node, axis=-1)
        stretch, strains = at_stations[3], self.strains if part == () else self.strains[:, part]
        np.divide(at_stations[:3], stretch, out=strains[:3])
        np.subtract(stretch, 1.0, out=strains[3])

    def put(self, arms: list[int], part: Results) -> None:
        """Store ``part``, which has the arms of these numbers; there is room for them."""
        for mine, theirs in zip(self.arrays, part.arrays, strict=True):
            mine[arms] = theirs
        self.strains[:, arms] = part.strains
        if part._station_tensions is not None:
            self._add_stations(arms, part._station_tensions)

    def set_tendons(self, points: FloatArray, stations: FloatArray) -> None:
        """Store the tensions along tendons with friction [N].

        ``points`` (tendons, points) are those of the last arm at the points of its rod,
        ``stations`` (arms, stations, tendons) those of all arms at the stations.
        """
        self._point_tensions = points
        self._station_tensions = stations[0] if self.is_one else stations

    def _add_tendons(self, part: slice | tuple[()], tendons: TendonTensions) -> None:
        """Store the tensions along the tendons of the arms ``part``."""
        self._point_tensions = tendons.points
        if self.is_one:
            self._station_tensions = tendons.stations.T
            return
        at_stations = np.moveaxis(tendons.stations, 0, -1)
        self._add_stations(part, at_stations)

    def _add_stations(self, part: slice | tuple[()] | list[int], tensions: FloatArray) -> None:
        """Store the ``tensions`` (arms, stations, tendons) of the arms ``part`` of a batch."""
        if self._station_tensions is None:
            self._station_tensions = np.empty((*self._lead, *tensions.shape[-2:]))
        self._station_tensions[part] = tensions

    def _read_all(self, read_out: ReadOut, part: slice | tuple[()], twist: FloatArray) -> None:
        """Store the arms ``part`` by one call of ``read_out`` each."""
        strains = np.empty((4, self._grid.s.size))
        if isinstance(part, tuple):
            read_out(twist, self.strains, self.position, self.quaternion)
            return
        for number, arm in enumerate(range(*part.indices(len(self.position)))):
            read_out(twist[:, number], strains, self.position[arm], self.quaternion[arm])
            self.strains[:, arm] = strains

    def _check(self, stretch: FloatArray) -> None:
        """Raise a SolveError unless all of ``stretch`` (..., nodes) are > 0, which NaN is not."""
        if not stretch.min(initial=1.0) > 0.0:
            lowest = np.atleast_2d(stretch).min(axis=-1)
            arm = int(np.argmin(lowest > 0.0))
            node = int(np.argmin(np.atleast_2d(stretch)[arm]))
            raise SolveError(
                f'tensions compress the arm to nothing at s = {self._grid.nodes[node]:.4g} m '
                f'(q = {lowest[arm] - 1.0:.4g}, must be > -1)',
                arm,
            )

    def backbone(
        self,
        model: str,
        tensions: FloatArray,
        tip_wrench: FloatArray,
        lead: tuple[int, ...],
        reach: FloatArray,
    ) -> Backbone:
        """The `Backbone` of these read-only arrays, with the leading axes ``lead``."""
        along_tendons = self._station_tensions
        position, quaternion, strains = self.position, self.quaternion, self.strains
        residual, iterations = self.residual, self.iterations
        # None for a batch, where it would take most of the memory.
        twist = self.twist if lead == () else None
        if residual.shape != lead:
            count = self._grid.s.size
            position = position.reshape(*lead, count, 3)
            quaternion = quaternion.reshape(*lead, count, 4)
            strains = strains.reshape(4, *lead, count)
            residual, iterations = residual.reshape(lead), iterations.reshape(lead)
            if along_tendons is not None:
                along_tendons = along_tendons.reshape(*lead, *along_tendons.shape[-2:])
        if along_tendons is not None:
            # At the base they are given, not interpolated from points beyond.
            at_base = along_tendons[..., 0, :] if lead else along_tendons[0]
            np.multiply(tensions.reshape(at_base.shape), reach[0], out=at_base)
        for array in (
            position, quaternion, strains, residual, iterations, tensions, tip_wrench, twist,
            along_tendons, self._point_tensions,
        ):  # fmt: skip
            if array is not None:
                array.setflags(write=False)
        if self._shape is not None:
            orientation = self._shape.orientation
            for part in (self._shape.twist, orientation.a, orientation.b):
                part.setflags(write=False)
        return Backbone(
            model=model,
            s=self._grid.s,
            section=self._grid.section,
            position=position,
            quaternion=quaternion,
            tau=strains[0],
            xi=strains[1],
            k=strains[2],
            q=strains[3],
            tensions=tensions,
            tip_wrench=tip_wrench,
            residual=residual,
            iterations=iterations,
            twist=twist,
            shape=self._shape if lead == () else None,
            reach=reach,
            slid_tensions=along_tendons,
            point_tensions=self._point_tensions if lead == () else None,
        )
