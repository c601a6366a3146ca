"""Solutions of the steps of a fit, and their derivatives by the unknowns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.fitting.unknowns.unknown import (
    ALIGNMENT,
    AXIAL,
    OFFSET,
    SHEATH,
    ZERO,
)
from octo_arm_model.experiment.fitting.unknowns.unknowns import Unknowns
from octo_arm_model.experiment.shapes.encoder_windows import lengths_of
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import (
    Wound,
    displacements_of,
    solve_displacements,
    tendon_compliance,
    unloaded_by_offset,
    wound_sensitivity,
)
from octo_arm_model.rod.sensitivity import Change, Sensitivity
from octo_arm_model.rod.solver import Solver


class Solutions:
    """Solutions of all steps at one x after another."""

    def __init__(self, unknowns: Unknowns) -> None:
        """Solve the steps whose readings ``unknowns`` has."""
        self._unknowns, self._readings = unknowns, unknowns.readings
        self._at: FloatArray = np.empty(0)
        self._solver: Solver | None = None
        self._backbones: dict[int, Backbone] = {}
        self._wound: dict[int, Wound] = {}
        self._changes: dict[int, tuple[Sensitivity, Change | None]] = {}
        self._differences: _Differences | None = None

    def backbone(self, x: FloatArray, step: int) -> Backbone:
        """Solution for a ``step`` at ``x``.

        Raises:
            SolveError: if it has none.
            ArmDefinitionError: if there can be no such arm.
        """
        solver, unknowns = self._solver_at(x), self._unknowns
        if step not in self._backbones:
            if unknowns.slides:
                # Tendons slide on from the step before.
                self._backbones = dict(enumerate(self._sequence(x, solver)))
            elif self._readings.are_lengths:
                read = self._readings.displacements[step] - unknowns.zeros(x)
                lengths = lengths_of(solver.arm.tendon_names, read)
                self._wound[step] = solve_displacements(
                    solver, lengths, start=self._wound.get(step)
                )
                self._backbones[step] = self._wound[step].backbone
            else:
                tensions = unknowns.tensions(x, self._readings.tensions[step])
                self._backbones[step] = solver.solve(tensions.reshape(solver.arm.tension_shape))
        return self._backbones[step]

    def _solver_at(self, x: FloatArray) -> Solver:
        # The arm does not depend on where the camera is.
        of_arm = np.delete(x, self._unknowns.alignment_columns)
        if self._solver is None or not np.array_equal(of_arm, self._at):
            self._solver, self._at = self._unknowns.solver(x), of_arm
            self._backbones, self._changes, self._differences = {}, {}, None
        return self._solver

    def _sequence(self, x: FloatArray, solver: Solver) -> list[Backbone]:
        """Solutions for all steps at ``x``, one after the other."""
        readings, unknowns = self._readings, self._unknowns
        if not readings.are_lengths:
            return followed(solver, [unknowns.tensions(x, read) for read in readings.tensions])
        zeros, names = unknowns.zeros(x), solver.arm.tendon_names
        found: list[Backbone] = []
        last: Wound | None = None
        for read in readings.displacements:
            last = solve_displacements(solver, lengths_of(names, read - zeros), start=last)
            found.append(last.backbone)
        return found

    def position_change(self, x: FloatArray, step: int) -> FloatArray:
        """Derivative of the stations of a ``step`` by x, (n, 3, unknowns)."""
        backbone, unknowns = self.backbone(x, step), self._unknowns
        if set(unknowns.names) <= set(ALIGNMENT):
            return np.zeros((*backbone.position.shape, x.size))
        if not unknowns.slides:
            return self._change(x, step, lambda change: change.pose[:, :3])
        return np.asarray(self._sequence_change(x).position[step])

    def _sequence_change(self, x: FloatArray) -> _Differences:
        """Differences of whole sequences: where a tendon sticks there are no other derivatives."""
        unknowns = self._unknowns
        if self._differences is None:
            here = [self.backbone(x, step) for step in range(len(self._readings.tensions))]
            begun = self._observed(x, self._solver_at(x), here)
            found = _Differences(*(np.zeros((*part.shape, x.size)) for part in begun))
            for number in range(x.size):
                if number in unknowns.alignment_columns:
                    continue
                moved, by = x.copy(), unknowns.difference(x, number)
                moved[number] += by
                solver = unknowns.solver(moved)
                there = self._observed(moved, solver, self._sequence(moved, solver))
                for out, new, old in zip(found, there, begun, strict=True):
                    out[..., number] = (new - old) / by
            self._differences = found
        return self._differences

    def _observed(
        self, x: FloatArray, solver: Solver, backbones: Sequence[Backbone]
    ) -> tuple[FloatArray, FloatArray]:
        """Stations (steps, n, 3) [m] and what encoders read (steps, tendons) [m] at ``x``."""
        positions = np.array([backbone.position for backbone in backbones])
        return positions, np.array([self._read(x, solver, backbone) for backbone in backbones])

    def _read(self, x: FloatArray, solver: Solver, backbone: Backbone) -> FloatArray:
        """Readings of the encoders at ``x`` by the model, (tendons,) [m]."""
        return displacements_of(solver, backbone).ravel() + self._unknowns.zeros(x)

    def _change(self, x: FloatArray, step: int, of: Callable[[Change], FloatArray]) -> FloatArray:
        """Derivative of what ``of`` takes of a `Change`, (..., unknowns), at fixed alignment."""
        unknowns, backbone, solver = self._unknowns, self.backbone(x, step), self._solver_at(x)
        change, wound = self._sensitivity(backbone, step)
        by_displacement = None if wound is None else of(wound)
        by_tension = of(change.by_tension)
        found = by_tension @ self._tension_change(x, step)
        for number, name in enumerate(unknowns.names):
            column = found[..., number]
            if name == 'youngs_modulus':
                column += of(change.by_youngs_modulus)[..., 0]
            elif name == 'poisson_ratio' and change.by_poisson_ratio is not None:
                column += of(change.by_poisson_ratio)[..., 0]
            elif name == SHEATH and change.by_sheath_stiffness is not None:
                by_all = of(change.by_sheath_stiffness).sum(axis=-1)
                column += unknowns.value(x, SHEATH, 0.0) * by_all
            elif name.startswith(OFFSET) and change.by_offset is not None:
                column += of(change.by_offset)[..., self._tendon(name, OFFSET)]
            elif name.startswith(ZERO) and by_displacement is not None:
                column -= by_displacement[..., self._tendon(name, ZERO)]
            elif name == AXIAL and by_displacement is not None:
                column -= by_displacement @ self._stretch_by_softness(backbone, solver)
        return found

    def _sensitivity(self, backbone: Backbone, step: int) -> tuple[Sensitivity, Change | None]:
        """First derivatives of the ``backbone`` of a ``step``, and those by displacements held."""
        assert self._solver is not None
        if step not in self._changes:
            if self._readings.are_lengths:
                wound = wound_sensitivity(self._solver, self._wound[step])
                self._changes[step] = wound.held, wound.by_displacement
            else:
                self._changes[step] = self._solver.sensitivity(backbone), None
        return self._changes[step]

    def _tendon(self, name: str, prefix: str) -> int:
        return self._unknowns.arm.tendon_names.index(name.removeprefix(prefix))

    def _tension_change(self, x: FloatArray, step: int) -> FloatArray:
        """Derivative of the tensions that readings stand for by x, (tendons, unknowns)."""
        read, unknowns = self._readings.tensions[step], self._unknowns
        pulls = self.backbone(x, step).tensions.ravel() > 0.0
        found = np.zeros((read.size, x.size))
        for number, name in enumerate(unknowns.names):
            if name == 'tension_scale':
                found[:, number] = unknowns.value(x, name, 1.0) * read * pulls
            elif name == 'tension_offset':
                found[:, number] = (read > unknowns.slack) & pulls
        return found

    def _stretch_by_softness(self, backbone: Backbone, solver: Solver) -> FloatArray:
        """Derivative of each tendon's stretch by the component of x for it, (tendons,) [m]."""
        unknown = next(one for one in self._unknowns.unknowns if one.name == AXIAL)
        return solver.tension_integrals(backbone).ravel() / unknown.reference

    def encoder_residuals(self, x: FloatArray, step: int) -> FloatArray:
        """Readings of the encoders of taut tendons less those of the model, (taut,) [m]."""
        solver, backbone = self._solver_at(x), self.backbone(x, step)
        away = self._readings.displacements[step] - self._read(x, solver, backbone)
        return np.asarray(away[self._unknowns.taut[step]])

    def encoder_change(self, x: FloatArray, step: int) -> FloatArray:
        """Derivative of `encoder_residuals` by x, (taut, unknowns)."""
        if self._unknowns.slides:
            return -self._sequence_change(x).reading[step, self._unknowns.taut[step]]
        solver, backbone = self._solver_at(x), self.backbone(x, step)
        compliance, unloaded = tendon_compliance(solver), unloaded_by_offset(solver, backbone)
        expected = compliance[:, np.newaxis] * self._tension_change(x, step)
        expected -= self._change(x, step, lambda change: change.tendon_length)
        for number, name in enumerate(self._unknowns.names):
            if name.startswith(ZERO):
                expected[self._tendon(name, ZERO), number] += 1.0
            elif name.startswith(OFFSET):
                tendon = self._tendon(name, OFFSET)
                expected[tendon, number] += unloaded[tendon]
            elif name == AXIAL:
                expected[:, number] += self._stretch_by_softness(backbone, solver)
        return -expected[self._unknowns.taut[step]]


class _Differences(NamedTuple):
    """Derivatives of all steps by x.

    Attributes:
        position: of the stations, (steps, n, 3, unknowns).
        reading: of what encoders read, (steps, tendons, unknowns).
    """

    position: FloatArray
    reading: FloatArray


def followed(solver: Solver, tensions: Iterable[FloatArray]) -> list[Backbone]:
    """Shapes under sets of ``tensions`` (tendons,) [N], in their order.

    Each tendon with friction slides on from the set before.

    Raises:
        SolveError: if the model has no answer for one.
    """
    found: list[Backbone] = []
    for pulled in tensions:
        shaped = pulled.reshape(solver.arm.tension_shape)
        last = found[-1] if found and solver.arm.friction else None
        found.append(solver.follow(shaped, last))
    return found
