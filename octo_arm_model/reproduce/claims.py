"""Claims of the paper's text, compared with the numbers of each model."""

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from octo_arm_model.config import paper_data
from octo_arm_model.reproduce import tables
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import DEFAULT_MODEL, MODELS
from octo_arm_model.rod.stations import nearest

PLANES = tuple(sorted({*range(-150, 181, 30), *range(-135, 136, 90)}))  # of Figure 10 [deg]
_PULL = 2.0  # largest amplitude of Table 3 [N]
_SAME_PLANE = 0.5  # tolerance of planes [deg], as the paper prints whole degrees
_FLAT = 1e-6  # distance from a plane over the length, up to the error of the solver
_SOFTER = 0.05  # relative decrease of E

Finding = tuple[str, bool]  # the numbers of a model, and whether they agree with the claim


@dataclass(frozen=True)
class Claim:
    """A claim of the paper's text."""

    says: str  #: the paper's words
    where: str  #: their place in the paper
    check: str  #: description of the computation, and of when the claim holds
    judge: Callable[[str], Finding]  #: returns the finding of a model

    @functools.cached_property
    def findings(self) -> dict[str, Finding]:
        """The findings of all models, by name of the model."""
        return {model: self.judge(model) for model in MODELS}

    @property
    def fails(self) -> bool:
        """Whether the paper's own model contradicts the claim."""
        return not self.findings[DEFAULT_MODEL][1]


CLAIMS: list[Claim] = []  # in the order of the paper


def _claim(says: str, where: str, check: str) -> Callable[[Callable[[str], Finding]], None]:
    """Return a decorator that adds a claim, which the decorated function judges."""
    return lambda judge: CLAIMS.append(Claim(says, where, check, judge))


def _below(value: float, digits: int) -> str:
    """Return ``value`` with ``digits`` decimals, or a text that it is below the last of them."""
    unit = 10.0**-digits
    return f'{value:.{digits}f}' if value >= unit / 2.0 else f'less than {unit:.{digits}f}'


def _bent(model: str, section: int, plane: float) -> Backbone:
    t1, t2, t3, t4 = (_PULL * tension for tension in tables.pair(plane))
    return tables.solve('table2', model, tables.pull(section, (t1, t2, t3, t4), 3))


def _worst_plane(model: str, sections: tuple[int, ...]) -> Finding:
    worst = max(
        tables.angle_between(tables.bending_plane(_bent(model, section, plane)), plane)
        for section, plane in itertools.product(sections, PLANES)
    )
    return (f'{_below(worst, 2)}° off at most', worst < _SAME_PLANE)


@_claim(
    'By pulling one cable the robot arm bends on the side of the cable.',
    'section 3; the plane of motion: section 5.2',
    f'Each of the 12 cables of Table 2 alone, {_PULL:g} N. Holds if the arm is within '
    f'{_SAME_PLANE}° of the side of its cable and within a millionth of L of one plane.',
)
def _one_cable(model: str) -> Finding:
    off_side, off_plane = 0.0, 0.0
    for section, plane in itertools.product((1, 2, 3), (-90, 0, 90, 180)):
        shape = _bent(model, section, plane)
        off_side = max(off_side, tables.angle_between(tables.bending_plane(shape), plane))
        off_plane = max(off_plane, tables.out_of_plane(shape) / shape.s[-1])
    return (
        f'{_below(off_side, 2)}° aside, {_below(100 * off_plane, 4)} % of L out of the plane',
        off_side < _SAME_PLANE and off_plane < _FLAT,
    )


@_claim(
    'The manipulator can be bent and twisted ‘arbitrarily’ in 3D space by pulling several '
    'cables anchored at different distances from the base.',
    'section 3',
    'The tensions of Figure 15. Holds if the arm is more than 1 % of L off the plane that '
    'fits it best. The twist is that of the cross sections, the integral of τ: straight '
    'cables give none, and what renda2012 has comes from its jump (11).',
)
def _in_space(model: str) -> Finding:
    shape = tables.solve('table4', model, paper_data.FETCHING_IN_SPACE)
    off_plane = tables.out_of_plane(shape) / shape.s[-1]
    return (
        f'{100 * off_plane:.0f} % of L off the best plane, twist of '
        f'{_below(abs(tables.tip_rotation(shape)), 2)}°',
        off_plane > 0.01,
    )


@_claim(
    'The behaviour of N(s) and M(s) has a point of discontinuity for every value of s '
    'corresponding to an anchorage cross section.',
    'section 4',
    'Steps of q between neighbours of 401 stations, tensions of Figure 14. Holds if those at '
    'the anchorages are ten times all others. (Figure 12 shows none: only cables that end '
    'at the tip are pulled there.)',
)
def _jumps(model: str) -> Finding:
    shape = tables.solve('table4', model, paper_data.FETCHING_IN_PLANE)
    steps = np.abs(np.diff(shape.q))
    at_anchorages = tables.anchorages(shape)[:-1]
    elsewhere = float(np.delete(steps, at_anchorages).max())
    return (
        'q steps by ' + ' and '.join(f'{steps[i]:.3f}' for i in at_anchorages) + f', elsewhere by '
        f'{elsewhere:.3f} at most',
        bool(steps[at_anchorages].min() > 10.0 * elsewhere),
    )


@_claim(
    'The error generally is higher on the distal part of the manipulator: a small error on '
    'the base results in a big error on the tip because it is integrated along the arm.',
    'section 5.2',
    f'The prototype at {paper_data.PROTOTYPE_IN_FIGURE_9:g} N, moved by taking E '
    f'{100 * _SOFTER:g} % lower. Holds if it moves more the further it is from the base.',
)
def _errors_grow(model: str) -> Finding:
    # Shapes depend on tensions over E alone.
    tension = paper_data.PROTOTYPE_IN_FIGURE_9
    shape, softer = (
        tables.solve('prototype', model, tables.one_cable(pull))
        for pull in (tension, tension / (1.0 - _SOFTER))
    )
    error = np.linalg.norm(softer.position - shape.position, axis=1) * 1e3
    quarters = error[nearest(np.array([0.25, 0.5]) * shape.s[-1], shape.s)]
    return (
        f'{quarters[0]:.1f} mm at L/4, {quarters[1]:.1f} at L/2, {error[-1]:.1f} at the tip',
        bool((np.diff(error) > 0.0).all()),
    )


_claim(
    'This ratio corresponds to the ratio between the sine and the cosine of the desired '
    'inclination of the bending plane.',
    'section 6.1, Figure 10',
    f'{len(PLANES)} planes all around, {_PULL:g} N, against atan2(T13 − T11, '
    'T12 − T14), which is the paper’s arctangent with its quadrant. Holds if all are within '
    f'{_SAME_PLANE}°.',
)(functools.partial(_worst_plane, sections=(1,)))


@_claim(
    'Three different planes of bending: (A) 135°; (B) −30°; (C) 60°.',
    'Figure 11, Table 3',
    f'Holds if each is within {_SAME_PLANE}°.',
)
def _captions(model: str) -> Finding:
    planes = [
        tables.bending_plane(tables.solve('table2', model, tensions))
        for tensions in paper_data.BENDING.values()
    ]
    return (
        ', '.join(f'{plane:.2f}°' for plane in planes),
        all(
            tables.angle_between(plane, tables.law(tensions)) < _SAME_PLANE
            for plane, tensions in zip(planes, paper_data.BENDING.values(), strict=True)
        ),
    )


_claim(
    'The bending can start arbitrarily from any anchorage cross section maintaining the same '
    'characteristic.',
    'section 6.1',
    f'As Figure 10, by the cables of section 2 and of section 3. Holds if all are within '
    f'{_SAME_PLANE}°.',
)(functools.partial(_worst_plane, sections=(2, 3)))


@_claim(
    'Increasing the absolute value of the tension leads to a higher curvature along the arm.',
    'section 6.1',
    'The prototype, from each tension of Table 1 to the next. Holds if the curvature rises '
    'at every station.',
)
def _more_tension(model: str) -> Finding:
    curvatures = [
        tables.solve('prototype', model, tables.one_cable(tension)).k
        for tension in paper_data.PROTOTYPE_ERRORS
    ]
    ratio = min(float((b / a).min()) for a, b in itertools.pairwise(curvatures))
    return (f'by {100 * (ratio - 1):.0f} % or more everywhere', ratio > 1.0)


@_claim(
    'This movement composed of three bends: proximal, medial and distal. The first fetching '
    'movement lies in one plane.',
    'section 6.2, Figure 14',
    'What sections 3, 2 and 1 turn by. Holds if each turns the other way than the one before, '
    'and all lie within a millionth of L of one plane.',
)
def _fetching_in_plane(model: str) -> Finding:
    shape = tables.solve('table4', model, paper_data.FETCHING_IN_PLANE)
    off_plane = tables.out_of_plane(shape) / shape.s[-1]
    proximal, medial, distal = tables.turns(shape).values()
    return (
        f'turns by {proximal:+.0f}°, {medial:+.0f}°, {distal:+.0f}°; '
        f'{_below(100 * off_plane, 4)} % of L out of the plane',
        proximal * medial < 0.0 and medial * distal < 0.0 and off_plane < _FLAT,
    )


@_claim(
    'The distal tendons can prevent the action of the more proximal ones if they are pulled '
    'in opposite directions.',
    'section 6.2',
    'What section 3 turns by under all tensions of Figure 14 and under T33 alone. Holds if '
    'it is less.',
)
def _opposite(model: str) -> Finding:
    alone = (*((0.0,) * 4,) * 2, paper_data.FETCHING_IN_PLANE[2])
    together, by_itself = (
        abs(tables.turns(tables.solve('table4', model, tensions))[3])
        for tensions in (paper_data.FETCHING_IN_PLANE, alone)
    )
    return (f'{together:.0f}° instead of {by_itself:.0f}°', together < by_itself)


@_claim(
    'A three-dimensional fetching is more efficient; in fact with the same actuator strength '
    'the distal part of the arm is closer to the base.',
    'section 6.2, Figures 14 and 15',
    f'Distance from the base; the tensions add up to {np.sum(paper_data.FETCHING_IN_PLANE):g} and '
    f'{np.sum(paper_data.FETCHING_IN_SPACE):g} N. Holds if tip and section 1 are nearer in space.',
)
def _nearer_in_space(model: str) -> Finding:
    distances = []
    for tensions in (paper_data.FETCHING_IN_PLANE, paper_data.FETCHING_IN_SPACE):
        shape = tables.solve('table4', model, tensions)
        distal = shape.position[shape.section == 1] - shape.position[0]
        mean = float(np.linalg.norm(distal, axis=1).mean())
        distances.append((1e3 * tables.tip_distance(shape), 1e3 * mean))
    (plane, plane_mean), (space, space_mean) = distances
    return (
        f'tip {space:.0f} mm in space, {plane:.0f} mm in the plane; mean of section 1 '
        f'{space_mean:.0f} and {plane_mean:.0f} mm',
        space < plane and space_mean < plane_mean,
    )


@_claim(
    'A robot arm such as that described in this paper is able to modulate its flexional '
    'stiffness just by properly actuating antagonistic tendons.',
    'section 7',
    'The prototype’s curvature under 0.1 N more in T11 than in T13, with 2 N in both against '
    'none. Holds if it is lower at every station.',
)
def _antagonists(model: str) -> Finding:
    free, stiff = (
        tables.solve('prototype', model, tables.pull(1, (both + 0.1, 0.0, both, 0.0), 1)).k
        for both in (0.0, 2.0)
    )
    lower = 100.0 * (1.0 - stiff / free)
    return (
        f'curvature lower by {lower.min():.0f} to {lower.max():.0f} %',
        bool(lower.min() > 0.0),
    )
