"""When measurements contradict an estimate for so long that it, and not they, must be wrong."""

from __future__ import annotations

import collections
import itertools
from collections.abc import Sequence
from typing import NamedTuple

from octo_arm_model.estimation.measurements import Measurement

_KEPT = 2  # readings of each sensor: as many as show that it agrees with itself
_LINEAR = 1000  # readings of one that tells of the state without a shape


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
    """One kind of measurement: its newest readings, and since when [s] all are refused."""

    def __init__(self, is_linear: bool) -> None:
        most = _LINEAR if is_linear else _KEPT
        self.is_linear, self.readings = is_linear, collections.deque[Reading](maxlen=most)
        self.since: float | None = None

    def add(self, reading: Reading) -> None:
        if reading.is_accepted:
            self.since = None
        elif self.since is None:
            self.since = reading.time
        self.readings.append(reading)

    @property
    def refused_for(self) -> float:
        """How long all of its readings have been refused [s]."""
        return 0.0 if self.since is None else self.readings[-1].time - self.since


class Contradiction:
    """Watches which measurements are refused, and since when."""

    def __init__(self, after: float) -> None:
        """Of a sensor that is refused for ``after`` [s]; 0 for never."""
        self._after = after
        self._sensors: dict[str, _Sensor] = {}

    def add(self, readings: Sequence[Reading]) -> None:
        """Note ``readings``."""
        for one in readings:
            measurement = one.measurement
            sensor = self._sensors.setdefault(measurement.name, _Sensor(measurement.is_linear))
            sensor.add(one)

    def forget(self) -> None:
        """Begin anew."""
        self._sensors.clear()

    def readings(self) -> list[Reading]:
        """The newest readings of every sensor, by time; none while nothing is refused for long.

        Of the time since the sensor that is refused first is. Where there are load cells they
        begin with a reading of these, without which a shape is hard to find.
        """
        sensors = self._sensors.values()
        since = min(
            (one.since for one in sensors
             if one.since is not None and 0.0 < self._after <= one.refused_for),
            default=None,
        )  # fmt: skip
        if since is None:
            return []
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
