"""What messages of a backbone hold, whoever made them."""

from __future__ import annotations

from typing import Any

import numpy as np

from octo_arm_model import Backbone


def assert_hold(path: Any, poses: Any, strains: Any, backbone: Backbone) -> None:
    """Check that Path, PoseArray and SectionStrains hold ``backbone`` unchanged."""
    assert poses.poses == [pose.pose for pose in path.poses]
    places = [pose.position for pose in poses.poses]
    np.testing.assert_array_equal([[p.x, p.y, p.z] for p in places], backbone.position)
    turns = [pose.orientation for pose in poses.poses]
    np.testing.assert_array_equal([[q.x, q.y, q.z, q.w] for q in turns], backbone.quaternion)
    assert strains.model == backbone.model
    for name in ('s', 'section', 'tau', 'xi', 'k', 'q'):
        np.testing.assert_array_equal(getattr(strains, name), getattr(backbone, name))
