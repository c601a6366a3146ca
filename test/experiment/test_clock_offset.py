"""The offset of the camera's clock, from the motion."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from experiments import ARM, HELD, PARAMETERS, recording, staircase

from octo_arm_model.config.config import Config
from octo_arm_model.experiment.clock_offset import clock_offset
from octo_arm_model.experiment.fit import followed


@pytest.mark.parametrize('ahead', [-0.7, 0.35])
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


@pytest.mark.parametrize(('ahead', 'friction'), [(0.0, 0.1), (0.3, 0.02)])
def test_friction_is_not_taken_for_an_offset(ahead: float, friction: float) -> None:
    """A tip that is behind at each reversal is so at rest as well, which no clock explains."""
    values = {**PARAMETERS, 'tendons.friction': [friction], 'material.youngs_modulus': 1.3e5}
    solver = Config.from_parameters(values).solver('closed_form', 31)
    time, pulled = staircase((0.0, 1.5, 3.0, 1.5), hold=2.0, rate=25.0)
    tensions = np.outer(pulled, [1.0, 0.0, 0.0, 0.0])
    tips = np.array([backbone.tip for backbone in followed(solver, tensions)])
    tips += 5e-4 * np.random.default_rng(0).standard_normal(tips.shape)
    found = clock_offset(ARM, time, tensions, time[::3] + ahead, tips[::3])
    assert found == pytest.approx(-ahead, abs=0.021)


def test_arms_that_the_model_does_not_cover_have_a_clock_too() -> None:
    """The search is by the paper's model, which knows no sheaths, and no friction."""
    seen = recording()
    tips = np.array([points[-1] for points in seen.frames])
    arm = dataclasses.replace(
        ARM, sheath_stiffness=(1e5,), friction=(0.1,), axial_stiffness=(9.0,)
    )
    where = seen.tension_time, seen.tensions, seen.frame_time - 0.5, tips
    assert clock_offset(arm, *where) == pytest.approx(0.5, abs=0.03)


def test_frames_at_rest_alone_do_not_move_the_clock() -> None:
    seen = recording(held=HELD[:4], rate=50.0)
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
