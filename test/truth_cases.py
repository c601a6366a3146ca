"""Shapes, derivatives and refusals that are known, to hold a solver to: `truth/truth.json.gz`.

Every case is an arm as parameters, what is done to it step by step, and what comes out at given
arc coordinates, each quantity with its error. They are frozen: the core of commit dfd4d63a, which
others have replaced since, made them by `test/truth/make_truth.py` (last in commit d0bcf8b8). It
put ends of elements at L / 24 and L / 48 and took 4 and 8 times as many stations: a value is that
of the finest run, its error the distance of the two. Of several equilibria those were kept that
are found alike from nothing, along loads that grow, and by both forms of the node functions. Four
errors were raised by hand: of by_tension of random_13_metal/25, of strain and tension of
random_17_thin/29 and of tension of random_19_stout/31, which later cores give alike at accuracies
of 1e-8 to 1e-12.

Nothing here uses more of the package than its parameters and its public names.
"""

import functools
import gzip
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model import (
    Backbone,
    Config,
    OctoArmError,
    Sensitivity,
    Solver,
    Uncertainty,
    Wound,
    displacements_of,
    solve_displacements,
    wound_sensitivity,
)

FILE = Path(__file__).parent / 'truth' / 'truth.json.gz'
Answer = dict[str, np.ndarray]

# Largest distance from the truth that counts as none: of places in parts of the length, of angles
# [rad], of strains in parts of the largest and of 1 / length (curvatures) or 1, of tensions in
# parts of the largest. Of derivatives and covariances in parts of the largest of their block.
SHAPE, STRAIN, TENSION, DERIVATIVE = 1e-6, 1e-5, 1e-6, 1e-4
# Derivatives of the tip: rows of its position and of its rotation vector are blocks of their own.
_DERIVATIVES = ('by_tension', 'by_youngs_modulus', 'by_poisson_ratio', 'by_offset',
                'by_sheath_stiffness', 'by_friction', 'by_displacement')  # fmt: skip
# Of a quantity that does not matter, as nu without torsion, derivatives are rounding: so much of
# the length and of a radian per unit counts as zero.
_NOTHING = {'by_youngs_modulus': 1e-3, 'by_poisson_ratio': 1e-3, 'by_friction': 1e-3}


@dataclass(frozen=True)
class Case:
    """An arm, what is done to it, and what is right.

    Attributes:
        name: of the case.
        kind: what it is about.
        parameters: of the arm, by their dotted names, as `Config.from_parameters` takes them.
        steps: what is done, one after the other, see `Case.solve`.
        s: arc coordinates of the values along the arm [m]; each is a station.
        expected: right values of the last step.
        error: that these may have, largest over the values of a quantity.
        today: how far the solver that made the file (before the rewrite) is from them, where that
            is more than is tolerated.
        refused: name of the exception, and a text in its message, where there is no answer.
        fault: what that solver does wrong; empty where it does not.
    """

    name: str
    kind: str
    parameters: Mapping[str, Any]
    steps: tuple[Mapping[str, Any], ...]
    s: np.ndarray
    expected: Answer
    error: Mapping[str, float]
    today: Mapping[str, float]
    refused: tuple[str, str] | None
    fault: str

    @property
    def config(self) -> Config:
        """The arm."""
        return Config.from_parameters(self.parameters)

    def build(self, compiled: bool | None = None) -> Solver:
        """A new solver of the arm."""
        return self.config.solver(compiled=compiled)

    def solve(self, solver: Solver) -> Answer:
        """What ``solver`` says of the last of the `steps`, of the quantities in `expected`."""
        return answer_of(solver, self.config.uncertainty, self.steps, self.s, self.expected)

    def tolerance(self, quantity: str) -> np.ndarray:
        """Largest distance of each value of a ``quantity`` from the one expected."""
        allowed = tolerance(quantity, self.expected[quantity], self.config.arm.length)
        return np.maximum(allowed, self.error.get(quantity, 0.0))


def read_cases() -> tuple[Case, ...]:
    """All cases."""
    return _read()


@functools.cache
def _read() -> tuple[Case, ...]:
    with gzip.open(FILE, 'rt', encoding='utf-8') as file:
        content = json.load(file)
    return tuple(_cases(content))


def _cases(content: Mapping[str, Any]) -> Iterator[Case]:
    for case in content['cases']:
        expected = {
            name: np.array(values, dtype=float)
            for name, values in case.get('expected', {}).items()
        }
        refused = case.get('refused')
        yield Case(
            case['name'], case['kind'],
            {
                name: value
                for name, value in (content['arms'].get(case['arm'], {}) | case['changes']).items()
                if value is not None  # which takes a parameter out
            },
            tuple(case['steps']), np.array(case.get('s', [])), expected,
            case.get('error', {}), case.get('today', {}),
            None if refused is None else (refused[0], refused[1]), case.get('fault', ''),
        )  # fmt: skip


# What is solved ---------------------------------------------------------------------------------


def answer_of(
    solver: Solver,
    uncertainty: Uncertainty,
    steps: tuple[Mapping[str, Any], ...],
    s: np.ndarray,
    quantities: Any,
) -> Answer:
    """Values of the ``quantities`` at ``s`` after the last of the ``steps``.

    A step has 'tensions' and perhaps a 'tip_wrench', and is solved from the unloaded arm, or
    follows the last one where 'follow' is true, or has it as a start where 'start' is true. One
    with 'displacements' by tendon has 'tensions' by tendon, and starts from the last one if any.
    'tips' are the tips of all steps.
    """
    last: Backbone | Wound | None = None
    tips = []
    for step in steps:
        last = _take(solver, step, last)
        tips.append((last.backbone if isinstance(last, Wound) else last).tip)
    assert last is not None
    found = _Found(solver, uncertainty, last, s, np.array(tips))
    return {name: np.array(found.value(name)) for name in quantities}


def _take(solver: Solver, step: Mapping[str, Any], last: Any) -> Backbone | Wound:
    wrench = step.get('tip_wrench')
    if 'displacements' in step:
        given = step['displacements'], step.get('tensions')
        return solve_displacements(solver, *given, start=last, tip_wrench=wrench)
    if step.get('follow'):
        return solver.follow(step['tensions'], last, wrench)
    return solver.solve(step['tensions'], wrench, start=last if step.get('start') else None)


class _Found:
    """Quantities of one solution, computed where they are asked for."""

    def __init__(
        self, solver: Solver, uncertainty: Uncertainty, last: Backbone | Wound, s: np.ndarray,
        tips: np.ndarray,
    ) -> None:  # fmt: skip
        self.solver, self.uncertainty, self.tips = solver, uncertainty, tips
        self.wound = last if isinstance(last, Wound) else None
        self.backbone = last.backbone if isinstance(last, Wound) else last
        self.at = stations_at(self.backbone, s)

    @functools.cached_property
    def sensitivity(self) -> Sensitivity:
        if self.wound is not None:
            return self.of_winches.held
        return self.solver.sensitivity(self.backbone)

    @functools.cached_property
    def of_winches(self) -> Any:
        assert self.wound is not None
        return wound_sensitivity(self.solver, self.wound)

    def value(self, name: str) -> Any:
        of_shape: dict[str, Callable[[Backbone], Any]] = {
            'position': lambda shape: shape.position[self.at],
            'quaternion': lambda shape: upright(shape.quaternion[self.at]),
            'strain': lambda shape: np.stack(
                [shape.tau[self.at], shape.xi[self.at], shape.k[self.at], shape.q[self.at]], -1
            ),
            'tension': lambda shape: shape.tendon_tensions[self.at],
            'base_tension': lambda shape: shape.tensions.ravel(),
            'length': lambda shape: self.solver.tendon_lengths(shape).ravel(),
            'displacement': lambda shape: displacements_of(self.solver, shape).ravel(),
            'tips': lambda _: self.tips,
        }
        if name in of_shape:
            return of_shape[name](self.backbone)
        if name == 'compliance':
            return self.sensitivity.compliance
        if name == 'by_displacement':
            return self.of_winches.by_displacement.tip
        if name == 'covariance':
            if self.wound is not None:
                return self.of_winches.tip_covariance(self.uncertainty)
            return self.solver.tip_covariance(self.backbone, self.uncertainty)
        if name == 'length_by_tension':
            return self.sensitivity.by_tension.tendon_length
        change = getattr(self.sensitivity, name)
        return None if change is None else change.tip


def stations_at(backbone: Backbone, s: np.ndarray) -> np.ndarray:
    """Numbers of the stations of ``backbone`` at ``s`` (n,) [m]."""
    near = np.abs(backbone.s - np.reshape(s, (-1, 1)))
    missing = near.min(axis=1) > 1e-9 * backbone.s[-1]
    assert not missing.any(), f'no station at s = {np.asarray(s)[missing]}'
    return near.argmin(axis=1)


def upright(quaternion: np.ndarray) -> np.ndarray:
    """The one of a ``quaternion`` (..., 4) and its negative whose largest number is positive."""
    largest = np.abs(quaternion).argmax(axis=-1)[..., np.newaxis]
    return quaternion * np.sign(np.take_along_axis(quaternion, largest, axis=-1))


# What is compared -------------------------------------------------------------------------------


def distance(quantity: str, found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """How far each value ``found`` is from the one ``expected``."""
    if quantity == 'quaternion':  # The sign of one is free.
        flip = np.sign((found * expected).sum(axis=-1, keepdims=True))
        return np.abs(flip * found - expected)
    return np.abs(found - expected)


def tolerance(quantity: str, expected: np.ndarray, length: float) -> np.ndarray:
    """Distance of each value from the one ``expected`` that counts as none."""
    ones = np.ones(expected.shape)
    if quantity in ('position', 'tips', 'length', 'displacement'):
        return SHAPE * length * ones
    if quantity == 'quaternion':
        return 2.0 * SHAPE * ones
    if quantity == 'strain':
        curvature = max(float(np.abs(expected[..., :3]).max()), 1.0 / length)
        return STRAIN * np.array([curvature, curvature, curvature, 1.0]) * ones
    if quantity in ('tension', 'base_tension'):
        return TENSION * np.abs(expected).max() * ones
    if quantity == 'length_by_tension':
        return DERIVATIVE * np.abs(expected).max() * ones
    assert quantity in (*_DERIVATIVES, 'compliance', 'covariance'), quantity
    size = np.abs(expected)
    nothing = _NOTHING.get(quantity, 0.0)
    blocks = (slice(0, 3), slice(3, 6))
    if quantity in ('compliance', 'covariance'):
        for rows in blocks:
            for columns in blocks:
                ones[rows, columns] = size[rows, columns].max()
    else:
        ones[:3] = max(size[:3].max(), nothing * length)
        ones[3:] = max(size[3:].max(), nothing)
    return DERIVATIVE * ones


def refusal_of(case: Case, compiled: bool | None = None) -> OctoArmError | None:
    """The error of a ``case`` that is to be refused; None where it is solved."""
    try:
        case.solve(case.build(compiled))
    except OctoArmError as error:
        return error
    return None
