"""Tendons that are straight between the holes of discs.

The chord of a tendon, from the hole A of one disc to the hole B of the next one, has the length
l = |B - A|, the unit vector e, and the energy T l. A change dz of the twist between them, at r and
R, moves B relative to A by

    dB = (R dkappa) x (B - r) + R dv,    dl/dz = (R^T ((B - r) x e), R^T e),                    (1)

so that sections there bear the forces of the chords, F = sum T e and C = sum T a x e about the
midline at b, the far end, with a = B - b. This adds to their residual

    (R^T (C + (b - r) x F), R^T F).                                                            (2)

It changes with the pose of b relative to the disc before, by a stiffness K of the turned chords
(3), and by (2) itself, as a change of the pose turns and moves r and R:

    P = T (1 - e e^T) / l,    d(F, C) = K (db, dtheta_b),
    K = sum [ P, -P a^; a^ P, -a^ P a^ + T e^ a^ ]                                              (3)

Only twists between the same two discs couple, so that the Jacobian has full blocks of these.
Holes have constant places on the rigid disc, whatever the strains of the section.

With friction a tendon loses tension, dT = -mu T dphi, only in holes, which turn it by the angle
phi = 2 asin(|k| / 2), with k = e_2 - e_1 of the chords on both sides.
"""

import functools
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import BoolArray, FloatArray
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.forms import Form
from octo_arm_model.rod.friction import Friction, LocalTensions, TensionDerivatives
from octo_arm_model.rod.rotations import rotation_matrices, skew
from octo_arm_model.rod.section_arrays import cross
from octo_arm_model.rod.tables import Tables, Work, places_at
from octo_arm_model.rod.tendons import PathChange, Tendons

_NO_TURN = 1e-12  # angle below which a tendon is straight in a hole, without derivative [rad]


class Chords(NamedTuple):
    """The chords of J tendons along D pieces of an arm, in base_frame, from its base."""

    position: FloatArray  #: position of the midline at the nodes, (N, 3) [m]
    frames: FloatArray  #: orientations of both ends of pieces, (D + 1, 3, 3)
    far: FloatArray  #: position of the midline at the far end of pieces, (D, 3) [m]
    arms: FloatArray  #: vectors from the far end to the holes, (D, J, 3) [m]
    unit: FloatArray  #: unit vectors of the chords, (D, J, 3)
    length: FloatArray  #: lengths of the chords, (D, J) [m]


class ChordModel:
    """The equations of the chords of one arm at its nodes.

    Pieces of the arm end at the faces of discs, the last one, without chords, at the tip.

    Attributes:
        piece: piece of each node, (N,).
        first: first node of each piece, (D,).
        sizes: lengths of pieces, (D,) [m].
        reach: 1 where a chord acts and 0 beyond the anchorage of its tendon, (D, J).
        holes: offsets of the holes at both ends of pieces along t, n and b, (D + 1, J, 3) [m].
        outward: change of the offsets per metre that tendons move outwards, (D + 1, J, 3).
    """

    def __init__(self, arm: Arm, elements: Elements, tables: Tables, form: Form) -> None:
        """Tabulate holes of ``arm``; all faces of discs are edges of ``elements``."""
        self._elements, self._form = elements, form
        self._last: tuple[FloatArray, FloatArray, Chords] | None = None
        stops = np.unique([0.0, *arm.discs.faces, arm.length])
        self._places = places_at(elements, stops)
        self.piece = np.searchsorted(stops, elements.s) - 1
        self.first = np.searchsorted(self.piece, np.arange(stops.size - 1))
        # Groups of pieces with n nodes: the nodes, (K, n), and integrals from the start to each.
        counts, from_base = np.bincount(self.piece), elements.from_base
        groups = [self.first[counts == n, np.newaxis] + np.arange(n) for n in set(counts.tolist())]
        self._groups = [
            (nodes, from_base[nodes[..., np.newaxis], nodes[:, np.newaxis]]) for nodes in groups
        ]
        self.sizes, self.reach = np.diff(stops), tables.reach[self.first]
        self.holes = np.zeros((stops.size, self.reach.shape[1], 3))
        self.outward = np.zeros_like(self.holes)
        self.holes[..., 1:] = arm.tendon_offsets(stops).T
        self.outward[..., 1:] = arm.tendon_outwards(stops)[:2].T

    def chords(self, tables: Tables, z: FloatArray, work: Work) -> Chords:
        """Return the chords at twists ``z`` (N, m), whose orientations are in ``work``.

        The chords of the last twists are cached.
        """
        if self._last is not None and self._last[0] is z and self._last[1] is tables.base:
            return self._last[2]
        position, quaternion, _ = self._form.poses(tables, z, self._places, work)
        far, frames = position[0], rotation_matrices(quaternion[0].T[[3, 0, 1, 2]])
        frames = np.moveaxis(frames, 2, 0)
        arms = self.holes @ frames.swapaxes(1, 2)
        holes = far[:, np.newaxis] + arms
        chord = holes[1:] - holes[:-1]
        length = np.sqrt((chord * chord).sum(axis=2))
        unit = chord / length[..., np.newaxis]
        midline = self._elements.from_base @ work.slope
        chords = Chords(midline, frames, far[1:], arms[1:], unit, length)
        self._last = z, tables.base, chords
        return chords

    def add_pull(self, tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
        """Add (2) under local ``tensions`` (N, J) [N] to the residual in ``work``."""
        chords = self.chords(tables, z, work)
        pull = self.at_pieces(tensions)[..., np.newaxis] * chords.unit
        force, couple = pull.sum(axis=1), cross(chords.arms, pull).sum(axis=1)
        force, lever = force[self.piece], chords.far[self.piece] - chords.position
        moment = couple[self.piece] + cross(lever, force)
        axes_wrench = np.stack([moment, force], axis=1) @ work.rotation
        work.residual[:, :3] += axes_wrench[:, 0]
        work.residual[:, 3:] += axes_wrench[:, 1, : z.shape[1] - 3]

    def at_pieces(self, values: FloatArray) -> FloatArray:
        """Return ``values`` (N, J) of each piece, (D, J), zero beyond the anchorages."""
        return values[self.first] * self.reach

    def add_tangent(self, tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
        """Add the derivative of (2) by the twists to the Jacobian in ``work``."""
        chords, local = self.chords(tables, z, work), self.at_pieces(tensions)[..., np.newaxis]
        force = (local * chords.unit).sum(axis=1)[:, np.newaxis]
        couple = cross(chords.arms, local * chords.unit).sum(axis=1)[:, np.newaxis]
        stiffness = _stiffness(chords, local[..., np.newaxis])
        jacobian = work.jacobian.reshape(*z.shape, *z.shape)
        for nodes, own in self._groups:
            of, turn = self.piece[nodes[:, 0]], work.rotation[nodes].swapaxes(2, 3)
            lever = chords.far[of, np.newaxis] - chords.position[nodes]
            by_pose = np.zeros((*nodes.shape, z.shape[1], 6))
            by_pose[..., :3, :3], by_pose[..., :3, 3:] = turn @ skew(lever), turn
            by_pose[..., 3:, :3] = turn[..., : z.shape[1] - 3, :]
            flat, shape = by_pose.reshape(len(of), -1, 6), by_pose.shape[1:3]
            block = (flat @ stiffness[of] @ flat.swapaxes(1, 2)).reshape(-1, *shape, *shape)
            weights = self._elements.weights[nodes][:, np.newaxis]
            block = block.swapaxes(2, 3) * weights[..., np.newaxis, np.newaxis]
            moment = couple[of] + cross(lever, force[of])
            held = force[of], moment, weights - own, own
            _add_turned(block, turn, work.slope[nodes], held)
            jacobian[nodes[:, :, np.newaxis], :, nodes[:, np.newaxis], :] += block

    def angles(self, tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
        """Compute the angles by which holes turn tendons between the base and every node.

        They do not depend on ``tensions``. The orientations of ``z`` (N, m) are in ``work``.
        """
        kink = np.diff(self.chords(tables, z, work).unit, axis=0)
        size = np.sqrt((kink * kink).sum(axis=2))
        angle = np.zeros_like(self.reach)
        angle[1:] = (2.0 * np.arcsin(np.minimum(0.5 * size, 1.0))).cumsum(axis=0)
        work.angle[:] = (angle * self.reach * (tables.friction > 0.0))[self.piece]


class ChordTendons(Tendons):
    """The tendons of a `ChordModel`, whose lengths are distributed along the pieces.

    Attributes:
        model: equations of the chords.
        chords: chords at the given twists.
    """

    def __init__(
        self, model: ChordModel, tables: Tables, z: FloatArray, tensions: FloatArray, work: Work
    ) -> None:
        """Compute tendons at twists ``z`` (N, m), as oriented in ``work``, under ``tensions``."""
        super().__init__(tables, z, np.zeros_like(tensions), np.zeros((*tensions.shape, 2)))
        self.model, self.chords = model, model.chords(tables, z, work)
        self._pull, self._rotation = tensions * tables.reach, work.rotation.copy()
        along = self.chords.length * model.reach / model.sizes[:, np.newaxis]
        self.stretch = along[model.piece]

    def by_forces(self, force: FloatArray, couple: FloatArray | float = 0.0) -> FloatArray:
        """Return R^T ((B - r) x f + c), R^T f of forces f at the holes and couples c, (N, J, m).

        ``force`` and ``couple`` are (D, J, 3).
        """
        chords, piece = self.chords, self.model.piece
        holes = (chords.far[:, np.newaxis] + chords.arms)[piece] - chords.position[:, np.newaxis]
        force, couple = force[piece], np.broadcast_to(couple, force.shape)[piece]
        gradients = np.empty((*force.shape[:2], self._strains))
        gradients[..., :3] = (cross(holes, force) + couple) @ self._rotation
        gradients[..., 3:] = force @ self._rotation[..., : self._strains - 3]
        return gradients

    @functools.cached_property
    def stretch_by_twist(self) -> FloatArray:
        """Derivative of the lengths per reference length by the twists, (N, J, m)."""
        return self.by_forces(self.chords.unit * self.model.reach[..., np.newaxis])

    def by_path(self, path: FloatArray) -> PathChange:
        """Return derivatives by an outward shift of the holes, whatever the ``path``."""
        model, (_, frames, _, _, unit, length) = self.model, self.chords
        shift = model.outward @ frames.swapaxes(1, 2)
        chord = np.diff(shift, axis=0)
        along = (unit * chord).sum(axis=2)
        turned = (chord - unit * along[..., np.newaxis]) / length[..., np.newaxis]
        gradient = self.by_forces(turned, cross(shift[1:], unit)) * self._pull[..., np.newaxis]
        stretch = (along * model.reach / model.sizes[:, np.newaxis])[model.piece]
        return PathChange(np.moveaxis(turned[model.piece], 2, 0), stretch, gradient)


class ChordTensionDerivatives(TensionDerivatives):
    """Derivatives of local tensions, which change only in the holes."""

    def __init__(
        self, friction: Friction, local: LocalTensions, tendons: ChordTendons, weights: FloatArray
    ) -> None:
        """Linearise about ``tendons`` with tensions ``local``; nodes have ``weights`` (N,)."""
        self._slide(friction, local)
        self._inverse = None
        self._model, self._pull = tendons.model, tendons.stretch_by_twist
        unit, length = tendons.chords.unit, tendons.chords.length[..., np.newaxis]
        kink = np.diff(unit, axis=0)
        size = np.sqrt((kink * kink).sum(axis=2))
        scale = np.maximum(size * np.sqrt(np.maximum(1.0 - 0.25 * size * size, 1e-12)), 1e-300)
        # Derivatives of the angle by k, for the holes at both ends of pieces.
        self._by_kink = np.where(size > _NO_TURN, 1.0 / scale, 0.0)[..., np.newaxis] * kink
        start, end = np.zeros_like(unit), np.zeros_like(unit)
        start[1:], end[:-1] = self._by_kink, self._by_kink
        across = [
            (one - unit * (unit * one).sum(axis=2, keepdims=True)) / length for one in (start, end)
        ]
        turned = np.zeros_like(unit)
        turned[:-1] = cross(unit[1:], end[:-1])
        at_start = tendons.by_forces(across[0])
        at_both = at_start + tendons.by_forces(-across[1], turned)
        pieces = np.arange(len(unit))[:, np.newaxis, np.newaxis, np.newaxis]
        piece = self._model.piece[:, np.newaxis]
        at_start, at_both = (
            (weights[:, np.newaxis, np.newaxis] * one).swapaxes(0, 1)
            for one in (at_start, at_both)
        )
        by_z = (piece < pieces) * at_both + (piece == pieces) * at_start
        rate = self._slip * self._tables.friction * self._tension
        rate = self._model.at_pieces(friction.spread(self._to_nodes, rate))
        self._rates = rate
        self._by_twists = rate[..., np.newaxis] * by_z.reshape(*rate.shape, -1)
        straight = np.zeros_like(self._model.reach, np.bool_)
        straight[:-1] = (size <= _NO_TURN) & (self._model.reach[1:] > 0.0)
        self._straight = straight[self._model.piece]

    def _are_straight(self) -> BoolArray:
        """Return whether tendons end a piece at a hole that does not turn them, (N, J)."""
        return self._straight

    def add_to(self, jacobian: FloatArray) -> None:
        """Add the derivative of the residual by the local tensions to the ``jacobian``."""
        rates = self._by_twists[self._model.piece]
        rows = self._pull.swapaxes(1, 2) @ rates
        jacobian += rows.reshape(jacobian.shape)

    def by_unit(self, change: FloatArray) -> FloatArray:
        """Return the change of local tensions by that of unit tangents, (3, N, J), (N, J)."""
        unit = np.moveaxis(change, 0, 2)[self._model.first]
        angle = np.zeros_like(self._rates)
        angle[1:] = (self._by_kink * np.diff(unit, axis=0)).sum(axis=2).cumsum(axis=0)
        return np.asarray((self._rates * angle)[self._model.piece])

    def by_twists(self, change: FloatArray) -> FloatArray:
        """Return the change of local tensions by a ``change`` of the twists, (N, J, k)."""
        return np.asarray(
            (self._by_twists @ change.reshape(-1, change.shape[2]))[self._model.piece]
        )

    def _angles(self) -> FloatArray:
        """Return the angles of all tendons, slack ones too, (N, J)."""
        return self._local.angle


def _add_turned(
    block: FloatArray,
    turn: FloatArray,
    slope: FloatArray,
    held: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> None:
    """Add the change of (2) for constant F and C to every ``block`` (K, n, n, m, m).

    ``held`` are F and the moment at the nodes, (K, 1, 3) and (K, n, 3), and integrals from each
    node to the end of its piece, and from its start, (K, n, n). ``turn`` are the inverse
    orientations, (K, n, 3, 3), and ``slope`` is r', (K, n, 3).
    """
    (force, moment, further, own), more = held, block.shape[-1] - 3
    # A turn at k moves b - r_i by its cross product with these, (K, n, n, 3).
    moved = (further[:, np.newaxis] * slope.swapaxes(1, 2)[:, :, np.newaxis]) @ own[:, np.newaxis]
    moved, force = np.moveaxis(moved, 1, 3), force[:, np.newaxis]
    inner = moved[..., np.newaxis] * force[..., np.newaxis, :]
    inner -= (moved * force).sum(axis=3)[..., np.newaxis, np.newaxis] * np.eye(3)
    further, own = further[..., np.newaxis, np.newaxis], own[..., np.newaxis, np.newaxis]
    inner += own * skew(moment)[:, :, np.newaxis]
    rows, axes = turn[:, :, np.newaxis], turn.swapaxes(2, 3)[:, np.newaxis]
    mixed = rows @ skew(force) @ axes
    block[..., :3, :3] += rows @ inner @ axes
    block[..., :3, 3:] -= further * mixed[..., :more]
    block[..., 3:, :3] += own * mixed[..., :more, :]


def _stiffness(chords: Chords, tensions: FloatArray) -> FloatArray:
    """Return K of (3) of every piece under ``tensions`` (D, J, 1, 1) [N], (D, 6, 6)."""
    unit, arm = chords.unit, skew(chords.arms)
    along = np.eye(3) - unit[..., np.newaxis] * unit[..., np.newaxis, :]
    across = tensions / chords.length[..., np.newaxis, np.newaxis] * along
    blocks = np.empty((*unit.shape[:2], 6, 6))
    blocks[..., :3, :3], blocks[..., :3, 3:] = across, -across @ arm
    blocks[..., 3:, :3] = arm @ across
    blocks[..., 3:, 3:] = tensions * (skew(unit) @ arm) - arm @ across @ arm
    return np.asarray(blocks.sum(axis=1))
