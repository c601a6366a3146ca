"""From a state to the shape of the arm, and its derivatives by the state.

Statics depend on E through the ratios of tensions and loads to it, so an arm of another E is
solved as the one described, under tensions and loads divided by the ratio of both.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, LoadError, SolveError, TensionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import Budget
from octo_arm_model.arm.loads import ZERO, Loads, ScaledLoads
from octo_arm_model.arm.validation import LARGEST, check_class
from octo_arm_model.config.config import Config
from octo_arm_model.estimation.tip_curvature import TipCurvature
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
        unit_loads: loads of magnitude one, whose magnitudes are ``state.unit_loads``.
        tip_curvature: second derivatives of the position of the tip.
        tendon_compliance: by how much each tendon itself stretches [m/N], (tendons,).
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
        """Prepare ``arm`` for ``unknowns``; ``loads`` and ``options`` are those of `Solver`.

        Raises:
            ConfigError: as `Solver`; if external forces are unknown and the model has no loads; if
                E is, and there are loads of a kind that has no magnitude, or sheaths; if tendons
                have friction and the loss of tension by it is not unknown.
            MeasurementError: if a point force is not on the arm.
        """
        check_class('loads', loads, Loads)
        self.arm, self.loads = arm, loads
        self.state = State(unknowns, arm)
        self.tip_curvature = TipCurvature(self.state)
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
        """The arm of ``config``, with its base, loads, elastic law and, by default, stations.

        ``options`` are compiled and budget.

        Raises:
            OctoArmError: as the constructor.
        """
        check_class('config', config, Config)
        given = config.solver_options | ({} if stations is None else {'stations': stations})
        return cls(config.arm, unknowns, model, **given, **options)

    def tip_wrench(self, x: FloatArray) -> FloatArray:
        """Force and moment on the tip in ``x``, known and unknown, (6,) [N, N m]."""
        wrench = self._known_wrench.copy()
        for first, where in ((0, self.state.tip_force), (3, self.state.tip_moment)):
            own = x[where]
            wrench[first : first + own.size] += own
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
        every = slice(None)
        parts: list[_Part] = [
            (state.tension, by.by_tension, every, along),
            (state.log_modulus, by.by_youngs_modulus, every, 1.0),
            (state.tension_loss, by.by_tension, every, -along * x[state.tension]),
        ]
        by_tip_force = None
        if by.by_tip_wrench is not None:
            by_tip_force = by.by_tip_wrench.pose[:, :, _FORCE]
            parts.append((state.tip_force, by.by_tip_wrench, _FORCE, 1.0 / ratio))
            parts.append((state.tip_moment, by.by_tip_wrench, _MOMENT, 1.0 / ratio))
        if self.unit_loads:
            by_loads = self.solver.sensitivity_to_loads(backbone, self.unit_loads)
            parts.append((state.unit_loads, by_loads, every, 1.0 / ratio))
        return StateChange(state.size, parts, by_tip_force)

    def _transmitted(self, x: FloatArray) -> FloatArray:
        """Tension along every tendon over that at the base, one for all where none is lost."""
        loss = x[self.state.tension_loss]
        return np.exp(-loss) if loss.size else _ONE

    def _set_magnitudes(self, x: FloatArray) -> float:
        """Make the loads those of ``x``; returns the ratio of the stiffnesses."""
        ratio, state = self.stiffness(x), self.state
        if self._scaled is not None:
            known = [1.0] if self._scales_dead else []
            self._scaled.magnitudes = np.array([*x[state.unit_loads], *known]) / ratio
        return ratio


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

    def backbone_at(self, x: FloatArray) -> Backbone:
        """Shape in a state ``x`` nearby, to first order, with its tensions and tip wrench."""
        shape, by = self.solved, x - self.x
        pose, (tau, xi, k, q) = _times(self.change.pose, by), _times(self.change.strain, by).T
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

        None where the model has no loads.

        Raises:
            SolveError: as `solved`.
        """
        by_force, model = self.change.by_tip_force, self.model
        if by_force is None:
            return None
        ratio = model.stiffness(self.x)
        return model.tip_curvature.by_state(self.solved, self.change.pose, by_force, ratio)

    def forget(self) -> None:
        """Free the memory of derivatives, which are found again where asked for."""
        for name in ('change', 'tip_curvature'):
            self.__dict__.pop(name, None)

    @functools.cached_property
    def tendon_lengths(self) -> FloatArray:
        """Length of every tendon [m], (tendons,)."""
        return self.model.solver.tendon_lengths(self.solved).ravel()


# Components of a state, the change of the shape by what they change, the columns of that change,
# and unit of what they change per unit of each component, one for all or for each.
_Part = tuple[slice, Change, slice, FloatArray | float]


class StateChange:
    """Change of the shape per unit of each component of a state, the last axis; see `Change`.

    Attributes:
        by_tip_force: change of pose per newton on the tip along all axes of the arm as described,
            (stations, 6, 3); None where the model has no loads.
    """

    def __init__(
        self, size: int, parts: Sequence[_Part], by_tip_force: FloatArray | None = None
    ) -> None:
        """Of a state of ``size`` components, of which those in none of ``parts`` do nothing."""
        self._size, self._parts, self.by_tip_force = size, parts, by_tip_force

    @functools.cached_property
    def pose(self) -> FloatArray:
        """Displacement [m] and rotation vector [rad] in base_frame, (stations, 6, state)."""
        return self._chained([change.pose for _, change, *_ in self._parts])

    @functools.cached_property
    def twist(self) -> FloatArray | None:
        """Change of the twists at the solver's nodes, (nodes, strains, state), where known."""
        found = [change.twist for _, change, *_ in self._parts]
        known = [one for one in found if one is not None]
        return self._chained(known) if len(known) == len(found) else None

    @property
    def tip(self) -> FloatArray:
        """The same of the tip alone, (6, state)."""
        return self.pose[-1]

    @functools.cached_property
    def strain(self) -> FloatArray:
        """Change of tau, xi, k [1/m] and q [-], (stations, 4, state)."""
        return self._chained([change.strain for _, change, *_ in self._parts])

    @functools.cached_property
    def tendon_length(self) -> FloatArray:
        """Change of the length of every tendon [m], (tendons, state)."""
        return self._chained([change.tendon_length for _, change, *_ in self._parts])

    def _chained(self, changes: Sequence[FloatArray]) -> FloatArray:
        found = np.zeros((*changes[0].shape[:-1], self._size))
        for (where, _, columns, scale), change in zip(self._parts, changes, strict=True):
            if where.stop > where.start:
                np.multiply(change[..., columns], scale, out=found[..., where])
        return found


def _times(change: FloatArray, by: FloatArray) -> FloatArray:
    """Product of a ``change`` (stations, k, n) and ``by`` (n,), as one of matrices."""
    return (change.reshape(-1, by.size) @ by).reshape(change.shape[:2])
