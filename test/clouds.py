"""What a sensor_msgs/PointCloud2 holds, read by its table of fields alone."""

from typing import Any

import numpy as np

_KINDS = {7: 'f4', 8: 'f8'}


def profiles_of(message: Any) -> np.ndarray:
    """Every field of every point as a column, (points, fields)."""
    assert message.height == 1 and message.is_dense
    assert message.row_step == message.width * message.point_step == len(message.data)
    data, columns = np.array(message.data, np.uint8).tobytes(), []
    for field in message.fields:
        assert field.count == 1
        kind = np.dtype(_KINDS[field.datatype]).newbyteorder('><'[not message.is_bigendian])
        assert field.offset + kind.itemsize <= message.point_step
        columns.append([
            np.frombuffer(data, kind, 1, point * message.point_step + field.offset)[0]
            for point in range(message.width)
        ])  # fmt: skip
    return np.array(columns, dtype=float).T
