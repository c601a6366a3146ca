"""Time and error against general-purpose ways to solve the same models.

The paper's way: equations (10) to (12) with `solve_ivp`, RK23 at its default tolerances, then
the kinematics (1) likewise, read out at 101 stations. Everything is timed in this one run and
reported as ratios; the errors are against the same equations at tight tolerances. Loads: see
`loaded_bvp`.

    python benchmarks/solvers.py [--brief]
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from brief import IS_BRIEF, make_parser
from loaded_bvp import LoadedBvp
from scipy.integrate import solve_ivp

from octo_arm_model import (
    MODELS,
    Arm,
    Backbone,
    Body,
    Config,
    Loads,
    Section,
    Solver,
    Uncertainty,
    load_config,
)
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.rod.forms import is_available

STATIONS = 101
GRAVITY = (0.0, 0.0, -9.81)
UNCERTAIN = Uncertainty(tension=0.02, youngs_modulus=0.05)
BATCH = 100 if IS_BRIEF else 10_000
MOST_REPEATS = 2 if IS_BRIEF else 1000


class PaperWay:
    """Equations (10) to (12) and (1) of the paper, written as they are printed and marched."""

    def __init__(self, arm: Arm, **integrator: Any) -> None:
        """Solve ``arm`` with `solve_ivp` options ``integrator``."""
        self._options = integrator
        parts = [part for part in arm.sections if isinstance(part, Section)]
        self._l = [part.anchorage for part in parts]
        self._a = np.array([part.offset_base for part in parts])
        self._b = np.array([part.offset_anchorage for part in parts])
        self._slope = (self._b - self._a) / np.array(self._l)
        body, material = arm.body, arm.material
        assert isinstance(body, Body)
        assert isinstance(material.youngs_modulus, float)
        assert isinstance(material.shear_modulus, float)
        self._young, self._shear = material.youngs_modulus, material.shear_modulus
        self._radius_base = body.radius_base
        self._taper = (body.radius_tip - body.radius_base) / body.length

    def tip(self, tensions: Any) -> np.ndarray:
        """Tip position [m], base at the origin with t, n, b along x, y, z."""
        tensions = np.asarray(tensions, dtype=float)
        state = np.concatenate([np.zeros(3), np.eye(3).ravel()])
        for i, strains in reversed(list(enumerate(self._strains(tensions)))):
            state = self._frames(tensions, i, strains, state)
        return state[:3]

    def _start(self, i: int) -> float:
        return self._l[i + 1] if i + 1 < len(self._l) else 0.0

    def _strains(self, tensions: np.ndarray) -> list[Callable[[float], np.ndarray]]:
        young, shear = self._young, self._shear
        omega: np.ndarray = np.zeros(3)
        solutions = []
        for i, stop in enumerate(self._l):
            t1, t2, t3, t4 = tensions[: i + 1].T
            a, slope, b = self._a[: i + 1], self._slope[: i + 1], self._b[i]
            second = 0.25 * np.pi * self._radius(stop) ** 4
            omega = omega + np.array(
                [
                    0.0,
                    b * (t4[i] - t2[i]) / (b * b * (t4[i] + t2[i]) + young * second),
                    b * (t1[i] - t3[i]) / (b * b * (t1[i] + t3[i]) + young * second),
                ]
            )

            def slope_of(s_tilde: float, omega: np.ndarray) -> np.ndarray:
                tau, xi, k = omega
                radius = self._radius(-s_tilde)
                j = 0.25 * np.pi * radius**4
                dj = np.pi * radius**3 * self._taper
                y = a - slope * s_tilde
                a1, b1 = y * y @ (t1 + t3), y * y @ (t2 + t4)
                da1, db1 = 2 * y * slope @ (t1 + t3), 2 * y * slope @ (t2 + t4)
                alpha, beta = y @ (t1 - t3), y @ (t4 - t2)
                tau_s = -tau * (2 * shear * dj + da1 + db1) - k * xi * (a1 - b1)
                xi_s = -xi * (young * dj + db1) - tau * k * b1 - tau * alpha + slope @ (t4 - t2)
                k_s = -k * (young * dj + da1) + tau * xi * a1 + tau * beta + slope @ (t1 - t3)
                return -np.array(
                    [
                        (tau_s - k * beta + xi * alpha) / (2 * shear * j + a1 + b1),
                        xi_s / (young * j + b1),
                        k_s / (young * j + a1),
                    ]
                )

            solution = solve_ivp(
                slope_of, (-stop, -self._start(i)), omega, dense_output=True, **self._options
            )
            omega = solution.y[:, -1]
            solutions.append(solution.sol)
        return solutions

    def _frames(
        self, tensions: np.ndarray, i: int, omega: Callable[[float], np.ndarray], state: np.ndarray
    ) -> np.ndarray:
        t1, t2, t3, t4 = tensions[: i + 1].T
        total = tensions[: i + 1].sum()
        a, slope = self._a[: i + 1], self._slope[: i + 1]
        young = self._young

        def slope_of(s: float, state: np.ndarray) -> np.ndarray:
            tau, xi, k = omega(-s)
            y = a + slope * s
            force = k * (y @ (t1 - t3)) + xi * (y @ (t4 - t2)) - total
            q = force / (young * np.pi * self._radius(s) ** 2)
            t, n, b = state[3:6], state[6:9], state[9:]
            return (1 + q) * np.concatenate(
                [t, k * n - xi * b, -k * t + tau * b, xi * t - tau * n]
            )

        stations = np.linspace(self._start(i), self._l[i], 1 + STATIONS // len(self._l))
        span = (stations[0], stations[-1])
        return solve_ivp(slope_of, span, state, t_eval=stations, **self._options).y[:, -1]

    def _radius(self, s: float) -> float:
        return self._radius_base + self._taper * s


def seconds(work: Callable[[], object], repeats: int) -> float:
    """Median processor time of ``work`` [s], which other programs hardly change."""
    return float(np.median(_times(work, repeats)))


def least(work: Callable[[], object], repeats: int) -> float:
    """Least processor time of ``work`` [s]: what it takes on a machine that is not busy."""
    return min(_times(work, repeats))


def _times(work: Callable[[], object], repeats: int) -> list[float]:
    times = []
    for _ in range(min(repeats, MOST_REPEATS)):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return times


def main() -> None:
    """Print the tables."""
    make_parser(__doc__).parse_args()
    config = load_config(preset_path('renda2012_table4'))
    arm = config.arm
    solvers = {model: Solver(arm, model, STATIONS, compiled=False) for model in MODELS}
    if is_available():
        for model in MODELS:
            solver = Solver(arm, model, STATIONS, compiled=True)
            solver.solve(FETCHING_IN_SPACE)
            solvers[f'{model}, compiled'] = solver
    unloaded(arm, solvers)
    batches(arm, solvers)
    loaded(config)
    hanging(config, [False, True] if is_available() else [False])
    friction()


def unloaded(arm: Arm, solvers: dict[str, Solver]) -> None:
    """Every model against the paper's way, and sensitivities against a solve."""
    paper = PaperWay(arm, method='RK23')
    tight = PaperWay(arm, method='DOP853', rtol=1e-11, atol=1e-12)
    print(f"One solve at {STATIONS} stations, arm of Table 4; the paper's way is 1")
    print(f'{"":12}{"way":24}{"ms":>8}{"quicker":>9}{"closed_form":>13}{"tip error / L":>15}')
    for name, tensions in (('Figure 14', FETCHING_IN_PLANE), ('Figure 15', FETCHING_IN_SPACE)):
        reference = tight.tip(tensions)
        slow = seconds(lambda: paper.tip(tensions), 15)
        error = np.linalg.norm(paper.tip(tensions) - reference) / arm.length
        print(f'{name:12}{"paper, RK23":24}{slow * 1e3:8.3f}{1.0:9.1f}{"":13}{error:15.1e}')
        quick = {
            way: seconds(lambda: solver.solve(tensions), 400) for way, solver in solvers.items()
        }
        for way, solver in solvers.items():
            # Other models, other equations: the reference is a fine grid of the same model.
            fine = reference
            if solver.model != 'renda2012':
                fine = Solver(arm, solver.model, 20 * STATIONS).solve(tensions).tip
            error = np.linalg.norm(solver.solve(tensions).tip - fine) / arm.length
            print(
                f'{"":12}{way:24}{quick[way] * 1e3:8.3f}{slow / quick[way]:9.1f}'
                f'{quick[way] / quick["closed_form"]:12.1f}x{error:15.1e}'
            )
    solver = solvers['exact']
    backbone = solver.solve(FETCHING_IN_SPACE)
    all_of_them = seconds(lambda: solver.sensitivity(backbone), 100)
    print(f'all sensitivities of exact: {all_of_them / quick["exact"]:.1f} solves')


def batches(arm: Arm, solvers: dict[str, Solver]) -> None:
    """Many arms in one call."""
    scale = np.array([[0.2], [1.5], [3.0]])
    sets = np.random.default_rng(2012).uniform(0.0, 1.0, (BATCH, *arm.tension_shape)) * scale
    print(f'\n{BATCH} random tension sets at {STATIONS} stations, per arm')
    print(f'{"way":24}{"one by one us":>15}{"in one call us":>16}{"cheaper":>9}')
    for way, solver in solvers.items():
        some = sets[:500]
        single = seconds(lambda: [solver.solve(x) for x in some], 3) / len(some)
        batch = seconds(lambda: solver.solve(sets), 3) / BATCH
        print(f'{way:24}{single * 1e6:15.1f}{batch * 1e6:16.1f}{single / batch:9.1f}')


def solver_of(
    config: Config,
    arm: Arm,
    loads: Loads,
    stations: int = STATIONS,
    *,
    compiled: bool | None = None,
) -> Solver:
    """Solver `exact` of another ``arm`` and ``loads``, else as ``config``."""
    changed = dataclasses.replace(config, arm=arm, loads=loads)
    return changed.solver('exact', stations, compiled=compiled)


def loaded(config: Config) -> None:
    """The exact model with gravity in water and a tip force, against `solve_bvp`."""
    arm = config.arm.with_density(1080.0)
    loads = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1000.0, tip_force=(0.0, 1e-3, 1e-3))
    solver = solver_of(config, arm, loads, compiled=False)
    tensions = np.array(FETCHING_IN_SPACE)
    fine = solver_of(config, arm, loads, 20 * STATIONS).solve(tensions).tip
    ours = solver.solve(tensions)
    cold = seconds(lambda: solver.solve(tensions), 50)
    moving = iter(np.sin(np.arange(1000.0)))
    warm = seconds(lambda: solver.solve(tensions * (1 + 0.01 * next(moving)), start=ours), 50)
    reference = LoadedBvp(arm, tensions, loads, 'neo_hookean', config.base)
    # The tolerance at which it is about as accurate as ours.
    with np.errstate(all='ignore'):
        slow = seconds(lambda: reference.tip(tol=1e-4), 3)
        slow_error = np.linalg.norm(reference.tip(tol=1e-4) - fine) / arm.length
    error = tip_error(solver, tensions)
    again = seconds(lambda: solver.sensitivity(ours), 50)
    print('\nFigure 15 in water with a force of 1.4 mN on the tip, model exact')
    print(f'{"way":24}{"ms":>10}{"quicker":>9}{"tip error / L":>15}')
    print(f'{"solve_bvp":24}{slow * 1e3:10.2f}{1.0:9.1f}{slow_error:15.1e}')
    print(f'{"from the unloaded shape":24}{cold * 1e3:10.2f}{slow / cold:9.1f}{error:15.1e}')
    print(f'{"from the last shape":24}{warm * 1e3:10.2f}{slow / warm:9.1f}')
    print(f'all sensitivities: {again / cold:.1f} solves')


def hanging(config: Config, ways: list[bool]) -> None:
    """The arm under its weight, as ratios to the compiled closed_form."""
    arm, tensions = config.arm.with_density(1080.0), np.array(FETCHING_IN_SPACE)
    closed_form = Solver(arm, 'closed_form', STATIONS, compiled=ways[-1])
    unit = least(lambda: closed_form.solve(tensions), 1000)
    name = 'compiled closed_form' if ways[-1] else 'closed_form'
    print(f'\nFigure 15 and the weight of the arm, in times of one {name}, {unit * 1e6:.1f} us')
    names = (
        'one',
        'warm, 1 %',
        'sensitivities',
        'covariance',
        'batch, warm',
        'batch, cold',
        'tip error / L',
    )
    print(f'{"exact":24}' + ''.join(f'{name:>15}' for name in names))
    for is_compiled in ways:
        for medium, loads in (
            ('without', Loads()),
            ('in water', Loads(gravity=GRAVITY, fluid_density=1000.0)),
            ('in air', Loads(gravity=GRAVITY)),
        ):
            solver = solver_of(config, arm, loads, compiled=is_compiled)
            way = f'{medium}{", compiled" if is_compiled else ""}'
            times = [value / unit for value in times_of(solver, tensions)]
            columns = ''.join(f'{value:15.1f}' for value in times)
            print(f'{way:24}{columns}{tip_error(solver, tensions):15.1e}')
    along(config, ways[-1])
    eight_arms(config, ways[-1])


def times_of(solver: Solver, tensions: np.ndarray) -> list[float]:
    """Seconds of a solve, from the last shape, derivatives, covariance, and a batch per arm."""
    cold = least(lambda: solver.solve(tensions), 100)
    last = solver.solve(tensions)
    # All of a size: the least time would be that of the smallest change.
    parts = 1.0 + 0.01 * np.resize([1.0, -1.0], 1000)
    moving = itertools.cycle(parts)
    batch = tensions * parts[: 3 if IS_BRIEF else 1000, np.newaxis, np.newaxis]

    def derivatives(work: Callable[[Backbone], object]) -> float:
        """Of the shapes of warm solves, each asked for once."""
        times = []
        for _ in range(min(100, MOST_REPEATS)):
            shape = solver.solve(next(moving) * tensions, start=last)
            times += _times(functools.partial(work, shape), 1)
        return min(times)

    return [
        cold,
        least(lambda: solver.solve(next(moving) * tensions, start=last), 400),
        derivatives(solver.sensitivity),
        derivatives(lambda shape: solver.tip_covariance(shape, UNCERTAIN)),
        least(lambda: solver.solve(batch, start=last), 3) / len(batch),
        least(lambda: solver.solve(batch[:100]), 3) / len(batch[:100]),
    ]


def tip_error(solver: Solver, tensions: np.ndarray) -> float:
    """Error of the tip, over the length, against a solver of an accuracy of 1e-12."""
    finer = Solver(solver.arm, 'exact', base=solver.base, loads=solver.loads, accuracy=1e-12)
    fine = finer.solve(tensions).tip
    return float(np.linalg.norm(solver.solve(tensions).tip - fine) / solver.arm.length)


def along(config: Config, is_compiled: bool) -> None:
    """What stations and sections cost a loaded arm, each step from the last shape."""
    print('\nIn air, from the last shape: us by stations, and by sections at 101 stations')
    arm, tensions = config.arm.with_density(1080.0), np.array(FETCHING_IN_SPACE)
    cases = [(arm, tensions, stations) for stations in (101, 401, 1601)]
    for count in (1, 2, 3, 6):
        anchorages = np.linspace(arm.length, 0.0, count, endpoint=False)
        sections = tuple(Section(float(at), 0.01, 0.002) for at in anchorages)
        pulls = np.tile([[0.0, 0.1, 0.1, 0.0]], (count, 1))
        cases.append((Arm(arm.material, arm.body, sections), pulls, STATIONS))
    for case, pulls, stations in cases:
        loads = Loads(gravity=GRAVITY)
        solver = solver_of(config, case, loads, stations, compiled=is_compiled)
        last = solver.solve(pulls)
        moving = itertools.cycle((0.99, 1.01))
        took = least(lambda: solver.solve(next(moving) * pulls, start=last), 200)
        print(f'{stations:6} stations {len(case.sections):3} sections {took * 1e6:10.1f}')


def eight_arms(config: Config, is_compiled: bool) -> None:
    """Eight arms in air, each from its own last shape, with tensions as in fetching."""
    arm, tensions = config.arm.with_density(1080.0), np.array(FETCHING_IN_SPACE)
    loads = Loads(gravity=GRAVITY)
    solver = solver_of(config, arm, loads, compiled=is_compiled)
    steps = 3 if IS_BRIEF else 1000
    lasts = [solver.solve(0.0 * tensions)] * 8
    rounds = []
    for step in range(1, steps + 1):
        part = 0.5 - 0.5 * np.cos(np.pi * step / 1000.0)
        start = time.process_time()
        lasts = [solver.follow(part * tensions, last) for last in lasts]
        rounds.append(time.process_time() - start)
    mean, quick = 1.0 / np.mean(rounds), 1.0 / np.median(rounds)
    print(
        f'\nEight arms in air that fetch in a second, 1000 steps: {mean:.0f} Hz on one core, '
        f'{quick:.0f} Hz in the median step'
    )


def friction() -> None:
    """What friction of the tendons costs, on the prototype, against the same solve without."""
    arm = load_config(preset_path('renda2012_prototype')).arm
    tensions = np.array([[2.0, 0.3, 0.1, 0.2]])
    wrench = np.array([0.01, 0.02, -0.01, 0.0, 0.0, 0.0])
    print('\nFriction mu = 0.2 on the prototype, NumPy')
    print(f'{"way":24}{"without ms":>12}{"with ms":>12}{"times":>8}')
    ways = {'closed_form': None, 'exact': None, 'exact, tip force': wrench}
    for name, on_tip in ways.items():
        taken = []
        for one in (arm, dataclasses.replace(arm, friction=(0.2,))):
            solver = Solver(one, name.partition(',')[0], compiled=False)
            taken.append(seconds(functools.partial(solver.solve, tensions, on_tip), 100))
        without, rough = taken
        print(f'{name:24}{without * 1e3:12.3f}{rough * 1e3:12.3f}{rough / without:8.1f}')


if __name__ == '__main__':
    main()
