"""Loading and unloading: from which side the tensions of a step were reached."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from octo_arm_model.arm.hints import FloatArray

LOADING, UNLOADING, MIXED, REST = 'loading', 'unloading', 'mixed', 'rest'
# Changes below this part of the highest tension do not count.
_PART = 0.02
# A tip that moves by less than this part of the length per relative change of E is at rest.
STILL = 0.01


def directions(tensions: FloatArray) -> list[str]:
    """Direction of each step of ``tensions`` (steps, tendons) [N], in order of time.

    'loading' where tensions have only risen since the step before, or since rest for the first,
    'unloading' where they have only fallen, 'mixed' where some rose and others fell; after a step
    of the same tensions that of this step, 'rest' before any is pulled.
    """
    band = _PART * float(tensions.max(initial=0.0))
    found: list[str] = []
    before = np.zeros(tensions.shape[-1])
    for pulled in tensions:
        rose, fell = bool((pulled - before > band).any()), bool((before - pulled > band).any())
        if rose or fell:
            found.append(MIXED if rose and fell else LOADING if rose else UNLOADING)
        else:
            found.append(found[-1] if found else REST)
        before = pulled
    return found


def difference(
    tension: Sequence[float], error: Sequence[float], direction: Sequence[str], noise: float
) -> tuple[float, float] | None:
    """By how much errors while loading exceed those while unloading, and at what mean tension.

    Args:
        tension: of each step [N].
        error: signed error of each step [m]; NaN for one that has none.
        direction: of each step, of `directions`.
        noise: standard deviation of an error by the noise of the camera [m].

    Returns:
        The mean difference [m] and the mean tension [N] of the steps where it is taken; None where
        the branches share no tensions, or differ by no more than three times the noise.
    """
    at, off, way = np.array(tension), np.array(error), np.array(direction)
    known = np.isfinite(off)
    up, down = (known & (way == name) for name in (LOADING, UNLOADING))
    if up.sum() < 2 or not down.any():
        return None
    order = np.argsort(at[up], kind='stable')
    rising = at[up][order]
    shared = down & (at >= rising[0] * (1.0 - _PART)) & (at <= rising[-1] * (1.0 + _PART))
    if not shared.any():
        return None
    apart = np.interp(at[shared], rising, off[up][order]) - off[shared]
    mean = float(apart.mean())
    # Friction grows with tension, so that differences scatter beyond the noise.
    scatter = apart.std(ddof=1) if len(apart) > 1 else 0.0
    least = np.maximum(3.0 * np.sqrt(2.0) * noise, 2.0 * scatter) / np.sqrt(len(apart))
    if abs(mean) <= least:
        return None
    return mean, float(at[shared].mean())


def remarks(
    tension: Sequence[float],
    error: Sequence[float],
    direction: Sequence[str],
    noise: float,
    length: float,
) -> list[str]:
    """Remarks on friction, of an arm of ``length`` [m]; see `difference`."""
    if UNLOADING not in direction:
        return [
            'no step was reached by unloading: friction or a load cell that reads wrong in '
            'proportion would scale all tensions alike, which no interval holds and nothing here '
            'shows'
        ]
    found = difference(tension, error, direction, noise)
    if found is None:
        return []
    apart, at = found
    return [
        f'loading and unloading differ by more than the noise: at the same tensions (on average '
        f'{at:.3g} N) the tip is {abs(apart) * 1e3:.2f} mm ({100.0 * abs(apart) / length:.2f} % '
        f'of the length) {"less" if apart < 0.0 else "farther"} bent while loading, as '
        f'{"friction or creep" if apart < 0.0 else "no friction"} does'
    ]


def part_along(away: FloatArray, move: FloatArray, least: float) -> float:
    """Part of ``away`` (3,) along ``move`` (3,) [m]; NaN where the move is below ``least``."""
    size = float(np.linalg.norm(move))
    return float(away @ move) / size if size > least else float('nan')
