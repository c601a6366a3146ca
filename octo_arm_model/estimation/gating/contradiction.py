"""When measurements contradict an estimate for so long that it, and not they, must be wrong."""

from __future__ import annotations

import collections
import itertools
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from octo_arm_model.estimation.measurements import Measurement

_KEPT = 2  # readings of each sensor: as many as show that it agrees with itself
_LINEAR = 1000  # readings of one that tells of the state without a shape
_LONGEST = 8  # times as long as at first, that a new beginning is waited for


class Reading(NamedTuple):
    """What one sensor measured.

    Attributes:
        time: [s].
        measurement: made then.
        is_accepted: whether it was within the gate.
    """

    time: float
    measurement: Measurement
    is_accepted: bool


class _Sensor:
    """One kind of measurement: its newest readings, and since when [s] all are refused.

    The time is infinite where the last was accepted.
    """

    def __init__(self, is_linear: bool) -> None:
        most = _LINEAR if is_linear else _KEPT
        self.is_linear, self.readings = is_linear, collections.deque[Reading](maxlen=most)
        self.since = self._before = math.inf

    def add(self, reading: Reading) -> None:
        self._before = self.since
        self.since = math.inf if reading.is_accepted else min(reading.time, self.since)
        self.readings.append(reading)

    def refuse(self, time: float) -> None:
        """Its newest reading is refused after all, if it is of that ``time`` [s]."""
        if self.readings[-1].time == time:
            self.readings[-1] = self.readings[-1]._replace(is_accepted=False)
            self.since = min(time, self._before)

    @property
    def refused_for(self) -> float:
        """How long all of its readings have been refused [s]."""
        return self.readings[-1].time - self.since


class Contradiction:
    """Watches which measurements are refused, and since when."""

    def __init__(self, after: float) -> None:
        """Of a sensor that is refused for ``after`` [s]; 0 for never."""
        self._after = after
        self._sensors: dict[str, _Sensor] = {}
        self._patience: dict[str, int] = {}

    def add(self, readings: Sequence[Reading]) -> None:
        """Note ``readings``."""
        for one in readings:
            measurement = one.measurement
            sensor = self._sensors.setdefault(measurement.name, _Sensor(measurement.is_linear))
            sensor.add(one)
            if one.is_accepted:
                self._patience.pop(measurement.name, None)

    def refuse(self, time: float, names: Iterable[str]) -> None:
        """Note that readings of ``time`` [s] are refused for what else was measured then."""
        for name in names:
            if name in self._sensors:
                self._sensors[name].refuse(time)

    def begin(self, *, is_vain: bool) -> None:
        """Forget all readings; if they were of no use wait for twice as long for the next."""
        refused = self._refused() if is_vain else []
        self._patience = {name: min(2 * self._patience.get(name, 1), _LONGEST) for name in refused}
        self._sensors.clear()

    def _refused(self) -> list[str]:
        """Names of the sensors that have been refused for long."""
        return [
            name
            for name, one in self._sensors.items()
            if 0.0 < self._after * self._patience.get(name, 1) <= one.refused_for
        ]

    def readings(self) -> list[Reading]:
        """The newest readings of every sensor, by time; none while nothing is refused for long.

        Of the time since the sensor that is refused first is. Where there are load cells they
        begin with a reading of these, without which a shape is hard to find.
        """
        sensors, refused = self._sensors.values(), self._refused()
        if not refused:
            return []
        since = min(self._sensors[name].since for name in refused)
        every = [one for sensor in sensors for one in sensor.readings if one.time >= since]
        newest = [
            one for sensor in sensors for one in itertools.islice(reversed(sensor.readings), _KEPT)
            if one.time >= since
        ]  # fmt: skip
        linear = [one for one in every if one.measurement.is_linear]
        if linear:
            first = min(one.time for one in newest)
            start = next((one for one in reversed(linear) if one.time <= first), linear[0])
            newest = [one for one in newest if one.time >= start.time and one is not start]
            newest.append(start)
        return sorted(newest, key=lambda one: one.time)
