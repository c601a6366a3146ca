"""The winches that pull a simulated arm, by tension or by length, and what the arm does.

Lengths of an arm that moves are held by its time steps. One without inertia follows the tensions
that hold them at rest.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import Wound, displacements_of, solve_displacements
from octo_arm_model.simulation.dynamic_arm import DynamicArm, Reeled
from octo_arm_model.simulation.hardware import SimulatedHardware
from octo_arm_model.simulation.movements import check_command
from octo_arm_model.simulation.parameters import SimulatorConfig
from octo_arm_model.simulation.pushed_arm import PushedArm


class TendonDrive:
    """Winches, load cells and the arm that they pull.

    Attributes:
        hardware: winches and load cells.
        held: lengths that winches are to reel in, by tendon name [m]; all others follow tensions.
    """

    def __init__(self, config: SimulatorConfig) -> None:
        """Begin with slack tendons."""
        self._config = config
        self.hardware = SimulatedHardware(config.hardware, len(config.arm.tendons))
        self.held: dict[str, float] = {}
        self._wound: Wound | None = None
        self._shape: Backbone | None = None

    def go_on_with(self, config: SimulatorConfig) -> list[str]:
        """Use other parameters from now on; returns what is lost thereby, for a warning."""
        before, self._config, lost = self._config, config, []
        arm, last = config.pushed_arm, before.pushed_arm
        if arm and last and _goes_on(arm, last):
            lost.append('friction history forgotten: another arm, or pushed at another s')
        if config.arm.tendon_names == before.arm.tendon_names:
            self.hardware.change(config.hardware)
        else:
            self.hardware = SimulatedHardware(config.hardware, len(config.arm.tendons))
        is_same = config.model.has_balance_of(before.model)
        if not (is_same and (config.limits == before.limits).all()):
            if self.held:
                other = 'other limits' if is_same else 'another arm'
                lost.append(f'tendons are no longer driven by length: {other}')
            self.held, self._wound, self._shape = {}, None, None
        return lost

    def hold(self, lengths: Mapping[str, float], tensions: FloatArray) -> None:
        """Reel in ``lengths`` [m] from now on, by tendon name, beside ``tensions`` (tendons,) [N].

        Raises:
            TensionError: if a length is more than there is, or of an arm without inertia if a
                tendon would be pulled beyond its limit.
            OctoArmError: of that, as `solve_displacements`; what was held before still is.
        """
        config = self._config
        if isinstance(config.pushed_arm, DynamicArm):
            config.pushed_arm.check_lengths(lengths)
        elif lengths:
            wound = self._at_rest(lengths, tensions)
            check_command(config.arm, wound.backbone.tensions, config.limits)
            self._wound = wound
        self.held = dict(lengths)

    def set_points(self, tensions: FloatArray) -> FloatArray:
        """Of all winches (tendons,) [N], beside those commanded by ``tensions``.

        Never beyond a limit: a winch gives way before that.

        Raises:
            OctoArmError: as `solve_displacements`.
        """
        if not self.held or self._config.dynamics:
            return tensions
        self._wound = self._at_rest(self.held, tensions)
        return np.minimum(self._wound.backbone.tensions.ravel(), self._config.limits)

    def advance(self, set_points: FloatArray, elapsed: float) -> FloatArray:
        """Effective tensions once ``set_points`` (tendons,) [N] have acted for ``elapsed`` [s]."""
        return self.hardware.pull(set_points, elapsed, self._is_held())

    def move(self, tensions: FloatArray, force: FloatArray, elapsed: float) -> FloatArray:
        """Move the arm on under effective ``tensions`` (tendons,) and a push ``force`` (3,) [N].

        Returns its effective tensions, of tendons that are held too.

        Raises:
            SolveError: if no step succeeds; the arm stays as it was.
        """
        arm, hardware = self._config.pushed_arm, self.hardware
        if not isinstance(arm, DynamicArm):
            if arm is not None:
                arm.advance(tensions, force, elapsed)
            return tensions
        arm.advance(tensions, force, elapsed, self._reeled(elapsed))
        hardware.hold(arm.state.tensions, arm.reeled_in(), elapsed, self._is_held())
        return arm.state.tensions

    def encoders(self, tensions: FloatArray) -> FloatArray:
        """Lengths that winches have reeled in under effective ``tensions``, (tendons,) [m].

        Raises:
            OctoArmError: as `Solver.solve`.
        """
        config = self._config
        if isinstance(config.pushed_arm, DynamicArm):
            return config.pushed_arm.reeled_in()
        pulled = tensions.reshape(config.arm.tension_shape)
        self._shape = config.solver.follow(pulled, self._shape)
        return displacements_of(config.solver, self._shape).ravel()

    def _is_held(self) -> NDArray[np.bool_]:
        """Of which tendons of an arm that moves winches hold the lengths, (tendons,)."""
        arm, is_moving = self._config.arm, self._config.dynamics
        return np.array([is_moving and name in self.held for name in arm.tendon_names])

    def _reeled(self, elapsed: float) -> Reeled | None:
        if not self.held:
            return None
        config, (tension, _, crept, now) = self._config, self.hardware.state
        winches, relaxation = config.hardware.winches, config.hardware.relaxation
        goal = np.array([self.held.get(name, np.nan) for name in config.arm.tendon_names])
        most = np.minimum(config.limits, winches.force_limit or np.inf)
        bounds = np.array([np.full(most.size, winches.slack_floor), most])
        effective = relaxation.effective(relaxation.step(crept, bounds, elapsed), bounds)
        low, high = np.abs(tension - bounds) <= 1e-9 * (1.0 + bounds)
        # Without a floor time steps themselves tell which tendons of held winches are slack.
        low &= (effective[0] > 0.0) & (goal <= now)
        at = np.where(high & (goal > now), 1.0, -1.0 * low)
        direction, taut = np.nan_to_num(np.sign(goal - now)), bool(bounds[0, 0])
        return Reeled(winches.reel(now, goal, elapsed), effective, direction, at, taut)

    def _at_rest(self, lengths: Mapping[str, float], tensions: FloatArray) -> Wound:
        names = self._config.arm.tendon_names
        given = {
            name: float(tension)
            for name, tension in zip(names, tensions, strict=True)
            if name not in lengths
        }
        return solve_displacements(self._config.solver, lengths, given, self._wound)


def _goes_on(arm: PushedArm | DynamicArm, before: PushedArm | DynamicArm) -> bool:
    """Let ``arm`` go on from one ``before``; whether a history of friction is lost."""
    if isinstance(arm, DynamicArm):
        return isinstance(before, DynamicArm) and arm.go_on_from(before)
    return isinstance(before, PushedArm) and arm.go_on_from(before)
