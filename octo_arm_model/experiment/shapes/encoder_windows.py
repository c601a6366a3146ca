"""Encoder readings of steady windows, and tensions that follow from them where none were read."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from octo_arm_model.arm.errors import SolveError, TensionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.recording.recording import Recording
from octo_arm_model.experiment.shapes.steady_windows import Window, held_readings
from octo_arm_model.rod.displacements import Wound, solve_displacements


def with_displacements(window: Window, recording: Recording) -> Window:
    """The ``window`` with the mean reading of each encoder meanwhile, NaN where there is none.

    Without load cells an encoder that reads nothing meanwhile holds what it read last.
    """
    time, read = recording.displacement_time, recording.displacements
    if recording.is_driven:
        has_encoder = np.isfinite(read).any(axis=0)
        read = np.where(has_encoder, held_readings(read), np.nan)
    inside = (time >= window.start) & (time <= window.stop)
    if not inside.any():
        return window
    return dataclasses.replace(window, displacements=mean_of(read[inside]))


def mean_of(rows: FloatArray) -> FloatArray:
    """Mean of each column of ``rows`` (n, tendons) without NaN, NaN of those without any other."""
    known = np.isfinite(rows)
    count = known.sum(axis=0)
    total = np.where(known, rows, 0.0).sum(axis=0)
    return np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0)


def by_length(windows: Sequence[Window], config: Config) -> list[Window]:
    """Windows of held lengths, with the tensions that these have on the arm of ``config``.

    Args:
        windows: with ``displacements``; their tensions do not count.
        config: of the arm as it is known so far. A tendon without an encoder is slack, and those
            with friction slide from window to window, to the first from slack.

    Raises:
        SolveError: if lengths of a window cannot be held.
    """
    solver, names = config.solver('exact'), config.arm.tendon_names
    found: list[Window] = []
    last: Wound | None = None
    for window in windows:
        assert window.displacements is not None
        try:
            last = solve_displacements(solver, lengths_of(names, window.displacements), start=last)
        except (SolveError, TensionError) as error:
            raise SolveError(
                f'lengths held from {window.start:.3f} to {window.stop:.3f} s: {error}'
            ) from error
        tensions = last.backbone.tensions.ravel()
        found.append(
            dataclasses.replace(
                window, tensions=tensions, noise=np.zeros(tensions.size), is_driven=True
            )
        )
    return found


def lengths_of(names: Sequence[str], displacements: FloatArray) -> dict[str, float]:
    """Lengths reeled in [m] by name of the tendons that have an encoder."""
    return {
        name: float(length)
        for name, length in zip(names, displacements, strict=True)
        if np.isfinite(length)
    }
