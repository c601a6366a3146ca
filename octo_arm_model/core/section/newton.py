"""Minimum of the energy of each cross section by Newton's method."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.errors import ConvergenceError, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.numerics.batched_ldlt import factorise, substitute
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.formulas import planar_start, planar_step
from octo_arm_model.core.section.quasi_newton import balance

# Converged when the residual forces and moments are below this fraction of their `force_scale`.
TOLERANCE = 1e-11
MAX_ITERATIONS = 200
# A step is too long where the directional derivative of the energy at its end exceeds this part of
# minus that at its start.
OVERSHOOT = 0.9
# Relative residual below which those derivatives are dominated by rounding.
ROUNDING = 1e-6
_SHORTEST_TENDON = 0.05  # over its reference length: the cause reported where nothing converges


class Minimum(NamedTuple):
    """Strains of least energy.

    Attributes:
        strain: scaled strain, (n, batch, nodes).
        residual: largest residual over its `force_scale` in each arm, (batch,).
        iterations: number of Newton steps.
    """

    strain: FloatArray
    residual: FloatArray
    iterations: int


def initial_strain(energy: SectionEnergy, local_tensions: FloatArray) -> FloatArray:
    """Approximate scaled strain (n, batch, nodes) of least energy, to start from.

    As if all tendons were parallel to the midline: force and moment of ``local_tensions``
    (tendons, batch, nodes) [N] then do not depend on the strain, and the section bends in one
    plane. Stretch and curvature times radius follow from `planar_start` and one Newton step.
    """
    moment_n, moment_b, force = energy.resultants(local_tensions) / energy.stiffness.axial
    moment = np.sqrt(moment_n * moment_n + moment_b * moment_b)
    load = moment / energy.radius
    softening = energy.softening(local_tensions)
    straight, stretch, bend = planar_start(load, force, softening)
    f = energy.law.density(stretch, bend * bend)
    stretch, bend = planar_step(stretch, bend, load, force, softening, *f)
    curvature = bend / energy.radius
    # Begin with the straight state where the bent one is impossible or NaN.
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

    ``stretch`` and norm of the ``curvature`` are of the scaled strain, (batch, nodes).
    """
    return stretch > curvature * energy.lever_max


def force_scale(energy: SectionEnergy, local_tensions: FloatArray) -> FloatArray:
    """Scale of residual forces and moments: (n, batch, nodes) [N m and N].

    The sum of tensions, and of tensions times lever arms, plus a small fraction of the stiffness
    of the section, so that without tensions rounding stays below the tolerance.
    """
    force = np.add.reduce(local_tensions) + 1e-4 * energy.stiffness.axial
    scale = np.empty((energy.strains, *force.shape))
    scale[:3] = force * energy.lever_max
    scale[3:] = force
    return scale


def minimise(energy: SectionEnergy, local_tensions: FloatArray, start: FloatArray) -> Minimum:
    """Strains of least energy, from the scaled strain ``start`` (n, batch, nodes).

    ``local_tensions`` are (tendons, batch, nodes) [N].

    Raises:
        SolveError: if a tendon would be shortened to nothing.
        ConvergenceError: if equilibrium is not reached.
    """
    scale = force_scale(energy, local_tensions)
    tendons = energy.tendons(local_tensions)
    if tendons is not None:
        first = 0 if tendons.has_torsion else 1
        near = balance(energy, tendons, start[first:4], scale[first:4], TOLERANCE)
        if near is not None:
            strain = np.zeros_like(start)
            strain[first:4] = near.strain
            return Minimum(strain, near.residual, near.iterations)
    return _descend(energy, local_tensions, start, scale)


def _descend(
    energy: SectionEnergy, local_tensions: FloatArray, strain: FloatArray, scale: FloatArray
) -> Minimum:
    """`minimise` from ``strain`` by Newton's method with a line search.

    ``scale`` is the `force_scale`.
    """
    over = 1.0 / scale
    step: FloatArray | None = None
    slope = np.zeros(0)
    iterations = 0
    for _ in range(MAX_ITERATIONS):
        widening = energy.widening(strain[3])
        gradient, hessian = energy.derivatives(strain, local_tensions, widening)
        if energy.planar:
            # Exactly zero: tendons have no moment about t but rounding.
            gradient[0] = hessian[0, 1:] = hessian[1:, 0] = 0.0
        left = np.abs(gradient * over)
        worst = float(left.max(initial=0.0))  # NaN where a strain is impossible
        if worst <= TOLERANCE:
            # One more step: the error is then of the order of rounding.
            strain = strain - substitute(factorise(hessian), gradient)
            return Minimum(strain, left.max(axis=(0, 2), initial=0.0), iterations)
        if step is not None:
            fine = np.add.reduce(gradient * step) <= OVERSHOOT * slope  # False for NaN
            fine |= left.max(axis=0) <= ROUNDING
            if not fine.all():
                # Halve the steps that are too long.
                strain = strain - np.where(fine, 0.0, 0.5) * step
                step = np.where(fine, step, 0.5 * step)
                slope = np.where(fine, slope, 0.5 * slope)
                continue
        step = substitute(factorise(hessian), gradient)
        np.negative(step, out=step)
        slope = -np.add.reduce(gradient * step)
        strain = strain + step
        iterations += 1
    _refuse_short_tendons(energy, strain, local_tensions)
    raise ConvergenceError('the balance of the cross sections', worst, iterations, strain)


def _refuse_short_tendons(
    energy: SectionEnergy, strain: FloatArray, local_tensions: FloatArray
) -> None:
    """Report a tendon of zero length, where |u| is not smooth, as the cause of divergence.

    Raises:
        SolveError: if a tendon is shorter than `_SHORTEST_TENDON`.
    """
    length = np.where(local_tensions > 0.0, energy.lengthening(strain, local_tensions)[0], np.inf)
    if length.min(initial=np.inf) < _SHORTEST_TENDON:
        _, number, node = np.unravel_index(np.argmin(length), length.shape)
        raise SolveError(
            f'tensions shorten a tendon to nothing at s = {energy.s[node]:.4g} m', int(number)
        )
