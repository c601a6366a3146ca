"""The equations of the paper's two models, whose sections carry moments of their tendons alone.

With tendon j at the offset (r_n, r_b) in the axes of a cross section, tensions T enter by sums
over the tendons that act there,

    pull = sum T             n = sum T r_n          b = sum T r_b
    nn = sum T r_n^2         bb = sum T r_b^2       mixed = sum T r_n r_b
    torque = sum T (r_n r_b' - r_b r_n')

in the letters of the paper's equation (10), for four tendons a section, A1 = nn, B1 = bb,
alpha = n and beta = -b; the last two vanish. The moment of the tendons is M = F - D omega, with

    F = (-torque, -b, n)    D = [[nn + bb, 0, 0], [0, bb, -mixed], [0, -mixed, nn]]

linear in the strains omega = (tau, xi, k), and K (omega - omega at rest) that of the section, with
K = diag(GI, EJ_n, EJ_b).

`closed_form` is the balance (8a) with (3a), K omega = M, at every s by itself: a linear system,
symmetric positive definite for tensions that are not negative.

`renda2012` is the model as published, (10), (11) and (12), from the tip to the base, of circles
that are straight at rest, for which alone the paper states (10). The imbalance
p = K omega - M, with which omega = C (F + p) and C = (K + D)^-1, is not zero there: (10) is
p' = omega x M, or, as everything without p cancels, with (0, xi_0, k_0) = C F,

    p_t' = k_0 p_n - xi_0 p_b + (B1 - A1) C_n C_b p_n p_b
    p_n' = -p_t (c k_0 + B1 C_t C_b p_b)
    p_b' = +p_t (c xi_0 + A1 C_t C_n p_n)        c = (EJ + A1 + B1) C_t

At an anchorage (11) adds to omega what the tendons that end there would bend the arm by alone,
their C F. p is zero from the tip to the second anchorage, and smooth in every element, where it is
collocated at the nodes and swept until it converges (Picard iteration, Clenshaw and Norton 1963).

Both have (9a), q = N / (E A) with N = k n - xi b - pull.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.body import Body
from octo_arm_model.arm.errors import ConfigError, ConvergenceError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.profile import Profile
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.arm.tendon import Section
from octo_arm_model.rod import arrays
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.equilibrium import Problem
from octo_arm_model.rod.tables import PaperTables, places_at

# Sweeps stop when p changes by less than this part of the largest moment in the arm, which leaves
# an error ten times smaller, as each gains more than one digit by then.
TOLERANCE = 5e-8
# With derivatives, which are imaginary parts of about 1e-6 of the real ones.
_OF_DERIVATIVES = 1e-13
_ROUNDING = 1e-14  # of products of offsets


class PaperEquations:
    """One of the paper's models at the N nodes of a problem and at S stations.

    Strains depend on tensions and E through their ratio alone, and analytically on the tensions.

    Attributes:
        problem: the nodes.
        s: arc coordinates of nodes and stations [m], (N + S,).
        tables: the arm at these.
    """

    def __init__(self, arm: Arm, problem: Problem, s: FloatArray, *, is_published: bool) -> None:
        """Of ``arm`` at the nodes of ``problem`` and at stations ``s`` (S,) [m].

        Where ``is_published`` of `renda2012`, else of `closed_form`.
        """
        self.problem, self.s = problem, np.concatenate([problem.elements.s, s])
        self.tables = tabulate_paper(arm, problem.elements, s, is_published=is_published)

    def solve(self, tensions: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Twists under ``tensions`` (A, J), or at every node and station (A, N + S, J) [N].

        (1 + q) (tau, xi, k) [1/m] and 1 + q [-] at nodes and stations first, (A, P, 4), and
        relative residuals and iterations, (A,). Complex tensions give derivatives as imaginary
        parts.

        Raises:
            ConvergenceError: if equation (10) was not solved.
        """
        is_real, moments = not np.iscomplexobj(tensions), self.tables.moments
        if tensions.ndim == 2:
            # Row by row, as BLAS rounds several together otherwise: an arm of a batch is then that
            # of a single solve.
            rows = tensions[:, np.newaxis] @ moments.reshape(len(moments), -1)
            sums = rows.reshape(len(tensions), *moments.shape[1:])
        else:
            sums = np.einsum('apj,jcp->acp', tensions, moments)
        form, tolerance = (self.problem.form, TOLERANCE) if is_real else (arrays, _OF_DERIVATIVES)
        twist, outcome = form.paper_twists(self.tables, sums, tolerance)
        residual, sweeps, stuck = outcome.T
        if self.tables.swept and stuck.max() >= 0.0:
            worst = int(stuck.argmax())
            section = self.problem.elements.sections[int(stuck[worst])]
            error = f'equation (10) in section {section}'
            raise ConvergenceError(error, float(residual[worst]), int(sweeps[worst]))
        return twist, residual, sweeps.astype(np.int64)


def tabulate_paper(
    arm: Arm, elements: Elements, s: FloatArray, *, is_published: bool
) -> PaperTables:
    """Tables of ``arm`` at the nodes of ``elements`` and stations ``s`` (S,) [m].

    With equation (10) between nodes where ``is_published``.
    """
    stations, nodes = places_at(elements, s), elements.s.size
    # Sections are numbered from the tip.
    section = np.append(elements.sections, 0)
    swept = int((section > 1).sum()) if is_published else 0
    jumps = np.flatnonzero(section[1 : swept + 1] < section[:swept])
    anchorage = np.full(elements.lengths.size, -1)
    anchorage[jumps] = nodes + s.size + 2 * np.arange(jumps.size)
    sides = np.column_stack([section[jumps], section[jumps + 1]]).ravel()
    places = np.concatenate([elements.s, s, np.repeat(elements.edges[jumps + 1], 2)])
    section = np.concatenate([elements.section, section[stations.element], sides])
    rule, stiffness = elements.rule, SectionStiffness.at(arm, places)
    return PaperTables(
        tendon_moments(arm, places, section),
        np.stack(stiffness[:4]),
        np.stack(stiffness[1:4]) * arm.rest.at(places),
        elements.lengths,
        np.concatenate([rule.to_end, rule.weights[np.newaxis]]),
        swept,
        anchorage,
        stations,
    )


def tendon_moments(arm: Arm, s: FloatArray, section: IntArray) -> FloatArray:
    """From tensions to their sums at ``s`` (P,) [m], each in its ``section`` (P,): (J, 7, P).

    In the section numbered i from the tip the tendons of sections 1 to i act.
    """
    (n, b), (slope_n, slope_b) = arm.tendon_offsets(s), arm.tendon_slopes(s)
    largest = float(np.hypot(n, b).max())
    mixed, torque = n * b, n * slope_b - b * slope_n
    # Not by rounding only: straight tendons along n and b do not twist the arm.
    mixed[np.abs(mixed) <= _ROUNDING * largest**2] = 0.0
    torque[np.abs(torque) <= _ROUNDING * largest] = 0.0
    found = np.stack([np.ones_like(n), n, b, n * n, b * b, mixed, torque], axis=1)
    found *= (arm.tendon_section[:, np.newaxis] <= section)[:, np.newaxis]
    return found


def check_is_papers(arm: Arm) -> None:
    """Check that the paper's equations cover ``arm``.

    Raises:
        ConfigError: if they do not; the message says what.
    """
    problem = ''
    if not isinstance(arm.body, Body):
        problem = 'a body whose radius is not linear in s (7)'
    elif arm.body.inner_radius != 0.0:
        problem = 'tubes, as its sections are full circles (3)'
    if arm.stiffness.profiles:
        problem = 'sections of given stiffness (3)'
    if not arm.rest.is_straight:
        problem = 'an arm that is bent at rest (3)'
    material = (arm.material.youngs_modulus, arm.material.poisson_ratio)
    if any(isinstance(value, Profile) for value in material):
        problem = 'a material that varies along s (3)'
    for number, section in enumerate(arm.sections, start=1):
        if not (isinstance(section, Section) and section.is_papers):
            problem = f'section {number}, whose tendons are not straight along n, b, -n, -b (5)'
    if arm.friction:
        problem = 'friction of the tendons'
    if problem:
        raise ConfigError(
            f"model is 'renda2012', which does not cover {problem}: choose exact or closed_form"
        )
