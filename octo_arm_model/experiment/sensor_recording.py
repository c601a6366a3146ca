"""Inputs of an estimator from a recording: arm, unknowns, measurements, and a camera."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.arm.errors import BagError, MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_NAME
from octo_arm_model.arm.pose import Pose
from octo_arm_model.bags.reader import BagReader, Record
from octo_arm_model.bags.sensor_topics import SensorTopics, find_sensors
from octo_arm_model.bags.topics import MIDLINE, ArmTopics, describe, sensed_by
from octo_arm_model.config.config import Config
from octo_arm_model.estimation.measurements import Measurement, Tensions
from octo_arm_model.estimation.model import PATIENT, ArmModel
from octo_arm_model.estimation.settings import (
    PREFIX,
    RECORDING_DEFAULTS,
    EstimatorSettings,
    TensionStatistics,
)
from octo_arm_model.experiment.bag_recording import (
    MIDLINES,
    MeasuredTopics,
    notes_on,
    read_messages,
    read_readings,
    read_transforms,
    tf_topics,
)
from octo_arm_model.experiment.camera import RANGE, CameraCheck
from octo_arm_model.experiment.midlines import without_spikes
from octo_arm_model.experiment.observations import Pairing, base_first, camera_offset
from octo_arm_model.experiment.recording import (
    Count,
    MarkerSources,
    MeasuredPoints,
    StampedRows,
    assemble,
)
from octo_arm_model.experiment.steady_windows import reading_noise
from octo_arm_model.wire.measurements import MeasuredArm, PoseOf
from octo_arm_model.wire.messages import Refusals
from octo_arm_model.wire.tensions import DISPLACEMENTS

_TIMES = 3.0  # standard deviations that the largest change of a tension may be


@dataclass(frozen=True)
class Sources:
    """The topics and parameters of a recording."""

    tensions: str | None = None  #: topic of the tensions, as for `find_sensors`
    #: topics of other measurements, by their names in `MEASUREMENT_TOPICS`
    others: Mapping[str, str | None] = field(default_factory=dict)
    midlines: str | None = None  #: topic of the camera; None for the usual one
    #: parameters of the arm and the estimator; None for the bag's description
    parameters: Mapping[str, Any] | None = None
    values: Mapping[str, Any] = field(default_factory=dict)  #: parameters that replace those
    #: parameters of load cells and encoders that replace those of the arm
    calibration: Mapping[str, Any] = field(default_factory=dict)
    alignment: Pose | None = None  #: pose of frames other than base_frame; None if it is not known
    #: offset added to the stamps of the camera [s]; None to find it
    clock_offset: float | None = None
    marker_names: tuple[str, ...] = ()  #: names of the markers, as for `find_sensors`


class StampedMeasurement(NamedTuple):
    """A measurement with its stamp and its time of receipt."""

    stamp_ns: int  #: time of the measurement [ns]
    received_ns: int  #: time at which the recorder received it [ns]
    measurement: Measurement


@dataclass(frozen=True)
class SensorRecording:
    """The input of an estimator from a recording."""

    parameters: Mapping[str, Any]  #: parameters of the arm
    config: Config  #: the configuration that they describe
    sensors: SensorTopics  #: topics that are read
    settings: EstimatorSettings  #: settings of the estimator
    models: Mapping[str, ArmModel]  #: models of its hypotheses
    groups: Sequence[Sequence[StampedMeasurement]]  #: measurements, grouped by their stamps
    origin_ns: int  #: stamp that times count from [ns]
    camera: CameraCheck | None  #: comparison of the estimates with a camera, or None
    refusals: Refusals  #: counts of the messages left out
    notes: list[str]  #: decisions made, in words


def read_sensor_recording(
    reader: BagReader,
    sources: Sources,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> SensorRecording:
    """Read the measurements in a bag, and prepare the estimator and the comparison with a camera.

    Raises:
        BagError: if a topic is missing or nothing is measured, or the bag is damaged.
        ConfigError: if there is no description of the arm, or the estimator does not cover it.
        OctoArmError: if a value is outside its range.
    """
    sensors = find_sensors(reader, sources.tensions, sources.others, sources.marker_names)
    found = sources.parameters
    described = found if found is not None else describe(reader, sensors.prefix)
    given = sensed_by(reader, {**described, **sources.values}, sources.calibration)
    own = {name: given.pop(name) for name in list(given) if name.startswith(PREFIX)}
    config = Config.from_parameters(given)
    refusals, notes = Refusals(), notes_on(reader)
    count, of_cells = Count(progress), sensors.tensions
    read = read_readings(reader, of_cells, config, refusals, count, raw=True)
    tensions = read or StampedRows('')
    stamps = np.array(tensions.stamps, np.int64)
    time = np.asarray(1e-9 * (stamps - stamps[:1]), np.float64)
    recorded = tension_statistics(time, np.array(tensions.rows)) if len(time) else None
    settings = EstimatorSettings.from_parameters(RECORDING_DEFAULTS | own, config, recorded)
    models = settings.models(config, budget=PATIENT)
    turned: set[str] = set()  # frames that are not base_frame, which have the pose given
    if sources.alignment is None:
        pose_of = _transforms(reader, sensors, config, refusals, count)
    else:
        pose_of = partial(_aligned, sources.alignment, turned)
    arm = MeasuredArm(config, settings, pose_of)
    groups = read_measured(reader, sensors, tensions, arm, refusals, count)
    if not groups:
        where = ', '.join(sensors.all)
        raise BagError(f'{reader.path}: nothing measured on {where}{refusals.in_short}')
    notes += _clocks(groups)
    usual = ArmTopics(reader, sensors.prefix).usual(MIDLINE, MIDLINES)
    topic = sources.midlines
    if topic is None and len(usual) == 1:
        topic = usual[0]
    origin = min(tensions.stamps, default=groups[0][0].stamp_ns)
    camera = None
    if topic is not None:
        try:
            if not tensions.rows:
                raise MeasurementError(
                    'there are no tensions to tell a shape without the estimator'
                )
            camera = _camera(reader, topic, config, tensions, sources, refusals, notes)
        except MeasurementError as error:
            notes.append(f'{topic} is not compared with: {error}')
    if sources.alignment is not None and not turned and camera is None:
        raise BagError('--align has no effect: all that is measured is in base_frame')
    return SensorRecording(
        given, config, sensors, settings, models, groups, origin, camera, refusals, notes
    )


def _clocks(groups: Sequence[Sequence[StampedMeasurement]]) -> list[str]:
    """Return a remark on clocks that differ by more than a message may be late."""
    delays: dict[str, list[int]] = {}
    for one in itertools.chain(*groups):
        delays.setdefault(one.measurement.name, []).append(one.received_ns - one.stamp_ns)
    late = {name: 1e-9 * float(np.median(found)) for name, found in delays.items()}
    ahead, behind = min(late, key=late.__getitem__), max(late, key=late.__getitem__)
    if late[behind] - late[ahead] <= RANGE:
        return []
    return [
        f'by times of receipt stamps of {ahead} are {late[behind] - late[ahead]:.6g} s ahead of '
        f'those of {behind}: they are not combined, expected one clock'
    ]


def _aligned(alignment: Pose, turned: set[str], frame: str, _: int) -> Pose:
    """Return the pose that is given for any ``frame``, and add this to ``turned``."""
    turned.add(frame)
    return alignment


def _transforms(
    reader: BagReader, sensors: SensorTopics, config: Config, refusals: Refusals, count: Count
) -> PoseOf | None:
    """Return what finds the poses of frames by TF; None if no sensor needs it or it is missing.

    Displacements have no frame; other sensors need it if a message is not in base_frame.
    """
    topics = tf_topics(reader)
    framed = [topic for name, topic in sensors.others.items() if name != DISPLACEMENTS]
    frames = {
        reader.read(record, lambda message: str(message.header.frame_id))[1]
        for record in (reader.messages(framed) if topics and framed else ())
    }
    if frames <= {None, '', config.base_frame}:
        return None
    tree = read_transforms(reader, topics, refusals, count)

    def pose_of(frame: str, stamp_ns: int) -> Pose:
        try:
            return tree.pose(frame, config.base_frame, stamp_ns)
        except MeasurementError as error:
            raise MeasurementError(f'its frame is {frame[:MAX_NAME]!r}, and {error}') from None

    return pose_of


def read_measured(
    reader: BagReader,
    sensors: SensorTopics,
    tensions: StampedRows,
    arm: MeasuredArm,
    refusals: Refusals,
    count: Count,
) -> list[list[StampedMeasurement]]:
    """Read all measurements, sorted by stamp; those with the same stamp form a list.

    ``tensions`` have been read. ``refusals`` count the messages left out, ``count`` all others.

    Raises:
        BagError: if the bag is damaged.
    """
    stddev = arm.settings.tension_stddev
    stamped = [
        StampedMeasurement(stamp, received, Tensions(row, stddev))
        for stamp, received, row in zip(tensions.stamps, tensions.received, tensions.rows)
    ]
    topics = list(sensors.readers)

    def read(record: Record, message: Any) -> Measurement:
        return sensors.readers[record.topic](
            message, arm=replace(arm, received_ns=record.received_ns)
        )

    for record, stamp_ns, measurement in read_messages(reader, topics, read, refusals, count):
        stamped.append(StampedMeasurement(stamp_ns, record.received_ns, measurement))
    stamped.sort(key=lambda m: m.stamp_ns)
    return [list(group) for _, group in itertools.groupby(stamped, key=lambda m: m.stamp_ns)]


def tension_statistics(time: FloatArray, tensions: FloatArray) -> TensionStatistics:
    """Return noise and rate of ``tensions`` (n, tendons) [N] at ``time`` (n,) [s], as received.

    At this rate the largest change between readings is three standard deviations. Each reading is
    replaced by the median of three, so that a single wrong reading has no effect. Readings with
    nearly the same stamp count as the usual time apart.
    """
    if len(time) < 3:
        return TensionStatistics(0.0, 0.0)
    order = np.argsort(time, kind='stable')
    time, tensions = time[order], tensions[order]
    middle = without_spikes(tensions)[1:-1]
    elapsed = np.diff(time[1:-1])
    is_later = elapsed > 0.0
    usual = float(np.median(elapsed[is_later])) if is_later.any() else 0.0
    apart = np.maximum(elapsed[is_later], usual)
    change = np.abs(np.diff(middle, axis=0))[is_later] / np.sqrt(apart[:, np.newaxis])
    rate = float(change.max(initial=0.0)) / _TIMES
    return TensionStatistics(reading_noise(tensions), rate)


def _camera(
    reader: BagReader,
    topic: str,
    config: Config,
    tensions: StampedRows,
    sources: Sources,
    refusals: Refusals,
    notes: list[str],
) -> CameraCheck:
    """Return the comparison of estimates with midlines or tips on a ``topic``.

    ``refusals`` count messages left out, ``notes`` get decisions. MeasurementError is raised
    if there is nothing to compare, or neither end is clearly the base.
    """
    measured = MarkerSources((topic,), is_aligned=sources.alignment is not None)
    points = MeasuredPoints(measured, config.arm.length)
    topics = MeasuredTopics(ArmTopics(reader), measured, Count())
    frames = topics.read(points, config.base_frame, refusals, notes)
    recording = assemble({}, tensions, None, frames, points, refusals, notes)
    alignment = sources.alignment
    if alignment is None and recording.frame_id == config.base_frame:
        alignment = Pose()
    elif alignment is None:
        notes.append(f'the pose of {recording.frame_id!r} is fitted, once for each shape')
    pairing = Pairing(offset=sources.clock_offset)
    lines = base_first(recording, pairing, config, alignment, notes)
    ahead = camera_offset(recording, pairing, config, lines, notes)
    return CameraCheck(topic, recording, ahead, lines, alignment, config.solver('exact'))
