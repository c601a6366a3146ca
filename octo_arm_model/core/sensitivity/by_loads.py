"""What dead loads of any kind do to a balanced rod, to first order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.errors import ConfigError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.load_resultants import dead_resultants
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.state import State
from octo_arm_model.core.numerics.vectors import cross
from octo_arm_model.core.sensitivity.analytic import lengths_along, read_out
from octo_arm_model.core.sensitivity.imbalance import Imbalance
from octo_arm_model.core.sensitivity.results import Change


def by_loads(rod: LoadedRod, state: State, arm: Arm, loads: Sequence[Loads]) -> Change:
    """Of the balanced ``state`` of a loaded ``rod`` of ``arm``, per unit of each of ``loads``.

    Raises:
        LoadError: if a load that acts already states no tangent stiffness.
        ConfigError: if tendons have friction.
    """
    if state.sliding is not None:
        raise ConfigError('tendons have friction, with which there is no derivative by loads')
    problem = rod.equilibrium
    problem.require_tangents('sensitivity')
    columns = np.stack([_wrench(rod, state, arm, one) for one in loads], axis=1)
    twist = state.shape.twist
    response = problem.linearised(state).solve(columns[: len(twist)])
    pose, strains = read_out(rod, state, response)
    energy = problem.energy
    local_tensions = energy.local_tensions(state.condition.tensions[np.newaxis])
    stretch = Imbalance(energy, rod.parameters, twist, local_tensions).length_by_twist
    length = lengths_along(stretch * problem.collocation.weights, response.twist)
    return Change(pose, strains, length)


def _wrench(rod: LoadedRod, state: State, arm: Arm, loads: Loads) -> FloatArray:
    """Moment and force of ``loads`` in the axes of all cross sections, (6, points)."""
    own = rod.equilibrium.collocation
    force, moment = dead_resultants(arm, own, loads)
    force = force + np.array(loads.tip_force)[:, np.newaxis]
    moment = moment + np.array(loads.tip_moment)[:, np.newaxis]
    moment += own.integrate_from_tip(cross(state.tangent, force))
    wrench = np.stack([moment, force])
    return np.einsum('jin,kjn->kin', state.rotation, wrench).reshape(6, -1)
