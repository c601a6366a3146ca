"""First derivatives of a rod in equilibrium by the magnitudes of dead loads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.errors import ConfigError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.equilibrium import Equilibrium
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.state import Condition, State
from octo_arm_model.core.numerics.vectors import cross
from octo_arm_model.core.rod.solution import Shape
from octo_arm_model.core.sensitivity.analytic import lengths_along, read_out
from octo_arm_model.core.sensitivity.imbalance import Imbalance
from octo_arm_model.core.sensitivity.results import Change


def by_loads(rod: LoadedRod, condition: Condition, shape: Shape, loads: Sequence[Loads]) -> Change:
    """Change of the equilibrium ``shape`` of a loaded ``rod`` per unit of each of ``loads``.

    Raises:
        LoadError: if a load on the rod states no tangent stiffness.
        ConfigError: if tendons have friction.
    """
    problem = rod.equilibrium
    if problem.friction is not None:
        raise ConfigError('tendons have friction, with which there is no derivative by loads')
    problem.require_tangents('sensitivity')
    dead = [rod.dead_resultants(one) for one in loads]
    force, moment = (np.array(part) for part in zip(*dead, strict=True))
    if rod.differentiate is not None:
        return Change(*rod.differentiate(condition, shape, (force, moment), False))
    state, twist = problem.state(condition, shape), shape.twist
    response = problem.linearised(state).solve(_wrenches(problem, state, force, moment))
    pose, strains = read_out(rod, state, response)
    energy = problem.energy
    local_tensions = energy.local_tensions(condition.tensions[np.newaxis])
    stretch = Imbalance(energy, rod.parameters, twist, local_tensions).length_by_twist
    length = lengths_along(stretch * problem.collocation.weights, response.twist)
    return Change(pose, strains, length)


def _wrenches(
    problem: Equilibrium, state: State, force: FloatArray, moment: FloatArray
) -> FloatArray:
    """Wrenches on the cross sections in their axes, (n, loads, points).

    ``force`` and ``moment`` (loads, 3, points) are `LoadedRod.dead_resultants`.
    """
    tangent = np.broadcast_to(state.tangent[:, np.newaxis], force.swapaxes(0, 1).shape)
    force, moment = force.swapaxes(0, 1), moment.swapaxes(0, 1)
    moment = moment + problem.collocation.integrate_from_tip(cross(tangent, force))
    wrench = [np.einsum('jin,jcn->icn', state.rotation, part) for part in (moment, force)]
    return np.concatenate(wrench)[: len(state.imbalance)]
