"""Boxes of tensions for tests of workspaces, and how two workspaces are compared."""

import dataclasses

import numpy as np

from octo_arm_model.analysis.workspace import Workspace

HIGHEST = np.array([[0.1] * 4, [1.0] * 4, [4.0] * 4])
# Closed form: alone, four tendons of 1.4 N in all compress the tip of this arm to nothing.
TOO_HIGH = np.array([[0.6] * 4, [1.0] * 4, [4.0] * 4])


def assert_same(one: Workspace, other: Workspace) -> None:
    for field in dataclasses.fields(Workspace):
        a, b = (np.asarray(getattr(workspace, field.name)) for workspace in (one, other))
        assert (a.shape, a.dtype) == (b.shape, b.dtype), field.name
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-12, err_msg=field.name)
