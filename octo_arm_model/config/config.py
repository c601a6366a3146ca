"""The configuration of an arm and its solver, read from a ROS parameter file without ROS."""

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ArmDefinitionError, ConfigError, ContinuationError, shown
from octo_arm_model.arm.limits import MIN_RATE, Budget
from octo_arm_model.arm.loads import Loads
from octo_arm_model.arm.material import DEFAULT_LAW, MotionProperties
from octo_arm_model.arm.pose import Pose
from octo_arm_model.arm.validation import check_class
from octo_arm_model.config import build
from octo_arm_model.config.parameter import refuse_unknown
from octo_arm_model.config.parameter_files import find_path, load_parameters, naming
from octo_arm_model.config.parameters import PARAMETERS, DiagnosticLimits
from octo_arm_model.config.surroundings import build_loads, build_motion
from octo_arm_model.rod.motion import Dynamics
from octo_arm_model.rod.sensitivity import Uncertainty
from octo_arm_model.rod.solver import Solver


@dataclass(frozen=True)
class Config:
    """The contents of a parameter file.

    Attributes:
        arm: the arm.
        base: pose of its base in ``base_frame``.
        model: name of the model.
        stations: number of stations along the backbone.
        base_frame: name of the frame the backbone is expressed in.
        frame_prefix: prefix of the names of the frames of tip and anchorages.
        law: name of the elastic law of the model exact.
        shear: whether its cross sections shear.
        loads: loads on the arm besides its tendons.
        motion: damping of an arm that moves, and the water's.
        uncertainty: standard deviations of tensions, displacements, material and tendon offsets.
        friction_memory: gap between tensions after which the history of tendons with friction is
            forgotten [s]; 0 for never.
        markers_rate: highest rate of the node's markers [Hz]; 0 for every shape.
        diagnostic_limits: thresholds of the node's diagnostics.
        tendon_limits: largest tension that may be commanded of each tendon [N]; empty for the
            defaults of `simulation.movements`.
        load_cells: calibration of the load cells.
        encoders: calibration of the encoders of the winches.
        tension_type: type of further messages that the node takes tensions from; empty for none.
        tension_field: their field that holds the tensions.
        displacement_type: likewise of displacements.
        displacement_field: their field that holds what encoders read.
        solve_budget: what one solve of a loaded arm may take in the node.
    """

    arm: Arm
    base: Pose
    model: str
    stations: int
    base_frame: str
    frame_prefix: str = ''
    law: str = DEFAULT_LAW
    shear: bool = False
    loads: Loads = field(default_factory=Loads)
    motion: MotionProperties = field(default_factory=MotionProperties)
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    friction_memory: float = 0.0
    markers_rate: float = 0.0
    diagnostic_limits: DiagnosticLimits = field(default_factory=DiagnosticLimits)
    tendon_limits: tuple[float, ...] = ()
    load_cells: build.LoadCellCalibration = field(default_factory=build.LoadCellCalibration)
    encoders: build.EncoderCalibration = field(default_factory=build.EncoderCalibration)
    tension_type: str = ''
    tension_field: str = ''
    displacement_type: str = ''
    displacement_field: str = ''
    solve_budget: Budget = field(default_factory=Budget)

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> 'Config':
        """From a mapping of dotted parameter names, as in ROS, to values.

        Raises:
            ConfigError: if a parameter is missing, unknown or of the wrong type.
            ArmDefinitionError: if the arm cannot exist.
        """
        check_class('values', values, Mapping)
        refuse_unknown(values, [parameter.name for parameter in PARAMETERS], 'the arm')
        given = {}
        for parameter in PARAMETERS:
            value = values.get(parameter.name, parameter.default)
            is_replaced = any(values.get(name) for name in parameter.unless)
            if value is not None:
                value = given[parameter.name] = parameter.convert(value)
                if value != 0.0 or not is_replaced:
                    parameter.check(value)
            elif not is_replaced:
                raise ConfigError(
                    f'{parameter.name} is missing, expected {parameter.type_name}: '
                    f'{parameter.description}'
                )
        _check(given)
        arm = build.build_arm(given)
        uncertainty = build.build_uncertainty(given, arm)
        if given['model'] != 'exact' and (uncertainty.poisson_ratio or uncertainty.offset):
            raise ConfigError(
                'material.poisson_ratio_stddev and tendons.offset_stddev go with model exact, not '
                f'with {given["model"]}'
            )
        build.check_each(given, arm, 'tendon_limits')
        return cls(
            arm=arm,
            base=Pose(given['base.position'], given['base.quaternion']),
            law=given['material.law'],
            shear=given['material.shear'],
            loads=build_loads(given),
            motion=build_motion(given),
            uncertainty=uncertainty,
            diagnostic_limits=DiagnosticLimits.of(given),
            load_cells=build.build_load_cells(given, arm),
            encoders=build.build_encoders(given, arm),
            solve_budget=Budget(given['solve_budget.iterations'], given['solve_budget.seconds']),
            **{name: given[name] for name in cls.__dataclass_fields__ if name in given},
        )

    def solver(
        self,
        model: str | None = None,
        stations: int | None = None,
        *,
        compiled: bool | None = None,
        budget: Budget | None = None,
    ) -> Solver:
        """Solver of this arm, with another ``model`` or number of ``stations`` if given.

        By default in machine code where numba works, see `Solver`, and with the iterations of
        `solve_budget`, but not its seconds: an answer does not depend on how busy a computer is.

        Raises:
            ConfigError: if there is no such model, it does not cover the arm or its loads, or the
                stations are too few.
            Exception: if ``compiled`` but numba is not installed or does not work.
        """
        return Solver(
            self.arm,
            self.model if model is None else model,
            compiled=compiled,
            budget=Budget(self.solve_budget.iterations) if budget is None else budget,
            **self.solver_options | ({} if stations is None else {'stations': stations}),
        )

    def dynamics(self, stations: int | None = None, *, compiled: bool | None = None) -> Dynamics:
        """The arm in motion, by the model exact whatever the file says.

        Raises:
            ConfigError: if the stations are too few.
            ArmDefinitionError: if the arm has no density.
            Exception: if ``compiled`` but numba is not installed or does not work.
        """
        return Dynamics(self.solver('exact', stations, compiled=compiled), self.motion)

    def node_solver(self) -> Solver:
        """As `solver`, for a node: within the whole `solve_budget`, and ready to solve.

        Tables are made and machine code is loaded at the first use: here, before messages come.

        Raises:
            OctoArmError: as `solver`, or if the unloaded arm has no shape.
        """
        solver = self.solver(budget=self.solve_budget)
        # A solve beyond its budget is reported when one comes.
        with contextlib.suppress(ContinuationError):
            backbone = solver.solve(0.0 * solver.rest_lengths)
            solver.tendon_lengths(backbone)
            solver.sensitivity(backbone)
        return solver

    def has_balance_of(self, other: 'Config') -> bool:
        """Whether its solver finds the shapes of that of ``other``, at the same stations."""
        mine, theirs = ((one.arm, one.model, one.solver_options) for one in (self, other))
        return mine == theirs

    @property
    def solver_options(self) -> dict[str, Any]:
        """Options of every `Solver` of this arm, besides its model and budget."""
        return {
            'stations': self.stations,
            'base': self.base,
            'material': self.law,
            'shear': self.shear,
            'loads': self.loads,
        }


def load_config(name: str | Path) -> Config:
    """Read a ROS parameter file, or that of a preset such as ``renda2012_table4``.

    Raises:
        ConfigError: if there is no such preset, or the file cannot be read or does not describe
            an arm; the message names the file.
    """
    path = find_path(name)
    values = load_parameters(path)
    with naming(path):
        return Config.from_parameters(values)


def _check(given: Mapping[str, Any]) -> None:
    """Check names of frames, of message types and fields, which come in pairs, and the rate."""
    if not given['base_frame']:
        raise ConfigError("base_frame is '', expected the name of a frame")
    for name in ('base_frame', 'frame_prefix'):
        if given[name].startswith('/'):
            expected = 'expected no / at its beginning, where tf2 refuses one'
            raise ConfigError(f'{name} is {shown(given[name])}, {expected}')
    for name in ('tension', 'displacement'):
        kind, field = given[f'{name}_type'], given[f'{name}_field']
        if bool(kind) != bool(field):
            raise ConfigError(
                f'{name}_type is {kind!r} and {name}_field is {field!r}, expected both or neither'
            )
    rate = given['markers_rate']
    if rate != 0.0 and rate < MIN_RATE:  # which is too low for a timer
        raise ArmDefinitionError('markers_rate', rate, f'0, or at least {MIN_RATE:g} [Hz]')
