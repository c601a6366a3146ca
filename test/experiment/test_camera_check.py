"""Against a camera, what is refused before anything is estimated."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model import Config
from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.experiment.alignment import Alignment
from octo_arm_model.experiment.camera_check import CameraCheck, CameraFrames


def test_tips_in_a_frame_of_unknown_pose_are_refused_at_the_beginning(prototype: Config) -> None:
    solver = prototype.solver('exact')
    time, tensions = np.array([0.0, 1.0]), np.zeros((2, 4))
    frames = CameraFrames(np.array([0.95]), [solver.solve(tensions[:1]).position[-1:]], None)
    with pytest.raises(MeasurementError, match='tips alone do not tell the pose of the camera'):
        CameraCheck(frames, solver, time, tensions)
    check = CameraCheck(frames._replace(alignment=Alignment.none()), solver, time, tensions)
    shape = solver.solve(tensions[:1])
    for at in time:
        check.add(float(at), shape)
    errors = check.errors()
    assert errors is not None
    np.testing.assert_allclose(errors.tip, 0.0, atol=1e-12)
