"""Remarks on a fit, in words: what its numbers hold and what they do not."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.fitting.held_back import HeldBackFit, Misfit
from octo_arm_model.experiment.fitting.identification import Identification
from octo_arm_model.experiment.fitting.least_squares.fit import Problem
from octo_arm_model.experiment.fitting.loads import MOST_FOLDS, steps_by_load
from octo_arm_model.experiment.fitting.model_error import noise_of
from octo_arm_model.experiment.fitting.unknowns.unknowns import Unknowns
from octo_arm_model.experiment.shapes.alignment import undetermined
from octo_arm_model.experiment.shapes.branches import (
    STILL,
    UNLOADING,
    directions,
    part_along,
    remarks,
)

_STRONG = 0.95  # correlations above this are reported
# A misfit above so many times that of noise is not explained by noise.
_BIASED = 2.0


def notes_on(
    problem: Problem,
    best: HeldBackFit,
    found: Identification,
    *,
    loose: str,
    fits: Sequence[str],
    tried: Sequence[HeldBackFit],
) -> list[str]:
    """All remarks on the ``best`` of the fits ``tried`` of ``fits``, which was ``found``.

    ``loose`` is the reason why no load can be left out; '' where each can.
    """
    after, correlations = found.after, found.correlations
    assert after is not None and correlations is not None
    notes = [
        *_of_misfit(problem, after, found.floor),
        *_of_branches(problem, best),
        *_of_loss(tried, best),
        *at_ends(problem.unknowns, best.x),
        *strong_pairs(correlations, problem.unknowns),
    ]
    tensions = np.array([shape.window.tensions for shape in problem.shapes])
    loads = len(steps_by_load(tensions))
    if loads < len(problem.shapes):
        notes.append(f'{len(problem.shapes)} steps are of {loads} loads; repeats count as one')
    if loads > MOST_FOLDS:
        notes.append(f'{loads} loads are left out in {MOST_FOLDS} groups')
    if 'tension_offset' in fits:
        notes.append(
            'one tension offset for all tendons that read at least 1 % of the highest tension'
        )
    if problem.unknowns.reads_encoders:
        notes.append(
            f'residuals of encoders are weighed by {problem.encoder_scale(best.x) * 1e3:.3g} mm, '
            f'those of the camera by {problem.scale(best.x) * 1e3:.3g} mm: what each has left'
        )
    if 'alignment' in fits:
        notes += undetermined(
            np.concatenate([shape.points for shape in problem.shapes]), after.rms
        )
    return [*notes, loose] if loose else notes


def _of_misfit(problem: Problem, after: Misfit, floor: float | None) -> list[str]:
    noise = noise_of(problem.shapes)
    notes = []
    if 0.0 < _BIASED * noise < after.rms:
        notes.append(
            f'noise of the camera explains {noise * 1e3:.3f} mm of the distance of '
            f'{after.rms * 1e3:.3f} mm that is left: the rest is of the model or of the tensions, '
            'and what is alike at all loads biases the estimates beyond their intervals'
        )
    if floor:
        notes.append(
            f'model error floor: {floor * 1e3:.3f} mm ({100.0 * floor / problem.length:.2f} % of '
            'the length) at held-back loads is neither noise nor a change of the fitted '
            'parameters; the intervals hold a bias of this size'
        )
    return notes


def _of_branches(problem: Problem, best: HeldBackFit) -> list[str]:
    """Remarks on loading and unloading, where the modulus is fitted."""
    if 'youngs_modulus' not in problem.unknowns.names:
        return []
    column = problem.unknowns.names.index('youngs_modulus')
    steps, least = range(len(problem.shapes)), STILL * problem.length
    ways = directions(np.array([shape.window.tensions for shape in problem.shapes]))
    # Residuals change opposite to the model's tip, which a softer arm moves as tensions do.
    bends = [
        part_along(
            problem.residuals(best.x, step)[-1], problem.change(best.x, step)[-1, :, column], least
        )
        for step in steps
    ]
    tensions = [shape.tension for shape in problem.shapes]
    notes = remarks(tensions, bends, ways, noise_of(problem.shapes) / 3.0**0.5, problem.length)
    if UNLOADING in ways and notes:
        notes.append(
            'intervals take this difference for scatter from load to load, so they are wider than '
            '95 %: the branches cancel where each load is reached from both sides'
        )
    return notes


def _of_loss(tried: Sequence[HeldBackFit], best: HeldBackFit) -> list[str]:
    if len(tried) < 2 or not best.away:
        return []
    words = ', '.join(f'{one.held_back * 1e3:.4f} mm by {one.loss}' for one in tried)
    return [f'loss {best.loss}, by the misfit at held-back loads: {words}']


def strong_pairs(correlations: FloatArray, unknowns: Unknowns) -> list[str]:
    """Pairs of strong correlation, but for those within the alignment, which always correlate."""
    names = unknowns.names
    alignment = unknowns.alignment_columns
    return [
        f'the data hardly tell {names[one]} and {names[other]} apart: their correlation is '
        f'{correlations[one, other]:+.4f}'
        for one, other in zip(*np.triu_indices(len(names), 1))
        if abs(correlations[one, other]) > _STRONG
        and not (one in alignment and other in alignment)
    ]


def at_ends(unknowns: Unknowns, x: FloatArray) -> list[str]:
    """Remarks on unknowns at an end of their range."""
    return [
        f'{unknown.name} is at the end of its range, where its interval is not to be relied on'
        for unknown, at in zip(unknowns.unknowns, x, strict=True)
        if not math.isinf(unknown.high) and min(at - unknown.low, unknown.high - at) < 1e-3
    ]
