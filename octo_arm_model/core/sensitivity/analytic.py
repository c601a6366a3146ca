"""Analytic derivatives of strains, poses and tendon lengths by parameters of the arm.

At fixed shape the derivative of the equilibrium by a parameter is an unbalanced wrench at every
cross section. The linearised equilibrium (`System.solve`) gives the change of twist (d kappa, d v)
that balances it, and with it, in base_frame, the rotation phi and displacement d u,

    phi(s) = int_0^s R d kappa    d u(s) = int_0^s phi x u' + R d v.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.linearised import Response
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.sliding.friction import Sliding
from octo_arm_model.core.loaded.sliding.friction_changes import FrictionChanges
from octo_arm_model.core.loaded.sliding.sliding_response import respond
from octo_arm_model.core.loaded.state import Condition, State
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.numerics.vectors import cross
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.quadrature import (
    integrate_from_base,
    integrate_from_tip,
    integration_weights,
)
from octo_arm_model.core.rod.solution import Shape, Solution
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.sensitivity.imbalance import Imbalance
from octo_arm_model.core.sensitivity.results import Change, Sensitivity


def derivatives(
    rod: LoadedRod, condition: Condition, shape: Shape, by_offsets: bool = True
) -> Sensitivity:
    """First derivatives at the equilibrium ``shape`` of a loaded ``rod``.

    Unless ``by_offsets`` none by the offsets and the sheaths of tendons without friction.

    Raises:
        LoadError: if a load states no tangent stiffness.
        ConvergenceError: if the linearised equilibrium is singular.
    """
    rod.equilibrium.require_tangents('sensitivity')
    if rod.differentiate is None:
        state = rod.equilibrium.state(condition, shape)
        return _derivatives(rod, state, by_offsets or state.sliding is not None)
    found = rod.differentiate(condition, shape, None, by_offsets)
    tendons = condition.tensions.size
    wrench, tension, young, poisson, offset = _split(*found, [6, tendons, 1, 1])
    return Sensitivity(tension, young, wrench, poisson, offset if by_offsets else None)


def _derivatives(rod: LoadedRod, state: State, by_offsets: bool) -> Sensitivity:
    """`derivatives` at the equilibrium ``state``, by NumPy.

    Columns: tensions, wrench on the tip, E, nu, then, ``by_offsets``, offsets and sheath
    stiffnesses, and with friction mu.
    """
    problem, parameters = rod.equilibrium, rod.parameters
    energy, twist = problem.energy, state.shape.twist
    tensions = state.condition.tensions
    local_tensions, direct = energy.local_tensions(tensions[np.newaxis]), None
    if state.sliding is not None:
        local_tensions = state.sliding.tensions
    count, tendons = len(twist), tensions.size
    imbalance = Imbalance(energy, parameters, twist, local_tensions)
    strain, sheaths, more = imbalance.strain, 0, 0
    if by_offsets:
        by_sheath = imbalance.by_sheath_stiffness
        sheaths = by_sheath.shape[1]
        more = tendons + sheaths
    if state.sliding is not None:
        # Imbalances by tension follow from the local changes; friction adds a column per tendon.
        more, direct = more + tendons, _direct(rod, state, state.sliding, sheaths)
    columns = np.zeros((6, tendons + 8 + more, twist.shape[1]))
    if state.sliding is None:
        columns[:count, :tendons] = imbalance.by_tension
    columns[:, tendons : tendons + 6] = problem.tip_wrenches(state)
    columns[:count, tendons + 6, np.newaxis] = imbalance.by_youngs_modulus
    columns[:count, tendons + 7, np.newaxis] = imbalance.by_poisson_ratio
    if by_offsets:
        columns[:count, tendons + 8 : 2 * tendons + 8] = imbalance.by_offset
        columns[:count, 2 * tendons + 8 : 2 * tendons + 8 + sheaths] = by_sheath
    response, slid = respond(problem, problem.linearised(state), state, columns[:count], direct)
    pose, strains = read_out(rod, state, response)
    weights = problem.collocation.weights
    length = lengths_along(imbalance.length_by_twist * weights, response.twist)
    # Derivatives of the lengths at fixed twist.
    at_place = energy.length_by_tension(strain, local_tensions) * energy.transmission
    at_place = at_place[:, 0] * weights
    tendon, mean = np.arange(tendons), None
    if slid is None:
        length[tendon, tendon] += np.einsum('jn,jn->j', at_place, energy.transmission[:, 0])
    else:
        length += np.einsum('jn,jcn->jc', at_place, slid)
        mean = rod.mean_along_tendons(slid)
    if by_offsets:
        own = parameters.length_by_offset(strain, local_tensions) @ weights
        length[tendon, tendons + 8 + tendon] += own
    if sheaths:
        own = parameters.length_by_sheath(strain, local_tensions) @ weights
        length[tendon, 2 * tendons + 8 + tendon] += own
    tension, wrench, young, poisson, offset, sheath, friction = _split(
        pose, strains, length, [tendons, 6, 1, 1, by_offsets * tendons, sheaths], mean
    )
    return Sensitivity(
        tension, young, wrench, poisson, offset if by_offsets else None,
        sheath if sheaths else None,
        None if slid is None else friction,
    )  # fmt: skip


def _split(
    pose: FloatArray, strains: FloatArray, length: FloatArray, counts: Sequence[int],
    mean: FloatArray | None = None,
) -> list[Change]:  # fmt: skip
    """Split the columns into groups of ``counts`` and one of the remaining columns."""
    parts, first = [], 0
    for count in (*counts, pose.shape[-1] - sum(counts)):
        own = slice(first, first + count)
        rest = None if mean is None else mean[:, own]
        parts.append(Change(pose[..., own], strains[..., own], length[..., own], rest))
        first += count
    return parts


def _direct(rod: LoadedRod, state: State, sliding: Sliding, sheaths: int) -> FloatArray:
    """Derivatives of the tensions along tendons with friction at fixed shape.

    (tendons, columns, points) [N], with the columns of `_derivatives`; ``sheaths`` is the number
    of compliant sheaths, that of the tendons or 0.

    Raises:
        SolveError: as `FrictionChanges.require_derivatives`.
    """
    friction, tendons = rod.equilibrium.friction, len(sliding.tensions)
    assert friction is not None
    changes = FrictionChanges(friction, sliding, state.shape.twist)
    changes.require_derivatives(state.condition.tensions)
    direct = np.zeros((tendons, 3 * tendons + 8 + sheaths, friction.points))
    own, first = np.arange(tendons), 2 * tendons + 8
    direct[own, own] = changes.by_base_tension()
    # A path or a sheath affects its own tendon only.
    direct[own, tendons + 8 + own] = changes.by_offset(rod.parameters)
    direct[own[:sheaths], first + own[:sheaths]] = changes.by_sheath_stiffness()
    direct[own, first + sheaths + own] = changes.by_coefficient()
    return direct


def read_out(rod: LoadedRod, state: State, response: Response) -> tuple[FloatArray, FloatArray]:
    """Changes of pose (stations, 6, columns) and strain (stations, 4, columns) by ``response``."""
    twist, stations = state.shape.twist, rod.stations
    angular = np.einsum('ijn,jcn->icn', state.rotation, response.twist[:3])
    axes = state.rotation[:, : len(twist) - 3]
    moved = np.einsum('ikn,kcn->icn', axes, response.twist[3:])
    turn = response.turn
    moved += cross(turn, np.broadcast_to(state.tangent[:, np.newaxis], turn.shape))
    pose = stations.integrate_from_base(np.concatenate([moved, angular]))
    change, at = stations.interpolate(response.twist[:4]), stations.interpolate(twist[:4])
    return pose.transpose(2, 0, 1), _strains(at, change).transpose(2, 0, 1)


def _strains(twist: FloatArray, change: FloatArray) -> FloatArray:
    """Change of tau, xi, k and q (4, columns, n) from ``change`` of the ``twist`` (4, n)."""
    strain = change.copy()
    omega = (twist[:3] / twist[3])[:, np.newaxis]
    strain[:3] = (strain[:3] - omega * strain[3]) / twist[3]
    return strain


def papers_twist_changes(
    solve: Callable[[FloatArray], Solution],
    energy: SectionEnergy,
    tensions: FloatArray,
    batch: int,
) -> FloatArray:
    """Derivatives (4, tendons + 1, nodes) of the twist by the tensions and by ln E.

    For a model of the paper, whose ``solve`` is called for ``batch`` sets of tensions at a time.
    Its equations are analytic in the tensions: with one of them perturbed by a small imaginary
    step, the imaginary part of the solution over the step is the derivative (Squire and Trapp
    1998), without cancellation; the step only has to exceed the tolerance of the sweeps of
    renda2012. Scaling E is equivalent to dividing all tensions by the same factor.
    """
    step = 1e-6 * max(float(tensions.max()), 1e-3 * float(energy.stiffness.axial.min()))
    moved = tensions + 1j * step * np.eye(tensions.size)
    parts = [moved[first : first + batch] for first in range(0, len(moved), batch)]
    by_tension = np.concatenate([solve(part).twist.imag for part in parts], axis=1) / step
    by_young = np.einsum('ijn,j->in', by_tension, -tensions)
    return np.concatenate([by_tension, by_young[:, np.newaxis]], axis=1)


def from_twist_changes(
    energy: SectionEnergy,
    grid: StationGrid,
    twist: FloatArray,
    frames: Quaternions,
    changes: FloatArray,
    counts: Sequence[int],
    mean: FloatArray | None = None,
) -> list[Change]:
    """Changes by groups of ``counts`` columns and the remaining ones, from those of the twist.

    ``changes`` of the twist are (4, columns, nodes), ``twist`` (4, nodes) is of the linear law and
    ``frames`` are those of the nodes; ``mean`` (tendons, columns) is `Change.tendon_tension`.
    """
    pose, strains = _integrate(twist, frames, grid, changes)
    # In the paper's models tendons stay on their paths, so that tensions do not matter here.
    by_twist = energy.lengthening(twist[:, np.newaxis], np.zeros_like(energy.active))[1][:, :, 0]
    length = lengths_along(by_twist * integration_weights(grid), changes)
    return _split(pose, strains, length, counts, mean)


def tip_from_twist_changes(
    grid: StationGrid, twist: FloatArray, frames: Quaternions, changes: FloatArray
) -> FloatArray:
    """Changes of the pose of the tip, (6, columns), as by `from_twist_changes`."""
    rotation = Quaternions(frames.a[0], frames.b[0]).matrix()
    # A bend rotates the rest of the arm about its cross section.
    lever = integrate_from_tip(rotation[:, 0] * twist[3], grid)
    by_twist = np.zeros((6, 4, twist.shape[1]))
    by_twist[:3, :3] = cross(rotation, np.broadcast_to(lever[:, np.newaxis], rotation.shape))
    by_twist[:3, 3] = rotation[:, 0]
    by_twist[3:, :3] = rotation
    return np.tensordot(by_twist * integration_weights(grid), changes, axes=([1, 2], [0, 2]))


def lengths_along(weighted: FloatArray, changes: FloatArray) -> FloatArray:
    """Changes of the tendon lengths [m], (tendons, columns), by ``changes`` of the twist.

    ``changes`` are (n, columns, points), ``weighted`` (n, tendons, points) is the gradient of each
    tendon's stretch by the twist times the quadrature weights.
    """
    return np.tensordot(weighted, changes[: len(weighted)], axes=([0, 2], [0, 2]))


def _integrate(
    twist: FloatArray, frames: Quaternions, grid: StationGrid, changes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """As `read_out`, from ``changes`` of the twist at the nodes, (4, columns, nodes)."""
    rotation = Quaternions(frames.a[0], frames.b[0]).matrix()
    advance = (rotation[:, 0] * twist[3])[:, np.newaxis]
    angle = integrate_from_base(np.einsum('ijn,jcn->icn', rotation, changes[:3]), grid)
    moved = cross(angle, np.broadcast_to(advance, angle.shape))
    moved += rotation[:, :1] * changes[3]
    at = grid.station_node
    pose = np.concatenate([integrate_from_base(moved, grid)[..., at], angle[..., at]])
    strain = _strains(twist[:4, at], changes[:4][..., at])
    return pose.transpose(2, 0, 1), strain.transpose(2, 0, 1)
