"""The messages of an estimate that a backbone alone has not, as bytes."""

from __future__ import annotations

from collections.abc import Sequence

from octo_arm_model.core.errors import ConfigError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.wire.cdr_backbone import tendon_tensions
from octo_arm_model.wire.cdr_layout import Layout, text_field
from octo_arm_model.wire.cdr_templates import Template


class EstimateWriter:
    """Writes forces and biases of one arm, for one thread at a time, as `BackboneWriter` does."""

    def __init__(self, frame_id: str, tendon_names: Sequence[str]) -> None:
        """Lay out the messages.

        Raises:
            ConfigError: if a name is not one that UTF-8 can hold.
        """
        frame, self._tendons = text_field('frame_id', frame_id), len(tendon_names)
        wrench = Layout(frame)
        wrench.numbers(6)
        self._wrench = Template(wrench)
        self._bias = Template(tendon_tensions(frame, tendon_names))

    def wrench(self, values: FloatArray, sec: int, nanosec: int) -> bytes:
        """Message geometry_msgs/WrenchStamped: force [N] and moment [N m], (6,).

        Raises:
            ConfigError: if there are not six, or a ROS stamp cannot hold the time.
        """
        if values.shape != (6,):
            raise ConfigError(f'wrench is of shape {values.shape}, expected (6,)')
        return self._wrench.write(sec, nanosec, values)

    def tension_bias(self, values: FloatArray, sec: int, nanosec: int) -> bytes:
        """Message octo_arm_msgs/TendonTensions: what each load cell shows too much [N].

        Raises:
            ConfigError: if there is not one for each tendon, or no stamp can hold the time.
        """
        if values.shape != (self._tendons,):
            raise ConfigError(f'bias is of shape {values.shape}, expected ({self._tendons},)')
        return self._bias.write(sec, nanosec, values)
