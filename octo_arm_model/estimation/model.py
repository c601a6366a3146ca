"""The shape of an arm in a state, and the derivatives of the shape by the state.

Statics depend on the ratios of tensions and loads to E. So an arm of another E has the shape of
the described one under tensions and loads that are divided by the ratio of the two E.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import (
    ConfigError,
    ContinuationError,
    ConvergenceError,
    LoadError,
    SolveError,
    TensionError,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import Budget
from octo_arm_model.arm.loads import ZERO, Loads, ScaledLoads
from octo_arm_model.arm.validation import LARGEST, check_class
from octo_arm_model.config.config import Config
from octo_arm_model.estimation.tip_curvature import tip_curvature
from octo_arm_model.estimation.unknowns import State, Unknowns, unit_loads
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.rotations import quaternion_product
from octo_arm_model.rod.sensitivity import Change
from octo_arm_model.rod.solver import Solver

# A step of the estimator that takes the solver longer is too long. An error of the shape by this
# residual is far below the noise of any sensor.
BUDGET = Budget(iterations=30, residual=1e-8)
# A step of a recording may take longer, as nobody waits for it.
PATIENT = Budget(iterations=90, residual=1e-8)

# Displacement of a station up to which the shape is linear in the state, over the length.
_LINEAR = 0.2
_MOST = math.log(LARGEST)  # largest logarithm of a ratio of stiffnesses
_ONE = np.ones(1)


class ArmModel:
    """The model of one arm whose tensions, loads and E are a state vector.

    Attributes:
        arm: the arm.
        state: the layout of the state vector.
        solver: the solver of the arm as described.
        loads: known loads, which act besides those of the state.
        unit_loads: loads of magnitude one, whose magnitudes are ``state.unit_loads``.
        tendon_compliance: stretch of each tendon per newton of its tension [m/N], (tendons,).
    """

    def __init__(
        self,
        arm: Arm,
        unknowns: Unknowns,
        model: str = 'exact',
        *,
        loads: Loads = Loads(),
        **options: Any,
    ) -> None:
        """Prepare the solver of an ``arm``; ``loads`` and ``options`` are those of `Solver`.

        Raises:
            ConfigError: if `Solver` refuses its options; if external forces are unknown and the
                model has no loads; if E is unknown and there are sheaths, or loads that have no
                magnitude; if tendons have friction and no unknown ``tension_loss``.
            MeasurementError: if a point force is not on the arm.
        """
        check_class('loads', loads, Loads)
        self.arm, self.loads = arm, loads
        self.state = State(unknowns, arm)
        if loads.scaled:
            raise ConfigError('loads.scaled are those of the estimator itself, expected none')
        if loads.others and unknowns.log_modulus is not None:
            raise ConfigError('loads.others do not go with an unknown log_modulus')
        if arm.sheath_stiffness and unknowns.log_modulus is not None:
            raise ConfigError(
                'sheath_stiffness, which is not in proportion to E, does not go with '
                'an unknown log_modulus'
            )
        if any(arm.friction):
            # With friction the shape depends on earlier tensions, which the state does not hold.
            if unknowns.tension_loss is None:
                raise ConfigError('tendons have friction, expected an unknown tension_loss')
            arm = dataclasses.replace(arm, friction=())
        self._known_tip_wrench = loads.tip_wrench
        dead = dataclasses.replace(loads, tip_force=ZERO, tip_moment=ZERO)
        self.unit_loads = unit_loads(arm, unknowns)
        scaled = list(self.unit_loads)
        # The ratio of the known loads to the stiffness changes with E too.
        self._scales_dead = unknowns.log_modulus is not None and dead.any
        if self._scales_dead:
            scaled.append(dead)
            dead = Loads()
        self._scaled = ScaledLoads(scaled) if scaled else None
        dead = dataclasses.replace(dead, scaled=self._scaled)
        options.setdefault('budget', BUDGET)
        self.solver = Solver(arm, model, loads=dead, **options)
        self.tendon_compliance = arm.tendon_compliance(self.solver.rest_lengths.ravel())
        if unknowns.tip_force or unknowns.tip_moment:
            self.solver.check_tip_wrench(np.full(6, np.finfo(float).tiny))  # a model with loads

    @classmethod
    def of(
        cls,
        config: Config,
        unknowns: Unknowns,
        model: str = 'exact',
        stations: int | None = None,
        **options: Any,
    ) -> ArmModel:
        """Return the model of a ``config``: its arm, base, loads, elastic law and stations.

        ``stations`` replaces their number, and ``options`` are compiled and budget.

        Raises:
            OctoArmError: if the arm, the loads or the options do not fit the unknowns.
        """
        check_class('config', config, Config)
        settings = config.solver_options | ({} if stations is None else {'stations': stations})
        return cls(config.arm, unknowns, model, **settings, **options)

    def tip_wrench(self, x: FloatArray) -> FloatArray:
        """Return force and moment on the tip in ``x``, known ones included, (6,) [N, N m]."""
        return np.asarray(self._known_tip_wrench + self.state.tip_wrench @ x)

    def stiffness(self, x: FloatArray) -> float:
        """Return E in ``x`` over that of the arm as described.

        Raises:
            SolveError: if the ratio is beyond any material, as a diverging search may make it.
        """
        ratio = x[self.state.log_modulus]
        if ratio.size and not abs(ratio[0]) <= _MOST:
            raise SolveError(
                f'no shape that explains what was measured: E is exp({ratio[0]:.3g}) times that '
                'of the arm as described'
            )
        return math.exp(ratio[0]) if ratio.size else 1.0

    def solve(self, x: FloatArray, start: Backbone | None) -> Backbone:
        """Return the shape in ``x`` of an arm with the described E, continued from ``start``.

        Raises:
            OctoArmError: if the solver finds no trustworthy shape, or refuses tensions or loads.
        """
        ratio = self._set_magnitudes(x)
        state_tensions = x[self.state.tension] * (self._transmission(x) / ratio)
        tensions = state_tensions.reshape(self.arm.tension_shape)
        wrench = self.tip_wrench(x)
        return self.solver.follow(tensions, start, wrench / ratio if wrench.any() else None)

    def derivatives(self, x: FloatArray, backbone: Backbone) -> StateChange:
        """Return the derivatives of the shape ``backbone`` in ``x`` by the state.

        Raises:
            OctoArmError: if the equilibrium has no sensitivities.
        """
        ratio, state = self._set_magnitudes(x), self.state
        by, components = self.solver.sensitivity(backbone), np.eye(state.size)
        scale = self._transmission(x) / ratio
        by_state = (scale * components[state.tension].T).T
        np.fill_diagonal(by_state[:, state.tension_loss], -scale * x[state.tension])
        parts, by_tip_force = [(by.by_tension, by_state)], None
        if state.unknowns.log_modulus is not None:
            parts.append((by.by_youngs_modulus, components[state.log_modulus]))
        if by.by_tip_wrench is not None:
            by_tip_force = by.by_tip_wrench.pose[:, :, :3]
            parts.append((by.by_tip_wrench, state.tip_wrench / ratio))
        if self.unit_loads:
            by_loads = self.solver.sensitivity_to_loads(backbone, self.unit_loads)
            parts.append((by_loads, components[state.unit_loads] / ratio))
        return StateChange.of(parts, by_tip_force)

    def _transmission(self, x: FloatArray) -> FloatArray:
        """Return the ratios of tensions along the arm to those at the base; one 1 without loss."""
        loss = x[self.state.tension_loss]
        return np.exp(-loss) if loss.size else _ONE

    def _set_magnitudes(self, x: FloatArray) -> float:
        """Set the magnitudes of the loads to those in ``x``, and return the ratio of the E."""
        ratio, state = self.stiffness(x), self.state
        if self._scaled is not None:
            dead_magnitude = [1.0] if self._scales_dead else []
            self._scaled.magnitudes = np.array([*x[state.unit_loads], *dead_magnitude]) / ratio
        return ratio


@dataclass
class Work:
    """A budget of shapes to evaluate, and of iterations of the solver; unlimited by default."""

    evaluations: int = sys.maxsize  #: number of shapes that are left
    iterations: int = sys.maxsize  #: number of iterations that are left

    def is_left(self, spared: int = 0) -> bool:
        """Return whether another shape may be evaluated, such that ``spared`` ones remain."""
        return self.evaluations > spared and self.iterations > 0


class Prediction:
    """The shape of an arm in one state, and its derivatives; each is computed on first use.

    Attributes:
        model: the model of the arm.
        x: the state, (n,).
        work: the budget from which the evaluation of the shape is taken.
    """

    def __init__(
        self, model: ArmModel, x: FloatArray, start: Backbone | None, work: Work | None = None
    ) -> None:
        """Prepare the prediction of a state ``x``, whose shape is continued from ``start``."""
        self.model, self.x, self._start, self.work = model, x, start, work or Work()

    @property
    def shape(self) -> Backbone | None:
        """The shape if it was solved, else the shape to continue from."""
        return self.__dict__.get('solved', self._start)

    @functools.cached_property
    def solved(self) -> Backbone:
        """The shape in the state, see `ArmModel.solve`.

        Raises:
            SolveError: if there is no trustworthy shape, or tensions or loads are too large.
        """
        iterations = 1
        try:
            shape = self.model.solve(self.x, self._start)
            iterations = int(shape.iterations)
            return shape
        except (TensionError, LoadError) as error:
            # The tensions and loads are those of a search, not of a user.
            raise SolveError(f'no shape that explains what was measured: {error}') from error
        except ConvergenceError as error:
            iterations = error.iterations
            raise
        finally:
            self.work.evaluations -= 1
            self.work.iterations -= iterations

    @functools.cached_property
    def change(self) -> StateChange:
        """The derivatives of the shape by the state.

        Raises:
            SolveError: if there is no trustworthy shape.
        """
        return self.model.derivatives(self.x, self.solved)

    def moved_to(self, x: FloatArray) -> Prediction:
        """Return the prediction of a state ``x``, continued from this shape to first order."""
        shape = self.shape
        if shape is not None and shape.equilibrium is not None and 'change' in vars(self):
            if (twist := self.change.twist) is not None:
                guess = shape.equilibrium.state.z + _directional(twist, x - self.x)
                equilibrium = shape.equilibrium._replace(guess=guess)
                shape = dataclasses.replace(shape, equilibrium=equilibrium)
        return Prediction(self.model, x, shape, self.work)

    def solved_at(self, x: FloatArray) -> Prediction:
        """Return the prediction of ``x`` with its shape, continued from this, or from nothing.

        Raises:
            SolveError: if there is no trustworthy shape.
        """
        new = self.moved_to(x)
        try:
            new.solved  # noqa: B018
        except ContinuationError:
            if self.shape is None:
                raise
            new = Prediction(self.model, x, None, self.work)
            new.solved  # noqa: B018
        return new

    def linear_part(self, x: FloatArray) -> float:
        """Return the fraction, at most 1, of the step to ``x`` in which the shape is linear."""
        distance = np.linalg.norm(self.change.pose[:, :3] @ (x - self.x), axis=1).max()
        return min(1.0, _LINEAR * self.model.arm.length / max(float(distance), 1e-300))

    def backbone_at(self, x: FloatArray) -> Backbone:
        """Return the shape in a state ``x`` to first order, with its own tensions.

        Of a step to a shape that is far away, as a search without work left states it, only the
        part in which the shape is linear is taken.
        """
        shape, step = self.solved, self.linear_part(x) * (x - self.x)
        pose = _directional(self.change.pose, step)
        tau, xi, k, q = _directional(self.change.strain, step).T
        turn = np.concatenate([0.5 * pose[:, 3:], np.ones((len(pose), 1))], axis=1)
        quaternion = quaternion_product(turn, shape.quaternion)
        return dataclasses.replace(
            shape,
            position=shape.position + pose[:, :3],
            quaternion=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
            tau=shape.tau + tau,
            xi=shape.xi + xi,
            k=shape.k + k,
            q=shape.q + q,
            tensions=x[self.model.state.tension].reshape(self.model.arm.tension_shape),
            tip_wrench=self.model.tip_wrench(x),
        )

    @functools.cached_property
    def tip_curvature(self) -> FloatArray | None:
        """Second derivatives of the position of the tip by the state, (3, n, n).

        None if the model has no loads.

        Raises:
            SolveError: if there is no trustworthy shape.
        """
        by_force, model = self.change.by_tip_force, self.model
        if by_force is None:
            return None
        pose, ratio = self.change.pose, model.stiffness(self.x)
        return tip_curvature(model.state, self.solved, pose, by_force, ratio)

    def forget(self) -> None:
        """Free the memory of the derivatives, which the next use computes again."""
        for name in ('change', 'tip_curvature'):
            self.__dict__.pop(name, None)

    @functools.cached_property
    def tendon_lengths(self) -> FloatArray:
        """Length of every tendon [m], (tendons,)."""
        return self.model.solver.tendon_lengths(self.solved).ravel()


@dataclass(frozen=True)
class StateChange(Change):
    """The derivatives of the shape by a state, whose components are the last axis."""

    #: derivatives of the pose by a force on the tip of the arm as described, (stations, 6, 3);
    #: None if the model has no loads
    by_tip_force: FloatArray | None = None

    @classmethod
    def of(
        cls, parts: Sequence[tuple[Change, FloatArray]], by_tip_force: FloatArray | None
    ) -> StateChange:
        """Return the sum of ``parts``: changes by quantities, and those (q, n) by the state."""
        by_state = np.concatenate([matrix for _, matrix in parts])

        def total(name: str) -> Any:
            values = [getattr(change, name) for change, _ in parts]
            if any(value is None for value in values):
                return None
            return np.concatenate(values, axis=-1) @ by_state

        names = 'pose', 'strain', 'tendon_length', 'twist'
        return cls(**{name: total(name) for name in names}, by_tip_force=by_tip_force)


def _directional(change: FloatArray, step: FloatArray) -> FloatArray:
    """Return the product of derivatives (stations, k, n) and a ``step`` (n,) of the state."""
    return (change.reshape(-1, step.size) @ step).reshape(change.shape[:2])
