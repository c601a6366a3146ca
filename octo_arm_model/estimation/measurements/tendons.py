"""What is measured of each tendon: its tension, or by how much it is drawn in."""

from __future__ import annotations

import functools
from collections.abc import Hashable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.errors import MeasurementError, TensionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.measurements.measurement import Measurement
from octo_arm_model.estimation.state.prediction import Prediction


class _OfTendons(Measurement):
    """One number for each of some tendons."""

    def __init__(
        self, value: ArrayLike, noise: ArrayLike, tendons: tuple[str, ...] | None = None
    ) -> None:
        """One number for each of ``tendons`` by name; of all, in the order of the arm, if None."""
        super().__init__(value, noise)
        self._tendons = tendons

    @property
    def kind(self) -> Hashable:
        """See `Measurement`."""
        return self.name, self._tendons

    def _which(self, at: Prediction) -> tuple[int, ...]:
        names = at.model.arm.tendon_names
        wanted = names if self._tendons is None else self._tendons
        self.check_size(len(wanted), 'one for each tendon')
        return _numbers(self.name, names, wanted)


@functools.lru_cache(maxsize=64)
def _numbers(what: str, names: tuple[str, ...], wanted: tuple[str, ...]) -> tuple[int, ...]:
    """Where tendons that are ``wanted`` are among the ``names`` of all.

    Raises:
        MeasurementError: if one is not; ``what`` is measured of it.
    """
    for name in wanted:
        if name not in names:
            known = ', '.join(names)
            raise MeasurementError(f'{what}: unknown tendon {name}; this arm has {known}')
    return tuple(names.index(name) for name in wanted)


class Tensions(_OfTendons):
    """Tensions as load cells show them, bias included [N]."""

    name = 'tensions'
    is_linear = True

    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (m,) [N]."""
        return self.value - self.jacobian(at) @ at.x

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (m, state)."""
        state = at.model.state
        parts = [part for part in (state.tension, state.tension_bias) if part.stop > part.start]
        return _sums(self._which(at), tuple(part.start for part in parts), state.size)

    def each_apart(self, at: Prediction) -> Iterator[tuple[Measurement, Measurement]]:
        """See `Measurement`."""
        if self.value.size < 2:
            return
        names = [at.model.arm.tendon_names[number] for number in self._which(at)]
        for number, name in enumerate(names):
            rest = np.delete(np.arange(self.value.size), number)
            tendons = tuple(names[:number] + names[number + 1 :])
            yield (
                Tensions(self.value[rest], self.covariance[np.ix_(rest, rest)], tendons),
                LoadCell(
                    self.value[number], float(np.sqrt(self.covariance[number, number])), name
                ),
            )


@functools.lru_cache(maxsize=64)
def _sums(which: tuple[int, ...], starts: tuple[int, ...], size: int) -> FloatArray:
    """Matrix (numbers, ``size``) of ones where the parts that begin at ``starts`` are summed."""
    found = np.zeros((len(which), size))
    for start in starts:
        found[np.arange(len(which)), start + np.array(which)] = 1.0
    found.setflags(write=False)
    return found


class LoadCell(Tensions):
    """The tension that one load cell shows, bias included [N]."""

    def __init__(self, value: float, noise: float, tendon: str) -> None:
        """Of ``tendon``, with one standard deviation."""
        super().__init__([value], noise, (tendon,))
        self.name = f'load cell {tendon}'


class TendonDisplacements(_OfTendons):
    """Length that the winch of each tendon has reeled in [m].

    By so much it is shorter within the arm than without tensions, and stretched itself.
    """

    name = 'tendon displacements'

    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (m,) [m]."""
        which = self._which(at)
        try:
            at.model.solver.check_displacements(self.value, which)
        except TensionError as error:
            raise MeasurementError(str(error)) from None
        stretched = at.model.tendon_compliance * at.x[at.model.state.tension]
        drawn_in = at.model.solver.rest_lengths.ravel() - at.tendon_lengths + stretched
        return self.value - drawn_in[list(which)]

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (m, state)."""
        by_state, state = -at.change.tendon_length, at.model.state
        by_state[:, state.tension] += np.diag(at.model.tendon_compliance)
        return by_state[list(self._which(at))]
