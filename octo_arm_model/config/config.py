"""The configuration of an arm and of its solver, read from a ROS parameter file without ROS."""

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
from octo_arm_model.config import build, calibration
from octo_arm_model.config.calibration import Calibration
from octo_arm_model.config.parameter import check_together, refuse_unknown
from octo_arm_model.config.parameter_files import find_path, load_parameters, naming
from octo_arm_model.config.parameters import PARAMETERS, DiagnosticLimits
from octo_arm_model.rod.motion import Dynamics
from octo_arm_model.rod.sensitivity import Uncertainty
from octo_arm_model.rod.solver import Solver


@dataclass(frozen=True)
class Config:
    """The contents of a parameter file; what is not listed is the parameter of that name.

    Attributes:
        arm: the arm.
        base: pose of the base in ``base_frame``.
        law: name of the elastic law of the model exact.
        shear: whether cross sections shear.
        loads: loads on the arm besides its tendons.
        motion: damping of the material, drag and added mass of the water, for an arm that moves.
        uncertainty: standard deviations of tensions, displacements, material and tendon offsets.
        diagnostic_limits: thresholds of the node's diagnostics.
        tendon_limits: largest tension that may be commanded of each tendon [N]; empty for the
            defaults of `simulation.movements`.
        load_cells: calibration of the load cells.
        encoders: calibration of the encoders of the winches.
        solve_budget: iterations and time that a solve of a loaded arm may take in the node.
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
    load_cells: Calibration = field(default_factory=Calibration)
    encoders: Calibration = field(default_factory=Calibration)
    tension_type: str = ''
    tension_field: str = ''
    displacement_type: str = ''
    displacement_field: str = ''
    solve_budget: Budget = field(default_factory=Budget)

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> 'Config':
        """Return the configuration with ``values`` by dotted names of parameters, as in ROS.

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
        check_together(PARAMETERS, given)
        _check(given)
        arm = build.build_arm(given)
        uncertainty = build.build_uncertainty(given, arm)
        if given['model'] != 'exact' and (uncertainty.poisson_ratio or uncertainty.offset):
            raise ConfigError(
                'material.poisson_ratio_stddev and tendons.offset_stddev go with model exact, not '
                f'with {given["model"]}'
            )
        calibration.check_each(given, arm, 'tendon_limits')
        loads = build.build_loads(given)
        seconds = given['solve_budget.seconds'] or (1.0 if loads.obstacles else 0.08)
        return cls(
            arm=arm,
            base=Pose(given['base.position'], given['base.quaternion']),
            law=given['material.law'],
            shear=given['material.shear'],
            loads=loads,
            motion=build.build_motion(given),
            uncertainty=uncertainty,
            diagnostic_limits=DiagnosticLimits.of(given),
            load_cells=calibration.build_load_cells(given, arm),
            encoders=calibration.build_encoders(given, arm),
            solve_budget=Budget(given['solve_budget.iterations'], seconds),
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
        """Return a solver of this arm, with another ``model`` or number of ``stations`` if given.

        By default it runs machine code if numba works, and has the iterations of `solve_budget`,
        but not its seconds, so that a result does not depend on how busy the computer is.

        Raises:
            ConfigError: if there is no such model, the model does not cover the arm or its loads,
                or there are too few stations.
            Exception: if ``compiled`` is true but numba is not installed or does not work.
        """
        return Solver(
            self.arm,
            self.model if model is None else model,
            compiled=compiled,
            budget=Budget(self.solve_budget.iterations) if budget is None else budget,
            **self.solver_options | ({} if stations is None else {'stations': stations}),
        )

    def dynamics(self, stations: int | None = None, *, compiled: bool | None = None) -> Dynamics:
        """Return the dynamics of the arm, always by the model exact.

        Raises:
            ConfigError: if there are too few stations.
            ArmDefinitionError: if the arm has no density.
            Exception: if ``compiled`` is true but numba is not installed or does not work.
        """
        return Dynamics(self.solver('exact', stations, compiled=compiled), self.motion)

    def node_solver(self) -> Solver:
        """Return a solver for a node, which has the whole `solve_budget` and is ready to solve.

        The first solve makes tables and loads machine code; it is made here, before messages come.

        Raises:
            OctoArmError: if the model does not cover the arm, or gives no shape without tensions.
        """
        solver = self.solver(budget=self.solve_budget)
        # A solve beyond the budget is reported when a message asks for it.
        with contextlib.suppress(ContinuationError):
            backbone = solver.solve(0.0 * solver.rest_lengths)
            solver.tendon_lengths(backbone)
            solver.sensitivity(backbone)
        return solver

    def has_balance_of(self, other: 'Config') -> bool:
        """Whether the solvers of this and the ``other`` give equal shapes at equal stations."""
        a, b = ((config.arm, config.model, config.solver_options) for config in (self, other))
        return a == b

    @property
    def solver_options(self) -> dict[str, Any]:
        """The options of every `Solver` of this arm besides model and budget."""
        return {
            'stations': self.stations,
            'base': self.base,
            'material': self.law,
            'shear': self.shear,
            'loads': self.loads,
        }


def load_config(name: str | Path) -> Config:
    """Read a ROS parameter file, or the file of a preset such as ``renda2012_table4``.

    Raises:
        ConfigError: if there is no such preset, or the file cannot be read or does not describe
            an arm; the message names the file.
    """
    path = find_path(name)
    values = load_parameters(path)
    with naming(path):
        return Config.from_parameters(values)


def _check(given: Mapping[str, Any]) -> None:
    """Check names of frames, and the rate of markers."""
    if not given['base_frame']:
        raise ConfigError("base_frame is '', expected the name of a frame")
    for name in ('base_frame', 'frame_prefix'):
        if given[name].startswith('/'):
            expected = 'expected no / at its beginning, where tf2 refuses one'
            raise ConfigError(f'{name} is {shown(given[name])}, {expected}')
    rate = given['markers_rate']
    if rate != 0.0 and rate < MIN_RATE:  # lower rates are too low for a timer
        raise ArmDefinitionError('markers_rate', rate, f'0, or at least {MIN_RATE:g} [Hz]')
