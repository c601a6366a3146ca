"""The balance of every cross section by itself: an arm without loads, or under known wrenches."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.rod.forms import Form
from octo_arm_model.rod.tables import (
    ALONG_B,
    ALONG_N,
    AXIAL,
    LEVER,
    SQUARED_RADIUS,
    Tables,
    Work,
)

TOLERANCE = 1e-11
_MOST_STEPS = 200
_ROUNDING = 1e-6  # residual below which steps are taken as they are
_SHORTENED = 0.5  # factor of a step that is too long
_OVERSHOOT = 0.9  # of the slope along a step, that may be left with the other sign at its end


def initial_twists(tables: Tables, tensions: FloatArray, strains: int) -> FloatArray:
    """Twists (n, m) near the balance under ``tensions`` (n, J) [N], as if tendons were parallel.

    Force and moment then do not depend on the strain, and the section bends in one plane; for
    rubber from stretch and bend of the straight section and a secant, see `planar` in `_planar`.
    """
    acts = np.arange(tensions.shape[1]) < tables.active[:, np.newaxis]
    pull = tensions * acts
    axial = tables.body[:, AXIAL]
    radius = np.sqrt(tables.body[:, SQUARED_RADIUS])
    force = pull.sum(axis=1) / axial
    about_n = (pull * tables.tendons[..., ALONG_B]).sum(axis=1) / axial
    about_b = -(pull * tables.tendons[..., ALONG_N]).sum(axis=1) / axial
    moment = np.hypot(about_n, about_b)
    straight, stretch, bend = _planar(tables.widens, moment / radius, force)
    curvature = bend / radius
    fails = ~(stretch > curvature * tables.body[:, LEVER])
    stretch, curvature = np.where(fails, straight, stretch), np.where(fails, 0.0, curvature)
    # Scaled curvatures; moments are those of the tendons' pull with opposite sign.
    curvature = -curvature / np.maximum(moment, 1e-300)
    if tables.widens:
        curvature = curvature * np.sqrt(stretch)
    z = np.zeros((len(tensions), strains))
    z[:, 1], z[:, 2], z[:, 3] = about_n * curvature, about_b * curvature, stretch
    return z


def _planar(
    widens: bool, load: FloatArray, force: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stretch without the moment, stretch, and bend: curvature times R.

    For a moment ``load`` over E A R and a compressive ``force`` over E A, exact to first order.
    """
    if not widens:
        stretch = np.maximum(1.0 - force, 0.05)
        return stretch, stretch, 4.0 * load
    # Straight rubber is in balance where this is lambda + 3 force, nearly, and 1 / lambda^2.
    stress = 1.0 + force + force + force * force / (1.0 + force)
    straight = 1.0 / np.sqrt(stress)
    ratio = 12.0 * load / (straight + 2.0 * stress)
    # Bending lengthens rubber.
    secant = np.sqrt(1.0 + ratio * ratio)
    stretch = straight * np.sqrt(secant)
    return straight, stretch, stretch * ratio / secant


def balance_sections(
    form: Form, tables: Tables, work: Work, tensions: FloatArray, wrench: FloatArray, z: FloatArray
) -> tuple[FloatArray, float, int]:
    """Twists (n, m) of every section in balance with ``wrench`` (n, m), by Newton's method.

    From ``z`` (n, m). ``work.scale`` is given, see `tables.force_scale`. Steps at whose end the
    energy has risen again are halved, each by itself.

    Returns:
        Twists, residual and number of steps.

    Raises:
        ConvergenceError: if it does not converge.
    """
    step, slope, left = np.zeros_like(z), np.zeros(len(z)), np.inf
    for iterations in range(_MOST_STEPS):
        left = form.section_steps(tables, z, tensions, wrench, work)
        if left <= TOLERANCE:
            return z + work.step, left, iterations + 1
        if not left <= _ROUNDING and iterations:
            along = (work.residual * step).sum(axis=1)
            worst = (np.abs(work.residual) / work.scale[:, _KINDS[z.shape[1]]]).max(axis=1)
            fine = (along <= _OVERSHOOT * slope) | (worst <= _ROUNDING)  # False for NaN
            if not fine.all():
                step = np.where(fine[:, np.newaxis], step, _SHORTENED * step)
                slope = np.where(fine, slope, _SHORTENED * slope)
                z = z - np.where(fine[:, np.newaxis], 0.0, step)
                continue
        step = work.step.copy()
        slope = -(work.residual * step).sum(axis=1)
        z = z + step
    raise ConvergenceError('the balance of the cross sections', left, _MOST_STEPS, z)


# Column of `Work.scale` of each strain.
_KINDS = {count: np.arange(count) // 3 for count in (4, 6)}


def straight_twists(strains: int) -> FloatArray:
    """Twist (m,) of the straight rod."""
    return np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])[:strains]
