"""Build the messages of a backbone as objects, independent of the node's writer of bytes."""

from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Path
from octo_arm_msgs.msg import SectionStrains
from std_msgs.msg import Header

from octo_arm_model import Backbone
from octo_arm_model.ros.topics import pose_message


def messages_of(backbone: Backbone, stamp: Any, frame: str) -> tuple[Any, Any, Any]:
    """Return Path, PoseArray and SectionStrains of a ``backbone``."""
    header = Header(stamp=stamp, frame_id=frame)
    poses = list(map(pose_message, backbone.position, backbone.quaternion))
    path = Path(header=header, poses=[PoseStamped(header=header, pose=pose) for pose in poses])
    strains = SectionStrains(
        header=header,
        model=backbone.model,
        s=backbone.s,
        tau=backbone.tau,
        xi=backbone.xi,
        k=backbone.k,
        q=backbone.q,
        section=backbone.section.astype(np.int32),
    )
    return path, PoseArray(header=header, poses=poses), strains


def assert_hold(path: Any, poses: Any, strains: Any, backbone: Backbone) -> None:
    """Check that the three messages have exactly the values of ``backbone``."""
    expected = messages_of(backbone, path.header.stamp, path.header.frame_id)
    assert (path, poses, strains) == expected
