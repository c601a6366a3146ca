"""Bags of a simulated motion: tensions and shapes, on the topics of the node."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from octo_arm_model.bags.demo import START, TENSIONS
from octo_arm_model.bags.topics import DESCRIPTION
from octo_arm_model.bags.writer import BagWriter, Message
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.simulation.moving_arm import Moment
from octo_arm_model.wire.backbone import BACKBONE_TOPICS, BackboneWriter
from octo_arm_model.wire.stamp import Stamp
from octo_arm_model.wire.tensions import TENSION_TOPICS


def add_motion(
    writer: BagWriter, config: Config, parameters: Mapping[str, Any], moments: Iterable[Moment]
) -> list[Moment]:
    """Write ``moments`` of the arm of ``config``, and return them.

    ``parameters`` are those of its file.

    Raises:
        OctoArmError: if the bag cannot be written, or the motion ends.
    """
    writer.add_text(f'/{DESCRIPTION}', parameters_as_yaml(parameters), START)
    topics = [writer.add(f'/{name}', type_name) for name, type_name in BACKBONE_TOPICS.items()]
    tensions = writer.add(f'/{TENSIONS}', TENSION_TOPICS[TENSIONS].type_name)
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
            yield tensions, received, layout.tensions(shape.tensions, *stamp)
            for topic, data in zip(topics, layout.all(shape, known, *stamp), strict=True):
                yield topic, received, data

    writer.write(messages())
    return made
