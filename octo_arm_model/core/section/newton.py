"""Minimum of the energy of each cross section: Newton's method with a line search."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.errors import ConvergenceError, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.numerics.batched_ldlt import factorise, substitute
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.formulas import planar_start, planar_step

# Converged when the residual forces and moments are below this fraction of their `force_scale`.
TOLERANCE = 1e-11
MAX_ITERATIONS = 200
# A step is too long where the slope of the energy at its end exceeds this fraction of the negative
# slope at its start.
OVERSHOOT = 0.9
# The Hessian of the tendons is included while a step leaves more than this of the residual.
_SLOW = 1e-2
# Where tendons cannot twist the arm it is small, and included after this many steps only.
_PATIENCE = 6
# Relative residual below which the slopes of the line search are rounding.
ROUNDING = 1e-6
FIRST_STEPS = 2  # Newton steps for the two unknowns of `initial_strain`
_SHORTEST_TENDON = 0.05  # over its reference length: the cause reported where nothing converges


class Minimum(NamedTuple):
    """Strains of least energy.

    Attributes:
        strain: scaled strain, (n, batch, nodes).
        residual: largest imbalance over its scale in each arm, (batch,).
        iterations: number of Newton steps.
    """

    strain: FloatArray
    residual: FloatArray
    iterations: int


def initial_strain(energy: SectionEnergy, local_tensions: FloatArray) -> FloatArray:
    """Approximation of the strain of least energy: that under tendons parallel to the midline.

    Their force and moment do not depend on the strain, and the section bends in one plane. The two
    unknowns, stretch and curvature times radius, take a few inexpensive Newton steps.
    """
    moment_n, moment_b, force = energy.resultants(local_tensions) / energy.stiffness.axial
    moment = np.sqrt(moment_n * moment_n + moment_b * moment_b)
    load = moment / energy.radius
    straight, stretch, bend = planar_start(load, force)
    for _ in range(FIRST_STEPS):
        f = energy.law.density(stretch, bend * bend)
        stretch, bend = planar_step(stretch, bend, load, force, *f)
    curvature = bend / energy.radius
    # The straight state where that is impossible or NaN.
    fails = ~can_be(energy, stretch, np.abs(curvature))
    if np.count_nonzero(fails):
        stretch, curvature = np.where(fails, straight, stretch), np.where(fails, 0.0, curvature)
    curvature /= np.maximum(moment, 1e-300)
    strain = np.zeros((energy.strains, *force.shape))
    np.multiply(moment_n, -curvature, out=strain[1])
    np.multiply(moment_b, -curvature, out=strain[2])
    strain[3] = stretch
    return strain


def can_be(energy: SectionEnergy, stretch: FloatArray, curvature: FloatArray) -> NDArray[np.bool_]:
    """Whether all fibres and tendons have positive length; False for NaN.

    By scaled strain: ``stretch`` and the norm of the ``curvature``, each (batch, nodes).
    """
    return stretch > curvature * energy.lever_max


def force_scale(energy: SectionEnergy, local_tensions: FloatArray) -> FloatArray:
    """Scale of residual forces and moments: (n, batch, nodes) [N m and N].

    The sum of tensions, and of tensions times lever arms, plus a small fraction of the stiffness
    of the section so that rounding is below tolerance without tensions.
    """
    force = np.add.reduce(local_tensions) + 1e-4 * energy.stiffness.axial
    scale = np.empty((energy.strains, *force.shape))
    scale[:3] = force * energy.lever_max
    scale[3:] = force
    return scale


def minimise(energy: SectionEnergy, local_tensions: FloatArray, start: FloatArray) -> Minimum:
    """Strains of least energy from scaled ``start``; tensions are (tendons, batch, nodes) [N].

    Raises:
        SolveError: if a tendon would be shortened to nothing.
        ConvergenceError: if balance is not reached.
    """
    if energy.planar and not np.count_nonzero(start[0]):
        found = _descend(energy, local_tensions, start[1:4])
        return found._replace(strain=_full(found.strain))
    return _descend(energy, local_tensions, start)


def _full(strain: FloatArray) -> FloatArray:
    """Strains with the torsion that was left out, zero."""
    return strain if len(strain) > 3 else np.concatenate([np.zeros_like(strain[:1]), strain])


def _descend(energy: SectionEnergy, local_tensions: FloatArray, strain: FloatArray) -> Minimum:
    """`minimise` for strains (4 or 6, batch, nodes), or the last three of 4 without torsion."""
    flat = len(strain) == 3
    over = 1.0 / force_scale(energy, local_tensions)[slice(1, 4) if flat else slice(None)]
    step: FloatArray | None = None
    slope = np.zeros(0)
    previous = np.inf
    tendons: FloatArray | None = None
    iterations = 0
    for _ in range(MAX_ITERATIONS):
        gradient, hessian = energy.material(strain)
        gradient += energy.tendon_gradient(strain, local_tensions)
        left = gradient * over
        np.abs(left, out=left)
        worst = float(left.max(initial=0.0))  # NaN where a section cannot be
        if worst <= TOLERANCE:
            return Minimum(strain, left.max(axis=(0, 2), initial=0.0), iterations)
        if step is not None:
            fine = np.add.reduce(gradient * step) <= OVERSHOOT * slope  # not where NaN
            if np.count_nonzero(fine) < fine.size:
                fine |= left.max(axis=0) <= ROUNDING
            if np.count_nonzero(fine) < fine.size:
                # Halve the steps that are too long.
                strain = strain - np.where(fine, 0.0, 0.5) * step
                step = np.where(fine, step, 0.5 * step)
                slope = np.where(fine, slope, 0.5 * slope)
                continue
        is_slow = not iterations or worst > _SLOW * previous
        if is_slow and (iterations >= _PATIENCE or not flat):
            _, tendons = energy.tendon_derivatives(_full(strain), local_tensions)
            tendons = tendons[1:, 1:] if flat else tendons
        previous = worst
        if tendons is not None:
            hessian += tendons
        step = substitute(factorise(hessian), gradient)
        np.negative(step, out=step)
        slope = -np.add.reduce(gradient * step)
        strain = strain + step
        iterations += 1
    _refuse_short_tendons(energy, _full(strain), local_tensions)
    raise ConvergenceError('the balance of the cross sections', worst, iterations, _full(strain))


def _refuse_short_tendons(
    energy: SectionEnergy, strain: FloatArray, local_tensions: FloatArray
) -> None:
    """Raise the cause where a tendon is shortened to nothing, at which |u| is not smooth.

    Raises:
        SolveError: if one is.
    """
    length = np.where(local_tensions > 0.0, energy.lengthening(strain, local_tensions)[0], np.inf)
    if length.min(initial=np.inf) < _SHORTEST_TENDON:
        _, number, node = np.unravel_index(np.argmin(length), length.shape)
        raise SolveError(
            f'tensions shorten a tendon to nothing at s = {energy.s[node]:.4g} m', int(number)
        )
