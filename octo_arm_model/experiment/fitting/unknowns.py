"""The unknowns of a fit, and the derivatives of the shape by them.

They form a vector x: of moduli and scales the logarithm of their ratio to the start, so that they
stay positive, of all others the value itself.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from octo_arm_model.config.config import Config
from octo_arm_model.core.errors import ConfigError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.solver import Solver
from octo_arm_model.experiment.fitting.tendon_offsets import move_tendons
from octo_arm_model.experiment.recording.alignment import Alignment

FITS = (
    'youngs_modulus', 'poisson_ratio', 'sheath_stiffness', 'tendon_offsets', 'friction',
    'tension_scale',
    'tension_offset', 'alignment',
)  # fmt: skip
ALIGNMENT = tuple(f'alignment_{part}' for part in ('x', 'y', 'z', 'turn_x', 'turn_y', 'turn_z'))
_OFFSET = 'tendon_offset.'
_SHEATH = 'sheath_stiffness'
_EXACT_ONLY = ('poisson_ratio', 'tendon_offsets', _SHEATH)
_STIFF_SHEATH = 10.0  # over the shear modulus: that a fit begins with where tendons kept places
_EXACT_PARAMETERS = (
    'material.poisson_ratio_stddev', 'tendons.offset_stddev', 'tendons.sheath_stiffness',
)  # fmt: skip
# Enough for the polygon through the stations to be as accurate as the curve.
FINE_STATIONS = 201
_FARTHEST = 10.0  # bound of logarithms
_ROUGHEST = 2.0  # largest coefficient of friction that is looked for [-]
_ROUGH = 0.1  # where the search begins without one in the config [-]
_DIFFERENCE = 1e-4  # step of differences, of the scale of an unknown
_PULLED = 1e-2  # of the highest tension: tendons below it count as slack


@dataclass(frozen=True)
class Unknown:
    """One number to fit.

    Attributes:
        name: of the parameter.
        unit: its unit.
        start: initial value of x.
        scale: a large change of x.
        low: least value of x.
        high: largest value of x.
        reference: value where x is 0, for one whose logarithm x is; None for others.
    """

    name: str
    unit: str
    start: float
    scale: float
    low: float = -math.inf
    high: float = math.inf
    reference: float | None = None

    def value(self, x: float) -> float:
        """Its value at ``x``."""
        return x if self.reference is None else self.reference * math.exp(x)

    def stddev(self, x: float, deviation: float) -> float:
        """Standard deviation of the value for a ``deviation`` of x, to first order."""
        return deviation if self.reference is None else self.value(x) * deviation


class Unknowns:
    """The unknowns of one model, as a vector.

    Attributes:
        model: its name.
        arm: the initial arm.
        unknowns: the components of the vector.
        names: their names.
        start: the initial vector.
    """

    def __init__(
        self,
        parameters: Mapping[str, Any],
        model: str,
        fits: Sequence[str],
        tensions: FloatArray,
        alignment: Alignment,
        without: Collection[str] = (),
    ) -> None:
        """Fit ``fits`` of `FITS`, beginning with ``parameters`` and ``alignment``.

        ``tensions`` (steps, tendons) [N] show which tendons are pulled. Of the components, those
        named in ``without`` stay as they are.

        Raises:
            ConfigError: if the model has no derivative by one of them.
        """
        for name in fits:
            if name not in FITS:
                raise ConfigError(f'cannot fit {name!r}, expected one of {", ".join(FITS)}')
            if name in _EXACT_ONLY and model != 'exact':
                raise ConfigError(
                    f'the model {model} has no derivative by {name}: choose --model exact'
                )
            if name == 'friction' and model == 'renda2012':
                raise ConfigError('the model renda2012 has no friction: choose another --model')
        self.model = model
        self._alignment = alignment
        self._parameters = {**parameters, 'model': model}
        if model != 'exact':
            for name in _EXACT_PARAMETERS:
                self._parameters.pop(name, None)
        config = Config.from_parameters(self._parameters)
        material = config.arm.material
        if self._parameters.get('material.shear_modulus'):
            # E is fitted at the same nu, so G changes with it.
            self._parameters['material.shear_modulus'] = 0.0
            self._parameters['material.poisson_ratio'] = float(material.poisson_ratio_at(0.0))
        if _SHEATH in fits:
            # One for all tendons, by the logarithm of which a fit never gets to rigid ones.
            known = config.arm.sheath_stiffness or (_STIFF_SHEATH * material.shear_modulus,)
            self._parameters['tendons.sheath_stiffness'] = [float(np.mean(known))]
            config = Config.from_parameters(self._parameters)
        self.arm, self._cells = config.arm, config.load_cells
        self._slack = _PULLED * tensions.max(initial=0.0)
        self._pulled = tensions.max(axis=0, initial=0.0) > self._slack
        self.unknowns = tuple(
            unknown
            for name in FITS
            if name in fits
            for unknown in self._unknowns_of(name)
            if unknown.name not in without
        )
        if not self.unknowns and not without:
            raise ConfigError('nothing to fit: no tendon is pulled')
        self.start = np.array([unknown.start for unknown in self.unknowns])
        self.names = tuple(unknown.name for unknown in self.unknowns)

    def _unknowns_of(self, name: str) -> list[Unknown]:
        material = self.arm.material
        if name == 'youngs_modulus':
            young = float(material.youngs_modulus_at(0.0))
            return [Unknown(name, 'Pa', 0.0, 1.0, -_FARTHEST, _FARTHEST, young)]
        if name == 'poisson_ratio':
            if self._parameters.get('material.table_poisson_ratio'):
                raise ConfigError('poisson_ratio cannot be fitted: the config has a table of it')
            ratio = float(material.poisson_ratio_at(0.0))
            return [Unknown(name, '-', ratio, 0.5, -1.0 + 1e-6, 0.5)]
        if name == _SHEATH:
            stiffness = self.arm.sheath_stiffness[0]
            return [Unknown(name, 'Pa', 0.0, 1.0, -_FARTHEST, _FARTHEST, stiffness)]
        if name == 'friction':
            # Not from zero, the end of its range, which a minimisation hardly leaves.
            given = float(np.mean(self.arm.friction or (_ROUGH,)))
            return [Unknown(name, '-', given, 0.1, 0.0, _ROUGHEST)]
        if name == 'tension_scale':
            return [Unknown(name, '-', 0.0, 1.0, -_FARTHEST, _FARTHEST, 1.0)]
        if name == 'tension_offset':
            return [Unknown(name, 'N', 0.0, 0.1)]
        if name == 'tendon_offsets':
            pulled = np.array(self.arm.tendon_names)[self._pulled]
            return [Unknown(f'{_OFFSET}{tendon}', 'm', 0.0, 1e-3) for tendon in pulled]
        start = (*self._alignment.shift, *self._alignment.turn)
        parts = zip(ALIGNMENT, 3 * ['m'] + 3 * ['rad'], start, strict=True)
        return [Unknown(part, unit, float(value), 1e-2) for part, unit, value in parts]

    def _get(self, x: FloatArray, name: str, default: float) -> float:
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
        scale, offset = self._get(x, 'tension_scale', 1.0), self._get(x, 'tension_offset', 0.0)
        return np.maximum(scale * read + offset * (read > self._slack), 0.0)

    def _calibrated(self, x: FloatArray) -> dict[str, Any]:
        """Parameters of load cells whose readings `tensions` turns into tensions at ``x``.

        A slack tendon has no offset: the deadband holds what it reads.
        """
        scale, offset = self._get(x, 'tension_scale', 1.0), self._get(x, 'tension_offset', 0.0)
        if (scale, offset) == (1.0, 0.0):
            return {}
        cells, count = self._cells, len(self._pulled)
        begun = np.array(cells.offset or count * (0.0,))
        band = scale * max(cells.deadband, float(self._slack) if offset else 0.0) + abs(offset)
        return {
            'tension_scale': (scale * np.array(cells.scale or count * (1.0,))).tolist(),
            'tension_offset': (scale * begun + offset * self._pulled).tolist(),
            'tension_deadband': band,
        }

    def parameters(self, x: FloatArray) -> dict[str, Any]:
        """Parameters of the arm at ``x``."""
        values = {**self._parameters, **self._calibrated(x)}
        young = self._get(x, 'youngs_modulus', math.nan)
        if math.isfinite(young):
            table = 'material.table_youngs_modulus'
            if values.get('material.table_s'):
                factor = young / float(self.arm.material.youngs_modulus_at(0.0))
                values[table] = [factor * value for value in values[table]]
            else:
                values['material.youngs_modulus'] = young
        ratio = self._get(x, 'poisson_ratio', math.nan)
        if math.isfinite(ratio):
            values['material.poisson_ratio'] = ratio
        sheath = self._get(x, _SHEATH, math.nan)
        if math.isfinite(sheath):
            values['tendons.sheath_stiffness'] = [sheath]
        if 'friction' in self.names:
            values['tendons.friction'] = [self._get(x, 'friction', 0.0)]
        moved = {
            tendon: self._get(x, f'{_OFFSET}{tendon}', 0.0) for tendon in self.arm.tendon_names
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

    def displacement(
        self, x: FloatArray, read: FloatArray, backbone: Backbone, solver: Solver
    ) -> FloatArray:
        """Derivative of the stations of ``backbone``, of ``solver``, by x, (n, 3, unknowns)."""
        if set(self.names) <= set(ALIGNMENT):
            return np.zeros((*backbone.position.shape, len(self.names)))
        change = solver.sensitivity(backbone)
        by_tension = change.by_tension.pose[:, :3]
        pulls = backbone.tensions.ravel() > 0.0
        columns = np.zeros((*by_tension.shape[:2], len(self.unknowns)))
        scale = self._get(x, 'tension_scale', 1.0)
        for number, name in enumerate(self.names):
            column = columns[..., number]
            if name == 'youngs_modulus':
                column += change.by_youngs_modulus.pose[:, :3, 0]
            elif name == 'poisson_ratio' and change.by_poisson_ratio is not None:
                column += change.by_poisson_ratio.pose[:, :3, 0]
            elif name == _SHEATH and change.by_sheath_stiffness is not None:
                by_all = change.by_sheath_stiffness.pose[:, :3].sum(axis=-1)
                column += self._get(x, _SHEATH, 0.0) * by_all
            elif name == 'tension_scale':
                column += by_tension @ (scale * read * pulls)
            elif name == 'tension_offset':
                column += by_tension @ ((read > self._slack) & pulls).astype(np.float64)
            elif name.startswith(_OFFSET) and change.by_offset is not None:
                tendon = self.arm.tendon_names.index(name.removeprefix(_OFFSET))
                column += change.by_offset.pose[:, :3, tendon]
        return columns

    @property
    def alignment_columns(self) -> list[int]:
        """Components of x that are of the alignment."""
        return [number for number, name in enumerate(self.names) if name in ALIGNMENT]

    @property
    def alignment_parts(self) -> list[int]:
        """Which of shift and turn, 0 to 5, these components are."""
        return [ALIGNMENT.index(name) for name in self.names if name in ALIGNMENT]
