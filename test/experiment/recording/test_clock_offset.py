"""The offset of the camera's clock, from the motion."""

from __future__ import annotations

import numpy as np
import pytest
from experiments import ARM, recording

from octo_arm_model.experiment.recording.clock_offset import clock_offset


@pytest.mark.parametrize('ahead', [-0.7, 0.0, 0.35])
def test_the_clock_of_the_camera_is_set_by_the_motion(ahead: float) -> None:
    seen = recording('exact', ahead, material__youngs_modulus=1.3e5)
    tips = np.array([points[-1] for points in seen.frames])
    told: list[tuple[int, int]] = []
    found = clock_offset(
        ARM, seen.tension_time, seen.tensions, seen.frame_time, tips,
        lambda done, total: told.append((done, total)),
    )  # fmt: skip
    assert found == pytest.approx(-ahead, abs=0.03)
    # From 2 s before to 2 s after, in steps of 10 ms.
    assert told == [(done, 401) for done in range(1, 402)]


def test_frames_at_rest_alone_do_not_move_the_clock() -> None:
    seen = recording(rate=50.0)
    # Of 3 s at rest and 1 s on the way, from 0.5 to 2.5 s.
    at_rest = (seen.frame_time % 4.0 > 0.5) & (seen.frame_time % 4.0 < 2.5)
    tips = np.array([points[-1] for points in seen.frames])[at_rest]
    found = clock_offset(
        ARM, seen.tension_time, seen.tensions, seen.frame_time[at_rest], tips
    )  # fmt: skip
    assert found == 0.0


def test_an_arm_at_rest_tells_no_time() -> None:
    seen = recording(held=(2.0, 2.0))
    rng = np.random.default_rng(0)
    tips = 1e-3 * rng.standard_normal((len(seen.frames), 3))
    assert clock_offset(ARM, seen.tension_time, seen.tensions, seen.frame_time, tips) is None
