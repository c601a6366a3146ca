"""Sensors that lie: how soon the estimator names them, and how wrong what it publishes is.

Simulated arms, still and moving, whose load cells, tip and markers have noise as told, and one of
which lies from `BEGIN`, or from the first message, to `END`. A row has after how long the liar was
named, alone or with those that are as suspect, and for which part of the rest of its lie, the
worst error of any station over its stated deviation, the share of estimates that are off by more
than five of them, the longest that an honest sensor was refused, how long the liar was refused
after its end, the estimates published, and the processor time of the worst message.

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
PULL = 1.0 / 3.0  # of what the tendon is pulled by at most
CELL, PLACE, FORCE, MOMENT = 0.02, 1e-3, 0.02, 0.002
MARKED = (0.45, 1.0)  # of the length
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
    """A fault, and who is there to tell."""

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
    """What came of a case; times in [s], NaN of what never was."""

    named_after: float
    named_part: float
    worst: float
    beyond: float
    honest_refused: float
    refused_after: float
    published: float
    slowest_ms: float


class Bench:
    """One arm, and an estimator for each case."""

    def __init__(self, name: str, *, is_compiled: bool | None = None) -> None:
        """Of a preset."""
        self.config = load_config(name)
        values = {'estimator.tension_rate': 1.0}
        self.settings = EstimatorSettings.from_parameters(values, self.config)
        self.models = self.settings.models(self.config, compiled=is_compiled)
        ((_, self.model),) = self.models.items()
        self.true = ArmModel.of(self.config, self.model.state.unknowns, compiled=is_compiled)
        self.names = self.config.arm.tendon_names
        self.highest = default_highest(self.config.arm).ravel()

    def run(self, case: Case) -> Row:
        """What comes of a ``case``."""
        own = Estimator.from_settings(self.settings, self.models, self.settings.window)
        record = _Record(case, self.liars(case))
        for step, (true, made) in enumerate(self.measured(case)):
            now = step / case.rate
            for number, one in enumerate(made):
                begin = time.process_time()
                try:
                    found = own.add(round(1e9 * now), [one])
                    estimate = found.estimate
                    away = estimate.backbone.position - true.position
                    covariance = estimate.pose_covariance
                except SolveError:
                    found = None
                spent = time.process_time() - begin
                record.note(now, own, spent, last=number == len(made) - 1)
                if found is not None:
                    record.error(now, away, covariance[:, :3, :3])
        return record.row()

    def liars(self, case: Case) -> frozenset[str]:
        """Names of the sensors that lie."""
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

    def tensions(self, case: Case, now: float) -> NDArray[np.float64]:
        """True ones [N]."""
        base = PULL * self.highest * np.where(np.arange(self.highest.size) % 4 < 2, 1.0, 0.3)
        base[case.tendon] = PULL * self.highest[case.tendon]
        if case.is_moving:
            turn = 0.5 * now + np.arange(base.size)
            base = base * (1.0 + 0.2 * np.sin(turn))
        return np.asarray(base)

    def measured(self, case: Case) -> Iterator[tuple[Backbone, list[Measurement]]]:
        """Every time: the true shape, and what is measured in the order in which it comes."""
        rng, at, stuck = np.random.default_rng(case.seed), None, None
        state, stddev = self.model.state, self.model.state.prior_stddev()
        force = 0.3 * stddev[state.tip_force] * rng.normal(size=3)
        for step in range(round(LAST * case.rate)):
            now = step / case.rate
            x = np.zeros(state.size)
            x[state.tension] = self.tensions(case, now)
            x[state.tip_force] = force
            at = Prediction(self.true, x, None if at is None else at.solved)
            shape, reading = at.solved, x[state.tension].copy()
            lies = case.begin <= now < END
            stuck = reading if now <= case.begin else stuck
            marked = np.array([round(part * (len(shape.s) - 1)) for part in MARKED])
            seen, tip = shape.position[marked].copy(), shape.tip.copy()
            if lies:
                reading, seen, tip = self._lie(case, now, (reading, seen, tip), stuck, at)
            noise = rng.normal(size=reading.size), rng.normal(size=seen.shape), rng.normal(size=3)
            cells = Tensions(reading + CELL * noise[0], CELL)
            others: list[Measurement] = []
            if 'tip' in SENSORS[case.sensors]:
                others.append(TipPosition(tip + PLACE * noise[1][0], PLACE))
            if 'markers' in SENSORS[case.sensors]:
                markers = seen + PLACE * rng.normal(size=seen.shape)
                others.append(Markers(shape.s[marked], markers, PLACE))
            if case.fault == 'base offset':
                others.append(self._base_wrench(at, rng, is_off=lies))
            yield shape, [cells, *others] if case.cells_first else [*others, cells]

    def _lie(
        self,
        case: Case,
        now: float,
        true: tuple[NDArray[np.float64], ...],
        stuck: NDArray[np.float64] | None,
        at: Prediction,
    ) -> tuple[NDArray[np.float64], ...]:
        """Readings, markers and tip with the fault."""
        reading, seen, tip = true
        tendon = case.tendon
        if case.fault in ('0', 'x 0.3', 'x 5'):
            reading[tendon] *= float(case.fault.removeprefix('x '))
        elif case.fault == 'stuck' and stuck is not None:
            reading[tendon] = stuck[tendon]
        elif case.fault == 'drift':
            reading[tendon] += 0.05 * (now - case.begin)
        elif case.fault == 'all cells x 1000':
            reading *= 1000.0
        elif case.fault == 'marker jumps':
            seen[-1] = seen[0]
        elif case.fault == 'tip 5 mm off':
            tip[2] += 0.005
        elif case.fault == 'tip and cells by 50 mm':
            by = at.change.tip[:3, self.model.state.tension.start + tendon]
            wrong = 0.05 / max(float(np.linalg.norm(by)), 1e-9)
            reading[tendon] += wrong
            tip += wrong * by
        return reading, seen, tip

    def _base_wrench(
        self, at: Prediction, rng: np.random.Generator, *, is_off: bool
    ) -> BaseWrench:
        scale = self.model.state.prior_stddev()[self.model.state.tip_force][0]
        force, moment = 0.1 * scale, 0.1 * scale * self.config.arm.length
        noise = np.repeat([force, moment], 3)
        true = -BaseWrench(np.zeros(6), 1.0).innovation(at)
        off = np.array([0.0, 3.0 * scale, 0.0, 0.0, 0.0, 0.0]) * is_off
        return BaseWrench(true + off + noise * rng.normal(size=6), noise)


class _Record:
    """Of one case, as it goes on."""

    def __init__(self, case: Case, liars: frozenset[str]) -> None:
        self._case, self._liars = case, liars
        self._named: list[tuple[float, bool]] = []
        self._ratios: list[float] = []
        self._refused: dict[str, float] = {}
        self._honest = self._after = self._slowest = 0.0
        self._count = 0

    def note(self, now: float, own: Estimator, spent: float, *, last: bool) -> None:
        """What is refused after a message, and what it cost; ``last`` of its stamp."""
        self._count += 1
        if now > 0.0:
            self._slowest = max(self._slowest, spent)
        if not last:
            return
        refused = {name: 1e-9 * ns for name, ns in own.refused_since.items()}
        lies = self._case.begin <= now < END
        for name, since in refused.items():
            if name not in self._liars:
                self._honest = max(self._honest, now - since + 1.0 / self._case.rate)
            elif now >= END:
                self._after = max(self._after, now - END + 1.0 / self._case.rate)
        if lies:
            named = refused.keys() | set(own.suspects)
            self._named.append((now - self._case.begin, bool(self._liars & named)))

    def error(
        self, now: float, away: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> None:
        """Errors of stations over their stated deviations."""
        deviation = np.sqrt(np.maximum(np.trace(covariance, axis1=1, axis2=2), 1e-12))
        ratio = np.linalg.norm(away, axis=1) / np.maximum(deviation, 1e-5)
        self._ratios.append(float(ratio[1:].max()))

    def row(self) -> Row:
        """The result."""
        first = next((after for after, is_named in self._named if is_named), np.nan)
        rest = [is_named for after, is_named in self._named if after >= first]
        ratios = np.array(self._ratios) if self._ratios else np.array([np.nan])
        return Row(
            first,
            float(np.mean(rest)) if rest else 0.0,
            float(ratios.max()),
            float(np.mean(ratios > 5.0)),
            self._honest,
            self._after,
            len(self._ratios) / self._count,
            1e3 * self._slowest,
        )


def cases(arms: tuple[str, ...], *, is_full: bool) -> Iterator[Case]:
    """All of them, or a part that takes minutes."""
    rates = (4.0, 20.0, 50.0) if is_full else (20.0,)
    moves = (False, True) if is_full else (True,)
    orders = (True, False) if is_full else (True,)
    for arm, sensors in itertools.product(arms, SENSORS):
        tendons = range(len(load_config(arm).arm.tendon_names))
        for fault, rate, moving, order in itertools.product(CELL_FAULTS, rates, moves, orders):
            for tendon in tendons if is_full else tendons[::5]:
                yield Case(arm, fault, tendon, sensors, rate, moving, order)
        for fault, rate, moving in itertools.product(('none', *OTHER_FAULTS), rates, moves):
            needs = {
                'marker jumps': 'markers',
                'tip 5 mm off': 'tip',
                'tip and cells by 50 mm': 'tip',
            }.get(fault)
            if needs is None or needs in SENSORS[sensors]:
                yield Case(arm, fault, 0, sensors, rate, moving)


def main() -> None:
    """Print the table."""
    parser = make_parser(__doc__)
    parser.add_argument('--full', action='store_true', help='every tendon, rate and order')
    parser.add_argument('--arm', help='one preset alone')
    parser.add_argument('--only', default='', help='cases whose words have this in them')
    given = parser.parse_args()
    arms = (given.arm,) if given.arm else ARMS[:1] if IS_BRIEF else ARMS
    benches: dict[str, Bench] = {}
    print(
        f'{"":58}{"named s":>8}{"of it":>7}{"worst":>8}{"> 5":>7}{"honest s":>9}{"after s":>8}'
        f'{"given":>7}{"ms":>7}'
    )
    for case in cases(arms, is_full=given.full):
        words = (
            f'{case.arm} {case.fault} {case.tendon} {case.sensors} {case.rate:g} Hz '
            f'{"moving" if case.is_moving else "still"}{"" if case.cells_first else " cells last"}'
        )
        if given.only not in words:
            continue
        bench = benches.setdefault(case.arm, Bench(case.arm))
        row = bench.run(case)
        print(
            f'{words:58}{row.named_after:8.2f}{100 * row.named_part:6.0f}%{row.worst:8.1f}'
            f'{100 * row.beyond:6.1f}%{row.honest_refused:9.2f}{row.refused_after:8.2f}'
            f'{100 * row.published:6.0f}%{row.slowest_ms:7.1f}',
            flush=True,
        )


if __name__ == '__main__':
    main()
