"""First derivatives of an equilibrium, and the covariance of the tip.

At fixed twists a quantity p changes the residual by d res/dp, which a change of the twists
balances, J dz = - d res/dp. With it, at nodes and stations, in base_frame,

    rotation phi = int R d kappa,    displacement d r = int phi x r' + R d v

where int is the integral from the base. Stations are reached from the nodes by integrals and
interpolation.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import Loads
from octo_arm_model.rod.equilibrium import State
from octo_arm_model.rod.factors import Deferred, Factors
from octo_arm_model.rod.friction import TensionDerivatives
from octo_arm_model.rod.local_loads import along, in_sections
from octo_arm_model.rod.rod import Equilibrium, Rod
from octo_arm_model.rod.rotations import skew
from octo_arm_model.rod.sensitivity import Change, Sensitivity, Uncertainty
from octo_arm_model.rod.tables import REST_T, SHEAR, TORSION, Tables
from octo_arm_model.rod.tendons import PathChange, Tendons, outward_paths

_MATERIAL, _PATHS = ('youngs_modulus', 'poisson_ratio'), ('offset', 'sheath_stiffness')
_Columns: TypeAlias = Mapping[str, slice]  # of quantities, by their names in `Sensitivity`


def _columns(**counts: int) -> _Columns:
    """So many columns of each quantity, one after the other; those of none are left out."""
    ends = itertools.pairwise(np.cumsum((0, *counts.values())).tolist())
    return {name: slice(*at) for (name, count), at in zip(counts.items(), ends) if count}


class _Sections:
    """Cross sections at several places, and what their residual changes by at fixed twists.

    Attributes:
        tendons: there.
    """

    def __init__(
        self,
        tables: Tables,
        outwards: FloatArray,
        z: FloatArray,
        gradient: FloatArray,
        tendons: Tendons,
        by_ratio: FloatArray,
    ) -> None:
        """Of ``tendons`` at twists ``z`` (n, m), with a ``gradient`` (n, m) of the energy.

        ``outwards`` (4, n, J) are `outward_paths`; G I and G A change by ``by_ratio`` (2, n) of
        them per unit of nu.
        """
        self._tables, self._outwards, self._z, self._gradient = tables, outwards, z, gradient
        self.tendons, self._by_ratio = tendons, by_ratio

    def imbalance(self, columns: _Columns, total: int) -> FloatArray:
        """Change of the residual at fixed local tensions and loads, (n, m, total)."""
        found = np.zeros((*self._z.shape, total))
        for name, where in columns.items():
            if name in _MATERIAL:
                found[..., where] = getattr(self, f'by_{name}')[..., np.newaxis]
            elif name in _PATHS:
                found[..., where] = getattr(self, f'by_{name}').gradient.swapaxes(1, 2)
        return found

    @functools.cached_property
    def by_offset(self) -> PathChange:
        """Per metre of each tendon's distance from the midline."""
        return self.tendons.by_path(self._outwards)

    @property
    def by_sheath_stiffness(self) -> PathChange:
        """Per pascal of each sheath."""
        return self.tendons.by_sheath_stiffness

    @property
    def by_youngs_modulus(self) -> FloatArray:
        """Per relative change of E, (n, m): the material's part of the gradient."""
        pull = self.tendons.tension[..., np.newaxis] * self.tendons.gradient
        return np.asarray(self._gradient - pull.sum(axis=1))

    @property
    def by_poisson_ratio(self) -> FloatArray:
        """Per unit of nu, (n, m), by G alone."""
        body, tendons, width = self._tables.body, self.tendons, self.tendons.width[:, 0]
        # Torsion of rubber is w (kappa_t - that at rest), as of all where w is 1.
        twist = self._z[:, 0] - body[:, REST_T]
        torque = self._by_ratio[0] * body[:, TORSION] * width * twist
        found = np.zeros_like(self._z)
        found[:, 0] = torque * width
        found[:, 3] = torque * tendons.widening[:, 0] * twist
        found[:, 4:] = (self._by_ratio[1] * body[:, SHEAR])[:, np.newaxis] * self._z[:, 4:]
        return found


class _Linear(NamedTuple):
    """An equilibrium and the system about it.

    Attributes:
        state: the equilibrium.
        factors: of the Jacobian.
        tension: derivatives of tensions with friction; None where none change.
        rates: derivatives of local tensions by those at the base at fixed twists, (N, J).
        sections: the cross sections.
        rotation: as in `Work`.
        slope: likewise.
    """

    state: State
    factors: Factors
    tension: TensionDerivatives | None
    rates: FloatArray
    sections: _Sections
    rotation: FloatArray
    slope: FloatArray


class Derivatives:
    """First derivatives of equilibria of a rod on one level of nodes, at given stations."""

    def __init__(self, rod: Rod, level: int, s: FloatArray) -> None:
        """At arc coordinates ``s`` (S,) [m] of ``rod``."""
        self._arm, self._problem = rod.arm, rod.problem(level)
        elements, own = self._problem.elements, self._problem.tables
        self._to_stations, self._at_stations = elements.integration(s), elements.interpolation(s)
        self._rest = self._problem.unloaded_tendons.stretch
        self._rest_lengths = elements.weights @ self._rest
        self._outwards = outward_paths(rod.arm, own, elements.s)
        ratio = rod.arm.material.poisson_ratio_at(elements.s)
        self._by_ratio = np.outer([1.0, 1.0], -1.0 / (1.0 + ratio))
        self._by_ratio[0] *= 'torsion' not in rod.arm.stiffness.profiles
        self._kept: _Linear | None = None

    def sensitivity(self, found: Equilibrium) -> Sensitivity:
        """Of an equilibrium that was ``found``, by all quantities of `Sensitivity`.

        Raises:
            LoadError: if a load states no tangent stiffness.
            ConvergenceError: if the Jacobian is singular.
        """
        tendons, slides = self._rest_lengths.size, self._problem.friction is not None
        columns = _columns(
            tension=tendons, youngs_modulus=1, tip_wrench=6, poisson_ratio=1,
            friction=tendons * slides,
        )  # fmt: skip
        wrenches = np.tile(np.eye(6), (self._problem.elements.s.size, 1, 1))
        change = self._change(found, columns, wrenches)
        parts: dict[str, Any] = {
            f'by_{name}': part_of(change, own) for name, own in columns.items()
        }
        return Sensitivity(**parts, find_path=functools.partial(self._by_path, found))

    def _by_path(self, found: Equilibrium, name: str) -> Change | None:
        """By one of `_PATHS`; None where it is of sheaths and all are rigid."""
        if name == 'offset' or self._problem.tables.compliance.any():
            return self._change(found, _columns(**{name: self._rest_lengths.size}))
        return None

    def by_loads(self, found: Equilibrium, loads: Sequence[Loads]) -> Change:
        """Change of an equilibrium that was ``found`` per unit of each of dead ``loads``.

        Raises:
            ArmDefinitionError: if gravity acts on an arm of no density.
            LoadError: if a load states no tangent stiffness.
            ConvergenceError: if the Jacobian is singular.
        """
        problem = self._problem
        wrenches = np.empty((problem.elements.s.size, 6, len(loads)))
        for number, one in enumerate(loads):
            dead = problem.loads.tabulate(self._arm, problem.elements, one)
            wrenches[..., number] = np.concatenate(dead, axis=1) + one.tip_wrench
        return self._change(found, _columns(tip_wrench=len(loads)), wrenches)

    def tip_covariance(self, found: Equilibrium, uncertainty: Uncertainty) -> FloatArray:
        """Covariance (6, 6) of the tip in an equilibrium that was ``found``, by the adjoint.

        Raises:
            LoadError: if a load states no tangent stiffness.
            ConvergenceError: if the Jacobian is singular.
        """
        problem, linear = self._problem, self._linearised(found)
        weights, inverse = problem.elements.weights, linear.rotation.swapaxes(1, 2)
        # What the twist of each node moves the tip by: rotations by their levers.
        lever = (weights[:, np.newaxis] * problem.elements.from_base).T @ linear.slope
        tip = np.zeros((len(lever), linear.state.z.shape[1], 6))
        tip[:, :3, :3] = inverse @ skew(lever)
        turn = weights[:, np.newaxis, np.newaxis] * inverse
        tip[:, 3:, :3], tip[:, :3, 3:] = turn[:, : tip.shape[1] - 3], turn
        by_residual = linear.factors.solve_transposed(-tip.reshape(-1, 6)).reshape(tip.shape)
        sections, columns = linear.sections, []
        by_tension = sections.tendons.stretch_by_twist
        for name in uncertainty.quantities:
            if name == 'tension':
                change = by_tension * linear.rates[..., np.newaxis]
            elif name == 'offset':
                change = sections.by_offset.gradient
                if linear.tension is not None:
                    local = linear.tension.by_unit(sections.by_offset.unit)
                    change = change + by_tension * local[..., np.newaxis]
            else:
                change = getattr(sections, f'by_{name}')[:, np.newaxis]
            columns.append(np.tensordot(by_residual, change, axes=([0, 1], [0, 2])))
        return uncertainty.tip_covariance(columns)

    def _linearised(self, found: Equilibrium) -> _Linear:
        """The system about an equilibrium that was ``found``; that of the last one is kept."""
        kept, problem, state = self._kept, self._problem, found.state
        if kept is None or kept.state is not state:
            problem.others.require_tangents('sensitivity')
            tension, known = problem.tension_derivatives(state), found.factors
            # What was judged stable has been linearised for that.
            if state is found.judged and isinstance(known, Deferred):
                factors = known.factors()
            else:
                factors = problem.linearise(state)
            problem.load_work(state)
            if tension is not None:
                tension.require(self._arm.tendon_names, state.acting.condition.tensions)
            work, rates = problem.work, problem.tension_rates(state)
            sections = _Sections(
                problem.tables, self._outwards, state.z, work.gradient.copy(),
                problem.tendons(state), self._by_ratio,
            )  # fmt: skip
            kept = self._kept = _Linear(
                state, factors, tension, rates, sections, work.rotation.copy(), work.slope.copy()
            )
        return kept

    def _change(
        self, found: Equilibrium, columns: _Columns, wrenches: FloatArray | None = None
    ) -> Change:
        """Of all ``columns``; loads change the wrench (N, 6, loads) beyond the nodes."""
        weights, total = self._problem.elements.weights, max(at.stop for at in columns.values())
        linear = self._linearised(found)
        sections, tendons = linear.sections, linear.sections.tendons
        has_friction = self._problem.friction is not None
        by_local = tendons.stretch_by_twist.swapaxes(1, 2)
        push = sections.imbalance(columns, total)
        local = self._local_changes(linear, columns, total)
        if has_friction:
            push += by_local @ local
        elif 'tension' in columns:
            push[..., columns['tension']] += by_local
        if wrenches is not None:
            force, levers = wrenches[:, :3], skew(linear.slope) @ wrenches[:, :3]
            moment = wrenches[:, 3:] + along(self._problem.elements.to_tip, levers)
            rows = in_sections(linear.rotation, force, moment, linear.state.z.shape[1])
            push[..., columns['tip_wrench']] -= rows
        z = linear.factors.solve(-push.reshape(-1, total)).reshape(push.shape)
        if linear.tension is not None:
            local += linear.tension.by_twists(z)
        by_z = weights[:, np.newaxis, np.newaxis] * tendons.stretch_by_twist
        length = np.tensordot(by_z, z, axes=([0, 2], [0, 1]))
        if tendons.has_sheaths:
            length += np.einsum('i,ij,ijc->jc', weights, tendons.stretch_by_tension, local)
        own = np.arange(len(length))
        for name in set(_PATHS).intersection(columns):
            moved = getattr(sections, f'by_{name}').stretch
            length[own, columns[name].start + own] += weights @ moved
        mean = None
        if has_friction:
            mean = np.einsum('i,ij,ijc->jc', weights, self._rest, local)
            mean /= self._rest_lengths[:, np.newaxis]
        return Change(*self._read(linear, z), length, mean, z)

    def _local_changes(self, linear: _Linear, columns: _Columns, total: int) -> FloatArray:
        """Changes of the local tensions at fixed twists, (N, J, total)."""
        found, tension = np.zeros((*linear.rates.shape, total)), linear.tension
        own = np.arange(found.shape[1])
        for name, where in columns.items():
            if name == 'tension':
                found[:, own, where.start + own] = linear.rates
            elif tension is not None and name == 'friction':
                found[:, own, where.start + own] = tension.by_friction
            elif tension is not None and name in _PATHS:
                unit = getattr(linear.sections, f'by_{name}').unit
                found[:, own, where.start + own] = tension.by_unit(unit)
        return found

    def _read(self, linear: _Linear, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Changes of poses (S, 6, columns) and strains (S, 4, columns) at the stations.

        Of changes ``z`` (N, m, columns) of the twists at the nodes.
        """
        rates = pose_rates(self._problem.elements.from_base, linear.rotation, linear.slope, z)
        strain = strain_changes(linear.state.z, z)
        return along(self._to_stations, rates), along(self._at_stations, strain)


def pose_rates(
    to_nodes: FloatArray, rotation: FloatArray, slope: FloatArray, z: FloatArray
) -> FloatArray:
    """Derivatives by s of displacements and rotations (N, 6, columns) at the nodes.

    Of changes ``z`` (N, m, columns) of the twists, with the integration ``to_nodes`` (N, N).
    """
    rates = np.empty((len(z), 6, z.shape[2]))
    np.matmul(rotation, z[:, :3], out=rates[:, 3:])
    turn = along(to_nodes, rates[:, 3:])
    np.matmul(rotation[..., : z.shape[1] - 3], z[:, 3:], out=rates[:, :3])
    rates[:, :3] -= skew(slope) @ turn
    return rates


def strain_changes(twist: FloatArray, z: FloatArray) -> FloatArray:
    """Changes of tau, xi, k and q (n, 4, columns) by those ``z`` of a ``twist`` (n, m)."""
    # tau, xi, k are curvatures over the stretch.
    bends, stretch = twist[:, :3, np.newaxis], twist[:, 3:4, np.newaxis]
    strain = z[:, :4].copy()
    strain[:, :3] -= (bends / stretch) * z[:, 3:4]
    strain[:, :3] /= stretch
    return strain


def part_of(change: Change, where: slice) -> Change:
    """Some of the quantities of a ``change``."""
    mean, twist = change.tendon_tension, change.twist
    return Change(
        change.pose[..., where], change.strain[..., where], change.tendon_length[..., where],
        None if mean is None else mean[..., where], None if twist is None else twist[..., where],
    )  # fmt: skip
