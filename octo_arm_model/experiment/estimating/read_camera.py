"""The midlines of a camera in a bag, by the clock of the tensions."""

from __future__ import annotations

from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.topics import MIDLINE, usual_topics
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.estimating.camera_check import CameraFrames
from octo_arm_model.experiment.recording.count import Count
from octo_arm_model.experiment.recording.measured_points import Measured, MeasuredPoints
from octo_arm_model.experiment.recording.measured_topics import MIDLINES, MeasuredTopics
from octo_arm_model.experiment.recording.recording import Stamped, assemble
from octo_arm_model.experiment.shapes.alignment import Alignment
from octo_arm_model.experiment.shapes.observations import Pairing, base_first, camera_offset
from octo_arm_model.wire.refusals import Refusals


def camera_topic(reader: BagReader, wanted: str | None) -> str | None:
    """The ``wanted`` topic, or the one of the usual name with midlines; None if there is none."""
    if wanted is not None:
        return wanted
    found = usual_topics(reader, MIDLINE, MIDLINES)
    return found[0] if len(found) == 1 else None


def read_camera(
    reader: BagReader,
    topic: str,
    config: Config,
    tensions: Stamped,
    alignment: Alignment | None,
    offset: float | None,
    refusals: Refusals,
    notes: list[str],
) -> CameraFrames:
    """Midlines or tips on a ``topic``.

    Args:
        reader: the bag.
        topic: where they are.
        config: the arm.
        tensions: those measured, from the first of which times count.
        alignment: from the camera's frame to base_frame; None for one to be fitted, or none at
            all where they are in base_frame.
        offset: to add to their stamps [s]; None to find it from the motion.
        refusals: count the messages left out.
        notes: told of what was decided.

    Raises:
        BagError: if there is no such topic, or of another type.
        MeasurementError: if there is nothing on it, or neither end is clearly the base.
    """
    measured = Measured((topic,))
    points = MeasuredPoints(measured, config.arm.length)
    topics = MeasuredTopics(reader, measured, points, config.base_frame)
    frames = list(topics.read(refusals, Count()))
    recording = assemble({}, tensions, None, frames, topic, measured, points, refusals, notes)
    if alignment is None and recording.frame_id == config.base_frame:
        alignment = Alignment.none()
    elif alignment is None:
        notes.append(f'the pose of {recording.frame_id!r} is fitted, to each of both shapes')
    pairing = Pairing(offset=offset)
    lines = base_first(recording, pairing, config, alignment, notes)
    ahead = camera_offset(recording, pairing, config, lines, notes)
    return CameraFrames(recording.frame_time + ahead, lines, alignment)
