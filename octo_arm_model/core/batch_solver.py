"""Shapes of one arm for batches of tensions, by compiled kernels where these cover it."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np

from octo_arm_model.core.compiled.compiled import Compiled
from octo_arm_model.core.errors import SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.models.statics import Setup, Statics
from octo_arm_model.core.rod.assembly import Results
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.section.tendons.tendon_sums import transmission


class BatchSolver:
    """Solves one arm for tensions and wrenches that have been checked."""

    def __init__(
        self, model: str, statics: Statics, setup: Setup, compiled: Compiled | None
    ) -> None:
        """Solve by ``statics`` of the ``model`` for ``setup``, or by ``compiled`` kernels."""
        self._model, self._statics, self._setup = model, statics, setup
        self._compiled, self._size = compiled, setup.batch

    def solve(
        self,
        tensions: FloatArray,
        tip_wrench: FloatArray,
        start: Backbone | None,
        before: FloatArray | None,
    ) -> Backbone:
        """Shape under ``tensions`` (..., *Arm.tension_shape) [N] and ``tip_wrench``.

        The result refers to ``tensions`` without a copy. ``tip_wrench`` (6,) or (..., 6) [N, N m]
        is the whole wrench on the tip; ``start`` and ``before`` are those of `Statics.solve`.

        Raises:
            SolveError: if the model has no trustworthy answer.
        """
        arm, grid, base = self._setup.arm, self._setup.grid, self._setup.base
        lead = tensions.shape[: -len(arm.tension_shape)]
        is_loaded = self._statics.is_loaded(tip_wrench)
        if not lead and is_loaded:
            results = Results(lead, grid, base)
            results.add((), self._statics.solve(tensions.ravel(), tip_wrench, start, before))
            return results.backbone(self._model, tensions, tip_wrench, lead, self._reach)
        wrenches = np.broadcast_to(tip_wrench, (*lead, 6)) if lead else tip_wrench
        batch = math.prod(lead)
        flat = tensions.reshape(batch, len(arm.tendons))
        flat_wrenches = wrenches.reshape(batch, 6)
        # One arm has no axis of a batch: NumPy takes much less time.
        read_out = self._compiled.read_out if self._compiled is not None else None
        results = Results(lead and (batch,), grid, base, read_out)
        groups = self._groups(flat_wrenches) if lead and is_loaded else None
        if groups is None:
            numbers = range(batch)
            self._fill(results, numbers, flat, flat_wrenches, start, before, is_loaded)
            return results.backbone(self._model, tensions, wrenches, lead, self._reach)
        results.make_room()
        for arms, is_loaded in groups:
            part = Results((len(arms),), grid, base, read_out)
            self._fill(part, arms, flat[arms], flat_wrenches[arms], start, before, is_loaded)
            results.put(arms, part)
        return results.backbone(self._model, tensions, wrenches, lead, self._reach)

    def _groups(self, wrenches: FloatArray) -> tuple[tuple[list[int], bool], ...] | None:
        """Numbers of the arms that are not loaded, and of those that are; None if all are.

        Each is solved as it is alone. ``wrenches`` (batch, 6) [N, N m] are those on the tips.
        """
        loaded = wrenches.any(axis=1)
        if loaded.all() or self._statics.is_loaded(np.zeros(6)):
            return None
        return tuple((np.flatnonzero(loaded == one).tolist(), one) for one in (False, True))

    def _fill(
        self, results: Results, numbers: Sequence[int], tensions: FloatArray,
        wrenches: FloatArray, start: Backbone | None, before: FloatArray | None, is_loaded: bool,
    ) -> None:  # fmt: skip
        """Solve for ``tensions`` (arms, tendons) and ``wrenches`` (arms, 6); fill in ``results``.

        ``numbers`` are those of the arms within the batch.

        Raises:
            SolveError: if the model has no trustworthy answer.
        """
        batch = len(numbers)
        if self._compiled is not None and not is_loaded:
            results.make_room()
            # Arms for which the kernels do not converge are solved, or refused, by NumPy.
            failed = self._compiled.solve(tensions, results)
            parts = [slice(one, one + 1) for one in failed]
        else:
            if not results.is_one:
                results.make_room()
            size = self._size
            parts = [slice(i, min(i + size, batch)) for i in range(0, batch, size)]
        for part in parts:
            one = 0 if results.is_one else part
            try:
                solution = self._statics.solve(tensions[one], wrenches[one], start, before)
                results.add(() if results.is_one else part, solution)
            except SolveError as error:
                if not results.is_one:
                    error.in_batch(numbers[part])
                raise

    @functools.cached_property
    def _reach(self) -> FloatArray:
        """`Backbone.reach`."""
        reach = transmission(self._setup.arm, self._setup.grid.s, self._setup.grid.section).T
        reach.setflags(write=False)
        return reach
