"""First derivatives of an equilibrium, and the covariance of the tip.

At fixed twists a quantity p changes the residual by d res/dp, which a change of the twists
balances, J dz = - d res/dp. With it, at nodes and stations, in base_frame,

    rotation phi = int R d kappa,    displacement d r = int phi x r' + R d v

and the change of what acts beyond a cross section, int (d r' x F + r' x dF) to the tip. Strains at
the stations are those that balance it there, and so as exact as these integrals.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.numerics.batched_ldlt import factorise, invert
from octo_arm_model.core.numerics.quaternion import quaternion_rates, rotation_matrices
from octo_arm_model.rod.equilibrium import State
from octo_arm_model.rod.lengths import rest_stretches
from octo_arm_model.rod.rod import Rod
from octo_arm_model.rod.sensitivity import Change, Sensitivity, Uncertainty
from octo_arm_model.rod.tables import (
    AXIAL,
    SHEAR,
    TORSION,
    Tables,
    Work,
    force_scale,
    tabulate,
    work_arrays,
)
from octo_arm_model.rod.tendons import Moved, Tendons

_ADDED_POINTS = 4  # in each element, for what stations read
_SKEW = np.zeros((3, 9))  # v @ this is the matrix of v x, row by row
_SKEW[[2, 1, 0, 2, 1, 0], [3, 6, 7, 1, 2, 5]] = 1.0, -1.0, 1.0, -1.0, 1.0, -1.0


class _Columns(NamedTuple):
    """Which columns belong to which quantities; none where a slice is empty."""

    tension: slice
    loads: slice
    material: slice
    offset: slice
    sheath_stiffness: slice
    friction: slice

    @classmethod
    def of(cls, *counts: int) -> _Columns:
        """So many of each."""
        ends = np.cumsum((0, *counts)).tolist()
        return cls(*(slice(first, last) for first, last in zip(ends[:-1], ends[1:])))

    @property
    def total(self) -> int:
        """Number of columns."""
        return int(self.friction.stop)


class _Sections:
    """Cross sections at nodes or stations, and what their residual changes by at fixed twists.

    Attributes:
        tendons: there.
        stretch: of these.
    """

    def __init__(
        self, tables: Tables, outwards: FloatArray, z: FloatArray, tensions: FloatArray, work: Work
    ) -> None:
        """Of twists ``z`` (n, m), with gradient and offsets in ``work``.

        ``outwards`` (4, n, J) are the directions of tendons away from the midline along n and b
        [-] and their slopes [1/m].
        """
        self._tables, self._outwards, self._z = tables, outwards, z
        self._gradient = work.gradient.copy()
        self.tendons = Tendons(tables, z, tensions, work.offsets)
        self.stretch = self.tendons.stretch()

    def imbalance(self, columns: _Columns, local: FloatArray) -> FloatArray:
        """Change of the residual but by loads, (n, m, columns).

        ``local`` (n, J, columns) is that of the local tensions.
        """
        found = self.stretch.length_by_z.swapaxes(1, 2) @ local
        if columns.material.stop > columns.material.start:
            found[..., columns.material.start] += self.by_youngs_modulus()
            found[..., columns.material.start + 1] += self.by_poisson_ratio()
        for where, moved in self.moved(columns):
            found[..., where] += moved.gradient.swapaxes(1, 2)
        return found

    def moved(self, columns: _Columns) -> list[tuple[slice, Moved]]:
        """What changes with the paths of tendons, and its columns."""
        found = []
        for where, name in (
            (columns.offset, 'by_offset'), (columns.sheath_stiffness, 'by_sheath_stiffness'),
        ):  # fmt: skip
            if where.stop > where.start:
                found.append((where, getattr(self, name)))
        return found

    @functools.cached_property
    def by_offset(self) -> Moved:
        """Per metre of each tendon's distance from the midline."""
        return self.tendons.by_offset(self._outwards)

    @functools.cached_property
    def by_sheath_stiffness(self) -> Moved:
        """Per pascal of each sheath."""
        return self.tendons.by_sheath_stiffness()

    def by_youngs_modulus(self) -> FloatArray:
        """Per relative change of E, (n, m): the material's part of the gradient."""
        pull = self.tendons.tension[..., np.newaxis] * self.stretch.gradient
        return np.asarray(self._gradient - pull.sum(axis=1))

    def by_poisson_ratio(self) -> FloatArray:
        """Per unit of nu, (n, m), by G alone."""
        body, tendons = self._tables.body, self.tendons
        over = -2.0 * body[:, SHEAR] / body[:, AXIAL]  # -1 / (1 + nu)
        torsion = over * body[:, TORSION] * tendons.scaled[0, :, 0]
        found = np.zeros_like(self._z)
        found[:, 0] = torsion * tendons.width[:, 0]
        found[:, 3] = torsion * tendons.slope[:, 0] * self._z[:, 0]
        found[:, 4:] = (over * body[:, SHEAR])[:, np.newaxis] * self._z[:, 4:]
        return found


class _Finer(NamedTuple):
    """An equilibrium at more points: twists, local tensions, and in base_frame the rest.

    Attributes:
        z: (n, m).
        tensions: (n, J) [N].
        rotation: (n, 3, 3).
        slope: r', (n, 3).
        force: of all that acts beyond, (n, 3) [N].
        moment: likewise, (n, 3) [N m].
    """

    z: FloatArray
    tensions: FloatArray
    rotation: FloatArray
    slope: FloatArray
    force: FloatArray
    moment: FloatArray


class Derivatives:
    """First derivatives of equilibria of a rod on one level of nodes, at given stations."""

    def __init__(self, rod: Rod, level: int, s: FloatArray) -> None:
        """At arc coordinates ``s`` (S,) [m] of ``rod``."""
        self._arm, self._problem = rod.arm, rod.problem(level)
        elements, own = self._problem.elements, self._problem.tables
        self._to_nodes = elements.integration(elements.s)
        self._rest = rest_stretches(own)
        self._rest_lengths = elements.weights @ self._rest
        self._outwards = _outwards(rod.arm, elements.s, own)
        finer = elements.with_more_points(_ADDED_POINTS)
        self._to_finer = elements.integration(finer.s)
        self._between = elements.interpolation(finer.s)
        self._tables = tabulate(rod.arm, finer, own.base, widens=own.widens)
        self._finer_outwards = _outwards(rod.arm, finer.s, self._tables)
        self._work = work_arrays(self._tables, self._problem.strains, has_jacobian=False)
        self._along_finer = finer.integration(finer.s)
        self._to_stations, self._at_stations = finer.integration(s), finer.interpolation(s)
        self._to_stations[s == 0.0] = 0.0  # not by rounding only

    def sensitivity(self, state: State, by_offsets: bool = True) -> Sensitivity:
        """Of the equilibrium ``state`` by all quantities of `Sensitivity`.

        Unless ``by_offsets`` none by the offsets and sheaths of tendons without friction.

        Raises:
            ConvergenceError: if the Jacobian is singular.
        """
        tendons, slides = self._rest_lengths.size, self._problem.tension_changes(state) is not None
        moved = tendons * (by_offsets or slides)
        sheaths = moved * bool(self._problem.tables.compliance.any())
        counts = tendons, 6, 2, moved, sheaths, tendons * slides
        columns = _Columns.of(*counts)
        wrenches = np.zeros((2, self._problem.elements.s.size, 3, 6))
        wrenches[0, ..., :3] = wrenches[1, ..., 3:] = np.eye(3)
        change = self._change(state, columns, wrenches)

        def part(where: slice) -> Change | None:
            return _part(change, where) if where.stop > where.start else None

        young, poisson = (_part(change, slice(at, at + 1)) for at in range(tendons + 6, tendons + 8))
        return Sensitivity(
            _part(change, columns.tension), young, _part(change, columns.loads), poisson,
            part(columns.offset), part(columns.sheath_stiffness), part(columns.friction),
        )  # fmt: skip

    def by_loads(self, state: State, loads: Sequence[Loads]) -> Change:
        """Change of the equilibrium ``state`` per unit of each of dead ``loads``.

        Raises:
            ArmDefinitionError: if gravity acts on an arm of no density.
            ConvergenceError: if the Jacobian is singular.
        """
        problem = self._problem
        wrenches = [problem.loads.tabulate(self._arm, problem.elements, one) for one in loads]
        columns = _Columns.of(0, len(loads), 0, 0, 0, 0)
        return self._change(state, columns, np.stack(wrenches, axis=-1))

    def tip_covariance(self, state: State, uncertainty: Uncertainty) -> FloatArray:
        """Covariance (6, 6) of the tip in the equilibrium ``state``, by the adjoint.

        Raises:
            ConvergenceError: if the Jacobian is singular.
        """
        problem, names = self._problem, uncertainty.quantities
        factors, work = problem.linearise(state), problem.work
        weights, rotation = problem.elements.weights, work.rotation
        # What the twist of each node moves the tip by: rotations by their levers.
        lever = (weights[:, np.newaxis] * self._to_nodes).T @ work.slope
        tip = np.zeros((len(lever), state.z.shape[1], 6))
        tip[:, :3, :3] = rotation.swapaxes(1, 2) @ _skew(lever)
        turn = weights[:, np.newaxis, np.newaxis] * rotation.swapaxes(1, 2)
        tip[:, 3:, :3], tip[:, :3, 3:] = turn[:, : tip.shape[1] - 3], turn
        by_residual = factors.solve_transposed(-tip.reshape(-1, 6)).reshape(tip.shape)
        sections = _Sections(problem.tables, self._outwards, state.z, state.acting.tensions, work)
        found = []
        for name in names:
            if name == 'tension':
                rates = problem.tension_rates(state)
                change = sections.stretch.length_by_z * rates[..., np.newaxis]
            elif name == 'offset':
                change = sections.by_offset.gradient
                slides = problem.tension_changes(state)
                if slides is not None:
                    local = slides.by_offset(self._outwards)[..., np.newaxis]
                    change = change + sections.stretch.length_by_z * local
            else:
                change = getattr(sections, f'by_{name}')()[:, np.newaxis]
            found.append(np.tensordot(by_residual, change, axes=([0, 1], [0, 2])))
        return uncertainty.tip_covariance(found)

    def _change(self, state: State, columns: _Columns, wrenches: FloatArray) -> Change:
        """Of all ``columns``; loads change force and moment (2, N, 3, loads) beyond the nodes."""
        problem, elements = self._problem, self._problem.elements
        factors, work = problem.linearise(state), problem.work
        nodes = _Sections(problem.tables, self._outwards, state.z, state.acting.tensions, work)
        local = self._local_changes(state, columns)
        force, moment = wrenches
        to_tip = elements.weights - self._to_nodes
        moment = moment + _along(to_tip, _skew(work.slope) @ force)
        push = nodes.imbalance(columns, local)
        push[..., columns.loads] -= _turned(work.rotation, moment, force, push.shape[1])
        z = factors.solve(-push.reshape(-1, columns.total)).reshape(push.shape)
        slides = problem.tension_changes(state)
        if slides is not None:
            local = local + slides.by_twists(z)
        pose, strain = self._read(state, columns, z, local, wrenches)
        stretch, own = nodes.stretch, np.arange(self._rest_lengths.size)
        by_z = elements.weights[:, np.newaxis, np.newaxis] * stretch.length_by_z
        length = np.tensordot(by_z, z, axes=([0, 2], [0, 1]))
        if nodes.tendons.has_sheaths:
            length += np.einsum('i,ij,ijc->jc', elements.weights, stretch.by_tension, local)
        for where, moved in nodes.moved(columns):
            length[own, where.start + own] += elements.weights @ moved.stretch
        mean = None
        if slides is not None:
            mean = np.einsum('i,ij,ijc->jc', elements.weights, self._rest, local)
            mean /= self._rest_lengths[:, np.newaxis]
        return Change(pose, strain, length, mean)

    def _local_changes(self, state: State, columns: _Columns) -> FloatArray:
        """Changes of the local tensions at fixed twists, (N, J, columns)."""
        problem = self._problem
        slides = problem.tension_changes(state)
        found = np.zeros((*problem.tables.reach.shape, columns.total))
        own = np.arange(found.shape[1])
        if columns.tension.stop > columns.tension.start:
            found[:, own, columns.tension.start + own] = problem.tension_rates(state)
        if slides is not None and columns.friction.stop > columns.friction.start:
            found[:, own, columns.offset.start + own] = slides.by_offset(self._outwards)
            found[:, own, columns.friction.start + own] = slides.by_friction
            if columns.sheath_stiffness.stop > columns.sheath_stiffness.start:
                found[:, own, columns.sheath_stiffness.start + own] = slides.by_sheath_stiffness
        return found

    def _read(
        self, state: State, columns: _Columns, z: FloatArray, local: FloatArray,
        wrenches: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """Changes of poses (S, 6, columns) and strains (S, 4, columns) at the stations.

        Of the twists ``z`` (N, m, columns), the local tensions (N, J, columns) and the
        ``wrenches`` (2, N, 3, loads) beyond, at the nodes. As in `read_out`, what integrals of
        these say is balanced at more points of each element, from which stations are reached.
        """
        problem, work, acting = self._problem, self._problem.work, state.acting
        finer = self._finer_state(state)
        # Wrenches at the finer points.
        spin = work.rotation @ z[:, :3]
        moved = _moved(work.rotation, work.slope, _along(self._to_nodes, spin), z)
        carried = -_skew(acting.force) @ moved
        carried[..., columns.loads] += _skew(work.slope) @ wrenches[0]
        turn = _along(self._to_finer, spin)
        moment = _along(problem.elements.weights - self._to_finer, carried)
        moment += _skew(finer.moment) @ turn
        force = _skew(finer.force) @ turn
        force[..., columns.loads] += _along(self._between, wrenches[0])
        moment[..., columns.loads] += _along(self._between, wrenches[1])
        # And the twists that balance them.
        sections = _Sections(
            self._tables, self._finer_outwards, finer.z, finer.tensions, self._work
        )
        push = _turned(finer.rotation, moment, force, z.shape[1])
        push -= sections.imbalance(columns, _along(self._between, local))
        z = _inverses(self._work.hessian) @ push
        rates = np.empty((len(z), 6, columns.total))
        rates[:, 3:] = finer.rotation @ z[:, :3]
        turn = _along(self._along_finer, rates[:, 3:])
        rates[:, :3] = _moved(finer.rotation, finer.slope, turn, z)
        # tau, xi, k are curvatures over the stretch.
        strain = z[:, :4].copy()
        strain[:, :3] -= (finer.z[:, :3] / finer.z[:, 3:4])[..., np.newaxis] * z[:, 3:4]
        strain[:, :3] /= finer.z[:, 3, np.newaxis, np.newaxis]
        return _along(self._to_stations, rates), _along(self._at_stations, strain)

    def _finer_state(self, state: State) -> _Finer:
        """The equilibrium ``state`` at more points, with their sections in `_work`."""
        problem, acting = self._problem, state.acting
        work, own, strains = self._work, problem.work, state.z.shape[1]
        rates = np.empty((len(state.z), 7))
        quaternion_rates(own.quaternion, state.z[:, :3], rates[:, :4])
        rates[:, 4:] = (_skew(own.slope) @ acting.force[..., np.newaxis])[..., 0]
        found = self._to_finer @ rates
        turn = found[:, :4] + problem.tables.base
        turn /= np.sqrt((turn * turn).sum(axis=1, keepdims=True))
        rotation = rotation_matrices(np.ascontiguousarray(turn.T)).transpose(2, 0, 1)
        given = [state.z, acting.force, acting.couple, acting.tensions]
        between = self._between @ np.concatenate(given, axis=1)
        z = np.ascontiguousarray(between[:, :strains])
        tensions = np.ascontiguousarray(between[:, strains + 6 :])
        force, moment = between[:, strains : strains + 3], between[:, strains + 3 : strains + 6]
        moment = moment + (problem.elements.weights @ rates[:, 4:] - found[:, 4:])
        work.scale[:] = force_scale(self._tables, tensions)
        columns = moment[..., np.newaxis], force[..., np.newaxis]
        wrench = _turned(rotation, *columns, strains)[..., 0]
        problem.form.section_steps(self._tables, z, tensions, wrench, work)
        # The Hessian of twists so near is exact enough.
        z, work.gradient[:] = z + work.step, wrench
        slope = rotation[:, :, 0] * z[:, 3:4]
        slope += (rotation[..., 1 : strains - 3] @ z[:, 4:, np.newaxis])[..., 0]
        return _Finer(z, tensions, rotation, slope, force, moment)


def _part(change: Change, where: slice) -> Change:
    mean = change.tendon_tension
    return Change(
        change.pose[..., where], change.strain[..., where], change.tendon_length[..., where],
        None if mean is None else mean[..., where],
    )  # fmt: skip


def _outwards(arm: Arm, s: FloatArray, tables: Tables) -> FloatArray:
    """Directions of tendons away from the midline at ``s``, and their slopes, (4, n, J)."""
    found = np.stack([*arm.tendon_outwards(s), *arm.tendon_outward_slopes(s)])
    return np.ascontiguousarray(found.swapaxes(1, 2) * tables.reach)


def _along(matrix: FloatArray, values: FloatArray) -> FloatArray:
    """``matrix`` (n, N) times ``values`` (N, k, columns)."""
    product = matrix @ values.reshape(len(values), -1)
    return product.reshape(-1, *values.shape[1:])


def _moved(
    rotation: FloatArray, slope: FloatArray, turn: FloatArray, z: FloatArray
) -> FloatArray:
    """Rates of displacement (n, 3, columns) by a ``turn`` (n, 3, columns) and by twists ``z``."""
    found = rotation[..., : z.shape[1] - 3] @ z[:, 3:]
    found -= _skew(slope) @ turn
    return np.asarray(found)


def _turned(
    rotation: FloatArray, moment: FloatArray, force: FloatArray, strains: int
) -> FloatArray:
    """Wrenches in the axes of the sections, (n, strains, columns)."""
    inverse = rotation.swapaxes(1, 2)
    return np.concatenate([inverse @ moment, inverse[:, : strains - 3] @ force], axis=1)


def _inverses(matrices: FloatArray) -> FloatArray:
    """Of symmetric ``matrices`` (n, m, m), that of stable cross sections."""
    return invert(factorise(matrices.transpose(1, 2, 0))).transpose(2, 0, 1)


def _skew(vectors: FloatArray) -> FloatArray:
    """Matrices (n, 3, 3) of the cross product of ``vectors`` (n, 3) with another."""
    return (vectors @ _SKEW).reshape(-1, 3, 3)

