"""What a solution is refused for: no material and no sheath bears it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.errors import ConvergenceError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.material import LINEAR
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

SHORTEST_FIBRE = 0.02  # of its reference length
_SHORTENS = 1.0  # tension over E A that would shorten a straight rod to nothing


def check_solution(problem: Problem, state: State, is_loaded: bool) -> None:
    """Refuse a ``state`` of ``problem`` that cannot be trusted.

    Raises:
        SolveError: if there is a place for that; the message states its arc coordinate.
    """
    check_stretches(problem, state.z)
    check_contact(problem, state)
    if problem.tables.compliance.any():
        check_tendons(problem, state)
        if not is_loaded:
            check_stable(problem, state)


def check_contact(problem: Problem, state: State) -> None:
    """Refuse a midline inside an obstacle."""
    if problem.contact is not None:
        problem.load_work(state)
        problem.contact.check_depths(problem.places())


def explain(problem: Problem, tensions: FloatArray, error: ConvergenceError) -> SolveError:
    """Why cross sections under ``tensions`` (N, J) [N] have no balance, after ``error``."""
    tables = problem.tables
    pull = (tensions * tables.reach).max(axis=1) / tables.body[:, AXIAL]
    node = int(np.argmax(pull))
    if pull[node] > _SHORTENS:
        s = problem.elements.s[node]
        return SolveError(f'tensions shorten a tendon to nothing at s = {s:.4g} m')
    if tables.compliance.any():
        what = 'the balance of the cross sections, with tendons in compliant sheaths,'
        return ConvergenceError(what, error.residual, error.iterations)
    return error


def explain_discs(
    problem: Problem, tensions: FloatArray, error: ConvergenceError
) -> ConvergenceError:
    """Why an arm under ``tensions`` (J,) [N] has no balance after ``error``, if by its discs.

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
    what = (
        'the balance of an arm that tensions fold between discs that are '
        f'{discs.sizes[discs.piece[node]]:.4g} m apart at s = {problem.elements.s[node]:.4g} m, '
        f'with T h^2 / 12 of {softer[node]:.3g} E J,'
    )
    return ConvergenceError(what, error.residual, error.iterations)


def check_stretches(problem: Problem, z: FloatArray) -> None:
    """Refuse twists ``z`` (N, m) that compress a section, or a fibre of rubber, to nothing.

    The stress of rubber is unbounded at zero length, unlike that of any material.
    """
    stretch = z[:, 3]
    if problem.tables.law != LINEAR:
        shortest = _shortest_fibres(problem.tables, z)
        node = int(np.argmin(shortest))
        if not shortest[node] > SHORTEST_FIBRE:
            raise SolveError(
                'tensions compress a fibre of the arm to nothing at s = '
                f'{problem.elements.s[node]:.4g} m (to {shortest[node]:.2g} of its length, must '
                f'be > {SHORTEST_FIBRE})'
            )
    check_compression(problem.elements.s, stretch)


def check_compression(s: FloatArray, stretch: FloatArray) -> None:
    """Refuse a section of those at ``s`` (n,) [m] whose ``stretch`` (n,) is not positive."""
    worst = int(np.argmin(stretch))
    if not stretch[worst] > 0.0:  # nor NaN
        raise SolveError(
            f'tensions compress the arm to nothing at s = {s[worst]:.4g} m '
            f'(q = {stretch[worst] - 1.0:.4g}, must be > -1)'
        )


def are_stretched(tables: Tables, z: FloatArray, arms: int) -> NDArray[np.bool_]:
    """Whether `check_stretches` passes for each of ``arms`` with twists ``z`` (A N, m), (A,)."""
    fine = z[:, 3] > 0.0
    if tables.law != LINEAR:
        fine &= _shortest_fibres(tables, z) > SHORTEST_FIBRE
    return np.asarray(fine.reshape(arms, -1).all(axis=1), np.bool_)


def _shortest_fibres(tables: Tables, z: FloatArray) -> FloatArray:
    """Length of the shortest fibre of sections of twists ``z`` (N, m) over that at rest, (N,)."""
    body, stretch = tables.body, z[:, 3]
    (width, _, _), (rest, _) = widening(tables.law, stretch), rest_bend(tables.law, stretch)
    about_n = width * z[:, 1] - rest * body[:, REST_N]
    about_b = width * z[:, 2] - rest * body[:, REST_B]
    bend = body[:, SQUARED_N] * about_n**2 + body[:, SQUARED_B] * about_b**2
    return np.asarray(stretch - np.sqrt(bend))


def check_tendons(problem: Problem, state: State) -> None:
    """Refuse tendons that are pressed out of the body."""
    problem.load_work(state)
    tables = problem.tables
    path = tables.tendons[..., [ALONG_N, ALONG_B]]
    moved = path + problem.work.offsets
    squared = (moved * moved).sum(axis=-1)
    farthest = np.maximum((path * path).sum(axis=-1), tables.body[:, RADIUS, np.newaxis] ** 2)
    outside = (squared > farthest) & (state.acting.tensions > 0.0) & (tables.compliance > 0.0)
    _refuse(problem, outside.any(axis=1), 'press a tendon out of the body', 'its sheath is')


def check_stable(problem: Problem, state: State) -> None:
    """Refuse an equilibrium without loads that is no minimum of the energy."""
    problem.form.sections(problem.tables, state.z, state.acting.tensions, problem.work)
    least = np.linalg.eigvalsh(problem.work.hessian)[:, 0]
    _refuse(problem, ~(least > 0.0), 'bend the arm without end', 'sheaths are')


def _refuse(problem: Problem, where: NDArray[np.bool_], effect: str, soft: str) -> None:
    """Raise a `SolveError` at the first of the nodes ``where`` (N,), if any."""
    if where.any():
        at = f's = {problem.elements.s[int(np.argmax(where))]:.4g} m'
        raise SolveError(f'tensions {effect} at {at}: {soft} too soft')
