"""What the paper claims of its results: section 6, and section 3 of one cable."""

from __future__ import annotations

import itertools

import numpy as np

from octo_arm_model.config.paper_data import (
    BENDING,
    FETCHING_IN_PLANE,
    FETCHING_IN_SPACE,
    PROTOTYPE_ERRORS,
    Tensions,
)
from octo_arm_model.reproduce import cases
from octo_arm_model.reproduce.claims.claim import Finding, below, claim
from octo_arm_model.rod.backbone import Backbone

PLANES = tuple(sorted({*range(-150, 181, 30), *range(-135, 136, 90)}))  # [deg], of Figure 10
_PULL = 2.0  # [N], the largest amplitude of Table 3
_SAME_PLANE = 0.5  # [deg]: the paper prints whole degrees
_FLAT = 1e-6  # out of the plane, relative to the length: what the solver's own error may be


@claim(
    'By pulling one cable the robot arm bends on the side of the cable.',
    'section 3; the plane of motion: section 5.2',
    f'Each of the 12 cables of Table 2 alone, {_PULL:g} N. Holds if the arm is within '
    f'{_SAME_PLANE}° of the side of its cable and within a millionth of L of one plane.',
)
def one_cable(model: str) -> Finding:
    """Section 3."""
    aside, out = 0.0, 0.0
    for section, plane in itertools.product((1, 2, 3), (-90, 0, 90, 180)):
        shape = _bent(model, section, plane)
        aside = max(aside, cases.angle_between(cases.bending_plane(shape), plane))
        out = max(out, cases.out_of_plane(shape) / shape.s[-1])
    return Finding(
        f'{below(aside, 2)}° aside, {below(100 * out, 4)} % of L out of the plane',
        aside < _SAME_PLANE and out < _FLAT,
    )


@claim(
    'This ratio corresponds to the ratio between the sine and the cosine of the desired '
    'inclination of the bending plane.',
    'section 6.1, Figure 10',
    f'{len(PLANES)} planes all around, {_PULL:g} N, against atan2(T13 − T11, '
    'T12 − T14), which is the paper’s arctangent with its quadrant. Holds if all are within '
    f'{_SAME_PLANE}°.',
)
def plane_law(model: str) -> Finding:
    """Section 6.1."""
    return _worst_plane(model, (1,))


@claim(
    'Three different planes of bending: (A) 135°; (B) −30°; (C) 60°.',
    'Figure 11, Table 3',
    f'Holds if each is within {_SAME_PLANE}°.',
)
def captions(model: str) -> Finding:
    """Figure 11."""
    planes = [
        cases.bending_plane(cases.solve('table2', model, tensions))
        for tensions in BENDING.values()
    ]
    return Finding(
        ', '.join(f'{plane:.2f}°' for plane in planes),
        all(
            cases.angle_between(plane, cases.law(tensions)) < _SAME_PLANE
            for plane, tensions in zip(planes, BENDING.values(), strict=True)
        ),
    )


@claim(
    'The bending can start arbitrarily from any anchorage cross section maintaining the same '
    'characteristic.',
    'section 6.1',
    f'As Figure 10, by the cables of section 2 and of section 3. Holds if all are within '
    f'{_SAME_PLANE}°.',
)
def any_anchorage(model: str) -> Finding:
    """Section 6.1."""
    return _worst_plane(model, (2, 3))


@claim(
    'Increasing the absolute value of the tension leads to a higher curvature along the arm.',
    'section 6.1',
    'The prototype, from each tension of Table 1 to the next. Holds if the curvature rises '
    'at every station.',
)
def more_tension(model: str) -> Finding:
    """Section 6.1."""
    curvatures = [
        cases.solve('prototype', model, cases.pull(1, (tension, 0.0, 0.0, 0.0), 1)).k
        for tension in PROTOTYPE_ERRORS
    ]
    least = min(float((b / a).min()) for a, b in itertools.pairwise(curvatures))
    return Finding(f'by {100 * (least - 1):.0f} % or more everywhere', least > 1.0)


@claim(
    'This movement composed of three bends: proximal, medial and distal. The first fetching '
    'movement lies in one plane.',
    'section 6.2, Figure 14',
    'What sections 3, 2 and 1 turn by. Holds if each turns the other way than the one before, '
    'and all lie within a millionth of L of one plane.',
)
def fetching_in_plane(model: str) -> Finding:
    """Section 6.2."""
    shape = cases.solve('table4', model, FETCHING_IN_PLANE)
    out = cases.out_of_plane(shape) / shape.s[-1]
    proximal, medial, distal = cases.turns(shape).values()
    return Finding(
        f'turns by {proximal:+.0f}°, {medial:+.0f}°, {distal:+.0f}°; '
        f'{below(100 * out, 4)} % of L out of the plane',
        proximal * medial < 0.0 and medial * distal < 0.0 and out < _FLAT,
    )


@claim(
    'The distal tendons can prevent the action of the more proximal ones if they are pulled '
    'in opposite directions.',
    'section 6.2',
    'What section 3 turns by under all tensions of Figure 14 and under T33 alone. Holds if '
    'it is less.',
)
def opposite(model: str) -> Finding:
    """Section 6.2."""
    alone = (*((0.0,) * 4,) * 2, FETCHING_IN_PLANE[2])
    together, by_itself = (
        abs(cases.turns(cases.solve('table4', model, tensions))[3])
        for tensions in (FETCHING_IN_PLANE, alone)
    )
    return Finding(f'{together:.0f}° instead of {by_itself:.0f}°', together < by_itself)


@claim(
    'A three-dimensional fetching is more efficient; in fact with the same actuator strength '
    'the distal part of the arm is closer to the base.',
    'section 6.2, Figures 14 and 15',
    f'Distance from the base; the tensions add up to {np.sum(FETCHING_IN_PLANE):g} and '
    f'{np.sum(FETCHING_IN_SPACE):g} N. Holds if tip and section 1 are nearer in space.',
)
def nearer_in_space(model: str) -> Finding:
    """Section 6.2."""
    (plane, plane_mean), (space, space_mean) = (
        _distances(model, tensions) for tensions in (FETCHING_IN_PLANE, FETCHING_IN_SPACE)
    )
    return Finding(
        f'tip {space:.0f} mm in space, {plane:.0f} mm in the plane; mean of section 1 '
        f'{space_mean:.0f} and {plane_mean:.0f} mm',
        space < plane and space_mean < plane_mean,
    )


def _bent(model: str, section: int, plane: float) -> Backbone:
    t1, t2, t3, t4 = (_PULL * tension for tension in cases.pair(plane))
    return cases.solve('table2', model, cases.pull(section, (t1, t2, t3, t4), 3))


def _worst_plane(model: str, sections: tuple[int, ...]) -> Finding:
    worst = max(
        cases.angle_between(cases.bending_plane(_bent(model, section, plane)), plane)
        for section, plane in itertools.product(sections, PLANES)
    )
    return Finding(f'{below(worst, 2)}° off at most', worst < _SAME_PLANE)


def _distances(model: str, tensions: Tensions) -> tuple[float, float]:
    """Distances from the base of the tip, and of section 1 on average [mm]."""
    shape = cases.solve('table4', model, tensions)
    distal = shape.position[shape.section == 1] - shape.position[0]
    mean = np.linalg.norm(distal, axis=1).mean()
    return cases.tip_distance(shape) * 1e3, float(mean) * 1e3
