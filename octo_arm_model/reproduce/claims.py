"""Claims of the paper's text, and whether the numbers of each model agree with them."""

from __future__ import annotations

import dataclasses
import itertools
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from octo_arm_model.arm.loads import Loads
from octo_arm_model.config.paper_data import (
    BENDING,
    FETCHING_IN_PLANE,
    FETCHING_IN_SPACE,
    PROTOTYPE_AVERAGE_ERROR,
    PROTOTYPE_ERRORS,
    PROTOTYPE_IN_FIGURE_9,
    Tensions,
)
from octo_arm_model.reproduce import cases
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.interpolation import nearest
from octo_arm_model.rod.solver import DEFAULT_MODEL, MODELS


@dataclass(frozen=True)
class Finding:
    """The numbers of a model on a claim.

    Attributes:
        value: the numbers, as text.
        holds: whether they agree with the claim; None where that cannot be judged.
    """

    value: str
    holds: bool | None = None


@dataclass(frozen=True)
class Claim:
    """A claim of the paper's text.

    Attributes:
        says: the paper's words.
        where: where in the paper they are.
        check: what was computed, and when the claim holds; or why it cannot be checked.
        findings: by model; empty where it cannot be checked.
        is_of_machine: whether the numbers depend on the machine, as times do.
    """

    says: str
    where: str
    check: str
    findings: Mapping[str, Finding] = field(default_factory=dict)
    is_of_machine: bool = False

    @property
    def fails(self) -> bool:
        """Whether the paper's own model contradicts it; false for what depends on the machine."""
        finding = self.findings.get(DEFAULT_MODEL)
        return finding is not None and finding.holds is False and not self.is_of_machine


def count(claims: Sequence[Claim], model: str) -> tuple[int, int]:
    """How many claims hold for ``model``, and how many could be judged."""
    verdicts = [claim.findings[model].holds for claim in claims if model in claim.findings]
    return verdicts.count(True), len(verdicts) - verdicts.count(None)


def of_models(judge: Callable[[str], Finding]) -> dict[str, Finding]:
    """Findings of all models, by model."""
    return {model: judge(model) for model in MODELS}


def claim(
    says: str, where: str, check: str
) -> Callable[[Callable[[str], Finding]], Callable[[], Claim]]:
    """Make a claim of a function that judges one model; it is called when the claim is made."""

    def of(judge: Callable[[str], Finding]) -> Callable[[], Claim]:
        return lambda: Claim(says, where, check, of_models(judge))

    return of


def below(value: float, digits: int) -> str:
    """``value`` to ``digits`` decimals, or that it is less than the last of them."""
    least = 10.0**-digits
    return f'{value:.{digits}f}' if value >= least / 2.0 else f'less than {least:.{digits}f}'


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


_SOFTER = 0.05  # of E
_LOOP = 0.01  # [s]
_REPEATS = 200


@claim(
    'The manipulator can be bent and twisted ‘arbitrarily’ in 3D space by pulling several '
    'cables anchored at different distances from the base.',
    'section 3',
    'The tensions of Figure 15. Holds if the arm is more than 1 % of L off the plane that '
    'fits it best. The twist is that of the cross sections, the integral of τ: straight '
    'cables give none, and what renda2012 has comes from its jump (11).',
)
def in_space(model: str) -> Finding:
    """Section 3."""
    shape = cases.solve('table4', model, FETCHING_IN_SPACE)
    out = cases.out_of_plane(shape) / shape.s[-1]
    return Finding(
        f'{100 * out:.0f} % of L off the best plane, twist of '
        f'{below(abs(cases.tip_rotation(shape)), 2)}°',
        out > 0.01,
    )


def weight() -> Claim:
    """Section 4."""
    config = cases.config('prototype')
    tensions = cases.pull(1, (PROTOTYPE_IN_FIGURE_9, 0.0, 0.0, 0.0), 1)
    # Normal to the plane of motion; the camera looked down on it.
    loads = Loads(gravity=(0.0, 0.0, -9.81))

    def sag(difference: float) -> float:
        # In water: weight less buoyancy, by the difference of the densities.
        arm = config.arm.with_density(difference)
        of_arm = dataclasses.replace(config, arm=arm)
        loaded = dataclasses.replace(of_arm, loads=loads).solver('exact').solve(tensions)
        free = of_arm.solver('exact').solve(tensions)
        return 100.0 * float(np.linalg.norm(loaded.tip - free.tip)) / arm.length

    return Claim(
        'The buoyancy and gravity are almost complementary, as the density of silicone is very '
        'close to the density of water.',
        'section 4',
        'The paper prints no density, so this cannot be judged. What the exact model says to it: '
        'how far weight less buoyancy moves the tip of the prototype at '
        f'{PROTOTYPE_IN_FIGURE_9:g} N, across its plane of motion, if the silicone is heavier '
        'than the water by 1, 10 and 80 kg/m³.',
        {
            **{model: Finding('has no weight') for model in MODELS if model != 'exact'},
            'exact': Finding(
                ', '.join(f'{sag(difference):.2g} %' for difference in (1.0, 10.0, 80.0)) + ' of L'
            ),
        },
    )


@claim(
    'The behaviour of N(s) and M(s) has a point of discontinuity for every value of s '
    'corresponding to an anchorage cross section.',
    'section 4',
    'Steps of q between neighbours of 401 stations, tensions of Figure 14. Holds if those at '
    'the anchorages are ten times all others. (Figure 12 shows none: only cables that end '
    'at the tip are pulled there.)',
)
def jumps(model: str) -> Finding:
    """Section 4."""
    shape = cases.solve('table4', model, FETCHING_IN_PLANE)
    steps = np.abs(np.diff(shape.q))
    at = cases.anchorages(shape)[:-1]
    elsewhere = float(np.delete(steps, at).max())
    return Finding(
        'q steps by ' + ' and '.join(f'{steps[i]:.3f}' for i in at) + f', elsewhere by '
        f'{elsewhere:.3f} at most',
        bool(steps[at].min() > 10.0 * elsewhere),
    )


def finite_elements() -> Claim:
    """Section 5.1."""
    return Claim(
        'An almost perfect correlation has been obtained with a maximum error detected on the '
        'tip equal to 1 mm.',
        'section 5.1, Figure 8',
        'Cannot be checked: neither the output of the finite elements nor their tensions are '
        'printed.',
    )


def measured() -> Claim:
    """Section 5.2."""
    mean = sum(PROTOTYPE_ERRORS.values()) / len(PROTOTYPE_ERRORS)
    return Claim(
        'The average error measured at the tip is less than 6% of the arm length L.',
        'section 5.2, Table 1',
        'Cannot be checked: the midlines taken from the pictures were not published. The mean of '
        f'the errors printed is {mean:.2f} %; below them {PROTOTYPE_AVERAGE_ERROR} % is printed.',
    )


@claim(
    'The error generally is higher on the distal part of the manipulator: a small error on '
    'the base results in a big error on the tip because it is integrated along the arm.',
    'section 5.2',
    f'The prototype at {PROTOTYPE_IN_FIGURE_9:g} N, moved by taking E {100 * _SOFTER:g} % '
    'lower. Holds if it moves more the further it is from the base.',
)
def errors_grow(model: str) -> Finding:
    """Section 5.2."""
    config = cases.config('prototype')
    tensions = cases.pull(1, (PROTOTYPE_IN_FIGURE_9, 0.0, 0.0, 0.0), 1)
    material = config.arm.material
    assert isinstance(material.youngs_modulus, float)
    softer = dataclasses.replace(
        material, youngs_modulus=(1.0 - _SOFTER) * material.youngs_modulus
    )
    arm = dataclasses.replace(config.arm, material=softer)
    shape = cases.solve('prototype', model, tensions)
    solver = dataclasses.replace(config, arm=arm).solver(model, cases.STATIONS)
    off = solver.solve(tensions).position
    error = np.linalg.norm(off - shape.position, axis=1) * 1e3
    quarters = error[nearest(np.array([0.25, 0.5]) * shape.s[-1], shape.s)]
    return Finding(
        f'{quarters[0]:.1f} mm at L/4, {quarters[1]:.1f} at L/2, {error[-1]:.1f} at the tip',
        bool((np.diff(error) > 0.0).all()),
    )


@claim(
    'A robot arm such as that described in this paper is able to modulate its flexional '
    'stiffness just by properly actuating antagonistic tendons.',
    'section 7',
    'The prototype’s curvature under 0.1 N more in T11 than in T13, with 2 N in both against '
    'none. Holds if it is lower at every station.',
)
def antagonists(model: str) -> Finding:
    """Section 7."""
    free, held = (
        cases.solve('prototype', model, cases.pull(1, (both + 0.1, 0.0, both, 0.0), 1)).k
        for both in (0.0, 2.0)
    )
    lower = 100.0 * (1.0 - held / free)
    return Finding(
        f'curvature lower by {lower.min():.0f} to {lower.max():.0f} %', bool(lower.min() > 0.0)
    )


def fast_enough() -> Claim:
    """Sections 1 and 7."""

    def judge(model: str) -> Finding:
        ready = cases.config('table4').solver(model)
        times = []
        for _ in range(_REPEATS):
            began = time.perf_counter()
            ready.solve(FETCHING_IN_SPACE)
            times.append(time.perf_counter() - began)
        median = float(np.median(times))
        return Finding(f'{median * 1e3:.2f} ms, {1.0 / median:.0f} a second', median < _LOOP)

    return Claim(
        'The developed continuum approach is fast enough to be implemented in the embedded '
        'control of the manipulator.',
        'sections 1 and 7',
        f'One shape of Figure 15 at {cases.config("table4").stations} stations, median of '
        f'{_REPEATS}, measured on the machine that made this page ({platform.system()}, '
        f'{platform.machine()}, Python {platform.python_version()}). The paper names no rate; '
        f'here a loop of {1.0 / _LOOP:.0f} Hz is asked for.',
        of_models(judge),
        is_of_machine=True,
    )


CLAIMS: tuple[Callable[[], Claim], ...] = (
    one_cable,
    in_space,
    weight,
    jumps,
    finite_elements,
    measured,
    errors_grow,
    plane_law,
    captions,
    any_anchorage,
    more_tension,
    fetching_in_plane,
    opposite,
    nearer_in_space,
    antagonists,
    fast_enough,
)
