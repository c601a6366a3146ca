"""Lengths of the tendons within the arm."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.equilibrium import Problem, State
from octo_arm_model.rod.tables import SLOPE_B, SLOPE_N, Tables
from octo_arm_model.rod.tendons import Stretch, tendon_stretch


class Lengths(NamedTuple):
    """Lengths of the tendons in a state, and their gradients.

    Attributes:
        length: (J,) [m].
        by_z: by the twists of all nodes at fixed local tensions, (J, N, m).
        by_tension: by the tension at every node at fixed twists, (J, N) [m/N]; zero without
            sheaths.
    """

    length: FloatArray
    by_z: FloatArray
    by_tension: FloatArray


def tendon_lengths(problem: Problem, state: State) -> Lengths:
    """Lengths of all tendons in a ``state``, in equilibrium or not."""
    problem.load_work(state)
    return lengths_of(
        problem,
        tendon_stretch(problem.tables, state.z, state.acting.tensions, problem.work.offsets),
    )


def lengths_of(problem: Problem, stretch: Stretch) -> Lengths:
    """Lengths of tendons of known ``stretch`` at the nodes."""
    weights = problem.elements.weights
    by_z = weights[:, np.newaxis, np.newaxis] * stretch.length_by_z
    by_tension = weights[:, np.newaxis] * stretch.by_tension
    return Lengths(weights @ stretch.stretch, by_z.swapaxes(0, 1), by_tension.T)


def rest_stretches(tables: Tables) -> FloatArray:
    """Length of every tendon of the unloaded arm per reference length, (N, J) [-].

    Zero beyond the anchorages.
    """
    slopes = tables.tendons[..., SLOPE_N], tables.tendons[..., SLOPE_B]
    return np.asarray(tables.reach * np.sqrt(1.0 + slopes[0] ** 2 + slopes[1] ** 2))


def rest_stretches_by_offset(tables: Tables, arm: Arm, s: FloatArray) -> FloatArray:
    """Derivatives of `rest_stretches` by every tendon's distance from the midline, (N, J) [1/m].

    Of the tendons of ``arm`` at its nodes ``s`` (N,) [m].
    """
    slopes = tables.tendons[..., SLOPE_N], tables.tendons[..., SLOPE_B]
    outwards = arm.tendon_outward_slopes(s)
    change = slopes[0] * outwards[0].T + slopes[1] * outwards[1].T
    size = np.sqrt(1.0 + slopes[0] ** 2 + slopes[1] ** 2)
    return np.asarray(tables.reach * change / size)
