"""The stiffness of the rubber about a tendon, estimated from the radii of thread and body."""

from __future__ import annotations

import math

from octo_arm_model.core.arm.validation import positive
from octo_arm_model.core.errors import ArmDefinitionError

_WIDEST = 0.5  # of the radius of the body, a sheath that is still a hole in it


def estimate_sheath_stiffness(
    thread_radius: float, body_radius: float, shear_modulus: float
) -> float:
    """Stiffness k [Pa] of rubber of a ``shear_modulus`` [Pa] about a thread or its sheath.

    Plane strain of an incompressible disc of ``body_radius`` [m] under a force that is spread
    evenly over a ring of ``thread_radius`` about its centre and balanced by the shear of the beam,
    evenly over the section. Kelvin's line force moves the ring by (1/2 - ln r) / (4 pi G) and the
    mean of the section by (1 - ln R) / (4 pi G), and with the balance leaves the rim free of
    traction:

        k = 4 pi G / (ln(R / r) - 1/2) .

    Kelvin's solution in the plane: e.g. Timoshenko and Goodier, Theory of Elasticity, section 42
    (force at a point of a plate), for plane strain and nu = 1/2. For tapered arms with the mean
    radius; off the centre rubber yields a little more.

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
