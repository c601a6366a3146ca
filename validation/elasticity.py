"""Equilibrium of a three-dimensional elastic arm whose tendons are pulled, by Newton's method."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from arm_mesh import ArmMesh, Mesh
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, csr_matrix, diags
from scipy.sparse.linalg import splu
from solid import Solid
from tendon_potential import SolidTendon

from octo_arm_model import Arm, SolveError
from octo_arm_model.arm.hints import FloatArray

_TOLERANCE = 1e-8  # of the forces' imbalance over the tendons' forces
_MOST_FACTORISATIONS = 15
_GROWTH = 30.0  # of the imbalance in a step
_REUSE = 0.2  # fall of the imbalance for which a factorisation is used again
_SMALLEST = 1e-3  # part of a load step
_DISC_FACTOR = 30.0  # plastic over silicone; stiffer discs change the tip by less than 1e-4 L

Report = Callable[[str], None]


@dataclass(frozen=True)
class Contact:
    """Constraints by tendons, discs and base.

    Attributes:
        sheath: radius of the tendons' sheaths [m]; None where the whole section holds a tendon.
        disc: thickness of the rigid discs that end at the anchorages [m]; 0 for none, so that the
            pull spreads over the soft section.
        clamped: whether the base is glued; if not it may widen.
        steps: pieces of a tendon's polygon in every layer.
    """

    sheath: float | None = None
    disc: float = 0.0
    clamped: bool = True
    steps: int = 6


@dataclass(frozen=True)
class SolidShape:
    """Equilibrium of an elastic arm; places in the axes t, n, b of the base.

    Attributes:
        tensions: tensions of the pulled tendons [N].
        s: arc coordinate of every node of the midline [m], (nodes,).
        midline: their deformed places [m], (nodes, 3).
        rotation: of the tip's section, to least squares, (3, 3); its columns are t, n and b.
        lengths: deformed lengths of the tendons [m].
        elastic: elastic energy of the whole arm [J].
        volume: least and greatest ratio of volumes at the quadrature points.
        residual: imbalance of forces over the tendons' forces.
        state: displacements and pressures.
    """

    tensions: tuple[float, ...]
    s: FloatArray
    midline: FloatArray
    rotation: FloatArray
    lengths: tuple[float, ...]
    elastic: float
    volume: tuple[float, float]
    residual: float
    state: FloatArray

    @property
    def tip(self) -> FloatArray:
        """Deformed place of the tip [m]."""
        tip: FloatArray = self.midline[-1]
        return tip

    @property
    def potential(self) -> float:
        """Elastic energy and that of the tendons [J]."""
        return self.elastic + float(np.dot(self.tensions, self.lengths))


class ElasticArm:
    """An arm of solid elements with some of its tendons."""

    def __init__(
        self, arm: Arm, mesh: Mesh, pulled: Sequence[int], contact: Contact = Contact()
    ) -> None:
        """Fill ``arm`` with elements and lay the tendons ``pulled`` through them.

        Where all of them lie in the plane z = 0 half of the arm is enough.
        """
        everywhere = np.linspace(0.0, arm.length, 9)
        sideways = np.abs(arm.tendon_offsets(everywhere)[1][list(pulled)])
        half = bool(np.all(sideways < 1e-9 * arm.length))
        self.mesh = ArmMesh(arm, mesh, half, contact.disc)
        self.solid = Solid(self.mesh, arm.material, _DISC_FACTOR)
        self.tendons = [
            SolidTendon(self.mesh, arm, number, contact.sheath, contact.steps) for number in pulled
        ]
        self._free = np.flatnonzero(~self._fixed(contact.clamped))
        # Displacements and pressures of one magnitude, for the pivots.
        count = self.solid.displacements
        young = float(arm.material.youngs_modulus_at(0.0))
        self._scale = np.full(self.solid.size, young)
        self._scale[:count] = 0.1 * arm.body.radius(0.0)
        axis = np.hypot(*self.mesh.nodes[1:]) < 1e-9 * arm.length
        order = np.argsort(self.mesh.nodes[0][axis])
        self._axis = np.flatnonzero(axis)[order]

    def follow(
        self,
        tensions: Sequence[Sequence[float]],
        report: Report = lambda line: None,
        guesses: Sequence[FloatArray] = (),
    ) -> Iterator[SolidShape]:
        """Equilibria at each of ``tensions``, followed from the unloaded arm or near ``guesses``.

        Raises:
            SolveError: if the path ends before a tension is reached.
        """
        known = [(np.zeros(len(self.tendons)), np.zeros(self.solid.size))]
        for number, target in enumerate(np.asarray(tensions, dtype=float)):
            origin, done, step = known[-1][0], 0.0, 1.0
            guess = guesses[number] if len(guesses) else None
            while done < 1.0:
                part = min(1.0, done + step)
                now = origin + part * (target - origin)
                found = self._newton(now, self._predicted(known, now) if guess is None else guess)
                name = f'load {number + 1}/{len(tensions)}, {" ".join(f"{t:.3g}" for t in now)} N'
                if found is None:
                    step, guess = step if guess is not None else 0.5 * step, None
                    report(f'{name}: a smaller step')
                    if step < _SMALLEST:
                        raise SolveError(f'the elastic arm was lost on the way to {target} N')
                    continue
                state, residual, count = found
                report(f'{name}: residual {residual:.0e} after {count} factorisations')
                known = [known[-1], (now, state)]
                done = part
                step *= 2.0 if count <= 6 else 1.0
            yield self._shape(target, state, residual)

    def guess(self, other: ElasticArm, state: FloatArray) -> FloatArray:
        """The ``state`` of an ``other``, coarser arm at the nodes of this one."""
        count = other.solid.displacements
        moved = other.mesh.at(self.mesh.nodes) @ state[:count].reshape(-1, 3)
        pressure = other.mesh.at(self.mesh.corners, pressure=True) @ state[count:]
        return np.concatenate([moved.ravel(), pressure])

    @property
    def area(self) -> float:
        """Area of the base, as the elements have it [m^2]."""
        area = float(np.sum(self.mesh.face(0.0)[2]))
        return 2.0 * area if self.mesh.half else area

    def midline(self, displacement: FloatArray) -> FloatArray:
        """Deformed places of the nodes of the midline [m], (n, 3), from the base."""
        return (self.mesh.nodes.T + displacement)[self._axis]

    def small_response(self, load: FloatArray) -> FloatArray:
        """Displacements (nodes, 3) of the unloaded arm under small forces ``load`` (nodes, 3)."""
        state = np.zeros(self.solid.size)
        force = np.zeros(self.solid.size)
        force[: self.solid.displacements] = load.ravel()
        answer = self._factorised(self.solid.hessian(state))(force)
        return answer[: self.solid.displacements].reshape(-1, 3)

    def _fixed(self, clamped: bool) -> NDArray[np.bool_]:
        nodes = self.mesh.nodes
        small = 1e-9 * float(nodes[0].max())
        base = nodes[0] < small
        fixed = np.zeros((nodes.shape[1], 3), dtype=bool)
        fixed[base] = True
        if not clamped:
            fixed[base, 1:] = False
            fixed[base & (np.hypot(nodes[1], nodes[2]) < small), 1:] = True
            # No turn about the axis.
            fixed[base & (np.abs(nodes[2]) < small), 2] = True
        if self.mesh.half:
            fixed[np.abs(nodes[2]) < small, 2] = True
        pressures = self.solid.size - self.solid.displacements
        return np.concatenate([fixed.ravel(), np.zeros(pressures, dtype=bool)])

    @staticmethod
    def _predicted(known: list[tuple[FloatArray, FloatArray]], now: FloatArray) -> FloatArray:
        """State at the tensions ``now`` on the line through the last two known."""
        if len(known) == 1 or not np.any(known[-1][0] - known[-2][0]):
            return known[-1][1]
        (before, first), (last, second) = known
        change = last - before
        part = float(np.dot(now - last, change) / np.dot(change, change))
        return second + part * (second - first)

    def _forces(self, tensions: FloatArray, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient of the whole potential, and the tendons' part of it."""
        moved = self._displacement(state)
        pull = np.zeros(self.solid.size)
        for tension, tendon in zip(tensions, self.tendons):
            pull[: self.solid.displacements] += tension * tendon.gradient(moved).ravel()
        return self.solid.gradient(state) + pull, pull

    def _newton(
        self, tensions: FloatArray, state: FloatArray
    ) -> tuple[FloatArray, float, int] | None:
        """State, residual and number of factorisations; None if there is no convergence."""
        residual, gradient = self._residual(tensions, state)
        if not np.isfinite(residual):
            return None
        count, solve = 0, None
        while residual >= _TOLERANCE:
            fresh = solve is None
            if solve is None:
                if count == _MOST_FACTORISATIONS:
                    return None
                solve, count = self._factorised(self._hessian(tensions, state)), count + 1
            step = solve(-gradient)
            # Bending turns a step's error into stretch, so growth for a few steps is no failure.
            # With the stiffness of an earlier state every step must lower the residual.
            allowed = _GROWTH * max(residual, 1e-3) if fresh else _REUSE * residual
            part = 1.0
            while True:
                trial = state + part * step
                after, changed = self._residual(tensions, trial)
                if after <= allowed or not fresh:
                    break
                part *= 0.5
                if part < 1e-3:
                    return None
            if not after <= _REUSE * residual:
                solve = None
            if after <= allowed:
                state, residual, gradient = trial, after, changed
        return state, residual, count

    def _residual(self, tensions: FloatArray, state: FloatArray) -> tuple[float, FloatArray]:
        gradient, pull = self._forces(tensions, state)
        free, scale = self._free, self._scale[self._free]
        size = float(np.linalg.norm(scale * pull[free]))
        return float(np.linalg.norm(scale * gradient[free])) / size, gradient

    def _hessian(self, tensions: FloatArray, state: FloatArray) -> csr_matrix:
        moved = self._displacement(state)
        matrix = self.solid.hessian(state)
        pulls = sum(t * tendon.hessian(moved) for t, tendon in zip(tensions, self.tendons))
        pulls.resize(matrix.shape)
        return matrix + pulls

    def _factorised(self, matrix: csr_matrix) -> Callable[[FloatArray], FloatArray]:
        """What solves linear equations in the free unknowns."""
        scale = self._scale[self._free]
        inner = diags(scale) @ matrix[self._free][:, self._free] @ diags(scale)
        factors = splu(csc_matrix(inner))

        def solve(right: FloatArray) -> FloatArray:
            answer = np.zeros(right.size)
            answer[self._free] = scale * factors.solve(scale * right[self._free])
            return answer

        return solve

    def _displacement(self, state: FloatArray) -> FloatArray:
        return state[: self.solid.displacements].reshape(-1, 3)

    def _shape(self, tensions: FloatArray, state: FloatArray, residual: float) -> SolidShape:
        moved = self._displacement(state)
        places = self.mesh.nodes.T + moved
        double = 2.0 if self.mesh.half else 1.0
        return SolidShape(
            tensions=tuple(float(t) for t in tensions),
            s=self.mesh.nodes[0][self._axis],
            midline=self.midline(moved),
            rotation=self._tip_rotation(places),
            lengths=tuple(tendon.length(moved) for tendon in self.tendons),
            elastic=double * self.solid.energy(state),
            volume=self.solid.volume(state),
            residual=residual,
            state=state,
        )

    def _tip_rotation(self, places: FloatArray) -> FloatArray:
        """Rotation that fits the motion of the tip's section."""
        nodes = self.mesh.nodes
        end = nodes[0] > nodes[0].max() * (1.0 - 1e-9)
        before, after = nodes.T[end], places[end]
        if self.mesh.half:
            before, after = (np.vstack([p, p * (1.0, 1.0, -1.0)]) for p in (before, after))
        u, _, v = np.linalg.svd((after - after.mean(0)).T @ (before - before.mean(0)))
        return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v, dtype=np.float64)
