"""The motion of an arm under tensions or lengths that are known at times, as those recorded."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import positive
from octo_arm_model.rod.motion import Dynamics
from octo_arm_model.rod.motion_state import Inputs, MotionState

STEP = 2e-3  # of the integration [s]
LONGEST_GAP = 10.0  # between readings that one motion goes on through [s]
_ON_STEP = 1e-6  # so near to the end of a step is there [s]


class _Known(NamedTuple):
    """What is known of the tendons at a time [s]."""

    time: float
    tensions: FloatArray
    displacements: dict[str, float]

    @property
    def inputs(self) -> Inputs:
        """As a step takes them."""
        return Inputs(self.tensions, self.displacements)


class DrivenMotion:
    """Moves an arm from reading to reading, between which tensions and lengths change linearly.

    It begins in the equilibrium of the first reading. All steps are of one length, so that the
    motion does not depend on when readings are taken: a time between two of them is reached by a
    shorter one, from which the motion does not go on.

    Attributes:
        dynamics: of the arm.
        starts: how many times the motion began at rest.
    """

    def __init__(self, dynamics: Dynamics, step: float = STEP) -> None:
        """Move the arm of ``dynamics`` in steps [s]."""
        self.dynamics, self._step = dynamics, positive('step', step, 's')
        self.starts = 0
        self._state: MotionState | None = None  # after the last whole step
        self._known: _Known | None = None
        self._origin_ns, self._steps, self._ended = 0, 0, ''
        self._newest_ns: dict[str, int] = {}

    def read(
        self, stamp_ns: int, tensions: FloatArray | None = None,
        displacements: dict[str, float] | None = None,
    ) -> None:  # fmt: skip
        """Go on to a stamp [ns], from which on ``tensions`` or ``displacements`` are known.

        The motion begins again at rest where the stamps of either go back, and after
        `LONGEST_GAP`. A stamp before those of the other counts as if it came with the last one.

        Raises:
            SolveError: if there is no equilibrium to begin with, or no step succeeds. A motion
                that ended goes on where it may begin again.
            OctoArmError: if the readings do not fit the arm; what is known stays.
        """
        source = 'tensions' if displacements is None else 'displacements'
        goes_back = stamp_ns < self._newest_ns.get(source, stamp_ns)
        last = self._known or _Known(0.0, np.zeros(self.dynamics.solver.arm.tension_shape), {})
        time = max(1e-9 * (stamp_ns - self._origin_ns), last.time)
        now = _Known(
            time,
            last.tensions if tensions is None else tensions,
            last.displacements if displacements is None else displacements,
        )
        self.dynamics.driven(now.inputs)
        begins = self._known is None or goes_back or time - last.time > LONGEST_GAP
        self._newest_ns = {**({} if begins else self._newest_ns), source: stamp_ns}
        if begins:
            self._known = None
            self._state = self.dynamics.at_rest(now.inputs)
            self._origin_ns, self._steps, self._ended = stamp_ns, 0, ''
            self._known = now._replace(time=0.0)
            self.starts += 1
            return
        self._known = now
        if not self._ended:
            try:
                self._advance(last, now)
            except SolveError as error:
                self._ended = str(error)
        if self._ended:
            raise SolveError(self._ended)

    @property
    def is_wound(self) -> bool:
        """Whether some tendons are driven by length."""
        return self._known is not None and bool(self._known.displacements)

    @property
    def state(self) -> MotionState:
        """At the last reading.

        Raises:
            SolveError: if the step to there does not succeed, or nothing was read.
        """
        if self._state is None or self._known is None:
            raise SolveError('the arm does not move yet')
        rest = self._known.time - self._steps * self._step
        if rest <= _ON_STEP:
            return self._state
        return self.dynamics.step(self._state, self._known.inputs, rest)

    def _advance(self, before: _Known, now: _Known) -> None:
        state, step = self._state, self._step
        assert state is not None
        if not now.displacements.keys() <= before.displacements.keys():
            reeled = self.dynamics.displacements(state).tolist()
            named = dict(zip(self.dynamics.solver.arm.tendon_names, reeled))
            before = before._replace(displacements=named | before.displacements)
        while (end := (self._steps + 1) * step) <= now.time + _ON_STEP:
            part = min((end - before.time) / max(now.time - before.time, _ON_STEP), 1.0)
            lengths = {
                name: (1.0 - part) * before.displacements[name] + part * value
                for name, value in now.displacements.items()
            }
            pulled = (1.0 - part) * before.tensions + part * now.tensions
            state = self._state = self.dynamics.step(state, Inputs(pulled, lengths), step)
            self._steps += 1
