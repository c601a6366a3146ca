"""Stiffness of the rubber around a tendon, estimated from the radii of tendon and body."""

from __future__ import annotations

import math

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.validation import positive

_WIDEST = 0.5  # of the radius of the body: largest sheath for which the formula holds


def estimate_sheath_stiffness(
    thread_radius: float, body_radius: float, shear_modulus: float
) -> float:
    """Stiffness k [Pa] of rubber of ``shear_modulus`` [Pa] around a tendon or its sheath.

    Plane strain of an incompressible disc of ``body_radius`` R [m] under a force per length that
    is uniform on a ring of ``thread_radius`` r [m] about the centre and balanced by a uniform body
    force, the shear of the beam. Per unit of force, Kelvin's solution displaces the ring by (1/2 -
    ln r) / (4 pi G) and the section on average by (1 - ln R) / (4 pi G), and with the body force
    leaves the rim free of traction:

        k = 4 pi G / (ln(R / r) - 1/2) .

    Kelvin's solution in the plane: e.g. Timoshenko and Goodier, Theory of Elasticity, section 42
    (force at a point of a plate), for plane strain and nu = 1/2. Tapered arms take the
    mean radius; off the centre the rubber is a little softer.

    Raises:
        ArmDefinitionError: if a value is not > 0, or the thread is wider than half of the body.
    """
    thread = positive('thread_radius', thread_radius, 'm')
    body = positive('body_radius', body_radius, 'm')
    modulus = positive('shear_modulus', shear_modulus, 'Pa')
    if thread > _WIDEST * body:
        expected = f'at most {_WIDEST} of the radius of the body, {_WIDEST * body:.6g} [m]'
        raise ArmDefinitionError('thread_radius', thread, expected)
    return 4.0 * math.pi * modulus / (math.log(body / thread) - 0.5)
