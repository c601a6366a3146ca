"""Find equilibria of a three-dimensional elastic arm with tendons, by Newton's method."""

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

_TOLERANCE = 1e-8  # largest norm of residual forces over that of the tendons' forces
_MOST_FACTORISATIONS = 15
_GROWTH = 30.0  # largest growth of the residual in a step
_REUSE = 0.2  # fall of the residual for which a factorisation is used again
_SMALLEST = 1e-3  # smallest fraction of a load step
_DISC_FACTOR = 30.0  # stiffness of a disc; more changes the tip by less than 1e-4 L

Report = Callable[[str], None]


@dataclass(frozen=True)
class Contact:
    """Constraints by tendons, discs and base.

    Attributes:
        sheath: radius of the tendons' sheaths [m]; None if whole sections guide the tendons.
        disc: thickness of the discs at the anchorages [m]; 0 without discs, so that a tendon pulls
            on the soft section.
        clamped: whether the base section is clamped; if not, it can widen.
        steps: segments of a tendon's polygon per layer.
    """

    sheath: float | None = None
    disc: float = 0.0
    clamped: bool = True
    steps: int = 6


@dataclass(frozen=True)
class SolidShape:
    """Equilibrium of an elastic arm, in the axes t, n, b of the base.

    Attributes:
        tensions: tensions of the tendons [N].
        s: arc coordinates of the nodes on the midline [m], (nodes,).
        midline: positions of these nodes [m], (nodes, 3).
        rotation: rotation of the tip's section by least squares, with columns t, n, b, (3, 3).
        lengths: deformed lengths of the tendons [m].
        elastic: elastic energy of the whole arm [J].
        volume: smallest and largest ratio of deformed to initial volume.
        residual: norm of residual forces over that of the tendons' forces.
        state: displacements [m] and pressures [Pa].
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
        """Position of the tip [m]."""
        tip: FloatArray = self.midline[-1]
        return tip

    @property
    def potential(self) -> float:
        """Elastic energy plus tensions times lengths of the tendons [J]."""
        return self.elastic + float(np.dot(self.tensions, self.lengths))


class ElasticArm:
    """An arm of solid elements with some of its tendons under tension."""

    def __init__(
        self, arm: Arm, mesh: Mesh, pulled: Sequence[int], contact: Contact = Contact()
    ) -> None:
        """Mesh ``arm`` and guide the tendons ``pulled`` through the elements.

        If all of them are in the plane z = 0, only half of the arm is meshed.
        """
        stations = np.linspace(0.0, arm.length, 9)
        offsets_along_b = np.abs(arm.tendon_offsets(stations)[1][list(pulled)])
        half = bool(np.all(offsets_along_b < 1e-9 * arm.length))
        self.mesh = ArmMesh(arm, mesh, half, contact.disc)
        self.solid = Solid(self.mesh, arm.material, _DISC_FACTOR)
        self.tendons = [
            SolidTendon(self.mesh, arm, number, contact.sheath, contact.steps) for number in pulled
        ]
        self._free = np.flatnonzero(~self._fixed(contact.clamped))
        # Scales that give displacements and pressures similar magnitudes, for the pivots.
        count = self.solid.displacements
        young = float(arm.material.youngs_modulus_at(0.0))
        self._scale = np.full(self.solid.size, young)
        self._scale[:count] = 0.1 * arm.body.radius(0.0)
        is_on_axis = np.hypot(*self.mesh.nodes[1:]) < 1e-9 * arm.length
        order = np.argsort(self.mesh.nodes[0][is_on_axis])
        self._axis = np.flatnonzero(is_on_axis)[order]

    def follow(
        self,
        tensions: Sequence[Sequence[float]],
        report: Report = lambda line: None,
        guesses: Sequence[FloatArray] = (),
    ) -> Iterator[SolidShape]:
        """Yield the equilibrium at each of ``tensions``, from ``guesses`` or the previous ones.

        Raises:
            SolveError: if a load step becomes too small.
        """
        solutions = [(np.zeros(len(self.tendons)), np.zeros(self.solid.size))]
        for number, load in enumerate(np.asarray(tensions, dtype=float)):
            origin, fraction_done, step = solutions[-1][0], 0.0, 1.0
            guess = guesses[number] if len(guesses) else None
            while fraction_done < 1.0:
                fraction = min(1.0, fraction_done + step)
                pulls = origin + fraction * (load - origin)
                first = self._extrapolate(solutions, pulls) if guess is None else guess
                solution = self._newton(pulls, first)
                values = ' '.join(f'{t:.3g}' for t in pulls)
                name = f'load {number + 1}/{len(tensions)}, {values} N'
                if solution is None:
                    step, guess = step if guess is not None else 0.5 * step, None
                    report(f'{name}: did not converge, takes a smaller step')
                    if step < _SMALLEST:
                        raise SolveError(f'the elastic arm has no equilibrium near {pulls} N')
                    continue
                state, residual, count = solution
                report(f'{name}: residual {residual:.0e} after {count} factorisations')
                solutions = [solutions[-1], (pulls, state)]
                fraction_done = fraction
                step *= 2.0 if count <= 6 else 1.0
            yield self._shape(load, state, residual)

    def guess(self, other: ElasticArm, state: FloatArray) -> FloatArray:
        """Interpolate the ``state`` of an ``other`` mesh at the nodes of this one."""
        count = other.solid.displacements
        displacement = other.mesh.at(self.mesh.nodes) @ state[:count].reshape(-1, 3)
        pressure = other.mesh.at(self.mesh.corners, pressure=True) @ state[count:]
        return np.concatenate([displacement.ravel(), pressure])

    @property
    def area(self) -> float:
        """Area of the base of the elements [m^2]."""
        area = float(np.sum(self.mesh.face(0.0)[2]))
        return 2.0 * area if self.mesh.half else area

    def midline(self, displacement: FloatArray) -> FloatArray:
        """Return the positions of the nodes on the midline, from the base on [m], (n, 3)."""
        return (self.mesh.nodes.T + displacement)[self._axis]

    def small_response(self, load: FloatArray) -> FloatArray:
        """Return the linear response (nodes, 3) [m] to forces ``load`` (nodes, 3) [N]."""
        state = np.zeros(self.solid.size)
        force = np.zeros(self.solid.size)
        force[: self.solid.displacements] = load.ravel()
        response = self._factorise(self.solid.hessian(state))(force)
        return response[: self.solid.displacements].reshape(-1, 3)

    def _fixed(self, clamped: bool) -> NDArray[np.bool_]:
        nodes = self.mesh.nodes
        small = 1e-9 * float(nodes[0].max())
        base = nodes[0] < small
        fixed = np.zeros((nodes.shape[1], 3), dtype=bool)
        fixed[base] = True
        if not clamped:
            fixed[base, 1:] = False
            fixed[base & (np.hypot(nodes[1], nodes[2]) < small), 1:] = True
            # Prevents a rotation about the axis.
            fixed[base & (np.abs(nodes[2]) < small), 2] = True
        if self.mesh.half:
            fixed[np.abs(nodes[2]) < small, 2] = True
        pressures = self.solid.size - self.solid.displacements
        return np.concatenate([fixed.ravel(), np.zeros(pressures, dtype=bool)])

    @staticmethod
    def _extrapolate(
        solutions: list[tuple[FloatArray, FloatArray]], tensions: FloatArray
    ) -> FloatArray:
        """Extrapolate the last two ``solutions`` linearly to other ``tensions``."""
        if len(solutions) == 1 or not np.any(solutions[-1][0] - solutions[-2][0]):
            return solutions[-1][1]
        (first, state_before), (last, state_last) = solutions
        difference = last - first
        fraction = float(np.dot(tensions - last, difference) / np.dot(difference, difference))
        return state_last + fraction * (state_last - state_before)

    def _forces(self, tensions: FloatArray, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the gradient of the whole potential and that of the tendons."""
        displacement = self._displacement(state)
        pull = np.zeros(self.solid.size)
        for tension, tendon in zip(tensions, self.tendons):
            pull[: self.solid.displacements] += tension * tendon.gradient(displacement).ravel()
        return self.solid.gradient(state) + pull, pull

    def _newton(
        self, tensions: FloatArray, state: FloatArray
    ) -> tuple[FloatArray, float, int] | None:
        """Return state, residual and number of factorisations, or None without convergence."""
        residual, gradient = self._residual(tensions, state)
        if not np.isfinite(residual):
            return None
        count, solve = 0, None
        while residual >= _TOLERANCE:
            is_new = solve is None
            if solve is None:
                if count == _MOST_FACTORISATIONS:
                    return None
                solve, count = self._factorise(self._hessian(tensions, state)), count + 1
            step = solve(-gradient)
            # Errors of bending cause stretch, so that the residual may grow for a few steps.
            # With the stiffness of an earlier state every step must reduce the residual.
            allowed = _GROWTH * max(residual, 1e-3) if is_new else _REUSE * residual
            fraction = 1.0
            while True:
                trial = state + fraction * step
                trial_residual, trial_gradient = self._residual(tensions, trial)
                if trial_residual <= allowed or not is_new:
                    break
                fraction *= 0.5
                if fraction < 1e-3:
                    return None
            if not trial_residual <= _REUSE * residual:
                solve = None
            if trial_residual <= allowed:
                state, residual, gradient = trial, trial_residual, trial_gradient
        return state, residual, count

    def _residual(self, tensions: FloatArray, state: FloatArray) -> tuple[float, FloatArray]:
        gradient, pull = self._forces(tensions, state)
        free, scale = self._free, self._scale[self._free]
        size = float(np.linalg.norm(scale * pull[free]))
        return float(np.linalg.norm(scale * gradient[free])) / size, gradient

    def _hessian(self, tensions: FloatArray, state: FloatArray) -> csr_matrix:
        displacement = self._displacement(state)
        matrix = self.solid.hessian(state)
        pulls = sum(t * tendon.hessian(displacement) for t, tendon in zip(tensions, self.tendons))
        pulls.resize(matrix.shape)
        return matrix + pulls

    def _factorise(self, matrix: csr_matrix) -> Callable[[FloatArray], FloatArray]:
        """Return a function that solves linear equations in the free unknowns."""
        scale = self._scale[self._free]
        scaled = diags(scale) @ matrix[self._free][:, self._free] @ diags(scale)
        factors = splu(csc_matrix(scaled))

        def solve(right_side: FloatArray) -> FloatArray:
            solution = np.zeros(right_side.size)
            solution[self._free] = scale * factors.solve(scale * right_side[self._free])
            return solution

        return solve

    def _displacement(self, state: FloatArray) -> FloatArray:
        return state[: self.solid.displacements].reshape(-1, 3)

    def _shape(self, tensions: FloatArray, state: FloatArray, residual: float) -> SolidShape:
        displacement = self._displacement(state)
        positions = self.mesh.nodes.T + displacement
        halves = 2.0 if self.mesh.half else 1.0
        return SolidShape(
            tensions=tuple(float(t) for t in tensions),
            s=self.mesh.nodes[0][self._axis],
            midline=self.midline(displacement),
            rotation=self._tip_rotation(positions),
            lengths=tuple(tendon.length(displacement) for tendon in self.tendons),
            elastic=halves * self.solid.energy(state),
            volume=self.solid.volume(state),
            residual=residual,
            state=state,
        )

    def _tip_rotation(self, positions: FloatArray) -> FloatArray:
        """Return the least-squares rotation of the tip's section."""
        nodes = self.mesh.nodes
        is_tip = nodes[0] > nodes[0].max() * (1.0 - 1e-9)
        before, after = nodes.T[is_tip], positions[is_tip]
        if self.mesh.half:
            before, after = (np.vstack([p, p * (1.0, 1.0, -1.0)]) for p in (before, after))
        u, _, v = np.linalg.svd((after - after.mean(0)).T @ (before - before.mean(0)))
        return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v, dtype=np.float64)
