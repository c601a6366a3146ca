"""Between ROS messages and the core: nothing but conversion, in both directions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseArray, PoseStamped, Quaternion
from nav_msgs.msg import Path
from octo_arm_msgs.msg import SectionStrains, TendonTensions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header

from octo_arm_model.arm import Arm
from octo_arm_model.backbone import Backbone
from octo_arm_model.errors import TensionError
from octo_arm_model.hints import FloatArray


def tensions_from_tendon_tensions(message: TendonTensions, arm: Arm) -> FloatArray:
    """Tensions (sections, tendons of a section) [N], matched by name.

    Raises:
        TensionError: if names are unknown, repeated or missing, or lengths differ.
    """
    return _by_name(message.name, message.tension, 'tension', arm)


def tensions_from_joint_state(message: JointState, arm: Arm) -> FloatArray:
    """Tensions (sections, tendons of a section) [N] from the efforts, matched by name.

    Raises:
        TensionError: if names are unknown, repeated or missing, or lengths differ.
    """
    return _by_name(message.name, message.effort, 'effort', arm)


def tensions_from_array(message: Float64MultiArray, arm: Arm) -> FloatArray:
    """Tensions (sections, tendons of a section) [N] from a row-major array.

    The layout may be empty, flat or sections x tendons.

    Raises:
        TensionError: if the length or the layout is another.
    """
    shape = arm.tension_shape
    count = shape[0] * shape[1]
    if len(message.data) != count:
        raise TensionError(
            f'data has {len(message.data)} values, expected {count}: '
            f'{shape[0]} section(s) from the tip, {shape[1]} tendons each'
        )
    layout = tuple(dimension.size for dimension in message.layout.dim)
    if message.layout.data_offset != 0 or layout not in ((), (count,), shape):
        raise TensionError(
            f'layout is {layout} with data_offset {message.layout.data_offset}, expected an '
            f'empty one or {shape} with data_offset 0'
        )
    return np.array(message.data, dtype=np.float64).reshape(shape)


def _by_name(names: Sequence[str], values: Sequence[float], field: str, arm: Arm) -> FloatArray:
    if len(names) != len(values):
        raise TensionError(f'name has {len(names)} entries but {field} has {len(values)}')
    tension_of = dict(zip(names, values))
    if len(tension_of) < len(names):
        repeated = sorted({name for name in names if list(names).count(name) > 1})
        raise TensionError(f'tendon named more than once: {", ".join(repeated)}')
    unknown = [name for name in names if name not in arm.tendon_names]
    if unknown:
        raise TensionError(
            f'unknown tendon {", ".join(unknown)}; this arm has {", ".join(arm.tendon_names)}'
        )
    missing = [name for name in arm.tendon_names if name not in tension_of]
    if missing:
        raise TensionError(f'no tension for tendon {", ".join(missing)}')
    ordered = [tension_of[name] for name in arm.tendon_names]
    return np.array(ordered, dtype=np.float64).reshape(arm.tension_shape)


def backbone_messages(
    backbone: Backbone, stamp: Time, frame_id: str
) -> tuple[Path, PoseArray, SectionStrains]:
    """One solved arm as messages, all with the same header."""
    header = Header(stamp=stamp, frame_id=frame_id)
    poses = [
        Pose(
            position=Point(x=x, y=y, z=z),
            orientation=Quaternion(x=qx, y=qy, z=qz, w=qw),
        )
        for (x, y, z), (qx, qy, qz, qw) in zip(
            backbone.position.tolist(), backbone.quaternion.tolist()
        )
    ]
    path = Path(header=header, poses=[PoseStamped(header=header, pose=pose) for pose in poses])
    strains = SectionStrains(
        header=header,
        model=backbone.model,
        s=backbone.s,
        section=backbone.section.astype(np.int32),
        tau=backbone.tau,
        xi=backbone.xi,
        k=backbone.k,
        q=backbone.q,
    )
    return path, PoseArray(header=header, poses=poses), strains
