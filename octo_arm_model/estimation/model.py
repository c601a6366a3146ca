"""From a state to the shape of the arm, and its derivatives by the state.

Statics depend on E through the ratios of tensions and loads to it, so an arm of another E is
solved as the one described, under tensions and loads divided by the ratio of both.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, LoadError, SolveError, TensionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import Budget
from octo_arm_model.arm.loads import ZERO, Loads, ScaledLoads
from octo_arm_model.arm.validation import LARGEST, check_class
from octo_arm_model.config.config import Config
from octo_arm_model.estimation.tip_curvature import CurvedTip
from octo_arm_model.estimation.unknowns import State, Unknowns, unit_loads
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.rotations import quaternion_product
from octo_arm_model.rod.sensitivity import Change
from octo_arm_model.rod.solver import Solver

# A step of the estimator that leads where the arm is followed for longer is too long.
# What is left of the residual is nothing beside the noise of any sensor.
BUDGET = Budget(iterations=30, residual=1e-8)
# Of a recording nobody waits for a single step.
PATIENT = Budget(iterations=90, residual=1e-8)

_FORCE, _MOMENT = slice(0, 3), slice(3, 6)  # of a wrench
_MOST = math.log(LARGEST)  # of the logarithm of a ratio of stiffnesses
_ONE = np.ones(1)


class ArmModel:
    """One arm whose tensions, loads and E are a state; `of` makes that of a file.

    Attributes:
        arm: the arm.
        state: what the vector holds.
        solver: of the arm as described.
        loads: that act besides those of the state.
        unit_loads: loads of magnitude one of which the state holds the magnitudes, from
            ``state.point_forces`` to ``state.current``.
        curved_tip: second derivatives of the position of the tip.
        tendon_compliance: by how much each tendon itself stretches [m/N], (tendons,).
    """

    def __init__(
        self,
        arm: Arm,
        unknowns: Unknowns,
        model: str = 'exact',
        *,
        loads: Loads = Loads(),
        has_history: bool = False,
        **options: Any,
    ) -> None:
        """Prepare ``arm`` for ``unknowns``; ``loads`` and ``options`` are those of `Solver`.

        Where it ``has_history`` tendons with friction go on from the shape that a prediction is
        followed from, as those of a simulated arm, whose states come one after another.

        Raises:
            ConfigError: as `Solver`; if external forces are unknown and the model has no loads; if
                E is, and there are loads of a kind that has no magnitude, or sheaths; if tendons
                have friction and the loss of tension by it is not unknown.
            MeasurementError: if a point force is not on the arm.
        """
        check_class('loads', loads, Loads)
        self.arm, self.loads = arm, loads
        self.state = state = State(unknowns, arm)
        self.curved_tip = CurvedTip(state)
        if loads.scaled:
            raise ConfigError('loads.scaled are those of the estimator itself, expected none')
        if loads.others and unknowns.log_modulus is not None:
            raise ConfigError('loads.others do not go with an unknown log_modulus')
        if arm.sheath_stiffness and unknowns.log_modulus is not None:
            raise ConfigError(
                'sheath_stiffness, which is not in proportion to E, does not go with '
                'an unknown log_modulus'
            )
        if any(arm.friction) and not has_history:
            # The shape follows from the course of the tensions then, which is not in the state.
            if unknowns.tension_loss is None:
                raise ConfigError('tendons have friction, expected an unknown tension_loss')
            arm = dataclasses.replace(arm, friction=())
        self._known_wrench = loads.tip_wrench
        dead = dataclasses.replace(loads, tip_force=ZERO, tip_moment=ZERO)
        self.unit_loads = unit_loads(arm, unknowns)
        scaled = list(self.unit_loads)
        # Weight changes with E too, in parts of the stiffness.
        self._scales_dead = unknowns.log_modulus is not None and dead.any
        if self._scales_dead:
            scaled.append(dead)
            dead = Loads()
        self._scaled = ScaledLoads(scaled) if scaled else None
        dead = dataclasses.replace(dead, scaled=self._scaled)
        options.setdefault('budget', BUDGET)
        self.solver = Solver(arm, model, loads=dead, **options)
        self.tendon_compliance = arm.tendon_compliance(self.solver.rest_lengths.ravel())
        if _has(state.tip_force) or _has(state.tip_moment):
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
        """The arm of ``config``, with its base, loads, elastic law and, by default, stations.

        ``options`` are has_history, compiled and budget.

        Raises:
            OctoArmError: as the constructor.
        """
        check_class('config', config, Config)
        given = config.solver_options | ({} if stations is None else {'stations': stations})
        return cls(config.arm, unknowns, model, **given, **options)

    def tip_wrench(self, x: FloatArray) -> FloatArray:
        """Force and moment on the tip in ``x``, known and unknown, (6,) [N, N m]."""
        wrench = self._known_wrench.copy()
        for part, where in ((_FORCE, self.state.tip_force), (_MOMENT, self.state.tip_moment)):
            if _has(where):
                wrench[part] += x[where]
        return wrench

    def stiffness(self, x: FloatArray) -> float:
        """E in ``x`` over that of the arm as described.

        Raises:
            SolveError: if it is beyond all that is, as where a search went astray.
        """
        ratio = x[self.state.log_modulus]
        if ratio.size and not abs(ratio[0]) <= _MOST:
            raise SolveError(
                f'no shape that explains what was measured: E is exp({ratio[0]:.3g}) times that '
                'of the arm as described'
            )
        return math.exp(ratio[0]) if ratio.size else 1.0

    def solve(self, x: FloatArray, start: Backbone | None) -> Backbone:
        """Shape in ``x``, followed from ``start``; of the arm as described, see the module.

        Raises:
            OctoArmError: as `Solver.solve`.
        """
        ratio = self._set_magnitudes(x)
        along = x[self.state.tension] * (self._transmitted(x) / ratio)
        tensions = along.reshape(self.arm.tension_shape)
        wrench = self.tip_wrench(x)
        return self.solver.follow(tensions, start, wrench / ratio if wrench.any() else None)

    def derivatives(self, x: FloatArray, backbone: Backbone) -> StateChange:
        """Change of the shape ``backbone`` in ``x`` per unit of each component of the state.

        Raises:
            OctoArmError: as `Solver.sensitivity`.
        """
        ratio, state = self._set_magnitudes(x), self.state
        by = self.solver.sensitivity(backbone)
        along = self._transmitted(x) / ratio
        lost, every = -along * x[state.tension], slice(None)
        parts = [
            Part(state.tension, by.by_tension, every, along),
            Part(state.log_modulus, by.by_youngs_modulus, every, 1.0),
            Part(state.tension_loss, by.by_tension, every, lost),
        ]
        by_tip_force = None
        if by.by_tip_wrench is not None:
            by_tip_force = by.by_tip_wrench.pose[:, :, _FORCE]
            parts.append(Part(state.tip_force, by.by_tip_wrench, _FORCE, 1.0 / ratio))
            parts.append(Part(state.tip_moment, by.by_tip_wrench, _MOMENT, 1.0 / ratio))
        if self.unit_loads:
            by_loads = self.solver.sensitivity_to_loads(backbone, self.unit_loads)
            where = slice(state.point_forces.start, state.current.stop)
            parts.append(Part(where, by_loads, every, 1.0 / ratio))
        return StateChange(state.size, parts, by_tip_force)

    def acting(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tensions and wrench on the tip in ``x``, as those of a `Backbone`."""
        return x[self.state.tension].reshape(self.arm.tension_shape), self.tip_wrench(x)

    def real(self, x: FloatArray, backbone: Backbone) -> Backbone:
        """``backbone`` with the tensions and the wrench on the tip of ``x``."""
        tensions, tip_wrench = self.acting(x)
        return dataclasses.replace(backbone, tensions=tensions, tip_wrench=tip_wrench)

    def _transmitted(self, x: FloatArray) -> FloatArray:
        """Tension along every tendon over that at the base, one for all where none is lost."""
        loss = x[self.state.tension_loss]
        return np.exp(-loss) if loss.size else _ONE

    def _set_magnitudes(self, x: FloatArray) -> float:
        """Make the loads those of ``x``; returns the ratio of the stiffnesses."""
        ratio, state = self.stiffness(x), self.state
        if self._scaled is not None:
            unknown = x[state.point_forces.start : state.current.stop]
            known = [1.0] if self._scales_dead else []
            self._scaled.magnitudes = np.array([*unknown, *known]) / ratio
        return ratio


def _has(part: slice) -> bool:
    """Whether a ``part`` of a state holds anything."""
    return bool(part.stop > part.start)


class Prediction:
    """What an arm is in one state; solved and differentiated where asked for.

    Attributes:
        model: the arm.
        x: the state.
    """

    def __init__(self, model: ArmModel, x: FloatArray, start: Backbone | None) -> None:
        """In the state ``x``, followed from the shape ``start``."""
        self.model, self.x, self._start = model, x, start

    @property
    def shape(self) -> Backbone | None:
        """The shape if it was solved, what to follow it from if not."""
        return self.__dict__.get('solved', self._start)

    @functools.cached_property
    def solved(self) -> Backbone:
        """Shape, of the arm as described.

        Raises:
            SolveError: if there is no trustworthy one, or none under tensions and loads so large.
        """
        try:
            return self.model.solve(self.x, self._start)
        except (TensionError, LoadError) as error:
            # Of a state that a search came to, not of anything that was given.
            raise SolveError(f'no shape that explains what was measured: {error}') from error

    @functools.cached_property
    def change(self) -> StateChange:
        """Change of the shape per unit of each component of the state.

        Raises:
            SolveError: as `solved`.
        """
        return self.model.derivatives(self.x, self.solved)

    def moved_to(self, x: FloatArray) -> Prediction:
        """The prediction of a state ``x``, whose shape begins with that of this one's change."""
        shape = self.shape
        if shape is not None and shape.equilibrium is not None and 'change' in vars(self):
            if (twist := self.change.twist) is not None:
                guess = shape.equilibrium.state.z + _times(twist, x - self.x)
                found = shape.equilibrium._replace(guess=guess)
                shape = dataclasses.replace(shape, equilibrium=found)
        return Prediction(self.model, x, shape)

    def distance(self, x: FloatArray) -> float:
        """Largest change of a coordinate of any station in the state ``x``, to first order [m]."""
        return float(np.abs(self.change.pose[:, :3] @ (x - self.x)).max())

    @functools.cached_property
    def tip_curvature(self) -> FloatArray | None:
        """Second derivatives of the position of the tip by the state, (3, n, n).

        By the geometry of the shape and its change, see `tip_curvature`; None where the model has
        no loads.

        Raises:
            SolveError: as `solved`.
        """
        change, model = self.change, self.model
        if change.by_tip_force is None:
            return None
        ratio = model.stiffness(self.x)
        return model.curved_tip.by_state(self.solved, change.pose, change.by_tip_force, ratio)

    def forget(self) -> None:
        """Free the memory of derivatives, which are found again where asked for."""
        self.__dict__.pop('change', None)
        self.__dict__.pop('tip_curvature', None)

    @functools.cached_property
    def tendon_lengths(self) -> FloatArray:
        """Length of every tendon [m], (tendons,)."""
        return self.model.solver.tendon_lengths(self.solved).ravel()


class Part(NamedTuple):
    """What some components of a state do to the shape.

    Attributes:
        where: these components.
        change: of the shape, per unit of what they change.
        columns: of that change, one for each component.
        scale: unit of what they change per unit of each component, one for all or for each.
    """

    where: slice
    change: Change
    columns: slice
    scale: FloatArray | float


class StateChange:
    """Change of the shape per unit of each component of a state, the last axis; see `Change`.

    Attributes:
        by_tip_force: change of pose by forces on the tip along all axes of the arm as described,
            (stations, 6, 3); None where the model has no loads.
    """

    def __init__(
        self, size: int, parts: Sequence[Part], by_tip_force: FloatArray | None = None
    ) -> None:
        """Of a state of ``size`` components, of which those in none of ``parts`` do nothing.

        ``by_tip_force`` is the change of pose by forces of 1 N on the tip, whatever the state.
        """
        self._size, self._parts, self.by_tip_force = size, parts, by_tip_force

    @functools.cached_property
    def pose(self) -> FloatArray:
        """Displacement [m] and rotation vector [rad] in base_frame, (stations, 6, state)."""
        return self._chained([one.change.pose for one in self._parts])

    @functools.cached_property
    def twist(self) -> FloatArray | None:
        """Change of the twists at the solver's nodes, (nodes, strains, state), where known."""
        found = [one.change.twist for one in self._parts if one.change.twist is not None]
        return self._chained(found) if len(found) == len(self._parts) else None

    @property
    def tip(self) -> FloatArray:
        """The same of the tip alone, (6, state)."""
        return self.pose[-1]

    @functools.cached_property
    def strain(self) -> FloatArray:
        """Change of tau, xi, k [1/m] and q [-], (stations, 4, state)."""
        return self._chained([one.change.strain for one in self._parts])

    @functools.cached_property
    def tendon_length(self) -> FloatArray:
        """Change of the length of every tendon [m], (tendons, state)."""
        return self._chained([one.change.tendon_length for one in self._parts])

    def moved(
        self, backbone: Backbone, by: FloatArray, acting: tuple[FloatArray, FloatArray]
    ) -> Backbone:
        """The ``backbone`` that this is the change of after a small change ``by`` of the state.

        ``acting`` are the tensions and the wrench on the tip then. Stations alone: what
        `Solver.solve` starts from stays.
        """
        pose, strain = _times(self.pose, by), _times(self.strain, by)
        turn = np.concatenate([0.5 * pose[:, 3:], np.ones((len(pose), 1))], axis=1)
        quaternion = quaternion_product(turn, backbone.quaternion)
        tau, xi, k, q = strain.T
        return dataclasses.replace(
            backbone,
            position=backbone.position + pose[:, :3],
            quaternion=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
            tau=backbone.tau + tau,
            xi=backbone.xi + xi,
            k=backbone.k + k,
            q=backbone.q + q,
            tensions=acting[0],
            tip_wrench=acting[1],
        )

    def _chained(self, changes: Sequence[FloatArray]) -> FloatArray:
        found = np.zeros((*changes[0].shape[:-1], self._size))
        for (where, _, columns, scale), change in zip(self._parts, changes, strict=True):
            if where.stop > where.start:
                np.multiply(change[..., columns], scale, out=found[..., where])
        return found


def _times(change: FloatArray, by: FloatArray) -> FloatArray:
    """Product of a ``change`` (stations, k, n) and ``by`` (n,), as one of matrices."""
    return (change.reshape(-1, by.size) @ by).reshape(change.shape[:2])
