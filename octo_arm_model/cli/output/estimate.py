"""What `octo-arm estimate` prints: JSON, and a summary in text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from octo_arm_model.arm.hints import FloatArray
    from octo_arm_model.experiment.estimating.history import Touch
    from octo_arm_model.experiment.estimating.run import Result


def as_dict(result: Result) -> dict[str, Any]:
    """All but the estimates themselves, in SI units."""
    return {
        'times': len(result.moments),
        'touches': [
            {
                'start': touch.start, 'stop': touch.stop, 'contact': touch.hypothesis,
                'force': touch.force.tolist(), 'force_stddev': touch.stddev.tolist(),
            }
            for touch in result.touches
        ],
        'innovations': {
            name: {
                'accepted': one.accepted, 'refused': one.refused,
                'mean_square': _or_none(one.mean),
            }
            for name, one in result.consistency.items()
        },
        'restarts': list(result.restarts),
        'without_estimate': result.failures.of(''),
        'left_out': result.recorded.refusals.lines(),
        'keeps_prior': list(result.unlearnt),
        'hypotheses': dict(result.hypotheses),
        'camera': None if result.camera is None else {
            'frames': len(result.camera.time),
            'tip_error': [_or_none(_median(one)) for one in result.camera.tip],
            'mean_error': [_or_none(_median(one)) for one in result.camera.mean],
        },
        'notes': [*result.recorded.notes, *result.recorded.settings.notes],
    }  # fmt: skip


def summary(result: Result, files: Sequence[str]) -> str:
    """The same in text, and the ``files`` written."""
    recorded = result.recorded
    lines = [*recorded.notes, *recorded.settings.notes]
    lines.append(f'{len(result.moments)} times estimated from {", ".join(recorded.sensors.all)}')
    lines += [_touch(touch) for touch in result.touches]
    if not result.touches:
        lines.append('not touched: no force is larger than its uncertainty explains')
    if len(result.hypotheses) > 1:
        parts = [f'{name} {100.0 * part:.0f} %' for name, part in result.hypotheses.items()]
        lines.append(f'place of contact, mean probability: {", ".join(parts)}')
    tip = np.median([one.tip_stddev for one in result.moments], axis=0)
    lines.append(f'tip known to {_millimetres(tip)} mm in x, y, z (median standard deviation)')
    for name, one in result.consistency.items():
        mean = f', normalised innovation {one.mean:.2f} (1)' if one.size else ''
        lines.append(f'{name}: {one.accepted} used{mean}')
        if one.refused_from is not None and one.refused_to is not None:
            start, stop = (
                1e-9 * (stamp - recorded.origin_ns) for stamp in (one.refused_from, one.refused_to)
            )
            lines.append(
                f'  {one.refused} refused, which do not fit the rest, from {start:.2f} to '
                f'{stop:.2f} s'
            )
    lines += [
        f'begun anew at {time:.2f} s: sensors contradicted the estimate, and agreed'
        for time in result.restarts
    ]
    lines += [
        f'{count} times without an estimate, as {reason}'
        for reason, count in result.failures.of('').items()
    ]
    lines += recorded.refusals.lines()
    if result.camera is not None:
        lines += _camera(result)
    lines += [f'not observable: {reason}' for reason in result.unlearnt]
    lines += [f'{file} written' for file in files]
    return '\n'.join(lines)


def _touch(touch: Touch) -> str:
    """One touch in words."""
    size = 1e3 * float(np.linalg.norm(touch.force))
    parts = ', '.join(
        f'{1e3 * value:.1f} +- {1e3 * stddev:.1f}'
        for value, stddev in zip(touch.force, touch.stddev, strict=True)
    )
    where = {'tip': 'at the tip', 'current': 'by a current'}.get(
        touch.hypothesis, f'at {touch.hypothesis}'
    )
    return f'touched {where} from {touch.start:.2f} to {touch.stop:.2f} s: {size:.1f} mN ({parts})'


def _camera(result: Result) -> list[str]:
    """Errors against the camera, of all frames and of those while the arm was touched."""
    camera = result.camera
    assert camera is not None
    touched = np.zeros(camera.time.size, dtype=bool)
    for touch in result.touches:
        touched |= (camera.time >= touch.start) & (camera.time <= touch.stop)
    lines = []
    every = np.ones_like(touched)
    for what, which in (('', every), (' while touched', touched)):
        if not which.any():
            continue
        for name, pair in (('tip', camera.tip), ('midline', camera.mean)):
            found, plain = (1e3 * _median(one[which]) for one in pair)
            if np.isfinite(found):
                lines.append(
                    f'against {result.recorded.camera_topic}{what}: {name} off by {found:.2f} mm, '
                    f'without the estimator {plain:.2f} mm (medians of {which.sum()} frames)'
                )
    return lines


def _or_none(value: float) -> float | None:
    """The ``value``; None of NaN, which is no JSON."""
    return None if math.isnan(value) else value


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float('nan')


def _millimetres(values: FloatArray) -> str:
    return ', '.join(f'{1e3 * value:.2f}' for value in values)
