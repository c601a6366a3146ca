"""Measure how often intervals of ``octo-arm identify`` contain the truth, by simulation.

    python validation/laboratories.py LABS [--first N] [--only KIND ...]

Each laboratory has a prototype with another Young's modulus; its shape depends only on the ratio
of tension to modulus. The true shapes come from a model, so that this model is right, or from
finite elements (`results.json`), so that every model is wrong. The tension of the first tendon
rises and falls in steps. Friction of the sheath reduces rising tensions by 2 to 6 % and increases
falling ones by as much. Load cells have noise and an offset, which a deadband hides at slack
tendons. The camera has noise, loses a fifth of its frames and has an unknown pose, fitted as well.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.pose import Pose
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.experiment.fit import LOSSES
from octo_arm_model.experiment.identification import best_of, disagreements, envelope_of
from octo_arm_model.experiment.identify import identify
from octo_arm_model.experiment.observations import Observations, Pairing, observe
from octo_arm_model.experiment.recording import Recording
from octo_arm_model.experiment.steady_windows import SteadyRule
from octo_arm_model.experiment.uncertainty import AUTO

FloatArray = NDArray[np.float64]
FITS = ('youngs_modulus', 'alignment')
DEADBAND = 0.01  # [N]
_HOLD, _RAMP = 2.0, 0.5  # [s]
# Notes on a fit that warn of intervals with a coverage below 95 %.
_WARNINGS = ('no step was reached by unloading', 'wider than 95 %')
TENSIONS = np.array([1.09, 2.0, 2.6, 3.3, 3.95])  # [N] at the preset's modulus


@dataclass(frozen=True)
class Kind:
    """A kind of laboratory.

    Attributes:
        truth: model of the true shapes, or 'finite elements'.
        models: fitted models.
        friction: mean fraction of the tension that friction takes [-].
        has_falling: whether the tension falls again.
    """

    truth: str
    models: tuple[str, ...]
    friction: float
    has_falling: bool


_PLAIN, _BOTH = ('closed_form',), ('closed_form', 'exact')  # renda2012 is closed_form here
KINDS = {
    'right model': Kind('closed_form', _PLAIN, 0.04, True),
    'right model, no friction': Kind('closed_form', _PLAIN, 0.0, True),
    'right model, up only': Kind('closed_form', _PLAIN, 0.04, False),
    'choice of models': Kind('exact', _BOTH, 0.04, True),
    'finite elements': Kind('finite elements', _BOTH, 0.04, True),
}


class Truth:
    """The prototype's midline as a function of the tension, by interpolation."""

    def __init__(self, name: str) -> None:
        """Compute midlines by the model ``name``, or load those of 'finite elements'."""
        self.parameters = load_parameters(preset_path('renda2012_prototype'))
        if name != 'finite elements':
            config = Config.from_parameters(self.parameters)
            tensions = np.linspace(0.0, 4.2, 29)
            solver = config.solver(name, 81)
            lines = solver.solve(
                tensions[:, np.newaxis, np.newaxis] * [1.0, 0.0, 0.0, 0.0]
            ).position
        else:
            path = Path(__file__).parent / 'results.json'
            case = json.loads(path.read_text(encoding='utf-8'))['cases']['prototype']
            midlines = 1e-3 * np.array(case['midlines_mm'])
            steps = np.linalg.norm(np.diff(midlines[0], axis=0), axis=1)
            arc = np.concatenate([[0.0], np.cumsum(steps)])
            straight = np.zeros_like(midlines[0])
            straight[:, 0] = arc * float(self.parameters['body.length']) / arc[-1]
            tensions = np.concatenate([[0.0], np.array(case['tensions_N'])[:, 0]])
            lines = np.concatenate([straight[np.newaxis], midlines])
        self._spline = CubicSpline(tensions, lines)
        self.highest = float(tensions[-1])

    def midline(self, tension: FloatArray) -> FloatArray:
        """Return midlines (..., points, 3) [m] at ``tension`` [N] with the preset's modulus."""
        return np.asarray(self._spline(np.minimum(tension, self.highest)))


def laboratory(arm: Truth, kind: Kind, seed: int) -> tuple[Recording, float]:
    """Return the recording of a laboratory and its true Young's modulus [Pa]."""
    rng = np.random.default_rng(seed)
    factor = rng.uniform(0.85, 1.2)
    levels = factor * TENSIONS * rng.uniform(0.9, 1.0)
    held = np.concatenate([[0.0], levels, levels[-2::-1] if kind.has_falling else []])
    begins = np.arange(held.size) * (_HOLD + _RAMP)
    corners = np.stack([begins, begins + _HOLD], axis=1).ravel()
    time = np.arange(0.0, corners[-1], 0.02)
    tensions = np.interp(time, corners, np.repeat(held, 2))
    readings = np.zeros((time.size, 4))
    readings[:, 0] = tensions
    readings += rng.uniform(-0.003, 0.003, 4) + 0.005 * rng.standard_normal(readings.shape)
    readings[np.abs(readings) <= DEADBAND] = 0.0
    frames = np.arange(0.0, corners[-1], 0.1)
    frames = frames[rng.random(frames.size) > 0.2]
    # Friction is 0.5 to 1.5 times its mean: a loss up to the highest step, then a gain.
    sign = np.where(np.arange(held.size) <= TENSIONS.size, -1.0, 1.0)
    gain = 1.0 + sign * kind.friction * rng.uniform(0.5, 1.5, held.size)
    effective = np.interp(frames, corners, np.repeat(held * gain, 2)) / factor
    turn, shift = rng.normal(0.0, 0.03, 3), rng.normal(0.0, 0.005, 3)
    camera = Pose(tuple(shift), tuple(Rotation.from_rotvec(turn).as_quat()))
    lines = camera.from_base(arm.midline(effective))
    lines += 5e-4 * rng.standard_normal(lines.shape)
    young = factor * float(arm.parameters['material.youngs_modulus'])
    return Recording(
        arm.parameters, time, np.maximum(readings, 0.0), frames, tuple(lines), 'camera'
    ), young


def shapes_of(recording: Recording) -> Observations:
    """Return the steady steps of a ``recording`` with synchronous clocks."""
    rule = SteadyRule(None, 1.0, 0.5)
    return observe(recording, Pairing(rule, offset=0.0, base_end='first'))


@dataclass(frozen=True)
class Outcome:
    """Result of identify in a laboratory.

    Attributes:
        model: best model.
        error: relative error of its Young's modulus [-].
        half_width: half of its 95 % interval, relative to the truth [-].
        contains: whether this interval contains the truth.
        envelope_contains: whether the envelope of the intervals of all good models contains it.
        disagree: whether identify reports that models disagree.
        warned: whether identify warns of a coverage below 95 %, as with friction.
    """

    model: str
    error: float
    half_width: float
    contains: bool
    envelope_contains: bool
    disagree: bool
    warned: bool


def outcome(arm: Truth, kind: Kind, seed: int, loss: str = AUTO) -> Outcome:
    """Identify the arm in the laboratory ``seed`` of a ``kind``, with a ``loss`` of identify."""
    recording, young = laboratory(arm, kind, seed)
    shapes = shapes_of(recording).shapes
    fits = [identify(shapes, arm.parameters, model, FITS, loss=loss) for model in kind.models]
    best, envelope = best_of(fits), envelope_of(fits, 'youngs_modulus')
    estimate = best.estimates['youngs_modulus']
    assert estimate.value is not None and estimate.interval95 is not None and envelope is not None
    low, high = estimate.interval95
    return Outcome(
        best.model,
        estimate.value / young - 1.0,
        0.5 * (high - low) / young,
        low <= young <= high,
        envelope[0] <= young <= envelope[1],
        bool(disagreements(fits)),
        any(words in note for note in best.notes for words in _WARNINGS),
    )


def main() -> None:
    """Print a row for each laboratory, and the coverage for each kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('labs', type=int, help='number of laboratories of each kind')
    parser.add_argument('--first', type=int, default=0, help='seed of the first laboratory')
    parser.add_argument('--only', nargs='+', choices=KINDS, default=list(KINDS))
    parser.add_argument(
        '--loss',
        choices=(AUTO, *LOSSES),
        default=AUTO,
        help='loss of the fit; auto takes twice the time',
    )
    options = parser.parse_args()
    print('kind; seed; best model; error of E; half 95 % interval; interval contains E; ', end='')
    print('envelope contains E; models disagree; warning of low coverage')
    for name in options.only:
        arm, outcomes = Truth(KINDS[name].truth), []
        for seed in range(options.first, options.first + options.labs):
            outcomes.append(each := outcome(arm, KINDS[name], seed, options.loss))
            print(
                f'{name}; {seed}; {each.model}; {100.0 * each.error:+.2f} %; '
                f'+-{100.0 * each.half_width:.2f} %; {each.contains}; {each.envelope_contains}; '
                f'{each.disagree}; {each.warned}',
                flush=True,
            )
        shares = [
            100.0 * np.mean([getattr(each, field) for each in outcomes])
            for field in ('contains', 'envelope_contains', 'disagree', 'warned')
        ]
        error = 100.0 * np.mean([each.error for each in outcomes])
        half_width = 100.0 * np.median([each.half_width for each in outcomes])
        print(
            f'{name}: in {len(outcomes)} laboratories intervals contain E in {shares[0]:.1f} %, '
            f'envelopes of good models in {shares[1]:.1f} %; models disagree in {shares[2]:.1f} '
            f'%; warnings of low coverage in {shares[3]:.1f} %; mean error of E {error:+.2f} %, '
            f'median half interval {half_width:.2f} %',
            flush=True,
        )


if __name__ == '__main__':
    main()
