"""The unknowns of a fit as a vector, and the arm that it stands for; see `unknown`."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.fitting.unknowns.readings import Readings
from octo_arm_model.experiment.fitting.unknowns.tendon_offsets import move_tendons
from octo_arm_model.experiment.fitting.unknowns.unknown import (
    ALIGNMENT,
    AXIAL,
    FITS,
    OFFSET,
    SHEATH,
    ZERO,
    check_fits,
    unknowns_of,
)
from octo_arm_model.experiment.shapes.alignment import Alignment
from octo_arm_model.rod.solver import Solver

_STIFF_SHEATH = 10.0  # over the shear modulus: that a fit begins with where tendons kept places
_EXACT_PARAMETERS = (
    'material.poisson_ratio_stddev', 'tendons.offset_stddev', 'tendons.sheath_stiffness',
)  # fmt: skip
# Enough for the polygon through the stations to be as accurate as the curve.
FINE_STATIONS = 201
_DIFFERENCE = 1e-4  # step of differences, of the scale of an unknown
_PULLED = 1e-2  # of the highest tension: tendons below it count as slack


class Unknowns:
    """The unknowns of one model, as a vector.

    Attributes:
        model: its name.
        arm: the initial arm.
        unknowns: the components of the vector.
        names: their names.
        start: the initial vector.
        readings: what was read of the tendons.
        slack: tension below which a tendon counts as slack [N].
        taut: which tendons with an encoder reading are not, (steps, tendons); what winches of
            slack tendons have paid out says nothing.
        reads_encoders: whether encoder readings are residuals of the fit.
    """

    def __init__(
        self,
        parameters: Mapping[str, Any],
        model: str,
        fits: Sequence[str],
        readings: Readings,
        alignment: Alignment,
        without: Collection[str] = (),
    ) -> None:
        """Fit ``fits`` of `FITS`, beginning with ``parameters`` and ``alignment``.

        ``readings`` show which tendons are pulled, and which encoders read them. Of the
        components, those named in ``without`` stay as they are.

        Raises:
            ConfigError: if the model has no derivative by one of them, or nothing shows it.
        """
        check_fits(fits, model, readings.are_lengths)
        self.model, self.readings = model, readings
        self._alignment = alignment
        self._parameters = {**parameters, 'model': model}
        if model != 'exact':
            for name in _EXACT_PARAMETERS:
                self._parameters.pop(name, None)
        config = Config.from_parameters(self._parameters)
        material = config.arm.material
        if 'poisson_ratio' in fits and self._parameters.get('material.table_poisson_ratio'):
            raise ConfigError('poisson_ratio cannot be fitted: the config has a table of it')
        if self._parameters.get('material.shear_modulus'):
            # E is fitted at the same nu, so G changes with it.
            self._parameters['material.shear_modulus'] = 0.0
            self._parameters['material.poisson_ratio'] = float(material.poisson_ratio_at(0.0))
        if SHEATH in fits:
            # One for all tendons, by the logarithm of which a fit never gets to rigid ones.
            known = config.arm.sheath_stiffness or (_STIFF_SHEATH * material.shear_modulus,)
            self._parameters['tendons.sheath_stiffness'] = [float(np.mean(known))]
            config = Config.from_parameters(self._parameters)
        self.arm, self._cells = config.arm, config.load_cells
        self.slack = _PULLED * float(readings.tensions.max(initial=0.0))
        self._pulled = readings.tensions.max(axis=0, initial=0.0) > self.slack
        self.taut = (readings.tensions > self.slack) & np.isfinite(readings.displacements)
        if AXIAL in fits and not self.taut.any():
            raise ConfigError(
                f'{AXIAL} shows in encoder readings of tendons under tension, and this recording '
                'has none'
            )
        # What encoders read is weighed where nothing else shows what is fitted.
        self.reads_encoders = AXIAL in fits and not readings.are_lengths
        names = np.array(self.arm.tendon_names)
        pulled, encoders = names[self._pulled].tolist(), names[self.taut.any(axis=0)].tolist()
        self.unknowns = tuple(
            unknown
            for name in FITS
            if name in fits
            for unknown in unknowns_of(name, self.arm, pulled, encoders, alignment)
            if unknown.name not in without
        )
        if not self.unknowns and not without:
            raise ConfigError('nothing to fit: no tendon is pulled')
        self.start = np.array([unknown.start for unknown in self.unknowns])
        self.names = tuple(unknown.name for unknown in self.unknowns)

    def value(self, x: FloatArray, name: str, default: float) -> float:
        """Value of the unknown ``name`` at ``x``; ``default`` where it is none."""
        if name not in self.names:
            return default
        number = self.names.index(name)
        return self.unknowns[number].value(float(x[number]))

    def alignment(self, x: FloatArray) -> Alignment:
        """Transform camera to base at ``x``."""
        if not self.alignment_columns:
            return self._alignment
        parts = np.concatenate([self._alignment.shift, self._alignment.turn])
        parts[self.alignment_parts] = x[self.alignment_columns]
        return Alignment(parts[3:], parts[:3])

    def tensions(self, x: FloatArray, read: FloatArray) -> FloatArray:
        """Tensions (tendons,) [N] for readings ``read``; slack tendons have no offset."""
        scale, offset = self.value(x, 'tension_scale', 1.0), self.value(x, 'tension_offset', 0.0)
        return np.maximum(scale * read + offset * (read > self.slack), 0.0)

    def _calibrated(self, x: FloatArray) -> dict[str, Any]:
        """Parameters of load cells whose readings `tensions` turns into tensions at ``x``.

        A slack tendon has no offset: the deadband holds what it reads.
        """
        scale, offset = self.value(x, 'tension_scale', 1.0), self.value(x, 'tension_offset', 0.0)
        if (scale, offset) == (1.0, 0.0):
            return {}
        cells, count = self._cells, len(self._pulled)
        begun = np.array(cells.offset or count * (0.0,))
        band = scale * max(cells.deadband, float(self.slack) if offset else 0.0) + abs(offset)
        return {
            'tension_scale': (scale * np.array(cells.scale or count * (1.0,))).tolist(),
            'tension_offset': (scale * begun + offset * self._pulled).tolist(),
            'tension_deadband': band,
        }

    def parameters(self, x: FloatArray) -> dict[str, Any]:
        """Parameters of the arm at ``x``."""
        values = {**self._parameters, **self._calibrated(x)}
        young = self.value(x, 'youngs_modulus', math.nan)
        if math.isfinite(young):
            table = 'material.table_youngs_modulus'
            if values.get('material.table_s'):
                factor = young / float(self.arm.material.youngs_modulus_at(0.0))
                values[table] = [factor * value for value in values[table]]
            else:
                values['material.youngs_modulus'] = young
        ratio = self.value(x, 'poisson_ratio', math.nan)
        if math.isfinite(ratio):
            values['material.poisson_ratio'] = ratio
        sheath = self.value(x, SHEATH, math.nan)
        if math.isfinite(sheath):
            values['tendons.sheath_stiffness'] = [sheath]
        if AXIAL in self.names:
            stiffness = self.value(x, AXIAL, 0.0)
            values['tendons.axial_stiffness'] = [stiffness if math.isfinite(stiffness) else 0.0]
        if 'friction' in self.names:
            values['tendons.friction'] = [self.value(x, 'friction', 0.0)]
        moved = {
            tendon: self.value(x, f'{OFFSET}{tendon}', 0.0) for tendon in self.arm.tendon_names
        }
        return move_tendons(values, self.arm, moved) if any(moved.values()) else values

    def solver(self, x: FloatArray) -> Solver:
        """Solver of the arm at ``x``.

        Raises:
            ArmDefinitionError: if there can be no such arm.
        """
        config = Config.from_parameters(self.parameters(x))
        return config.solver(stations=max(config.stations, FINE_STATIONS))

    @property
    def slides(self) -> bool:
        """Whether tendons have friction, so that shapes depend on those before."""
        return 'friction' in self.names or bool(self.arm.friction)

    def difference(self, x: FloatArray, number: int) -> float:
        """Step of component ``number`` of ``x`` by which derivatives are differences."""
        unknown = self.unknowns[number]
        step = _DIFFERENCE * unknown.scale
        return step if x[number] + step <= unknown.high else -step

    def zeros(self, x: FloatArray) -> FloatArray:
        """Readings of the encoders at the taut unloaded arm, (tendons,) [m]."""
        return np.array([self.value(x, f'{ZERO}{name}', 0.0) for name in self.arm.tendon_names])

    @property
    def alignment_columns(self) -> list[int]:
        """Components of x that are of the alignment."""
        return [number for number, name in enumerate(self.names) if name in ALIGNMENT]

    @property
    def alignment_parts(self) -> list[int]:
        """Which of shift and turn, 0 to 5, these components are."""
        return [ALIGNMENT.index(name) for name in self.names if name in ALIGNMENT]
