"""Estimates written into a bag, on the topics on which the estimator's node publishes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rosbags.interfaces import Connection

from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.replay import open_copies
from octo_arm_model.bags.topics import DESCRIPTION
from octo_arm_model.bags.writer import BagWriter
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.wire.estimate import ESTIMATES, EstimateMessages
from octo_arm_model.wire.stamp import Stamp


class EstimateOutput:
    """Writes the estimates of one arm into a bag."""

    def __init__(
        self,
        writer: BagWriter,
        prefix: str,
        parameters: Mapping[str, Any],
        models: Mapping[str, ArmModel],
        start_ns: int,
    ) -> None:
        """Write to topics in the namespace ``prefix``, with its slash, by ``writer``.

        The arm of ``parameters`` is described there as of ``start_ns`` [ns]; it is estimated by
        ``models``, named as the hypotheses.

        Raises:
            BagError: if the bag cannot be written.
        """
        self._writer, self._prefix = writer, prefix
        frame = Config.from_parameters(parameters).base_frame
        self._messages = {name: EstimateMessages(frame, one) for name, one in models.items()}
        self._connections: dict[str, Connection] = {}
        writer.add_text(prefix + DESCRIPTION, parameters_as_yaml(parameters), start_ns)

    def write(self, hypothesis: str, estimate: Estimate, stamp_ns: int, received_ns: int) -> None:
        """Write an ``estimate`` by one hypothesis.

        Raises:
            ConfigError: if no stamp can hold the time.
            BagError: if the bag cannot be written.
        """
        found = self._messages[hypothesis].write(estimate, *Stamp.from_ns(stamp_ns))
        for topic, data in found.items():
            if topic not in self._connections:
                self._connections[topic] = self._writer.add(self._prefix + topic, ESTIMATES[topic])
            self._writer.write([(self._connections[topic], received_ns, data)])


def copy_bag(reader: BagReader, writer: BagWriter, prefix: str) -> dict[str, str]:
    """Copy what is in a bag but estimates of the arm of ``prefix``; topics not copied, and why.

    Raises:
        BagError: if a bag is damaged or cannot be written.
    """
    copies, left_out = open_copies(
        reader, writer, {prefix + topic for topic in (*ESTIMATES, DESCRIPTION)}
    )
    left_out.pop(prefix + DESCRIPTION, None)  # it is the same
    # One by one: many large messages at once may not fit into memory.
    writer.write(
        (connection, record.received_ns, record.data)
        for record in reader.messages(sorted({topic for topic, _ in copies}))
        if (connection := copies.get((record.topic, record.type_name)))
    )
    return left_out
