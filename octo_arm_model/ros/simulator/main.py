"""The node ``octo_arm_sim``: simulates winches, load cells and, if wanted, the arm.

It takes commanded tensions and publishes measured tensions on the topic of `octo_arm_node`. The
true tensions, without errors of load cells and with the motion of the arm, are published on
``ground_truth/tendon_tensions``: another `octo_arm_node`, in the namespace ``ground_truth``, then
computes the true shape of the arm. Winches are commanded by tension, or by length if they are
named on ``tendon_commands/displacements``; readings of their encoders are published on request.
The arm may be pushed, and its sensors publish on ``measured/...`` for `octo_arm_estimator`.
"""

import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, Vector3Stamped
from octo_arm_msgs.msg import TendonTensions
from rclpy.time import Time as RosTime
from sensor_msgs.msg import JointState

from octo_arm_model.arm.errors import ConfigError, LoadError, OctoArmError, in_short, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.config.parameters import PARAMETERS as ARM_PARAMETERS
from octo_arm_model.ros import topics
from octo_arm_model.ros.live_parameters import LiveParameters
from octo_arm_model.ros.node.diagnostics import NO_TIME, Report, make_status
from octo_arm_model.ros.node.inputs import Inputs
from octo_arm_model.ros.node.main import run
from octo_arm_model.ros.node.outputs import OUTPUT_QOS
from octo_arm_model.ros.simulator import publishers, services
from octo_arm_model.ros.start import CheckedNode
from octo_arm_model.simulation import movements
from octo_arm_model.simulation.dynamic_arm import DynamicArm, check_values
from octo_arm_model.simulation.simulator import PARAMETERS, SimulatorConfig, TendonDrive
from octo_arm_model.wire.tensions import NONE, read_displacements

_SLOW = 0.2  # time by which an arm falls behind the clock, over that in which it moved


class SimulatorNode(CheckedNode):
    """Publishes the tensions that load cells would measure."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters and start; OctoArmError if one is missing, unknown or impossible."""
        super().__init__('octo_arm_sim', **options)
        self._configured: SimulatorConfig | None = None
        self._folder: Path | None = None  # of the files that states are saved to
        self._measured, self._effective = (
            topics.create_publisher(self, TendonTensions, topic, OUTPUT_QOS)
            for topic in ('tendon_tensions', 'ground_truth/tendon_tensions')
        )
        # It counts commands, refused ones, readings published and lost, failed steps, the time
        # simulated, and that by which the arm fell behind the clock [s].
        self._diagnostics, self._failure = Report(self, self._statuses), ''
        self._outputs = publishers.ArmPublishers(self)
        self._time = services.SimulationClock(self, self._step)
        self._commanders = publishers.Commanders(self)
        self._push = services.PushService(self, lambda: self._config.push)
        self._live = LiveParameters(self, (*ARM_PARAMETERS, *PARAMETERS), self._prepare, self._use)
        self._live.begin()
        self._time.offer_services(self._reset, self._save, self._restore)
        count = self._diagnostics.count
        inputs = Inputs(
            self, self._diagnostics.refused, lambda older: count('commands', 1 + older)
        )
        for topic, message in movements.COMMAND_TOPICS.items():
            kind = topics.message_class(message.type_name)
            inputs.subscribe(kind, topic, partial(self._on_command, topic))
        self._lengths = inputs.subscribe(
            JointState, f'{movements.TOPIC}/displacements', self._on_lengths
        )
        inputs.subscribe(Vector3Stamped, services.PUSH_TOPIC, self._on_push, is_answered=False)
        inputs.subscribe(PoseStamped, 'base_pose', self._on_base, is_answered=False)
        inputs.subscribe(Vector3Stamped, 'current', self._on_current, is_answered=False)
        topics.check_overrides(self)

    def _prepare(self, values: dict[str, Any]) -> SimulatorConfig:
        """Check the parameters; a change must not give services another folder to write to."""
        config = SimulatorConfig.from_parameters(values)
        file = config.course.state_file
        if self._configured is None:
            self._folder = Path(file).parent if file else None
        elif file and Path(file).parent != self._folder:
            raise ConfigError(
                f'state_file is {shown(file)}, expected one in the folder of that given at the '
                f'start, {self._folder or "which was none"}'
            )
        return config

    def _use(self, config: SimulatorConfig, names: set[str]) -> None:
        """Use ``config`` from now on; ``names`` are the parameters that were set."""
        previous, self._configured = self._configured, config
        if any(name.startswith('push.') for name in names):
            self._push.forget()
        if previous is None:
            self._reset()
        else:
            self._go_on_from(previous, names)
        self._time.use(config.course)

    def _go_on_from(self, previous: SimulatorConfig, names: set[str]) -> None:
        config = self._config
        for lost in self._drive.go_on_with(config):
            self.get_logger().warning(lost)
        if config.model.arm.tendon_names != previous.model.arm.tendon_names:
            self._command = np.zeros(len(config.model.arm.tendons))
            self._is_commanded = False
            self.get_logger().warning('all tendons go slack, as they have other names')
        elif (self._command > config.limits).any():
            self._command = np.minimum(self._command, config.limits)
            self.get_logger().warning('tendons go down to their new limits')
        if 'profile.name' in names:
            self._is_playing, self._played_ns = config.profile is not None, 0.0
            if self._is_playing and self._drive.held:
                held = ' '.join(self._drive.held)
                self.get_logger().warning(f'the profile leaves out, as driven by length: {held}')

    @property
    def _config(self) -> SimulatorConfig:
        """The present configuration, which is set before any subscription exists."""
        assert self._configured is not None
        return self._configured

    def _on_command(self, name: str, topic: str, message: Any) -> None:
        """Drive the named tendons; the others keep their command."""
        arm = self._config.model.arm
        tensions, lengths = movements.read_command(name, message, arm, self._config.limits)
        present = zip(arm.tendon_names, self._command, strict=True)
        command = np.array([tensions.get(*item) for item in present])
        if name == movements.JOINTS:  # it takes tendons from their lengths, or gives them others
            before = self._drive.held
            held = {tendon: before[tendon] for tendon in before if tendon not in tensions}
            if lengths or held != before:
                self._drive.hold(held | lengths, command)
        self._follow(topic, command, tensions, lengths)

    def _follow(
        self,
        topic: str,
        command: FloatArray,
        tensions: Mapping[str, float],
        lengths: Mapping[str, float],
    ) -> None:
        """Use ``command`` [N]; record ``tensions`` [N] of free tendons and ``lengths`` [m]."""
        self._command, self._is_commanded, self._is_playing = command, True, False
        held = self._drive.held
        pulled = {name: ('N', float(pull)) for name, pull in tensions.items() if name not in held}
        driven = {name: ('m', length) for name, length in lengths.items()}
        self._commanders.note(topic, pulled | driven)

    def _on_lengths(self, topic: str, message: JointState) -> None:
        lengths = read_displacements(message, self._config.model.arm)
        self._drive.hold(lengths, self._command)
        self._follow(topic, self._command, {}, lengths)

    def _on_push(self, topic: str, message: Vector3Stamped) -> None:
        self._push.hold(message, self._config, self._moving_arm())

    def _on_base(self, topic: str, message: PoseStamped) -> None:
        services.check_frame(message.header, self._config, 'pose')
        position, q = message.pose.position, message.pose.orientation
        pose = Pose((position.x, position.y, position.z), (q.x, q.y, q.z, q.w))
        self._moving_arm().surroundings.move_base(pose)

    def _on_current(self, topic: str, message: Vector3Stamped) -> None:
        services.check_frame(message.header, self._config, 'current')
        if not self._config.model.loads.fluid_density:
            raise LoadError('loads.fluid_density is 0, expected that of the water that flows')
        flow = message.vector
        self._moving_arm().surroundings.flow((flow.x, flow.y, flow.z))

    def _moving_arm(self) -> DynamicArm:
        arm = self._config.pushed_arm
        if not isinstance(arm, DynamicArm):
            raise ConfigError('dynamics is false, expected true for an arm that moves')
        return arm

    def _reset(self) -> None:
        """Reset the simulation: slack tendons, no commands, the arm at rest without history."""
        config = self._config
        self._drive = TendonDrive(config)
        self._command = self._set_point = np.zeros(len(config.model.arm.tendons))
        if config.pushed_arm is not None:
            config.pushed_arm.reset()
        # Times since the beginning; of the profile a float, as its speed need not be 1.
        self._is_playing, self._played_ns, self._time_ns = config.profile is not None, 0.0, 0
        self._is_commanded = False
        self._push.forget()

    def _state_file(self) -> tuple[DynamicArm, Path]:
        arm, file = self._moving_arm(), self._config.course.state_file
        if not file:
            raise ConfigError("state_file is '', expected the name of a file of a state")
        return arm, Path(file)

    def _state(self) -> dict[str, FloatArray]:
        held, names = self._drive.held, self._config.model.arm.tendon_names
        return {
            'hardware': self._drive.hardware.state,
            'command': self._command,
            'lengths': np.array([held.get(name, 0.0) for name in names]),
            'driven': np.array([float(name in held) for name in names]),
            'played': np.array(self._played_ns),
            'time_ns': np.array(float(self._time_ns)),
            'playing': np.array(float(self._is_playing)),
            'surroundings': self._moving_arm().surroundings.values,
        }

    def _save(self) -> None:
        arm, path = self._state_file()
        arm.save(path, self._state())

    def _restore(self) -> None:
        """Read a saved state and continue from it with its commands; noise is not restored."""
        arm, path = self._state_file()
        config, names = self._config, self._config.model.arm.tendon_names
        shapes = {name: array.shape for name, array in self._state().items()}
        state, values = arm.read(path, shapes)
        check_values(values['surroundings'], state.base)
        for tensions in (values['command'], *values['hardware'][:-1]):
            movements.check_command(config.model.arm, tensions, config.limits)
        lengths = zip(names, values['lengths'].tolist(), values['driven'], strict=True)
        held = {name: length for name, length, is_driven in lengths if is_driven}
        arm.check_lengths(held)
        self._drive.hardware.state, self._drive.held = values['hardware'], held
        self._command, self._played_ns = values['command'], values['played'].item()
        self._is_playing = bool(values['playing']) and config.profile is not None
        self._is_commanded = False
        self._time_ns = round(values['time_ns'].item())
        self._time.is_stopped = False
        self._push.forget()
        arm.restore(state, values['surroundings'])

    def _step(self, elapsed_ns: int, now: RosTime) -> None:
        """Advance winches, load cells and arm by ``elapsed_ns``, up to the time ``now``."""
        config, course = self._config, self._config.course
        if course.dynamics and not course.publish_clock:
            # If a call is late, all that is simulated falls behind a clock that is not its own.
            late_ns, elapsed_ns = elapsed_ns, min(elapsed_ns, round(2e9 / course.rate))
            self._diagnostics.count('behind', 1e-9 * (late_ns - elapsed_ns))
        if self._is_playing and config.profile is not None:
            self._command = config.profile.at(1e-9 * self._played_ns, loop=config.playing.loop)
            self._played_ns += config.playing.speed * elapsed_ns
        before_ns, self._time_ns = self._time_ns, self._time_ns + elapsed_ns
        elapsed, model, stamp = 1e-9 * elapsed_ns, config.model, now.to_msg()
        try:
            self._set_point = self._drive.set_points(self._command)
        except OctoArmError as error:
            # The winches keep their last set point.
            self._diagnostics.log.add(f'{self._lengths.topic} refused', in_short(error))
        effective = self._drive.advance(self._set_point, elapsed)
        push_force = self._push.at(1e-9 * self._time_ns)
        *_, before = self._drive.hardware.state  # lengths that winches have reeled in
        has_moved = config.pushed_arm is not None
        self._diagnostics.count('simulated', elapsed)
        try:
            effective = self._drive.move(effective, push_force, elapsed)
        except OctoArmError as error:
            self._fail(error)
            has_moved = False
        self._effective.publish(
            topics.tensions_message(effective, model.arm, stamp, model.base_frame)
        )
        measured = self._drive.hardware.read()
        if measured is None:
            self._diagnostics.count('lost')
        else:
            self._measured.publish(self._readings_message(measured, stamp))
            self._diagnostics.count('published')
        if has_moved:
            times_ns = before_ns, self._time_ns
            self._outputs.publish(config, push_force, before, times_ns, stamp)

    def _fail(self, error: OctoArmError) -> None:
        self._failure = in_short(error)
        self._diagnostics.count('failed')
        self._diagnostics.log.add('the arm stays as it was', self._failure)
        if self._config.course.on_failure == 'pause' and not self._time.is_paused:
            self._time.is_paused = True
            self.get_logger().error(f'paused, as no step succeeds: {self._failure}')

    def _readings_message(self, readings: FloatArray, stamp: Time) -> TendonTensions:
        model = self._config.model
        message = topics.tensions_message(readings, model.arm, stamp, model.base_frame)
        if names := model.load_cells.names:
            # The message has the names that the node expects, and only tendons with a load cell.
            cells = [number for number, name in enumerate(names) if name != NONE]
            message.name = [names[number] for number in cells]
            message.tension = readings.ravel()[cells].tolist()
        return message

    def _statuses(self) -> list[DiagnosticStatus]:
        source = publishers.COMMANDS if self._is_commanded else publishers.NO_COMMAND
        source = publishers.PROFILE if self._is_playing else source
        source = publishers.PAUSED if self._time.is_paused else source
        has_time = self._config.course.publish_clock or self.get_clock().now().nanoseconds
        report, recent, totals = (
            self._diagnostics,
            self._diagnostics.lately,
            self._diagnostics.totals,
        )
        problems = [self._commanders.report() if has_time else NO_TIME]
        if refused := recent['refused']:
            problems.append(f'{refused:.0f} refused: {report.reason}')
        if failed := recent['failed']:
            problems.append(f'{failed:.0f} steps failed: {self._failure}')
        if recent['behind'] > _SLOW * recent['simulated']:
            part = recent['simulated'] / (recent['simulated'] + recent['behind'])
            problems.append(f'the arm moves at {part:.0%} of clock speed')
        status = make_status(
            'simulator',
            DiagnosticStatus.WARN,
            '; '.join(filter(None, problems)),
            f'following {source}',
            {
                'source': source,
                'commands [Hz]': f'{recent["commands"] / report.period:.1f}',
                'refused': int(totals['refused']),
                'last refusal': report.reason,
                'readings [Hz]': f'{recent["published"] / report.period:.1f}',
                'readings lost': int(totals['lost']),
                'real time factor': f'{recent["simulated"] / report.period:.2f}',
                'failed steps': int(totals['failed']),
                'last failure': self._failure,
            },
        )
        return [status]


main = partial(run, 'octo_arm_sim', SimulatorNode)


if __name__ == '__main__':
    sys.exit(main())
