"""Winches, relaxation and load cells in series: from commanded to measured tensions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.build import LoadCellCalibration
from octo_arm_model.simulation.load_cells import LoadCells, SimulatedLoadCells
from octo_arm_model.simulation.relaxation import Relaxation, SimulatedRelaxation
from octo_arm_model.simulation.winches import SimulatedWinches, Winches


@dataclass(frozen=True)
class Hardware:
    """Parameters of the hardware, by default ideal.

    Attributes:
        winches: parameters of the winches, which pull the tendons.
        load_cells: parameters of the load cells, which measure their tensions.
        relaxation: parameters of the viscoelastic material.
        calibration: conversion of readings to tensions; its inverse is applied to the tensions.
    """

    winches: Winches = field(default_factory=Winches)
    load_cells: LoadCells = field(default_factory=LoadCells)
    relaxation: Relaxation = field(default_factory=Relaxation)
    calibration: LoadCellCalibration = field(default_factory=LoadCellCalibration)


class Moment(NamedTuple):
    """Outputs of the hardware at one time, each (tendons,) [N].

    Attributes:
        measured: readings of the load cells; None where the message is lost.
        effective: tensions under which the elastic arm has the shape of this one; without
            relaxation the tensions of the tendons.
    """

    measured: FloatArray | None
    effective: FloatArray


class SimulatedHardware:
    """The hardware over time, initially with slack tendons."""

    def __init__(self, hardware: Hardware, tendons: int) -> None:
        """Begin with ``tendons`` slack tendons."""
        self._winches = SimulatedWinches(hardware.winches, tendons)
        self._calibration = hardware.calibration
        self._load_cells = SimulatedLoadCells(hardware.load_cells, tendons)
        self._relaxation = SimulatedRelaxation(hardware.relaxation, tendons)

    def change(self, hardware: Hardware) -> None:
        """Replace the parameters; the tensions stay."""
        self._winches.winches = hardware.winches
        self._calibration = hardware.calibration
        self._load_cells.change(hardware.load_cells)
        self._relaxation.relaxation = hardware.relaxation

    @property
    def state(self) -> FloatArray:
        """Tensions, set points and crept tensions (3, tendons) [N]; noise is none of it."""
        winches = self._winches
        return np.array([winches.tension, winches.set_point, self._relaxation.crept])

    @state.setter
    def state(self, state: FloatArray) -> None:
        winches = self._winches
        winches.tension, winches.set_point, self._relaxation.crept = state.copy()

    def step(self, command: FloatArray, dt: float) -> Moment:
        """Tensions after ``command`` (tendons,) [N] has been given for ``dt`` [s]."""
        tension = self._winches.step(command, dt)
        effective = self._relaxation.step(tension, dt)
        return Moment(self._load_cells.read(self._calibration.readings(tension)), effective)
