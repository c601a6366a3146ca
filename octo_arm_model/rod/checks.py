"""Checks of input, of its shapes and sizes, and of solutions that no real arm has."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import (
    ArmDefinitionError,
    ConvergenceError,
    LoadError,
    SolveError,
    TensionError,
    shown,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import Loads
from octo_arm_model.arm.material import LINEAR
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.arm.validation import real_numbers
from octo_arm_model.rod.equilibrium import Problem, State
from octo_arm_model.rod.section_formulas import rest_bend, widening
from octo_arm_model.rod.tables import (
    ALONG_B,
    ALONG_N,
    AXIAL,
    RADIUS,
    REST_B,
    REST_N,
    SQUARED_B,
    SQUARED_N,
    Tables,
    least_bending,
)

# Largest strain of the weakest section, if it were linear [-]. No material bears a tenth of it.
# Under larger forces the search for a balance takes long and fails.
LARGEST_STRAIN = 100.0
_FEW = 64  # count of numbers up to which Python is faster than NumPy


def check_tensions(arm: Arm, tensions: ArrayLike) -> FloatArray:
    """Return ``tensions`` as a float array that ends in the shape `Arm.tension_shape` [N].

    If that is flat, one set may also be given in rows, one for each section.

    Raises:
        TensionError: if the shape is not that of the arm, or a tension is negative or not
            finite; the message names the tendon.
    """
    shape = arm.tension_shape
    if len(shape) == 1:
        tensions = _flatten_rows(arm, tensions)
    array = real_numbers(tensions)
    if array is None or array.shape[-len(shape) :] != shape:
        expected = f'(..., {", ".join(str(count) for count in shape)})'
        if array is None:
            raise TensionError(
                f'tensions are {shown(tensions)}, expected numbers in rows of equal length, of '
                f'shape {expected}'
            )
        meaning = f'{len(arm.tendons)} tendons, section by section from the tip'
        if len(shape) == 2:
            meaning = f'{shape[0]} section(s) from the tip, {shape[1]} tendons each'
        raise TensionError(f'tensions have shape {array.shape}, expected {expected}: {meaning}')
    if not _are_tensions(array):
        bad = ~((array >= 0.0) & (array < np.inf))
        index = tuple(np.argwhere(bad)[0].tolist())
        tendon = int(np.ravel_multi_index(index[-len(shape) :], shape))
        lead = index[: -len(shape)]
        raise TensionError(
            f'tension of {arm.tendon_names[tendon]}{f" in set {lead}" if lead else ""} is '
            f'{float(array[index])!r} N, expected a finite number >= 0'
        )
    return array


def _flatten_rows(arm: Arm, tensions: ArrayLike) -> ArrayLike:
    """Return ``tensions``; if they are one set in rows, one for each section, as one row."""
    rows: Any = tensions if isinstance(tensions, (list, tuple)) else ()
    counts = [len(row) if isinstance(row, (list, tuple)) else None for row in rows]
    if counts == [len(section.tendons) for section in arm.sections]:
        return [tension for row in rows for tension in row]
    return tensions


def check_highest(arm: Arm, highest: ArrayLike) -> FloatArray:
    """Return largest tensions as (tendons,) [N], from one number or an array.

    The array has `Arm.tension_shape`, or one number for each section, (sections, 1).

    Raises:
        TensionError: if it has another shape, or a number is not finite and > 0.
    """
    numbers = real_numbers(highest)
    try:
        limits = np.broadcast_to(np.nan if numbers is None else numbers, arm.tension_shape).ravel()
    except ValueError:
        numbers = None
    if numbers is None:
        raise TensionError(
            f'highest is {shown(highest)}, expected one number or shape {arm.tension_shape}'
        )
    for name, value in zip(arm.tendon_names, limits.tolist(), strict=True):
        if not 0.0 < value < np.inf:
            raise TensionError(
                f'highest tension of {name} is {shown(value)} N, expected a finite number > 0'
            )
    return limits


def tip_wrench_of(given: ArrayLike) -> FloatArray:
    """Return the wrench ``given`` (..., 6) [N, N m] as a float array.

    Raises:
        LoadError: if the wrench is not six finite numbers.
    """
    array = real_numbers(given)
    if array is None or array.shape[-1:] != (6,) or not np.isfinite(array).all():
        raise LoadError(
            f'tip_wrench is {shown(given)}, expected force and moment: (..., 6) finite numbers'
        )
    return array.copy()


class LoadLimits:
    """The largest allowed force and moment on an arm.

    Attributes:
        force: `LARGEST_STRAIN` times the least E A [N].
        moment: `LARGEST_STRAIN` times the root of the least E A times the least E I [N m].
        tension: largest tension under which a balance can be found [N].
    """

    def __init__(self, arm: Arm, s: FloatArray) -> None:
        """Derive the limits from the stiffness of ``arm`` at arc coordinates ``s`` (n,) [m]."""
        stiffness = SectionStiffness.at(arm, s)
        axial, bending = float(stiffness.axial.min()), float(stiffness.bending.min())
        self.force = LARGEST_STRAIN * axial
        # The axial force is a difference of terms of this size; larger ones lose it in rounding.
        self.tension = 1e6 * axial
        self.moment = LARGEST_STRAIN * math.sqrt(axial * bending)
        factor = f'{LARGEST_STRAIN:.0f} times'
        self._force = f'at most {self.force:.4g} N, {factor} the least E A of the arm'
        self._moment = (
            f'at most {self.moment:.4g} N m, {factor} the root of its least E A times its least '
            'E I'
        )

    def check_tensions(self, tensions: FloatArray) -> None:
        """Check the largest of ``tensions`` [N].

        Raises:
            SolveError: if it is too large.
        """
        if (largest := float(tensions.max(initial=0.0))) > self.tension:
            raise SolveError(
                f'tension of {largest:.4g} N is beyond {self.tension:.4g} N, a '
                'million times what would compress the thinnest cross section to nothing'
            )

    def check_tip_wrench(self, wrench: FloatArray) -> None:
        """Check the force and the moment of a ``wrench`` (..., 6) on the tip [N, N m].

        Raises:
            LoadError: if it is too large.
        """
        if (largest := _largest(wrench[..., :3])) > self.force:
            raise LoadError(f'force on the tip is {largest:.4g} N, expected {self._force}')
        if (largest := _largest(wrench[..., 3:])) > self.moment:
            raise LoadError(f'moment on the tip is {largest:.4g} N m, expected {self._moment}')

    def check_loads(self, loads: Loads, resultants: FloatArray) -> None:
        """Check ``loads``, and their ``resultants`` on the cross sections of the straight rod.

        The latter are forces and free moments (2, n, 3) [N, N m].

        Raises:
            ArmDefinitionError: if one is too large, or all together are.
        """
        if _largest(loads.tip_force) > self.force:
            raise ArmDefinitionError('loads.tip_force', loads.tip_force, self._force)
        moments = [('loads.point.moment', point.moment) for point in loads.points]
        for name, moment in [('loads.tip_moment', loads.tip_moment), *moments]:
            if _largest(moment) > self.moment:
                raise ArmDefinitionError(name, moment, self._moment)
        if (largest := _largest(resultants[0])) > self.force:
            raise ArmDefinitionError('force of all loads along the arm', largest, self._force)
        if (largest := _largest(resultants[1])) > self.moment:
            raise ArmDefinitionError('moment of all loads along the arm', largest, self._moment)


def _are_tensions(array: FloatArray) -> bool:
    """Return whether all numbers are finite and not negative."""
    if array.size <= _FEW:
        return all(0.0 <= tension < math.inf for tension in array.ravel().tolist())
    return bool(((array >= 0.0) & (array < np.inf)).all())


def _largest(vectors: FloatArray | tuple[float, ...]) -> float:
    """Return the largest norm of ``vectors`` (..., 3); infinite if one is NaN."""
    if np.ndim(vectors) == 1:  # the case of one arm, much faster than NumPy
        norm = math.hypot(*vectors)
        return math.inf if math.isnan(norm) else norm
    with np.errstate(over='ignore', invalid='ignore'):
        largest = float(np.linalg.norm(vectors, axis=-1).max(initial=0.0))
    return math.inf if math.isnan(largest) else largest


# Solutions ---------------------------------------------------------------------------------------

SHORTEST_FIBRE = 0.02  # least length of a fibre over its reference length
_SHORTENS = 1.0  # tension over E A that would shorten a straight rod to nothing


def check_solution(problem: Problem, state: State, is_loaded: bool) -> None:
    """Refuse a ``state`` of ``problem`` that no real arm has.

    Raises:
        SolveError: if it is refused; the message states the arc coordinate.
    """
    check_stretches(problem, state.z)
    if problem.contact is not None:
        problem.load_work(state)
        problem.contact.check_depths(problem.places())
    if problem.tables.compliance.any():
        _check_tendons(problem, state)
        if not is_loaded:
            _check_stable(problem, state)


def explain(problem: Problem, tensions: FloatArray, error: ConvergenceError) -> SolveError:
    """Return an error that says why sections under ``tensions`` (N, J) [N] have no balance."""
    tables = problem.tables
    pull = (tensions * tables.reach).max(axis=1) / tables.body[:, AXIAL]
    node = int(np.argmax(pull))
    if pull[node] > _SHORTENS:
        s = problem.elements.s[node]
        return SolveError(f'tensions shorten a tendon to nothing at s = {s:.4g} m')
    if tables.compliance.any():
        equations = (
            f'the balance of the cross sections, with {tensions.max():.3g} N in a sheath of '
            f'{1.0 / tables.compliance.max():.3g} Pa (expected tendons.sheath_stiffness to be '
            'larger, or tensions lower),'
        )
        return ConvergenceError(equations, error.residual, error.iterations)
    return error


def explain_discs(
    problem: Problem, tensions: FloatArray, error: ConvergenceError
) -> ConvergenceError:
    """Return an error that says that discs under ``tensions`` (J,) [N] explain it, or ``error``.

    A straight tendon makes an arm softer in bending between discs, by T h^2 / 12 at a distance h.
    """
    discs, tables = problem.discs, problem.tables
    if discs is None:
        return error
    pulled = tables.reach @ tensions
    softer = pulled * discs.sizes[discs.piece] ** 2 / (12.0 * least_bending(tables))
    node = int(np.argmax(softer))
    if not softer[node] > 1.0:
        return error
    equations = (
        'the balance of an arm that tensions fold between discs that are '
        f'{discs.sizes[discs.piece[node]]:.4g} m apart at s = {problem.elements.s[node]:.4g} m, '
        f'with T h^2 / 12 of {softer[node]:.3g} E J,'
    )
    return ConvergenceError(equations, error.residual, error.iterations)


def check_stretches(problem: Problem, z: FloatArray) -> None:
    """Refuse twists ``z`` (N, m) that compress a section, or a fibre of rubber, to nothing.

    The stress of this law is unbounded at zero length, unlike that of real materials.
    """
    if problem.tables.law != LINEAR:
        shortest = _shortest_fibres(problem.tables, z)
        node = int(shortest.argmin())
        if not shortest[node] > SHORTEST_FIBRE:
            raise SolveError(
                'tensions compress a fibre of the arm to nothing at s = '
                f'{problem.elements.s[node]:.4g} m (to {shortest[node]:.2g} of its length, must '
                f'be > {SHORTEST_FIBRE})'
            )
    check_compression(problem.elements.s, z[:, 3])


def check_compression(s: FloatArray, stretch: FloatArray) -> None:
    """Refuse a section of those at ``s`` (n,) [m] whose ``stretch`` (n,) is not positive."""
    worst = int(stretch.argmin())
    if not stretch[worst] > 0.0:  # nor NaN
        raise SolveError(
            f'tensions compress the arm to nothing at s = {s[worst]:.4g} m '
            f'(q = {stretch[worst] - 1.0:.4g}, must be > -1)'
        )


def are_stretched(tables: Tables, z: FloatArray, arms: int) -> NDArray[np.bool_]:
    """Return for which of the ``arms`` with twists ``z`` (A N, m) `check_stretches` passes."""
    is_valid = z[:, 3] > 0.0
    if tables.law != LINEAR:
        is_valid &= _shortest_fibres(tables, z) > SHORTEST_FIBRE
    return np.asarray(is_valid.reshape(arms, -1).all(axis=1), np.bool_)


def _shortest_fibres(tables: Tables, z: FloatArray) -> FloatArray:
    """Return the stretch of the shortest fibre of sections with twists ``z`` (N, m), (N,)."""
    body, stretch = tables.body, z[:, 3]
    (width, _, _), (rest, _) = widening(tables.law, stretch), rest_bend(tables.law, stretch)
    about_n = width * z[:, 1] - rest * body[:, REST_N]
    about_b = width * z[:, 2] - rest * body[:, REST_B]
    bend = body[:, SQUARED_N] * about_n**2 + body[:, SQUARED_B] * about_b**2
    return np.asarray(stretch - np.sqrt(bend))


def _check_tendons(problem: Problem, state: State) -> None:
    """Refuse tendons that are pressed out of the body."""
    problem.load_work(state)
    tables = problem.tables
    path = tables.tendons[..., [ALONG_N, ALONG_B]]
    distance = np.linalg.norm(path + problem.work.offsets, axis=-1)
    outside = distance > np.maximum(np.linalg.norm(path, axis=-1), tables.body[:, [RADIUS]])
    outside &= (state.at_nodes.tensions > 0.0) & (tables.compliance > 0.0)
    _refuse(problem, outside.any(axis=1), 'press a tendon out of the body', 'its sheath is')


def _check_stable(problem: Problem, state: State) -> None:
    """Refuse an equilibrium without loads that is not a minimum of the energy."""
    problem.compute_sections(state)
    least = np.linalg.eigvalsh(problem.work.hessian)[:, 0]
    _refuse(problem, ~(least > 0.0), 'bend the arm without end', 'sheaths are')


def _refuse(problem: Problem, is_refused: NDArray[np.bool_], effect: str, soft: str) -> None:
    """Raise SolveError with the place of the first node that ``is_refused`` (N,), if any."""
    if is_refused.any():
        place = f's = {problem.elements.s[int(np.argmax(is_refused))]:.4g} m'
        raise SolveError(f'tensions {effect} at {place}: {soft} too soft')
