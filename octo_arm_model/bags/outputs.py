"""Estimates and simulated motions written into bags, on the topics of the nodes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from octo_arm_model.bags.demo import START
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.replay import open_copies
from octo_arm_model.bags.topics import DESCRIPTION
from octo_arm_model.bags.writer import TENSIONS, BagWriter, Message
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.simulation.moving_arm import Moment
from octo_arm_model.wire.backbone import BACKBONE_TOPICS, BackboneWriter
from octo_arm_model.wire.estimate import ESTIMATES, EstimateMessages
from octo_arm_model.wire.messages import Stamp
from octo_arm_model.wire.tensions import TENSION_TOPICS


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
        writer.add_text(prefix + DESCRIPTION, parameters_as_yaml(parameters), start_ns)

    def write(self, hypothesis: str, estimate: Estimate, stamp_ns: int, received_ns: int) -> None:
        """Write an ``estimate`` by one hypothesis.

        Raises:
            ConfigError: if no stamp can hold the time.
            BagError: if the bag cannot be written.
        """
        found = self._messages[hypothesis].write(estimate, *Stamp.from_ns(stamp_ns))
        self._writer.write(
            (self._writer.add(self._prefix + topic, ESTIMATES[topic]), received_ns, data)
            for topic, data in found.items()
        )


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


def add_motion(
    writer: BagWriter, config: Config, parameters: Mapping[str, Any], moments: Iterable[Moment]
) -> list[Moment]:
    """Write ``moments`` of the arm of ``config``, and return them.

    ``parameters`` are those of its file.

    Raises:
        OctoArmError: if the bag cannot be written, or the motion ends.
    """
    writer.add_text(f'/{DESCRIPTION}', parameters_as_yaml(parameters), START)
    made, known = list[Moment](), np.zeros((6, 6))

    def messages() -> Iterator[Message]:
        layout: BackboneWriter | None = None
        for moment in moments:
            made.append(moment)
            shape, received = moment.backbone, START + round(moment.time * 1e9)
            if layout is None:
                described = config.base_frame, shape.model, shape.s, shape.section
                layout = BackboneWriter(*described, config.arm.tendon_names)
            stamp = Stamp.from_ns(received)
            tensions = writer.add(f'/{TENSIONS}', TENSION_TOPICS[TENSIONS].type_name)
            yield tensions, received, layout.tensions(shape.tensions, *stamp)
            answers = layout.all(shape, known, *stamp)
            for (topic, kind), data in zip(BACKBONE_TOPICS.items(), answers, strict=True):
                yield writer.add(f'/{topic}', kind), received, data

    writer.write(messages())
    return made
