"""The parameters that can be fitted, and the arm that a vector x of them describes.

For moduli and scales x is the logarithm of their ratio to the start, so that they stay positive.
For the stiffness of tendons it is the ratio of the start to the stiffness: encoder readings are
linear in it, and it is zero for tendons that do not stretch. For all others x is the value itself.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.arm.stiffness import SectionStiffness, default_highest
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.observations import MeasuredShape
from octo_arm_model.rod.solver import Solver

AXIAL = 'axial_stiffness'
SHEATH = 'sheath_stiffness'
SPOOL, ENCODER_ZEROS = 'displacement_scale', 'displacement_offset'
OF_ENCODERS = (SPOOL, ENCODER_ZEROS, AXIAL)  # parameters that encoder readings depend on
DAMPING, DRAG, ADDED_MASS = OF_MOTION = 'damping', 'drag', 'added_mass'
OF_WATER = DRAG, ADDED_MASS
BENDING, REST_CURVATURE, REST_TORSION = 'bending_stiffness', 'rest_curvature', 'rest_torsion'
OF_REST = tuple(f'{REST_CURVATURE}_{axis}' for axis in 'nb')
FITS = (
    'youngs_modulus',
    BENDING,
    'poisson_ratio',
    SHEATH,
    'tendon_offsets',
    'friction',
    'tension_scale',
    'tension_offset',
    'alignment',
    REST_CURVATURE,
    REST_TORSION,
    SPOOL,
    ENCODER_ZEROS,
    AXIAL,
    *OF_MOTION,
)
ALIGNMENT = tuple(f'alignment_{part}' for part in ('x', 'y', 'z', 'turn_x', 'turn_y', 'turn_z'))
OFFSET, ZERO = 'tendon_offset.', 'encoder_zero.'  # prefixes of the name of a tendon
_BY_LOAD_CELLS = ('tension_scale', 'tension_offset')
_FARTHEST = 10.0  # bound of logarithms
_ROUGHEST = 2.0  # largest fitted coefficient of friction [-]
_ROUGH = 0.1  # initial coefficient of friction if the config has none [-]
_THREAD = 200.0  # initial E A of tendons over their highest tension, if the config has none
_SOFTEST = 1e6  # initial stiffness of tendons over the least fitted one


class Scale(Enum):
    """The function that maps a component of x to the value of an unknown."""

    VALUE = auto()
    LOGARITHM = auto()
    INVERSE = auto()


@dataclass(frozen=True)
class Unknown:
    """One number to fit."""

    name: str  #: name of the parameter
    unit: str  #: unit of the parameter
    start: float  #: initial value of x
    scale: float  #: a large change of x
    low: float = -math.inf  #: least value of x
    high: float = math.inf  #: largest value of x
    kind: Scale = Scale.VALUE  #: meaning of x
    #: value of the parameter at x = 0 of a logarithm, or at x = 1 of an inverse
    reference: float = 1.0

    def value(self, x: float) -> float:
        """Return the value of the parameter at ``x``."""
        if self.kind is Scale.LOGARITHM:
            return self.reference * math.exp(x)
        if self.kind is Scale.INVERSE:
            return self.reference / x if x > 0.0 else math.inf
        return x

    def relative_change(self, x: float, step: float) -> float | None:
        """Return the relative change of the value by a ``step`` of x; None if x is the value."""
        if self.kind is Scale.VALUE:
            return None
        return step if self.kind is Scale.LOGARITHM else -step / max(x, 1e-300)

    def stddev(self, x: float, deviation: float) -> float:
        """Return the standard deviation of the value for a ``deviation`` of x, to first order."""
        relative = self.relative_change(x, deviation)
        return deviation if relative is None else self.value(x) * abs(relative)


def _check_fits(fits: Sequence[str], model: str, is_driven: bool, moves: bool) -> None:
    """Check that ``model`` has a derivative by each of ``fits``; ConfigError if not.

    ``is_driven`` says that tensions follow from lengths, ``moves`` that the arm moves.
    """
    if is_driven and model != 'exact':
        raise ConfigError(
            f'without load cells tensions follow from lengths, which the model {model} does not '
            'know: choose --model exact'
        )
    not_moving = ('alignment', *_BY_LOAD_CELLS, *OF_ENCODERS)
    not_in_paper = ('friction', BENDING, REST_CURVATURE, REST_TORSION)
    refused = (
        (moves, not_moving, '{} is not fitted to an arm that moves, expected one at rest'),
        (not moves, OF_MOTION, '{} shows in a motion alone: --dynamic is missing'),
        (
            model != 'exact',
            ('poisson_ratio', 'tendon_offsets', SHEATH),
            f'the model {model} has no derivative by {{}}: choose --model exact',
        ),
        (
            model == 'renda2012',
            not_in_paper,
            'the model renda2012 has no {}: choose another --model',
        ),
        (is_driven, _BY_LOAD_CELLS, '{} is of load cells, and there are none in this recording'),
    )
    for name in fits:
        if name not in FITS:
            raise ConfigError(f'cannot fit {name!r}, expected one of {", ".join(FITS)}')
        for holds, names, why in refused:
            if holds and name in names:
                raise ConfigError(why.format(name))


def unknowns_of(
    config: Config, pulled: Sequence[str], encoders: Sequence[str], alignment: Pose
) -> dict[str, list[Unknown]]:
    """Return the unknowns of each of `FITS` for the arm of ``config``.

    ``pulled`` names the tendons under tension, ``encoders`` those among them with an encoder, and
    ``alignment`` is the start of its own fit.
    """
    arm, material, motion = config.arm, config.arm.material, config.motion
    young, away = float(material.youngs_modulus_at(0.0)), 5e-3 * arm.length  # a large offset [m]
    highest = float(default_highest(arm).max())

    def ratio(name: str, unit: str, first: float) -> list[Unknown]:
        ends = -_FARTHEST, _FARTHEST
        return [Unknown(name, unit, 0.0, 1.0, *ends, Scale.LOGARITHM, first)]

    poisson = float(material.poisson_ratio_at(0.0))
    torsion, *curvatures = arm.rest.at(np.zeros(1))[:, 0].tolist()
    # A fit that starts at zero, the end of a range, would hardly leave it.
    damping = ('Pa s', motion.viscosity, 0.01 * young / 3.0) if motion.viscosity else None
    unit, damped, usual = damping or ('s', motion.damping_time or 0.01, 0.01)
    rough = float(np.mean(arm.friction or (_ROUGH,)))
    thread = float(np.mean(arm.axial_stiffness or (0.0,))) or _THREAD * highest
    spool = float(np.mean(np.abs(config.encoders.scale or (1.0,))))
    sheath = arm.sheath_stiffness[0] if arm.sheath_stiffness else 0.0
    units = 3 * [('m', away)] + 3 * [('rad', 1e-2)]
    pose = zip(ALIGNMENT, units, (*alignment.position, *alignment.rotation.as_rotvec()))
    return {
        'youngs_modulus': ratio('youngs_modulus', 'Pa', young),
        BENDING: ratio(BENDING, 'N m^2', math.sqrt(math.prod(_bending(arm)))),
        'poisson_ratio': [Unknown('poisson_ratio', '-', poisson, 0.5, -1.0 + 1e-6, 0.5)],
        SHEATH: ratio(SHEATH, 'Pa', sheath),
        'tendon_offsets': [Unknown(f'{OFFSET}{name}', 'm', 0.0, away) for name in pulled],
        'friction': [Unknown('friction', '-', rough, 0.1, 0.0, _ROUGHEST)],
        'tension_scale': ratio('tension_scale', '-', 1.0),
        'tension_offset': [Unknown('tension_offset', 'N', 0.0, 0.02 * highest)],
        'alignment': [Unknown(part, unit, float(at), size) for part, (unit, size), at in pose],
        REST_CURVATURE: [
            Unknown(part, '1/m', first, 0.1 / arm.length)
            for part, first in zip(OF_REST, curvatures, strict=True)
        ],
        REST_TORSION: [Unknown(REST_TORSION, '1/m', torsion, 0.1 / arm.length)],
        SPOOL: ratio(SPOOL, 'm', spool),
        ENCODER_ZEROS: [Unknown(f'{ZERO}{name}', 'm', 0.0, away) for name in encoders],
        AXIAL: [Unknown(AXIAL, 'N', 1.0, 1.0, 0.0, _SOFTEST, Scale.INVERSE, thread)],
        DAMPING: [Unknown(DAMPING, unit, damped, usual, 0.0)],
        DRAG: [Unknown(DRAG, '-', motion.normal_drag or 1.0, 1.0, 0.0)],
        ADDED_MASS: [Unknown(ADDED_MASS, '-', motion.added_mass or 1.0, 1.0, 0.0)],
    }


def _bending(arm: Arm) -> list[float]:
    """Return E J about n and about b [N m^2] of ``arm`` at its base."""
    found = SectionStiffness.at(arm, np.zeros(1))
    return [found.bending_n.item(), found.bending_b.item()]


def _check_arm(parameters: Mapping[str, Any], config: Config, fits: Sequence[str]) -> None:
    """Check that there is water, and that parameters fitted as one number are constant along s.

    ConfigError if not.
    """
    wet = [name for name in fits if name in OF_WATER]
    if wet and not config.loads.fluid_density:
        raise ConfigError(f'{wet[0]} is of the water, and loads.fluid_density is 0')
    arm = config.arm
    for name, table in (
        (REST_CURVATURE, 'rest.table_curvature'),
        (REST_TORSION, 'rest.table_torsion'),
        (BENDING, 'stiffness.table_bending'),
        ('poisson_ratio', 'material.table_poisson_ratio'),
    ):
        tables = [one for one in parameters if one.startswith(table)]
        if name in fits and any(parameters[one] for one in tables):
            raise ConfigError(f'{name} cannot be fitted: the config has a table of it')
    if BENDING in fits:
        stiffness = SectionStiffness.at(arm, np.linspace(0.0, arm.length, FINE_STATIONS))
        for along in (stiffness.bending_n, stiffness.bending_b):
            if np.ptp(along) > 1e-9 * along[0]:
                raise ConfigError(
                    f'{BENDING} cannot be fitted: E J is {along.min():.4g} to {along.max():.4g} '
                    'N m^2 along the arm, expected one number: fit youngs_modulus'
                )


def is_of_arm(name: str) -> bool:
    """Whether an unknown belongs to the arm and its load cells.

    Poses of a camera and zeros of encoders do not; they are fitted for the sake of others.
    """
    return name not in ALIGNMENT and not name.startswith(ZERO)


class Readings(NamedTuple):
    """Readings of the tendons in all steps."""

    tensions: FloatArray  #: tensions (steps, tendons) [N]
    displacements: FloatArray  #: encoder readings (steps, tendons) [m], NaN without an encoder
    are_lengths: bool = False  #: whether tensions follow from displacements instead of load cells

    @classmethod
    def of(cls, shapes: Sequence[MeasuredShape]) -> 'Readings':
        """Return the readings in the windows of measured ``shapes``."""
        tensions = np.array([shape.window.tensions for shape in shapes])
        none = np.full(tensions.shape[1], np.nan)
        read = [shape.window.displacements for shape in shapes]
        displacements = np.array([none if row is None else row for row in read])
        return cls(tensions, displacements, any(shape.window.is_driven for shape in shapes))


def move_tendons(
    values: Mapping[str, Any], arm: Arm, moved: Mapping[str, float]
) -> dict[str, Any]:
    """Return the parameters of ``arm`` with each tendon ``moved`` [m] away from the midline.

    A section has one distance for all its tendons, so that the paths become tables.
    """
    # Paths of sections are linear in s, and have no effect beyond their anchorages.
    s = np.array(values.get('tendons.table_s') or (0.0, arm.length))
    pairs = zip(arm.tendons, arm.tendon_names, strict=True)
    offsets = [tendon.offset.value(s) + moved[name] for tendon, name in pairs]
    angles = [tendon.angle.value(s) for tendon in arm.tendons]
    sections = 'sections.offset_base', 'sections.offset_anchorage'
    replaced = {*sections, 'tendons.angle', 'tendons.twist'}
    return {name: value for name, value in values.items() if name not in replaced} | {
        'tendons.table_s': s.tolist(),
        'tendons.table_angle': np.concatenate(angles).tolist(),
        'tendons.table_offset': np.concatenate(offsets).tolist(),
    }


_STIFF_SHEATH = 10.0  # initial stiffness of sheaths over the shear modulus, if the arm has none
_EXACT_PARAMETERS = (
    'material.poisson_ratio_stddev',
    'tendons.offset_stddev',
    'tendons.sheath_stiffness',
)
# Enough for the polygon through the stations to be as accurate as the curve.
FINE_STATIONS = 201
_PULLED = 1e-2  # part of the highest tension below which tendons count as slack


class Unknowns:
    """The unknowns of one model, as a vector.

    Attributes:
        model: name of the model.
        arm: the initial arm.
        unknowns: the components of the vector.
        names: names of the components.
        start: the initial vector.
        readings: readings of the tendons.
        slack: tension below which a tendon counts as slack [N].
        taut: which tendons with an encoder reading are not slack, (steps, tendons); readings of
            slack tendons are not used.
        reads_encoders: whether encoder readings are residuals of the fit.
    """

    def __init__(
        self,
        parameters: Mapping[str, Any],
        model: str,
        fits: Sequence[str],
        readings: Readings,
        alignment: Pose,
        without: Collection[str] = (),
        moves: bool = False,
    ) -> None:
        """Set up the unknowns of ``fits`` of `FITS`, from ``parameters`` and ``alignment``.

        ``readings`` show which tendons are pulled, and which have encoders. Components named in
        ``without`` keep their values. ``moves`` says that the arm moves.

        Raises:
            ConfigError: if the model has no derivative by one of them, or no reading shows it.
        """
        _check_fits(fits, model, readings.are_lengths, moves)
        self.model, self.readings = model, readings
        self._alignment = *alignment.position, *alignment.rotation.as_rotvec()
        self._parameters = {**parameters, 'model': model}
        if model != 'exact':
            for name in _EXACT_PARAMETERS:
                self._parameters.pop(name, None)
        config = Config.from_parameters(self._parameters)
        material = config.arm.material
        _check_arm(self._parameters, config, fits)
        if self._parameters.get('material.shear_modulus'):
            # E is fitted at constant nu, so that G changes with it.
            self._parameters['material.shear_modulus'] = 0.0
            self._parameters['material.poisson_ratio'] = float(material.poisson_ratio_at(0.0))
        if SHEATH in fits and SHEATH not in without:
            # All tendons share one stiffness, whose logarithm never reaches that of rigid sheaths.
            known = config.arm.sheath_stiffness or (_STIFF_SHEATH * material.shear_modulus,)
            self._parameters['tendons.sheath_stiffness'] = [float(np.mean(known))]
            config = Config.from_parameters(self._parameters)
        self._motion = config.motion
        self.arm, self._cells, self._encoders = config.arm, config.load_cells, config.encoders
        self._fits_encoders = {SPOOL, ENCODER_ZEROS} & {*fits}
        self.slack = _PULLED * float(readings.tensions.max(initial=0.0))
        self._pulled = readings.tensions.max(axis=0, initial=0.0) > self.slack
        self.taut = (readings.tensions > self.slack) & np.isfinite(readings.displacements)
        of_encoders = [name for name in OF_ENCODERS if name in fits]
        if of_encoders and not self.taut.any():
            raise ConfigError(
                f'{of_encoders[0]} shows in encoder readings of tendons under tension, and this '
                'recording has none, or displacement_offset makes them slack'
            )
        # Encoder readings are residuals if nothing else depends on the fitted parameters.
        self.reads_encoders = bool(of_encoders) and not readings.are_lengths
        # Tendons stretch from their taut length, which is not known exactly. If the two together
        # are undetermined the stiffness is left out, because it comes last.
        wanted = {*fits, *([ENCODER_ZEROS] if AXIAL in fits else [])}
        names = np.array(self.arm.tendon_names)
        pulled, encoders = names[self._pulled].tolist(), names[self.taut.any(axis=0)].tolist()
        candidates = unknowns_of(config, pulled, encoders, alignment)
        wanted_ones = (one for name in FITS if name in wanted for one in candidates[name])
        self.unknowns = tuple(one for one in wanted_ones if one.name not in without)
        if not self.unknowns and not without:
            raise ConfigError('nothing to fit: no tendon is pulled')
        self.start = np.array([unknown.start for unknown in self.unknowns])
        self.names = tuple(unknown.name for unknown in self.unknowns)

    @property
    def bounds(self) -> tuple[list[float], list[float]]:
        """The least and the largest values of x."""
        return [one.low for one in self.unknowns], [one.high for one in self.unknowns]

    def values(self, x: FloatArray) -> dict[str, float]:
        """Return the values of the unknowns at ``x`` by name."""
        return {one.name: one.value(at) for one, at in zip(self.unknowns, x.tolist(), strict=True)}

    def alignment(self, x: FloatArray) -> Pose:
        """Return the transform camera to base at ``x``."""
        found, begun = self.values(x), self._alignment
        parts = [found.get(name, one) for name, one in zip(ALIGNMENT, begun, strict=True)]
        turn = Rotation.from_rotvec(parts[3:])
        return Pose((parts[0], parts[1], parts[2]), tuple(turn.as_quat()))

    def inputs(self, x: FloatArray) -> FloatArray:
        """Return what acts on the tendons in all steps at ``x``, (steps, tendons).

        These are tensions [N], where slack tendons have no offset, or without load cells the
        lengths reeled in [m], NaN without an encoder.
        """
        read = self.readings.tensions
        if self.readings.are_lengths:
            begun = self.readings.displacements - self._encoder_offset
            return self._spool(x) * begun + self._encoder_offset - self._zeros(x)
        scale, offset = self._cell_changes(x)
        return np.maximum(scale * read + offset * (read > self.slack), 0.0)

    def parameters(self, x: FloatArray) -> dict[str, Any]:
        """Return the parameters of the arm, its load cells and its encoders at ``x``."""
        found = self.values(x)
        values, count = dict(self._parameters), len(self.arm.tendons)
        if self._cell_changes(x) != (1.0, 0.0):
            values |= self._load_cells(x)
        if (young := found.get('youngs_modulus')) is not None:
            # A modulus that varies along the arm and a given stiffness get the same factor.
            factor = young / float(self.arm.material.youngs_modulus_at(0.0))
            scaled = {name for name in values if name.startswith('stiffness.')}
            scaled -= {'stiffness.table_s'}
            if values.get('material.table_s'):
                scaled.add('material.table_youngs_modulus')
            else:
                values['material.youngs_modulus'] = young
            values |= {name: (factor * np.array(values[name])).tolist() for name in scaled}
        if BENDING in found:
            first = _bending(self.arm)
            factor = found[BENDING] / math.sqrt(math.prod(first))
            values['stiffness.bending'] = [factor * one for one in first]
        if {*OF_REST} & found.keys():
            _, *curvatures = self.arm.rest.at(np.zeros(1))[:, 0].tolist()
            pairs = zip(OF_REST, curvatures, strict=True)
            values[REST_CURVATURE] = [found.get(name, one) for name, one in pairs]
        for name, parameter, is_list in (
            (REST_TORSION, REST_TORSION, False),
            ('poisson_ratio', 'material.poisson_ratio', False),
            (SHEATH, 'tendons.sheath_stiffness', True),
            ('friction', 'tendons.friction', True),
            (AXIAL, 'tendons.axial_stiffness', True),
        ):
            if name in found:  # tendons that do not stretch have the stiffness 0
                value = found[name] if math.isfinite(found[name]) else 0.0
                values[parameter] = [value] if is_list else value
        if self._fits_encoders:
            radii = np.broadcast_to(self._encoders.scale or 1.0, count)
            values[SPOOL] = (self._spool(x) * radii).tolist()
            values[ENCODER_ZEROS] = (self._encoder_offset - self._zeros(x)).tolist()
        if {*OF_MOTION} & found.keys():
            motion = self._motion
            damping = 'viscosity' if motion.viscosity else 'damping_time'
            values |= {
                f'motion.{damping}': found.get(DAMPING, getattr(motion, damping)),
                'motion.water': '',
                'motion.normal_drag': found.get(DRAG, motion.normal_drag),
                'motion.tangential_drag': motion.tangential_drag,
                'motion.added_mass': found.get(ADDED_MASS, motion.added_mass),
            }
        moved = {name: found.get(f'{OFFSET}{name}', 0.0) for name in self.arm.tendon_names}
        return move_tendons(values, self.arm, moved) if any(moved.values()) else values

    def _cell_changes(self, x: FloatArray) -> tuple[float, float]:
        """Return scale [-] and offset [N] of the tensions at ``x`` over the readings."""
        found = self.values(x)
        return found.get('tension_scale', 1.0), found.get('tension_offset', 0.0)

    def _load_cells(self, x: FloatArray) -> dict[str, Any]:
        """Return the parameters of load cells that give the tensions `inputs` at ``x``."""
        cells, count, (scale, offset) = self._cells, len(self.arm.tendons), self._cell_changes(x)
        # Slack tendons have no offset: what they read, 0 unless said, is within the deadband.
        band = scale * max(cells.deadband, float(self.slack) if offset else 0.0)
        is_read = (self.readings.tensions > self.slack)[:, self._pulled]
        if not (is_read.all() and (self.inputs(x)[:, self._pulled] <= band).any()):
            band += abs(offset)
        begun = np.array(cells.offset or count * (0.0,))
        return {
            'tension_scale': (scale * np.array(cells.scale or count * (1.0,))).tolist(),
            'tension_offset': (scale * begun + offset * self._pulled).tolist(),
            'tension_deadband': band,
        }

    def solver(self, x: FloatArray) -> Solver:
        """Return the solver of the arm at ``x``; ArmDefinitionError if the arm is impossible."""
        config = Config.from_parameters(self.parameters(x))
        return config.solver(stations=max(config.stations, FINE_STATIONS))

    def readings_of(self, x: FloatArray, lengths: FloatArray) -> FloatArray:
        """Return the encoder readings for reeled-in ``lengths`` (steps, tendons) [m]."""
        begun = lengths + self._zeros(x) - self._encoder_offset
        return begun / self._spool(x) + self._encoder_offset

    def _spool(self, x: FloatArray) -> float:
        """Return the radius of the spools over that in the config [-]."""
        return math.exp(x[self.names.index(SPOOL)]) if SPOOL in self.names else 1.0

    @property
    def _encoder_offset(self) -> FloatArray:
        return np.broadcast_to(np.array(self._encoders.offset or 0.0), len(self.arm.tendons))

    def _zeros(self, x: FloatArray) -> FloatArray:
        """Return the encoder readings of the taut unloaded arm, (tendons,) [m]."""
        found = self.values(x)
        return np.array([found.get(f'{ZERO}{name}', 0.0) for name in self.arm.tendon_names])
