"""Measure how soon the estimator names a faulty sensor, and how wrong its estimates are meanwhile.

Arms are simulated, still and moving, with load cells, the tip and markers measured. Noise is as
configured; the fault lasts from `BEGIN`, or from the first message, to `END`. Each row has the
time until the faulty sensor is named, alone or among equally suspect ones; the share of the rest
of the fault in which it is named; the largest error of any station over its standard deviation;
the share of estimates beyond five deviations; the longest refusal of a sound sensor; the refusal
of the faulty one after the fault; the share of messages with an estimate; and the largest
processor time of a message.

    python benchmarks/faults.py [--full] [--arm NAME] [--only TEXT] [--brief]
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from brief import IS_BRIEF, make_parser
from numpy.typing import NDArray

from octo_arm_model import Backbone, load_config
from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurement import Measurement
from octo_arm_model.estimation.measurements import BaseWrench, Markers, Tensions, TipPosition
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.settings import EstimatorSettings

ARMS = ('renda2012_table4', 'renda2012_prototype', 'rao2021', 'renda2012_table2')
BEGIN, END, LAST = (0.1, 0.2, 0.3) if IS_BRIEF else (1.0, 4.0, 7.0)  # [s]
PULL = 1.0 / 3.0  # of the highest tension of a tendon
CELL, POSITION = 0.02, 1e-3  # standard deviations [N, m]
MARKED = (0.45, 1.0)  # places of the markers, over the length
CELL_FAULTS = ('0', 'x 0.3', 'x 5', 'stuck', 'drift')
OTHER_FAULTS = (
    'all cells x 1000',
    'tip and cells by 50 mm',
    'marker jumps',
    'tip 5 mm off',
    'base offset',
)
SENSORS = {'tip': ('tip',), 'markers': ('markers',), 'both': ('tip', 'markers')}


class Case(NamedTuple):
    """An arm with a fault, and the sensors besides its load cells."""

    arm: str
    fault: str
    tendon: int = 0
    sensors: str = 'both'
    rate: float = 20.0
    is_moving: bool = True
    cells_first: bool = True
    seed: int = 0
    begin: float = BEGIN  # [s]


class Row(NamedTuple):
    """Results of a case; times in [s], NaN if the faulty sensor was never named."""

    named_after: float
    named_share: float
    largest_error: float
    share_beyond_five: float
    sound_refused: float
    refused_after: float
    published: float
    slowest_ms: float


class Bench:
    """An arm whose cases are each run with a new estimator."""

    def __init__(self, name: str, *, is_compiled: bool | None = None) -> None:
        """Load the preset ``name`` and prepare its models."""
        self.config = load_config(name)
        values = {'estimator.tension_rate': 1.0}
        self.settings = EstimatorSettings.from_parameters(values, self.config)
        self.models = self.settings.models(self.config, compiled=is_compiled)
        ((_, self.model),) = self.models.items()
        self.true_model = ArmModel.of(self.config, self.model.state.unknowns, compiled=is_compiled)
        self.names = self.config.arm.tendon_names
        self.highest = default_highest(self.config.arm).ravel()

    def run(self, case: Case) -> Row:
        """Run the estimator through a ``case``."""
        given = self.settings.given
        estimator = Estimator(self.models, self.settings.rules, given.window, given.change_time)
        record = _Record(case, self.faulty_sensors(case))
        for step, (shape, measurements) in enumerate(self.measurements(case)):
            t = step / case.rate
            for number, measurement in enumerate(measurements):
                begin = time.process_time()
                try:
                    estimate = estimator.add(round(1e9 * t), [measurement]).estimate
                    error = estimate.backbone.position - shape.position
                    covariance = estimate.pose_covariance
                except SolveError:
                    estimate = None
                cpu = time.process_time() - begin
                record.add_message(t, estimator, cpu, is_last=number == len(measurements) - 1)
                if estimate is not None:
                    record.add_errors(error, covariance[:, :3, :3])
        return record.row()

    def faulty_sensors(self, case: Case) -> frozenset[str]:
        """Return the names of the faulty sensors."""
        if case.fault in CELL_FAULTS:
            return frozenset({f'load cell {self.names[case.tendon]}'})
        cells = frozenset(f'load cell {name}' for name in self.names)
        return {
            'none': frozenset[str](),
            'all cells x 1000': cells,
            'tip and cells by 50 mm': cells | {'tip position'},
            'marker jumps': frozenset({'markers'}),
            'tip 5 mm off': frozenset({'tip position'}),
            'base offset': frozenset({'base wrench'}),
        }[case.fault]

    def tensions(self, case: Case, t: float) -> NDArray[np.float64]:
        """Return the true tensions at the time ``t`` [N]."""
        base = PULL * self.highest * np.where(np.arange(self.highest.size) % 4 < 2, 1.0, 0.3)
        base[case.tendon] = PULL * self.highest[case.tendon]
        if case.is_moving:
            phase = 0.5 * t + np.arange(base.size)
            base = base * (1.0 + 0.2 * np.sin(phase))
        return np.asarray(base)

    def measurements(self, case: Case) -> Iterator[tuple[Backbone, list[Measurement]]]:
        """Yield the true shape of each time, and the measurements in order of their arrival."""
        rng, truth, stuck = np.random.default_rng(case.seed), None, None
        state, stddev = self.model.state, self.model.state.prior_stddev()
        force = 0.3 * stddev[state.tip_force] * rng.normal(size=3)
        for step in range(round(LAST * case.rate)):
            t = step / case.rate
            x = np.zeros(state.size)
            x[state.tension] = self.tensions(case, t)
            x[state.tip_force] = force
            truth = Prediction(self.true_model, x, None if truth is None else truth.solved)
            shape, reading = truth.solved, x[state.tension].copy()
            is_faulty = case.begin <= t < END
            stuck = reading if t <= case.begin else stuck
            markers_at = np.array([round(part * (len(shape.s) - 1)) for part in MARKED])
            markers, tip = shape.position[markers_at].copy(), shape.tip.copy()
            if is_faulty:
                true = reading, markers, tip
                reading, markers, tip = self._with_fault(case, t, true, stuck, truth)
            sizes = reading.size, markers.shape, 3
            cell_noise, tip_noise, _ = (rng.normal(size=size) for size in sizes)
            cells = Tensions(reading + CELL * cell_noise, CELL)
            others: list[Measurement] = []
            if 'tip' in SENSORS[case.sensors]:
                others.append(TipPosition(tip + POSITION * tip_noise[0], POSITION))
            if 'markers' in SENSORS[case.sensors]:
                markers = markers + POSITION * rng.normal(size=markers.shape)
                others.append(Markers(shape.s[markers_at], markers, POSITION))
            if case.fault == 'base offset':
                others.append(self._base_wrench(truth, rng, is_faulty=is_faulty))
            yield shape, [cells, *others] if case.cells_first else [*others, cells]

    def _with_fault(
        self,
        case: Case,
        t: float,
        true: tuple[NDArray[np.float64], ...],
        stuck: NDArray[np.float64] | None,
        truth: Prediction,
    ) -> tuple[NDArray[np.float64], ...]:
        """Return the ``true`` readings, markers and tip with the fault."""
        reading, markers, tip = true
        tendon = case.tendon
        if case.fault in ('0', 'x 0.3', 'x 5'):
            reading[tendon] *= float(case.fault.removeprefix('x '))
        elif case.fault == 'stuck' and stuck is not None:
            reading[tendon] = stuck[tendon]
        elif case.fault == 'drift':
            reading[tendon] += 0.05 * (t - case.begin)
        elif case.fault == 'all cells x 1000':
            reading *= 1000.0
        elif case.fault == 'marker jumps':
            markers[-1] = markers[0]
        elif case.fault == 'tip 5 mm off':
            tip[2] += 0.005
        elif case.fault == 'tip and cells by 50 mm':
            tip_per_tension = truth.change.tip[:3, self.model.state.tension.start + tendon]
            excess = 0.05 / max(float(np.linalg.norm(tip_per_tension)), 1e-9)
            reading[tendon] += excess
            tip += excess * tip_per_tension
        return reading, markers, tip

    def _base_wrench(
        self, truth: Prediction, rng: np.random.Generator, *, is_faulty: bool
    ) -> BaseWrench:
        scale = self.model.state.prior_stddev()[self.model.state.tip_force][0]
        force, moment = 0.1 * scale, 0.1 * scale * self.config.arm.length
        noise = np.repeat([force, moment], 3)
        wrench = -BaseWrench(np.zeros(6), 1.0).innovation(truth)
        offset = np.array([0.0, 3.0 * scale, 0.0, 0.0, 0.0, 0.0]) * is_faulty
        return BaseWrench(wrench + offset + noise * rng.normal(size=6), noise)


class _Record:
    """Collects the results of a case."""

    def __init__(self, case: Case, faulty: frozenset[str]) -> None:
        self._case, self._faulty = case, faulty
        self._named: list[tuple[float, bool]] = []
        self._ratios: list[float] = []
        self._refused: dict[str, float] = {}
        self._sound_refused = self._refused_after = self._slowest = 0.0
        self._count = 0

    def add_message(self, t: float, estimator: Estimator, cpu: float, *, is_last: bool) -> None:
        """Note which sensors are refused after a message; only after the last of a stamp."""
        self._count += 1
        if t > 0.0:
            self._slowest = max(self._slowest, cpu)
        if not is_last:
            return
        refused = {name: 1e-9 * ns for name, ns in estimator.refused_since.items()}
        is_faulty = self._case.begin <= t < END
        for name, since in refused.items():
            if name not in self._faulty:
                self._sound_refused = max(self._sound_refused, t - since + 1.0 / self._case.rate)
            elif t >= END:
                self._refused_after = max(self._refused_after, t - END + 1.0 / self._case.rate)
        if is_faulty:
            named = refused.keys() | set(estimator.suspects)
            self._named.append((t - self._case.begin, bool(self._faulty & named)))

    def add_errors(self, error: NDArray[np.float64], covariance: NDArray[np.float64]) -> None:
        """Note the largest ratio of ``error`` (stations, 3) to its standard deviation."""
        deviation = np.sqrt(np.maximum(np.trace(covariance, axis1=1, axis2=2), 1e-12))
        ratio = np.linalg.norm(error, axis=1) / np.maximum(deviation, 1e-5)
        self._ratios.append(float(ratio[1:].max()))

    def row(self) -> Row:
        """Return the results."""
        first = next((after for after, is_named in self._named if is_named), np.nan)
        rest = [is_named for after, is_named in self._named if after >= first]
        ratios = np.array(self._ratios) if self._ratios else np.array([np.nan])
        return Row(
            first,
            float(np.mean(rest)) if rest else 0.0,
            float(ratios.max()),
            float(np.mean(ratios > 5.0)),
            self._sound_refused,
            self._refused_after,
            len(self._ratios) / self._count,
            1e3 * self._slowest,
        )


def cases(arms: tuple[str, ...], *, is_full: bool) -> Iterator[Case]:
    """Yield all cases, or a selection that takes minutes."""
    rates = (4.0, 20.0, 50.0) if is_full else (20.0,)
    motions = (False, True) if is_full else (True,)
    orders = (True, False) if is_full else (True,)
    for arm, sensors in itertools.product(arms, SENSORS):
        tendons = range(len(load_config(arm).arm.tendon_names))
        for fault, rate, is_moving, order in itertools.product(
            CELL_FAULTS, rates, motions, orders
        ):
            for tendon in tendons if is_full else tendons[::5]:
                yield Case(arm, fault, tendon, sensors, rate, is_moving, order)
        for fault, rate, is_moving in itertools.product(('none', *OTHER_FAULTS), rates, motions):
            sensor = {
                'marker jumps': 'markers',
                'tip 5 mm off': 'tip',
                'tip and cells by 50 mm': 'tip',
            }.get(fault)
            if sensor is None or sensor in SENSORS[sensors]:
                yield Case(arm, fault, 0, sensors, rate, is_moving)


def main() -> None:
    """Print a row for each case."""
    parser = make_parser(__doc__)
    parser.add_argument('--full', action='store_true', help='run every tendon, rate and order')
    parser.add_argument('--arm', help='run one preset only')
    parser.add_argument('--only', default='', help='run the cases with this in their name')
    options = parser.parse_args()
    arms = (options.arm,) if options.arm else ARMS[:1] if IS_BRIEF else ARMS
    benches: dict[str, Bench] = {}
    print('Times in s; errors in standard deviations')
    print(
        f'{"":58}{"named after":>12}{"named":>7}{"error":>8}{"> 5 sd":>8}{"sound refused":>14}'
        f'{"refused after":>14}{"published":>10}{"max ms":>7}'
    )
    for case in cases(arms, is_full=options.full):
        name = (
            f'{case.arm} {case.fault} {case.tendon} {case.sensors} {case.rate:g} Hz '
            f'{"moving" if case.is_moving else "still"}{"" if case.cells_first else " cells last"}'
        )
        if options.only not in name:
            continue
        bench = benches.setdefault(case.arm, Bench(case.arm))
        row = bench.run(case)
        print(
            f'{name:58}{row.named_after:12.2f}{100 * row.named_share:6.0f}%'
            f'{row.largest_error:8.1f}{100 * row.share_beyond_five:7.1f}%'
            f'{row.sound_refused:14.2f}{row.refused_after:14.2f}'
            f'{100 * row.published:9.0f}%{row.slowest_ms:7.1f}',
            flush=True,
        )


if __name__ == '__main__':
    main()
