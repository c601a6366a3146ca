"""The simulator without ROS: its parameters, the tendons that it drives, and their URDF.

The time steps of an arm that moves hold lengths of tendons. An arm without inertia takes the
tensions that hold these lengths at rest.
"""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MIN_RATE
from octo_arm_model.arm.material import MotionProperties
from octo_arm_model.arm.validation import within
from octo_arm_model.config.calibration import Calibration
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter import ParameterGroup, check_together, refuse_unknown, stated
from octo_arm_model.config.parameters import PARAMETERS as ARM_PARAMETERS
from octo_arm_model.rod.displacements import Wound, solve_displacements
from octo_arm_model.rod.solver import Solver
from octo_arm_model.simulation import movements
from octo_arm_model.simulation.dynamic_arm import SUFFIX, DynamicArm, HeldLengths
from octo_arm_model.simulation.hardware import (
    Hardware,
    LoadCells,
    Relaxation,
    SimulatedHardware,
    Winches,
)
from octo_arm_model.simulation.profiles import CommandProfile
from octo_arm_model.simulation.pushed_arm import Push, PushedArm, Sensors, SimulatedArm

HIGHEST_RATE = 1000.0  # [Hz]
# The parameters of the arm that describe its load cells.
_OF_LOAD_CELLS = ('tension_names', 'tension_deadband', 'tension_offset', 'tension_scale')

_SLOWEST, _FASTEST = 1e-3, 1000.0
_MOVING_RATE = 1.0  # least rate of a moving arm, as a period takes many steps [Hz]
_ON_FAILURE = ('go_on', 'pause')


@dataclass(frozen=True)
class Course(ParameterGroup):
    """The parameters of time, dynamics, failures and the state file of the simulator."""

    GROUP = ''

    rate: float = stated(
        f'double | 100.0 | in [{MIN_RATE:g}, {HIGHEST_RATE:g}], '
        f'at least {_MOVING_RATE:g} with dynamics',
        'rate at which tensions are measured and published [Hz]',
    )
    dynamics: bool = stated(
        'bool | False',
        'whether the arm moves with inertia and water, see motion.*, or follows its '
        'tensions at once',
    )
    publish_clock: bool = stated(
        'bool | False',
        'whether the simulator has its own time, which begins at 0, advances by a period each '
        'step and is published on /clock',
    )
    real_time_factor: float = stated(
        f'double | 1.0 | 0, or {_SLOWEST:g} to {_FASTEST:g} | with publish_clock',
        'speed of this time relative to the wall clock [-]; 0 for as fast as possible',
    )
    on_failure: str = stated(
        f"string | 'go_on' | {' or '.join(_ON_FAILURE)} | choice",
        'reaction when no step of the arm succeeds, as when it is crushed: go_on from the last '
        'state, or pause',
    )
    state_file: str = stated(
        "string | ''",
        'file of the services save_state and restore_state, whose name ends with '
        f'{SUFFIX}; empty for none; it can be changed to one in the same folder only',
    )

    def __post_init__(self) -> None:
        """Check the values."""
        super().__post_init__()
        lowest = _MOVING_RATE if self.dynamics else MIN_RATE
        within('rate', self.rate, lowest, HIGHEST_RATE, 'Hz')
        if self.real_time_factor:
            within('real_time_factor', self.real_time_factor, _SLOWEST, _FASTEST, '-')
        if self.state_file and not self.state_file.endswith(SUFFIX):
            raise ConfigError(
                f'state_file is {shown(self.state_file)}, expected a name that ends with {SUFFIX}'
            )


@dataclass(frozen=True)
class Playing(ParameterGroup):
    """The parameters of the profile that the simulator plays."""

    GROUP = 'profile'

    name: str = stated(
        "string | ''", 'movement, or CSV or YAML file, that the simulator plays; empty for none'
    )
    speed: float = stated('double | 1.0 | > 0', 'factor of the speed at which it is played [-]')
    loop: bool = stated('bool | False', 'whether it is repeated')


_GROUPS = Course, Winches, LoadCells, Relaxation, Playing, Push, Sensors
PARAMETERS = tuple(parameter for group in _GROUPS for parameter in group.table())
_NAMES = [parameter.name for parameter in PARAMETERS]


@dataclass(frozen=True)
class SimulatorConfig:
    """The checked parameters of the simulator."""

    model: Config  #: configuration of the arm
    course: Course  #: parameters of time and dynamics
    playing: Playing  #: parameters of the profile to play
    hardware: Hardware  #: parameters of winches, load cells and relaxation
    push: Push  #: parameters of the push
    sensors: Sensors  #: parameters of the sensors besides load cells and encoders

    @functools.cached_property
    def limits(self) -> FloatArray:
        """The limits of the commanded tensions (tendons,) [N]."""
        return movements.tendon_limits(self.model)

    @functools.cached_property
    def profile(self) -> CommandProfile | None:
        """The profile that the simulator plays; None without one.

        ProfileError if it is invalid, not for this arm, or beyond the limit of a tendon.
        """
        if not self.playing.name:
            return None
        profile = movements.find_profile(self.playing.name, self.model.arm)
        movements.check_profile(profile, self.model.arm, self.limits)
        return profile

    @functools.cached_property
    def solver(self) -> Solver:
        """The solver of the arm with its push, for lengths of tendons."""
        arm = self.pushed_arm
        return (self.model if arm is None else arm.config).node_solver()

    @functools.cached_property
    def pushed_arm(self) -> SimulatedArm | None:
        """The simulated arm; None if it neither moves, nor is pushed, nor has sensors or encoders.

        OctoArmError if the arm cannot move, be pushed, or be measured by the sensors.
        """
        if self.course.dynamics:
            return DynamicArm(self.model, self.push, self.sensors)
        if not (any((*self.push.force, *self.sensors.rates)) or self.hardware.winches.encoders):
            return None
        return PushedArm(self.model, self.push, self.sensors)

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> 'SimulatorConfig':
        """Return the configuration with ``values`` of parameters of arm and simulator by name.

        Raises:
            ConfigError: if a parameter is missing, unknown or of the wrong type.
            ArmDefinitionError: if a value is outside its range.
            OctoArmError: if the profile or the simulated arm is refused.
        """
        known = [*_NAMES, *(parameter.name for parameter in ARM_PARAMETERS)]
        refuse_unknown(values, known, 'the simulator or the arm')
        config = Config.from_parameters({k: v for k, v in values.items() if k not in _NAMES})
        given = {p.name: p.convert(values.get(p.name, p.default)) for p in PARAMETERS}
        push, sensors = Push.of(given), Sensors.of(given)
        for name, s in (('push.s', push.s), *(('sensors.marker_s', s) for s in sensors.marker_s)):
            within(name, s, 0.0, config.arm.length, 'm')
        if config.encoders != Calibration():
            raise ConfigError(
                'displacement_names, displacement_scale and displacement_offset are of real '
                'encoders, and those of a simulator read lengths by name: leave them out'
            )
        winches, cells, relaxation = Winches.of(given), LoadCells.of(given), Relaxation.of(given)
        hardware = Hardware(winches, cells, relaxation, config.load_cells)
        simulator = cls(config, Course.of(given), Playing.of(given), hardware, push, sensors)
        check_together(PARAMETERS, given)
        simulator.profile, simulator.pushed_arm  # noqa: B018 - these properties raise errors
        return simulator


def for_arm_node(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return those parameters of load cells among ``values`` that the node of the arm needs."""
    arm = {parameter.name: parameter for parameter in ARM_PARAMETERS}
    shared = {name: arm[name].convert(values[name]) for name in _OF_LOAD_CELLS if name in values}
    return {name: value for name, value in shared.items() if value != ()}


def for_true_arm(arm: Arm) -> dict[str, Any]:
    """Return parameters of a node that takes tensions of ``arm`` without load cells."""
    tendons = len(arm.tendons)
    return {
        'tension_names': arm.tendon_names,
        'tension_deadband': 0.0,
        'tension_offset': tendons * (0.0,),
        'tension_scale': tendons * (1.0,),
    }


def in_water(config: Config) -> dict[str, Any]:
    """Return parameters with which the arm of ``config`` moves, by default in water.

    Density and damping are by default those of the silicone of Renda et al. 2018.
    """
    parameters: dict[str, Any] = {'dynamics': True, 'model': 'exact'}
    if not config.arm.material.density:
        parameters['material.density'] = 1080.0
    if not config.loads.fluid_density:
        parameters['loads.fluid_density'] = 1022.0
    if config.motion == MotionProperties():
        parameters |= {'motion.water': 'renda2018', 'motion.damping_time': 8.2e-3}
    return parameters


class TendonDrive:
    """The winches, the load cells and the arm that they pull.

    Attributes:
        hardware: winches and load cells.
        held: lengths that winches hold, by tendon name [m]; other winches follow tensions.
    """

    def __init__(self, config: SimulatorConfig) -> None:
        """Begin with slack tendons."""
        self._config = config
        self.hardware = SimulatedHardware(config.hardware, len(config.model.arm.tendons))
        self.held: dict[str, float] = {}
        self._wound: Wound | None = None

    def go_on_with(self, config: SimulatorConfig) -> list[str]:
        """Use the parameters ``config`` from now on, and return warnings about lost states."""
        before, self._config, warnings = self._config, config, []
        arm, last = config.pushed_arm, before.pushed_arm
        if arm and last and not arm.go_on_from(last) and any(before.model.arm.friction):
            warnings.append('friction history forgotten: another arm, or pushed at another s')
        if config.model.arm.tendon_names == before.model.arm.tendon_names:
            self.hardware.change(config.hardware)
        else:
            self.hardware = SimulatedHardware(config.hardware, len(config.model.arm.tendons))
        is_same = config.model.has_balance_of(before.model)
        if not (is_same and (config.limits == before.limits).all()):
            if self.held:
                reason = 'other limits' if is_same else 'another arm'
                warnings.append(f'tendons are no longer driven by length: {reason}')
            self.held, self._wound = {}, None
        return warnings

    def hold(self, lengths: Mapping[str, float], tensions: FloatArray) -> None:
        """Reel in ``lengths`` [m] from now on, by tendon name, beside ``tensions`` (tendons,) [N].

        Raises:
            TensionError: if a length is longer than its tendon, or if an arm without inertia
                would have a tension beyond its limit.
            OctoArmError: if no shape without inertia has these lengths; the last ones are held.
        """
        config = self._config
        if isinstance(config.pushed_arm, DynamicArm):
            config.pushed_arm.check_lengths(lengths)
        elif lengths:
            wound = self._at_rest(lengths, tensions)
            movements.check_command(config.model.arm, wound.backbone.tensions, config.limits)
            self._wound = wound
        self.held = dict(lengths)

    def set_points(self, tensions: FloatArray) -> FloatArray:
        """Return set points of all winches (tendons,) [N] for commanded ``tensions`` (tendons,).

        They are within the limits, as a winch lets out before that.

        Raises:
            OctoArmError: if no shape has the lengths that winches hold.
        """
        if not self.held or self._config.course.dynamics:
            return tensions
        self._wound = self._at_rest(self.held, tensions)
        return np.minimum(self._wound.backbone.tensions.ravel(), self._config.limits)

    def advance(self, set_points: FloatArray, elapsed: float) -> FloatArray:
        """Return effective tensions after ``elapsed`` [s] under ``set_points``, (tendons,) [N]."""
        return self.hardware.pull(set_points, elapsed, self._is_held())

    def move(self, tensions: FloatArray, force: FloatArray, elapsed: float) -> FloatArray:
        """Move the arm under effective ``tensions`` (tendons,) and a push ``force`` (3,) [N].

        Return the effective tensions, also those of tendons that winches hold at a length.

        Raises:
            SolveError: if no step succeeds; the arm stays as it was.
        """
        arm, hardware = self._config.pushed_arm, self.hardware
        if isinstance(arm, PushedArm):
            arm.advance(tensions, force)
        if not isinstance(arm, DynamicArm):
            return tensions
        arm.advance(tensions, force, elapsed, self._reeled(elapsed))
        hardware.hold(arm.state.tensions, arm.reeled_in(), elapsed, self._is_held())
        return arm.state.tensions

    def _is_held(self) -> NDArray[np.bool_]:
        """Whether the winch of each tendon holds a length of an arm that moves, (tendons,)."""
        arm, is_moving = self._config.model.arm, self._config.course.dynamics
        return np.array([is_moving and name in self.held for name in arm.tendon_names])

    def _reeled(self, elapsed: float) -> HeldLengths | None:
        if not self.held:
            return None
        config, (tension, _, crept, now) = self._config, self.hardware.state
        winches, relaxation = config.hardware.winches, config.hardware.relaxation
        goal = np.array([self.held.get(name, np.nan) for name in config.model.arm.tendon_names])
        most = np.minimum(config.limits, winches.force_limit or np.inf)
        bounds = np.array([np.full(most.size, winches.slack_floor), most])
        effective = relaxation.effective(relaxation.step(crept, bounds, elapsed), bounds)
        low, high = np.abs(tension - bounds) <= 1e-9 * most  # by rounding
        # Without a floor the time steps find out which tendons of held winches are slack.
        low &= (effective[0] > 0.0) & (goal <= now)
        at_bound = np.where(high & (goal > now), 1.0, -1.0 * low)
        direction, taut = np.nan_to_num(np.sign(goal - now)), bool(bounds[0, 0])
        return HeldLengths(winches.reel(now, goal, elapsed), effective, direction, at_bound, taut)

    def _at_rest(self, lengths: Mapping[str, float], tensions: FloatArray) -> Wound:
        names, arm = self._config.model.arm.tendon_names, self._config.pushed_arm
        wrench = arm.push_with(arm.force) if isinstance(arm, PushedArm) else None
        driven = {
            name: float(tension)
            for name, tension in zip(names, tensions, strict=True)
            if name not in lengths
        }
        return solve_displacements(self._config.solver, lengths, driven, self._wound, wrench)


PLUGIN = 'joint_state_topic_hardware_interface/JointStateTopicSystem'
INTERFACES = ('effort', 'position')
STATES = 'tendon_states'
_REELING = 1.0  # velocity limit of a tendon in the URDF [m/s]


def robot_description(config: Config, interface: str, namespace: str = '') -> str:
    """Return a URDF of the tendons; ConfigError if ``interface`` is not effort or position."""
    if interface not in INTERFACES:
        raise ConfigError(f'interface is {shown(interface)}, expected effort or position')
    robot, sub = ElementTree.Element('robot', name='octo_arm'), ElementTree.SubElement
    sub(robot, 'link', name='tendons')
    control = sub(robot, 'ros2_control', name='octo_arm', type='system')
    hardware = sub(control, 'hardware')
    sub(hardware, 'plugin').text = PLUGIN
    prefix = f'/{namespace.strip("/")}/' if namespace.strip('/') else '/'
    for what, topic in (('commands', movements.JOINTS), ('states', STATES)):
        sub(hardware, 'param', name=f'joint_{what}_topic').text = prefix + topic
    length = f'{config.arm.length:g}'
    limits = movements.tendon_limits(config).tolist()
    for name, highest in zip(config.arm.tendon_names, limits, strict=True):
        sub(robot, 'link', name=name)
        joint = sub(robot, 'joint', name=name, type='prismatic')
        sub(joint, 'parent', link='tendons')
        sub(joint, 'child', link=name)
        ends = {'lower': f'-{length}', 'upper': length}
        sub(joint, 'limit', ends, effort=f'{highest:g}', velocity=f'{_REELING:g}')
        driven = sub(control, 'joint', name=name)
        sub(driven, 'command_interface', name=interface)
        for state in ('position', 'velocity', 'effort'):
            sub(driven, 'state_interface', name=state)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding='unicode')
