"""Tensions in, backbone out: the one way to solve an arm."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm import Arm
from octo_arm_model.closed_form import ClosedForm
from octo_arm_model.cross_section import Stiffness
from octo_arm_model.errors import ConfigError, SolveError
from octo_arm_model.grid import DEFAULT_STATIONS, StationGrid
from octo_arm_model.hints import FloatArray, IntArray
from octo_arm_model.kinematics import Frame, Pose, backbone_frames
from octo_arm_model.parameters import DEFAULT_MODEL
from octo_arm_model.renda2012 import Renda2012
from octo_arm_model.rotation import Quaternions
from octo_arm_model.strains import Strains
from octo_arm_model.tendons import check_tensions

# Arms are solved side by side: enough to hide the cost of a NumPy call, few enough to stay in
# cache and for BLAS not to share a product among threads, which on a busy machine wait for each
# other far longer than they work.
_LARGEST_BATCH = 128
_LARGEST_PRODUCT = 250_000  # multiplications


class Statics(Protocol):
    """A model of the arm's statics: tensions to strains at given nodes."""

    def __init__(self, arm: Arm, nodes: FloatArray, section: IntArray) -> None:
        """Tabulate the arm at ``nodes`` (n,), each in its ``section`` (n,)."""

    def strains(self, tensions: FloatArray) -> Strains:
        """Strains (batch, nodes) under ``tensions`` (batch, tendons) [N]."""


MODELS: dict[str, type[Statics]] = {'renda2012': Renda2012, 'closed_form': ClosedForm}


@dataclass(frozen=True)
class Backbone:
    """Shape of the arm at every station, from base to tip. Its arrays are read-only.

    For a batch of tensions of shape (..., sections, tendons) the results keep the leading axes;
    ``s`` and ``section`` are common to all.

    Attributes:
        model: name of the model that made it.
        s: arc coordinate along the reference configuration [m], (stations,).
        section: section a station belongs to, numbered from the tip; 0 beyond the last
            anchorage, (stations,). At an anchorage everything holds on the side of the base.
        position: position of the cross section [m], (..., stations, 3).
        quaternion: its orientation x, y, z, w, (..., stations, 4); the local x axis is the
            tangent t, y is n and z is b.
        tau: torsion about t [1/m], (..., stations).
        xi: curvature about n [1/m], (..., stations).
        k: curvature about b [1/m], (..., stations).
        q: longitudinal strain [-], (..., stations).
    """

    model: str
    s: FloatArray
    section: IntArray
    position: FloatArray
    quaternion: FloatArray
    tau: FloatArray
    xi: FloatArray
    k: FloatArray
    q: FloatArray

    @property
    def tip(self) -> FloatArray:
        """Position of the tip [m], (..., 3)."""
        return self.position[..., -1, :]


class Solver:
    """Solves one arm with one model, many times.

    Everything that does not depend on the tensions is tabulated once.

    Attributes:
        arm: the arm.
        model: name of the model.
        base: pose of the base.
        grid: stations and quadrature nodes.
    """

    def __init__(
        self,
        arm: Arm,
        model: str = DEFAULT_MODEL,
        stations: int = DEFAULT_STATIONS,
        base: Pose = Pose(),
    ) -> None:
        """Prepare ``arm`` for ``stations`` stations, starting from the pose ``base``.

        Raises:
            ConfigError: if there is no such model or the stations are too few.
        """
        if model not in MODELS:
            raise ConfigError(f'model is {model!r}, expected one of {", ".join(MODELS)}')
        self.arm = arm
        self.model = model
        self.base = base
        self._base = Frame(np.array(base.position), Quaternions.from_xyzw(base.quaternion))
        self.grid = StationGrid.build(arm, stations)
        product = self.grid.nodes.size * len(arm.tendon_names)
        self._batch = max(1, min(_LARGEST_BATCH, _LARGEST_PRODUCT // product))
        # The axial force is a difference of terms of this size; further up it is all rounding.
        self._largest_tension = 1e6 * float(Stiffness.at(arm, self.grid.nodes).axial.min())
        self._statics = MODELS[model](arm, self.grid.nodes, self.grid.node_section)

    def solve(self, tensions: ArrayLike) -> Backbone:
        """Shape under ``tensions`` (..., sections from the tip, tendons of a section) [N].

        Raises:
            TensionError: if the tensions do not fit the arm, or are negative or not finite.
            SolveError: if the model has no trustworthy answer; never a guess in its place.
        """
        checked = check_tensions(self.arm, tensions)
        if checked.max(initial=0.0) > self._largest_tension:
            raise SolveError(
                f'tension of {checked.max():.4g} N is beyond {self._largest_tension:.4g} N, a '
                'million times what would compress the thinnest cross section to nothing'
            )
        lead = checked.shape[:-2]
        flat = checked.reshape(-1, len(self.arm.tendon_names))
        batch, count = len(flat), self.grid.s.size
        position = np.empty((batch, count, 3))
        quaternion = np.empty((batch, count, 4))
        strains = np.empty((4, batch, count))
        for start in range(0, batch, self._batch):
            part = slice(start, start + self._batch)
            at_nodes = self._solve_statics(flat[part], start)
            backbone_frames(at_nodes, self.grid, self._base, position[part], quaternion[part])
            strains[:, part] = at_nodes.values[..., self.grid.station_node]
        for array in (position, quaternion, strains):
            array.setflags(write=False)
        return Backbone(
            self.model,
            self.grid.s,
            self.grid.section,
            position.reshape(*lead, count, 3),
            quaternion.reshape(*lead, count, 4),
            *(values.reshape(*lead, count) for values in strains),
        )

    def _solve_statics(self, tensions: FloatArray, number: int) -> Strains:
        """Strains of one part of the batch, whose first set is ``number``."""
        with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
            strains = self._statics.strains(tensions)
        # The weakest section decides; NaN fails too.
        if not strains.q.min(initial=0.0) > -1.0:
            arm_in_batch, node = np.unravel_index(np.argmin(strains.q), strains.q.shape)
            raise SolveError(
                f'tensions compress the arm to nothing at s = {self.grid.nodes[node]:.4g} m '
                f'(q = {strains.q[arm_in_batch, node]:.4g}, must be > -1)'
                + (f' in set {number + arm_in_batch}' if number or len(tensions) > 1 else '')
            )
        return strains


@functools.lru_cache(maxsize=16)
def _cached_solver(arm: Arm, model: str, stations: int, base: Pose) -> Solver:
    return Solver(arm, model, stations, base)


def solve(
    arm: Arm,
    tensions: ArrayLike,
    model: str = DEFAULT_MODEL,
    stations: int = DEFAULT_STATIONS,
    base: Pose = Pose(),
) -> Backbone:
    """Shape of ``arm`` under ``tensions``; see `Solver`, which this keeps between calls."""
    return _cached_solver(arm, model, stations, base).solve(tensions)
