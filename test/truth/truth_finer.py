"""Finer runs of the solver that made the truth: knots along the arm, and more stations."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model import Config, Profile
from octo_arm_model.rod.stations import StationGrid, panels_of

DIGITS = 10  # significant ones of the largest value of a quantity that are kept


class Knotted(Profile):
    """A profile as another, said to be not smooth at more places."""

    def __init__(self, profile: Profile | float, knots: tuple[float, ...]) -> None:
        self._profile, self._knots = profile, knots

    def value(self, s: ArrayLike) -> np.ndarray:
        if isinstance(self._profile, Profile):
            return self._profile.value(s)
        return np.full(np.shape(s), self._profile)

    def slope(self, s: ArrayLike) -> np.ndarray:
        if isinstance(self._profile, Profile):
            return self._profile.slope(s)
        return np.zeros(np.shape(s))

    @property
    def knots(self) -> tuple[float, ...]:
        own = self._profile.knots if isinstance(self._profile, Profile) else ()
        far = [s for s in self._knots if all(abs(s - one) > 1e-4 * self._knots[-1] for one in own)]
        return tuple(sorted({*own, *far}))

    @property
    def reach(self) -> float:
        return self._profile.reach if isinstance(self._profile, Profile) else float('inf')


# Stations ---------------------------------------------------------------------------------------


def wanted_places(config: Config) -> np.ndarray:
    """Ends and middles of the parts between anchorages and loads [m]."""
    ends = [0.0, *(panel.stop for panel in panels_of(config.arm, config.loads.breaks))]
    return np.array(sorted({*ends, *(0.5 * (a + b) for a, b in itertools.pairwise(ends))}))


def stations_for(config: Config, about: int) -> int:
    """The smallest number of stations from ``about`` on with one in the middle of every part."""
    loads = config.loads
    panels = len(panels_of(config.arm, loads.breaks))
    for count in range(max(about, 2 * panels + 1), 40 * about):
        grid = StationGrid.build(config.arm, count, loads.breaks)
        places = wanted_places(config)
        if np.abs(grid.s[:, np.newaxis] - places).min(axis=0).max() < 1e-10 * config.arm.length:
            return count
    raise AssertionError('no such number of stations')


# Finer runs -------------------------------------------------------------------------------------


def refined(config: Config, fineness: tuple[int, int]) -> Config:
    """The same arm with so many equal parts between knots, and times as many stations."""
    knots, times = fineness
    places = np.arange(1, knots) * config.arm.length / knots
    return with_knots(config, places, stations_for(config, times * (config.stations - 1) + 1))


def with_knots(config: Config, s: np.ndarray, stations: int) -> Config:
    """The same arm with knots at ``s`` (n,) [m] and another number of stations."""
    arm = config.arm
    if config.model == 'renda2012':  # which has no knots
        return dataclasses.replace(config, stations=stations)
    places = tuple(s.tolist())
    material = arm.material
    material = dataclasses.replace(
        material, youngs_modulus=Knotted(material.youngs_modulus, places)
    )
    arm = dataclasses.replace(arm, material=material)
    return dataclasses.replace(config, arm=arm, stations=stations)
