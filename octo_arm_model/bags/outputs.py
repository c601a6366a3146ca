"""Bags that commands write: a synthetic experiment, estimates and simulated motions."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_FRICTION
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.arm.validation import not_negative, positive, whole, within
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.replay import open_copies
from octo_arm_model.bags.topics import DESCRIPTION, MIDLINE
from octo_arm_model.bags.writer import TENSIONS, BagWriter, Message, SensorMessages
from octo_arm_model.config.config import Config, load_config
from octo_arm_model.config.paper_data import PROTOTYPE_ERRORS
from octo_arm_model.config.parameter_files import parameters_as_yaml, preset_path
from octo_arm_model.estimation.estimate import Estimate, contact_of
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import displacements_of
from octo_arm_model.rod.rotations import axes_of
from octo_arm_model.rod.solver import Solver
from octo_arm_model.rod.stations import interpolated
from octo_arm_model.simulation.moving_arm import Moment
from octo_arm_model.wire.backbone import BACKBONE_TOPICS, TENSION_ESTIMATES, BackboneWriter
from octo_arm_model.wire.estimate import ESTIMATES, EstimateWriter
from octo_arm_model.wire.measurements import MARKERS, TIP_POSE
from octo_arm_model.wire.messages import Stamp
from octo_arm_model.wire.tensions import DISPLACEMENTS, TENSION_TOPICS

PRESET = 'renda2012_prototype'
# Pose of the camera's frame in base_frame: beside the arm, looking at it.
CAMERA_POSITION = (0.12, 0.05, 0.60)  # [m]
CAMERA_QUATERNION = (0.8, -0.36, 0.288, 0.384)  # x, y, z, w
TOUCH_DIRECTION = (0.0, 0.6, 0.8)  # in base_frame
# When a touch begins and has its full force, over the time of a tension; it ends symmetrically.
_TOUCH_AFTER, _TOUCH_GROWN = 0.125, 0.1875
_MOST_AHEAD = 1e8  # bound of a clock offset [s], as seconds of a stamp are an int32


@dataclass(frozen=True)
class Experiment:
    """The parameters of the simulated experiment of `add_demo`, and the noise of its sensors.

    Raises:
        ArmDefinitionError: if a value is impossible.
    """

    stiffness: float = 1.1  #: true Young's modulus over that of the config [-]
    clock_offset: float = 0.08  #: time by which the camera's clock is ahead [s]
    hold: float = 4.0  #: time for which each tension is held [s]
    ramp: float = 1.0  #: time from one tension to the next [s]
    tension_rate: float = 100.0  #: messages of tensions per second [Hz]
    camera_rate: float = 10.0  #: midlines per second [Hz]
    #: standard deviation of the tension of the tendon that is pulled [N]
    tension_noise: float = 0.005
    midline_noise: float = 0.0005  #: standard deviation of each coordinate of a midline [m]
    dropped: float = 0.05  #: share of the midlines that are missing [-]
    outliers: float = 0.03  #: share of the midlines with points far from the arm [-]
    #: true stiffness of the tendons' sheaths [Pa]; 0 for that of the config. Encoders of the
    #: winches are recorded only with this or ``axial_stiffness``.
    sheath: float = 0.0
    axial_stiffness: float = 0.0  #: true E A of the tendons [N]; 0 for that of the config
    encoder_noise: float = 2e-5  #: standard deviation of the reading of an encoder [m]
    #: coefficient of friction of the tendons [-]; with it tensions also go down again
    friction: float = 0.0
    #: force on the tip [N] along `TOUCH_DIRECTION` while the middle tension is held; with it the
    #: pose of the tip is measured too
    touch: float = 0.0
    markers: tuple[float, ...] = ()  #: arc coordinates of markers that are measured [m]
    marker_rate: float = 20.0  #: poses of the tip, and messages of markers, per second [Hz]
    marker_noise: float = 0.0005  #: standard deviation of each coordinate of tip and markers [m]
    #: standard deviation of each component of the tip's rotation vector [rad]
    turn_noise: float = 0.02
    seed: int = 0  #: seed of all random numbers

    def __post_init__(self) -> None:
        """Check the values that the command line sets."""
        positive('--stiffness', self.stiffness, '-')
        within('--clock-offset', self.clock_offset, -_MOST_AHEAD, _MOST_AHEAD, 's')
        not_negative('--sheath', self.sheath, 'stiffness', 'Pa')
        not_negative('--axial-stiffness', self.axial_stiffness, 'stiffness', 'N')
        not_negative('--friction', self.friction, 'coefficient', '-', MAX_FRICTION)
        not_negative('--touch', self.touch, 'force', 'N')
        whole('--seed', self.seed)

    def schedule(self, config: Config) -> tuple[FloatArray, FloatArray]:
        """Return the corners of the tension of the first tendon over time: [s] and [N].

        The tensions are those of the paper's Table 1. For an arm other than its prototype they are
        scaled by the largest tensions that the two arms can bear.
        """
        prototype = load_config(preset_path(PRESET)).arm
        limit, usual_limit = (default_highest(arm).flat[0] for arm in (config.arm, prototype))
        steps = np.concatenate([[0.0], np.array(list(PROTOTYPE_ERRORS)) * (limit / usual_limit)])
        if self.friction:
            steps = np.concatenate([steps, steps[-2:0:-1]])
        starts = np.arange(steps.size) * (self.hold + self.ramp)
        return np.stack([starts, starts + self.hold], axis=1).ravel(), np.repeat(steps, 2)

    def touches(self, time: FloatArray, corners: FloatArray) -> FloatArray:
        """Return the force on the tip (n, 3) [N] at ``time`` (n,) [s], by times of `schedule`."""
        parts = [_TOUCH_AFTER, _TOUCH_GROWN, 1.0 - _TOUCH_GROWN, 1.0 - _TOUCH_AFTER]
        t = corners[2 * (len(corners) // 4)] + self.hold * np.array(parts)
        return np.outer(np.interp(time, t, [0.0, self.touch, self.touch, 0.0]), TOUCH_DIRECTION)


def custom_data(experiment: Experiment) -> dict[str, str]:
    """Return custom data for the metadata of a demo: its parameters, and the text of the note."""
    camera = {'camera_position': CAMERA_POSITION, 'camera_quaternion': CAMERA_QUATERNION}
    truth = json.dumps({'model': 'exact', **asdict(experiment), **camera})
    note = (
        'This recording is synthetic: nothing of it was measured. octo-arm record-demo made it '
        f'with {truth}.'
    )
    return {'note': note, 'truth': truth}


def true_config(parameters: Mapping[str, Any], experiment: Experiment) -> Config:
    """Return the arm of ``parameters`` with the true values of the ``experiment``."""
    changed: dict[str, Any] = {'model': 'exact'}
    for name in ('material.youngs_modulus', 'material.table_youngs_modulus'):
        if parameters.get(name):
            changed[name] = (experiment.stiffness * np.array(parameters[name])).tolist()
    for name, value in (
        ('tendons.sheath_stiffness', experiment.sheath),
        ('tendons.axial_stiffness', experiment.axial_stiffness),
        ('tendons.friction', experiment.friction),
    ):
        if value:
            changed[name] = [value]
    return Config.from_parameters({**parameters, **changed})


def _shapes(solver: Solver, pulls: FloatArray, forces: FloatArray) -> list[Backbone]:
    """Return shapes while the first tendon is pulled, (n,), and the tip pushed, (n, 3) [N]."""
    shapes: list[Backbone] = []
    tensions = np.zeros((pulls.size, *solver.arm.tension_shape))
    tensions.reshape(pulls.size, -1)[:, 0] = pulls
    for pulled, wrench in zip(tensions, np.pad(forces, ((0, 0), (0, 3))), strict=True):
        last = shapes[-1] if shapes else None
        if last and (last.tensions == pulled).all() and (last.tip_wrench == wrench).all():
            shapes.append(last)
        else:
            shapes.append(solver.follow(pulled, last, wrench if wrench.any() else None))
    return shapes


START = 1_335_830_400 * 10**9  # 1 May 2012 [ns]
_POINTS = 41  # in a midline


def add_demo(writer: BagWriter, parameters: Mapping[str, Any], experiment: Experiment) -> None:
    """Write a simulated ``experiment`` on the arm of ``parameters``, the same for the same seed.

    The first tendon is pulled by the tensions of `Experiment.schedule`. The midlines are shapes of
    the model exact in the camera's frame, with stamps of the camera's clock.

    Raises:
        OctoArmError: if the parameters describe no valid arm, a marker is not on it, or the bag
            cannot be written.
    """
    config = Config.from_parameters(parameters)
    for s in experiment.markers:
        within('--markers', s, 0.0, config.arm.length, 'm')
    rng = np.random.default_rng(experiment.seed)
    times, pulls = experiment.schedule(config)
    messages = SensorMessages(writer, config, 'camera')
    solver = true_config(parameters, experiment).solver()

    def shapes_at(when: FloatArray) -> list[Backbone]:
        forces = experiment.touches(when, times)
        return _shapes(solver, np.interp(when, times, pulls), forces)

    writer.add_text(f'/{DESCRIPTION}', parameters_as_yaml(parameters), START)
    writer.add_text('/note', custom_data(experiment)['note'], START)

    samples = np.arange(0.0, times[-1], 1.0 / experiment.tension_rate)
    readings = np.interp(samples, times, pulls)
    # The load cell of a slack tendon reads zero, without noise.
    noise = experiment.tension_noise * rng.standard_normal(readings.size)
    readings = np.where(readings > 0.0, np.maximum(readings + noise, 0.0), 0.0)
    tensions = np.zeros((readings.size, len(config.arm.tendons)))
    tensions[:, 0] = readings
    messages.add_all(TENSIONS, _stamps(samples), tensions)

    if experiment.sheath or experiment.axial_stiffness:
        shapes = shapes_at(samples)
        reeled_in = np.array([displacements_of(solver, one).ravel() for one in shapes])
        # A separate generator, so that all else is the same with encoders and without.
        noise = np.random.default_rng([experiment.seed, 1]).standard_normal(reeled_in.shape)
        reeled_in += experiment.encoder_noise * noise
        messages.add_all(DISPLACEMENTS, _stamps(samples), reeled_in)

    instants = np.arange(0.0, times[-1], 1.0 / experiment.camera_rate)
    instants = instants[rng.random(instants.size) >= experiment.dropped]
    shapes = shapes_at(instants)
    places = np.linspace(0.0, shapes[0].s[-1], _POINTS)
    points = np.array([interpolated(places, shape.s, shape.position) for shape in shapes])
    # A row vector times the matrix is rotated by its inverse, from base_frame to the camera's.
    midlines = (points - CAMERA_POSITION) @ axes_of(CAMERA_QUATERNION)
    midlines += experiment.midline_noise * rng.standard_normal(midlines.shape)
    for midline in midlines:
        if rng.random() < experiment.outliers:
            # The tracking is lost from a random point on, as at a reflection.
            lost = slice(int(rng.integers(_POINTS // 4, _POINTS)), None)
            midline[lost] += rng.normal(0.0, 0.05 * config.arm.length, 3)
    ahead = round(1e9 * experiment.clock_offset)
    messages.add_all(MIDLINE, _stamps(instants), midlines, ahead_ns=ahead)
    if experiment.touch or experiment.markers:
        instants = np.arange(0.0, times[-1], 1.0 / experiment.marker_rate)
        _add_measured(messages, instants, shapes_at(instants), experiment)
    messages.write()


def _add_measured(
    messages: SensorMessages, times: FloatArray, shapes: Sequence[Backbone], experiment: Experiment
) -> None:
    """Add the poses of the tip and the markers of ``shapes`` at ``times`` (n,) [s]."""
    # A separate generator, so that all else is the same with a touch and without.
    rng = np.random.default_rng([experiment.seed, 2])
    stddev = np.repeat([experiment.marker_noise, experiment.turn_noise], 3)
    for stamp, shape in zip(_stamps(times), shapes, strict=True):
        if experiment.touch:
            error = stddev * rng.standard_normal(6)
            rotation = Rotation.from_rotvec(error[3:]) * Rotation.from_quat(shape.quaternion[-1])
            pose = shape.tip + error[:3], rotation.as_quat(), np.diag(stddev**2)
            messages.add(TIP_POSE, stamp, pose[0][np.newaxis], *pose[1:])
        if experiment.markers:
            points = interpolated(np.array(experiment.markers), shape.s, shape.position)
            noise = experiment.marker_noise * rng.standard_normal(points.shape)
            messages.add(MARKERS, stamp, points + noise)


def _stamps(times: FloatArray) -> list[int]:
    """Return the stamps [ns] of ``times`` [s] from the start."""
    return [START + round(time * 1e9) for time in times.tolist()]


def estimate_output(
    writer: BagWriter,
    prefix: str,
    parameters: Mapping[str, Any],
    models: Mapping[str, ArmModel],
    start_ns: int,
) -> Callable[[str, Estimate, int, int], None]:
    """Return a function that writes an estimate of a hypothesis with stamp and receipt [ns].

    It writes by ``writer`` to topics in the namespace ``prefix``, which ends with a slash. The arm
    of ``parameters`` is described there at the time ``start_ns`` [ns]. ``models`` are those of the
    hypotheses, by name.

    Raises:
        BagError: if the bag cannot be written, also by the function.
        ConfigError: by the function, if no stamp can hold the time.
    """
    frame = Config.from_parameters(parameters).base_frame
    writers = {}
    for name, model in models.items():
        others = EstimateWriter(frame, model.arm, model.solver.grid.s)
        writers[name] = model.arm, BackboneWriter.of(frame, model.solver), others
    writer.add_text(prefix + DESCRIPTION, parameters_as_yaml(parameters), start_ns)

    def write(hypothesis: str, estimate: Estimate, stamp_ns: int, received_ns: int) -> None:
        stamp, (arm, shapes, others) = Stamp.from_ns(stamp_ns), writers[hypothesis]
        written = shapes.all(estimate.backbone, estimate.pose_covariance[-1], *stamp)
        written[TENSION_ESTIMATES] = shapes.tensions(estimate.tensions, *stamp)
        written |= others.write(estimate, contact_of(estimate, arm), stamp)
        writer.write(
            (writer.add(prefix + topic, ESTIMATES[topic]), received_ns, data)
            for topic, data in written.items()
        )

    return write


def copy_bag(reader: BagReader, writer: BagWriter, prefix: str) -> dict[str, str]:
    """Copy a bag without estimates of the arm of ``prefix``; return topics not copied, and why.

    Raises:
        BagError: if a bag is damaged or cannot be written.
    """
    copies, left_out = open_copies(
        reader, writer, {prefix + topic for topic in (*ESTIMATES, DESCRIPTION)}
    )
    left_out.pop(prefix + DESCRIPTION, None)  # the description is the same
    # Messages are copied one by one, because many large ones may not fit into memory.
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
        OctoArmError: if the bag cannot be written, or the motion cannot be computed further.
    """
    writer.add_text(f'/{DESCRIPTION}', parameters_as_yaml(parameters), START)
    written, exact = list[Moment](), np.zeros((6, 6))
    layout = BackboneWriter.of(config.base_frame, config.solver('exact'))

    def messages() -> Iterator[Message]:
        for moment in moments:
            written.append(moment)
            shape, received = moment.backbone, START + round(moment.time * 1e9)
            stamp = Stamp.from_ns(received)
            tensions = writer.add(f'/{TENSIONS}', TENSION_TOPICS[TENSIONS].type_name)
            yield tensions, received, layout.tensions(shape.tensions, *stamp)
            for topic, data in layout.all(shape, exact, *stamp).items():
                yield writer.add(f'/{topic}', BACKBONE_TOPICS[topic]), received, data

    writer.write(messages())
    return written
