"""Build the parts of an arm, and the calibration of its load cells, from its parameters."""

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.arm import Arm, check_size
from octo_arm_model.arm.body import Body, GivenStiffness, ProfiledBody, RectangularBody, RestShape
from octo_arm_model.arm.errors import ArmDefinitionError, ConfigError, TensionError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.material import Material
from octo_arm_model.arm.profile import LINEAR, Constant, Profile, Table
from octo_arm_model.arm.tendon import Discs, RoutedSection, Section, Tendon, check_angle
from octo_arm_model.arm.validation import finite
from octo_arm_model.config.parameter import Values, check_length
from octo_arm_model.rod.checks import check_tensions
from octo_arm_model.rod.sensitivity import Uncertainty

_ROUNDING = 1e-15  # relative to an offset: rounding of the sum of reading and offset


@dataclass(frozen=True)
class LoadCellCalibration:
    """The calibration of the load cells of an arm: tension = scale * reading + offset.

    A tension within the deadband about zero is then set to zero, since load cells of slack tendons
    read small values of either sign. A tension below minus the deadband is refused.

    Attributes:
        deadband: largest magnitude of a tension that is set to zero [N], >= 0.
        offset: offset for each tendon [N]; empty for no offsets.
        scale: scale for each tendon [-], > 0; empty for 1.
        names: name of each tendon in incoming messages, as in `wire.tensions`; empty for the
            names of the tendons.
    """

    deadband: float = 0.0
    offset: tuple[float, ...] = ()
    scale: tuple[float, ...] = ()
    names: tuple[str, ...] = ()

    @functools.cached_property
    def is_identity(self) -> bool:
        """Whether readings are tensions as they are."""
        return not (self.deadband or any(self.offset) or any(k != 1.0 for k in self.scale))

    def tensions(self, arm: Arm, readings: ArrayLike) -> FloatArray:
        """Return tensions of ``arm`` for ``readings``, both (..., *`Arm.tension_shape`) [N].

        Raises:
            TensionError: if the shape is wrong, or a tension is not finite or below minus the
                deadband; the message names the tendon.
        """
        array, shape = np.asarray(readings), arm.tension_shape
        is_set = array.dtype.kind in 'fiu' and array.shape[-len(shape) :] == shape
        if self.is_identity or not is_set:
            return check_tensions(arm, readings)  # raises the error of what is no set
        tensions = self.scale_and_offset(array.astype(np.float64))
        try:
            return check_tensions(arm, tensions)
        except TensionError as error:
            raise TensionError(
                f'{error} after tension_scale and tension_offset, or within the tension_deadband '
                f'of {self.deadband:g} N'
            ) from None

    def scale_and_offset(self, readings: FloatArray) -> FloatArray:
        """Return tensions for ``readings``, (..., tendons) or (..., *`Arm.tension_shape`) [N].

        No tension is refused: those below minus the deadband are returned as they are.
        """
        flat, count = readings, max(len(self.scale), len(self.offset))
        if count and readings.shape[-1] != count:
            # If all sections have equal numbers of tendons, each is a row.
            flat = readings.reshape(*readings.shape[:-2], count)
        offset = np.array(self.offset or 0.0)
        with np.errstate(all='ignore'):  # a value that is not finite is refused as a tension
            tensions = flat * (self.scale or 1.0) + offset
        band = np.maximum(self.deadband, _ROUNDING * np.abs(offset))
        return np.where(np.abs(tensions) <= band, 0.0, tensions).reshape(readings.shape)

    def readings(self, tensions: FloatArray) -> FloatArray:
        """Return what load cells without errors read under ``tensions`` (tendons,) [N]."""
        return np.asarray((tensions - np.array(self.offset or 0.0)) / (self.scale or 1.0))


@dataclass(frozen=True)
class EncoderCalibration:
    """The calibration of the encoders of winches: length reeled in = scale * reading + offset.

    Attributes:
        names: name of the reading of each tendon in incoming messages, as in `wire.tensions`;
            tendons of one motor have the same name; empty for the names of the tendons.
        scale: scale for each tendon [m per unit of the reading]: radius of the spool for radians,
            < 0 if the motor lets the tendon out as it turns forwards; empty for 1.
        offset: offset for each tendon [m]; empty for no offsets.
    """

    names: tuple[str, ...] = ()
    scale: tuple[float, ...] = ()
    offset: tuple[float, ...] = ()

    @property
    def is_identity(self) -> bool:
        """Whether readings are lengths under the names of their tendons."""
        return self == EncoderCalibration()

    def lengths(self, readings: FloatArray) -> FloatArray:
        """Return the lengths reeled in [m] for ``readings``, both (..., tendons)."""
        return np.asarray(readings * (self.scale or 1.0) + np.array(self.offset or 0.0))


def build_arm(given: Values) -> Arm:
    """Return the arm with the parameters ``given``.

    Raises:
        ConfigError: if a list has the wrong length.
        ArmDefinitionError: if the arm cannot exist.
    """
    return Arm(
        _material(given),
        _body(given),
        _sections(given),
        given['tendon_names'],
        axial_stiffness=given['tendons.axial_stiffness'],
        free_length=given['tendons.free_length'],
        sheath_stiffness=given['tendons.sheath_stiffness'],
        friction=given['tendons.friction'],
        stiffness=_stiffness(given),
        rest=_rest(given),
        discs=_discs(given),
    )


def build_load_cells(given: Values, arm: Arm) -> LoadCellCalibration:
    """Return the calibration of the load cells of ``arm``.

    Raises:
        ConfigError: if offsets, scales or names are given, but not one for each tendon.
    """
    names = given['tension_names']
    distinct = [name for name in names if name != '-']
    if len(set(distinct)) < len(distinct) or '' in names or (names and not distinct):
        expected = 'distinct names or -, one name at least'
        raise ConfigError(f'tension_names is {shown(list(names))}, expected {expected}')
    lists = 'tension_offset', 'tension_scale', 'tension_names'
    check_each(given, arm, *lists)
    return LoadCellCalibration(given['tension_deadband'], *(tuple(given[name]) for name in lists))


def build_encoders(given: Values, arm: Arm) -> EncoderCalibration:
    """Return the calibration of the encoders of ``arm``.

    Raises:
        ConfigError: if offsets, scales or names are given, but not one for each tendon.
        ArmDefinitionError: if a scale is 0.
    """
    names, scale = given['displacement_names'], tuple(given['displacement_scale'])
    if '' in names:
        raise ConfigError(f'displacement_names is {shown(list(names))}, expected names or -')
    for factor in scale:
        if not finite('displacement_scale', factor):
            expected = 'a finite number other than 0 [m per unit of the reading]'
            raise ArmDefinitionError('displacement_scale', factor, expected)
    scale = len(arm.tendons) * scale if len(scale) == 1 else scale
    scaled = {**given, 'displacement_scale': scale}
    check_each(scaled, arm, 'displacement_names', 'displacement_scale', 'displacement_offset')
    return EncoderCalibration(tuple(names), scale, tuple(given['displacement_offset']))


def check_each(given: Values, arm: Arm, *names: str) -> None:
    """Check that each of the lists ``names`` is empty or has a value for each tendon of ``arm``.

    Raises:
        ConfigError: if a list has another number of values.
    """
    for name in names:
        if given[name]:
            check_length(name, given[name], len(arm.tendons), ', one per tendon')


def build_uncertainty(given: Values, arm: Arm) -> Uncertainty:
    """Return standard deviations of tensions, displacements, material and offsets of tendons."""
    model = given['model_error_stddev']
    return Uncertainty(
        tension=given['tension_stddev'],
        displacement=given['displacement_stddev'],
        youngs_modulus=given['material.youngs_modulus_stddev'],
        poisson_ratio=given['material.poisson_ratio_stddev'],
        offset=given['tendons.offset_stddev'],
        # An error of the curvature that is constant along the arm and moves the tip by d turns
        # the tip by 2 d / length.
        model_position=model * arm.length,
        model_rotation=2.0 * model,
    )


def _material(given: Values) -> Material:
    density, ratio = given['material.density'], given['material.poisson_ratio']
    shear = given['material.shear_modulus']
    s = given['material.table_s']
    if s:
        young = _table(given, 'material.table_youngs_modulus', s)
        if given['material.table_poisson_ratio']:
            ratio = _table(given, 'material.table_poisson_ratio', s)
        return Material(young, ratio, density)
    young = given['material.youngs_modulus']
    return (
        Material.from_moduli(young, shear, density) if shear else Material(young, ratio, density)
    )


def _discs(given: Values) -> Discs:
    s, count = given['tendons.discs'], given['tendons.disc_count']
    disc = given['tendons.disc_thickness'], given['tendons.disc_mass']
    return Discs.evenly(count, given['body.length'], *disc) if count else Discs(s, *disc)


def _body(given: Values) -> Body | ProfiledBody | RectangularBody:
    length, discs = given['body.length'], given['body.disc_radius']
    width, height = (_along(given, 'body', x, given[f'body.{x}']) for x in ('width', 'height'))
    bore = _along(given, 'body', 'inner_radius', given['body.inner_radius'])
    if width != 0.0 or height != 0.0:
        _all_along(given, 'body', {'width': 0.0, 'height': 0.0})
        return RectangularBody(length, width, height, discs)
    if given['body.table_s']:
        radius = _table(given, 'body.table_radius', given['body.table_s'])
        return ProfiledBody(length, radius, discs, bore)
    return Body(length, given['body.radius_base'], given['body.radius_tip'], discs, bore)


def _stiffness(given: Values) -> GivenStiffness:
    bending = given['stiffness.bending'] or (0.0,)
    if len(bending) not in (1, 2):
        check_length('stiffness.bending', bending, 2, ', about n and about b, or one for both')
    values = {
        'axial': given['stiffness.axial'],
        'bending_n': bending[0],
        'bending_b': bending[-1],
        'torsion': given['stiffness.torsion'],
    }
    return GivenStiffness(**_all_along(given, 'stiffness', values))


def _rest(given: Values) -> RestShape:
    curvature = given['rest_curvature']
    check_length('rest_curvature', curvature, 2, ', about n and about b')
    values = {
        'curvature_n': curvature[0],
        'curvature_b': curvature[1],
        'torsion': given['rest_torsion'],
    }
    return RestShape(**_all_along(given, 'rest', values))


def _all_along(
    given: Values, group: str, constants: Mapping[str, float]
) -> dict[str, float | Profile]:
    """Return the profiles in the tables of a ``group``, or its ``constants`` without a table."""
    tables = [f'{group}.table_{name}' for name in constants]
    if given[f'{group}.table_s'] and not any(given[table] for table in tables):
        raise ConfigError(f'{group}.table_s has no effect without one of {", ".join(tables)}')
    return {name: _along(given, group, name, value) for name, value in constants.items()}


def _along(given: Values, group: str, name: str, constant: float) -> float | Profile:
    """Return the profile ``name`` in a table of a ``group``, or the ``constant`` without one."""
    table, s = f'{group}.table_{name}', f'{group}.table_s'
    if not given[table]:
        return constant
    if constant:
        raise ConfigError(f'{table} and the same for all s are given, expected one of both')
    return _table(given, table, given[s])


def _sections(given: Values) -> tuple[Section | RoutedSection, ...]:
    anchorages = given['sections.anchorage']
    count = len(anchorages)
    expected = ' like sections.anchorage, one per section'
    numbers = given['sections.tendons'] or count * (4,)
    check_length('sections.tendons', numbers, count, expected)
    for number in numbers:
        if number < 1:
            raise ConfigError(f'sections.tendons is {list(numbers)}, expected at least 1 each')
    total = sum(numbers)
    check_size(count, total)
    angles = given['tendons.angle'] or tuple(
        2.0 * math.pi * j / number for number in numbers for j in range(number)
    )
    twists = given['tendons.twist'] or total * (0.0,)
    for name, column in (('tendons.angle', angles), ('tendons.twist', twists)):
        check_length(name, column, total, ', one per tendon')
    for number, angle in enumerate(angles):
        check_angle(f'tendons.angle[{number}]', angle)
    ends = itertools.accumulate(numbers)
    parts = [slice(end - number, end) for number, end in zip(numbers, ends, strict=True)]
    if given['tendons.table_s']:
        tendons = _routed(given, angles, total)
        return tuple(
            RoutedSection(anchorage, tuple(tendons[part]))
            for anchorage, part in zip(anchorages, parts, strict=True)
        )
    offsets = [given[f'sections.offset_{end}'] for end in ('base', 'anchorage')]
    for end, column in zip(('base', 'anchorage'), offsets, strict=True):
        check_length(f'sections.offset_{end}', column, count, expected)
    return tuple(
        Section(anchorage, base, end, angles[part], twists[part])
        for anchorage, base, end, part in zip(anchorages, *offsets, parts, strict=True)
    )


def _routed(given: Values, angles: Sequence[float], total: int) -> list[Tendon]:
    """Return the tendons with paths from tables."""
    s, between = given['tendons.table_s'], given['tendons.table_between']
    if between == LINEAR and any(given['tendons.friction']):
        raise ConfigError(
            'tendons.table_between is linear, and tendons.friction is given: it has no friction '
            'at kinks, expected pchip'
        )

    def tables(name: str) -> list[Profile]:
        column, count = given[f'tendons.table_{name}'], len(s)
        what = f', {count} for each of {total} tendons'
        check_length(f'tendons.table_{name}', column, total * count, what)
        rows = [column[j * count : (j + 1) * count] for j in range(total)]
        return [Table(s, row, f'{name} of tendon {j}', between) for j, row in enumerate(rows, 1)]

    offsets = tables('offset')
    directions = tables('angle') if given['tendons.table_angle'] else map(Constant, angles)
    return list(map(Tendon, offsets, directions))


def _table(given: Values, name: str, s: Sequence[float]) -> Table:
    check_length(name, given[name], len(s), f', one for each of {name.split(".")[0]}.table_s')
    return Table(tuple(s), tuple(given[name]), name)
