"""Compare time and error of the solver with those of general-purpose integrators.

The paper's method integrates equations (10) to (12) with `solve_ivp`, RK23 and default tolerances,
then the kinematics (1) in the same way at 101 stations. All times are measured in one run and
printed as ratios. The reference for errors is the same equations with tight tolerances. For loads
the comparison is with `loaded_bvp`.

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


class PaperMethod:
    """Equations (10) to (12) and (1) of the paper as printed, integrated along the arm."""

    def __init__(self, arm: Arm, **integrator: Any) -> None:
        """Prepare an ``arm`` and the options ``integrator`` of `solve_ivp`."""
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
        """Return the tip [m] of an arm whose base is at the origin, with t, n, b along x, y, z."""
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
            second_moment = 0.25 * np.pi * self._radius(stop) ** 4
            omega = omega + np.array(
                [
                    0.0,
                    b * (t4[i] - t2[i]) / (b * b * (t4[i] + t2[i]) + young * second_moment),
                    b * (t1[i] - t3[i]) / (b * b * (t1[i] + t3[i]) + young * second_moment),
                ]
            )

            def strain_rates(s_tilde: float, omega: np.ndarray) -> np.ndarray:
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
                strain_rates, (-stop, -self._start(i)), omega, dense_output=True, **self._options
            )
            omega = solution.y[:, -1]
            solutions.append(solution.sol)
        return solutions

    def _frames(
        self, tensions: np.ndarray, i: int, omega: Callable[[float], np.ndarray], state: np.ndarray
    ) -> np.ndarray:
        t1, t2, t3, t4 = tensions[: i + 1].T
        total_tension = tensions[: i + 1].sum()
        a, slope = self._a[: i + 1], self._slope[: i + 1]
        young = self._young

        def frame_rates(s: float, state: np.ndarray) -> np.ndarray:
            tau, xi, k = omega(-s)
            y = a + slope * s
            force = k * (y @ (t1 - t3)) + xi * (y @ (t4 - t2)) - total_tension
            q = force / (young * np.pi * self._radius(s) ** 2)
            t, n, b = state[3:6], state[6:9], state[9:]
            return (1 + q) * np.concatenate(
                [t, k * n - xi * b, -k * t + tau * b, xi * t - tau * n]
            )

        stations = np.linspace(self._start(i), self._l[i], 1 + STATIONS // len(self._l))
        span = (stations[0], stations[-1])
        return solve_ivp(frame_rates, span, state, t_eval=stations, **self._options).y[:, -1]

    def _radius(self, s: float) -> float:
        return self._radius_base + self._taper * s


def median_time(work: Callable[[], object], repeats: int) -> float:
    """Return the median processor time of ``work`` [s], which other programs change little."""
    return float(np.median(_processor_times(work, repeats)))


def shortest_time(work: Callable[[], object], repeats: int) -> float:
    """Return the shortest processor time of ``work`` [s], as on an idle machine."""
    return min(_processor_times(work, repeats))


def _processor_times(work: Callable[[], object], repeats: int) -> list[float]:
    times = []
    for _ in range(min(repeats, MOST_REPEATS)):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return times


def main() -> None:
    """Print all tables."""
    make_parser(__doc__).parse_args()
    config = load_config(preset_path('renda2012_table4'))
    arm = config.arm
    solvers = {model: Solver(arm, model, STATIONS, compiled=False) for model in MODELS}
    if is_available():
        for model in MODELS:
            solver = Solver(arm, model, STATIONS, compiled=True)
            solver.solve(FETCHING_IN_SPACE)
            solvers[f'{model}, compiled'] = solver
    compare_unloaded(arm, solvers)
    compare_batches(arm, solvers)
    compare_loaded(config)
    measure_weight(config, [False, True] if is_available() else [False])
    measure_friction()


def compare_unloaded(arm: Arm, solvers: dict[str, Solver]) -> None:
    """Compare each model with the paper's method, and sensitivities with a solve."""
    paper = PaperMethod(arm, method='RK23')
    tight = PaperMethod(arm, method='DOP853', rtol=1e-11, atol=1e-12)
    print(f"One solve at {STATIONS} stations, arm of Table 4; speedup over the paper's method")
    print(f'{"":12}{"method":24}{"ms":>8}{"speedup":>9}{"x closed_form":>15}{"tip error / L":>15}')
    for name, tensions in (('Figure 14', FETCHING_IN_PLANE), ('Figure 15', FETCHING_IN_SPACE)):
        reference = tight.tip(tensions)
        paper_time = median_time(lambda: paper.tip(tensions), 15)
        error = np.linalg.norm(paper.tip(tensions) - reference) / arm.length
        print(f'{name:12}{"paper, RK23":24}{paper_time * 1e3:8.3f}{1.0:9.1f}{"":15}{error:15.1e}')
        times = {
            method: median_time(lambda: solver.solve(tensions), 400)
            for method, solver in solvers.items()
        }
        for method, solver in solvers.items():
            # The reference of models with other equations is a fine grid of the same model.
            fine = reference
            if solver.model != 'renda2012':
                fine = Solver(arm, solver.model, 20 * STATIONS).solve(tensions).tip
            error = np.linalg.norm(solver.solve(tensions).tip - fine) / arm.length
            print(
                f'{"":12}{method:24}{times[method] * 1e3:8.3f}{paper_time / times[method]:9.1f}'
                f'{times[method] / times["closed_form"]:15.1f}{error:15.1e}'
            )
    solver = solvers['exact']
    backbone = solver.solve(FETCHING_IN_SPACE)
    derivatives = median_time(lambda: solver.sensitivity(backbone), 100)
    print(f'all sensitivities of exact take the time of {derivatives / times["exact"]:.1f} solves')


def compare_batches(arm: Arm, solvers: dict[str, Solver]) -> None:
    """Compare many solves one by one with one call for all."""
    scale = np.array([[0.2], [1.5], [3.0]])
    sets = np.random.default_rng(2012).uniform(0.0, 1.0, (BATCH, *arm.tension_shape)) * scale
    print(f'\n{BATCH} random tension sets at {STATIONS} stations, time per set')
    print(f'{"method":24}{"one by one us":>15}{"in one call us":>16}{"speedup":>9}')
    for method, solver in solvers.items():
        first_sets = sets[:500]
        single = median_time(lambda: [solver.solve(x) for x in first_sets], 3) / len(first_sets)
        batch = median_time(lambda: solver.solve(sets), 3) / BATCH
        print(f'{method:24}{single * 1e6:15.1f}{batch * 1e6:16.1f}{single / batch:9.1f}')


def solver_of(
    config: Config,
    arm: Arm,
    loads: Loads,
    stations: int = STATIONS,
    *,
    compiled: bool | None = None,
) -> Solver:
    """Return the solver exact of ``config`` with another ``arm`` and other ``loads``."""
    changed = dataclasses.replace(config, arm=arm, loads=loads)
    return changed.solver('exact', stations, compiled=compiled)


def compare_loaded(config: Config) -> None:
    """Compare the model exact, with gravity in water and a tip force, with `solve_bvp`."""
    arm = config.arm.with_density(1080.0)
    loads = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1000.0, tip_force=(0.0, 1e-3, 1e-3))
    solver = solver_of(config, arm, loads, compiled=False)
    tensions = np.array(FETCHING_IN_SPACE)
    fine = solver_of(config, arm, loads, 20 * STATIONS).solve(tensions).tip
    backbone = solver.solve(tensions)
    cold = median_time(lambda: solver.solve(tensions), 50)
    factors = iter(1.0 + 0.01 * np.sin(np.arange(1000.0)))
    warm = median_time(lambda: solver.solve(tensions * next(factors), start=backbone), 50)
    bvp = LoadedBvp(arm, tensions, loads, 'neo_hookean', config.base)
    # With this tolerance the errors of both are about equal.
    with np.errstate(all='ignore'):
        bvp_time = median_time(lambda: bvp.tip(tol=1e-4), 3)
        bvp_error = np.linalg.norm(bvp.tip(tol=1e-4) - fine) / arm.length
    error = tip_error(solver, tensions)
    derivatives = median_time(lambda: solver.sensitivity(backbone), 50)
    print('\nFigure 15 in water with a force of 1.4 mN on the tip, model exact')
    print(f'{"method":24}{"ms":>10}{"speedup":>9}{"tip error / L":>15}')
    print(f'{"solve_bvp":24}{bvp_time * 1e3:10.2f}{1.0:9.1f}{bvp_error:15.1e}')
    print(f'{"cold start":24}{cold * 1e3:10.2f}{bvp_time / cold:9.1f}{error:15.1e}')
    print(f'{"warm start":24}{warm * 1e3:10.2f}{bvp_time / warm:9.1f}')
    print(f'all sensitivities take the time of {derivatives / cold:.1f} solves')


def measure_weight(config: Config, forms: list[bool]) -> None:
    """Measure the arm under its weight, as ratios to one solve of closed_form."""
    arm, tensions = config.arm.with_density(1080.0), np.array(FETCHING_IN_SPACE)
    closed_form = Solver(arm, 'closed_form', STATIONS, compiled=forms[-1])
    unit = shortest_time(lambda: closed_form.solve(tensions), 1000)
    name = 'compiled closed_form' if forms[-1] else 'closed_form'
    print(f'\nFigure 15 with the weight of the arm; unit: a solve of {name}, {unit * 1e6:.1f} us')
    names = (
        'one solve',
        'warm start',
        'sensitivities',
        'covariance',
        'batch, warm',
        'batch, cold',
        'tip error / L',
    )
    print(f'{"exact":24}' + ''.join(f'{name:>15}' for name in names))
    for is_compiled in forms:
        for medium, loads in (
            ('without', Loads()),
            ('in water', Loads(gravity=GRAVITY, fluid_density=1000.0)),
            ('in air', Loads(gravity=GRAVITY)),
        ):
            solver = solver_of(config, arm, loads, compiled=is_compiled)
            label = f'{medium}{", compiled" if is_compiled else ""}'
            times = [value / unit for value in times_of(solver, tensions)]
            columns = ''.join(f'{value:15.1f}' for value in times)
            print(f'{label:24}{columns}{tip_error(solver, tensions):15.1e}')
    measure_stations_and_sections(config, forms[-1])
    measure_eight_arms(config, forms[-1])


def times_of(solver: Solver, tensions: np.ndarray) -> list[float]:
    """Return the times of the columns that `measure_weight` prints [s]."""
    cold = shortest_time(lambda: solver.solve(tensions), 100)
    last = solver.solve(tensions)
    # Changes of equal size, because otherwise the shortest time would belong to the smallest one.
    pair = 1.0 + 0.01 * np.resize([1.0, -1.0], 1000)
    factors = itertools.cycle(pair)
    batch = tensions * pair[: 3 if IS_BRIEF else 1000, np.newaxis, np.newaxis]

    def derivatives(work: Callable[[Backbone], object]) -> float:
        """Return the shortest time of ``work`` with new shapes, which have nothing cached [s]."""
        times = []
        for _ in range(min(100, MOST_REPEATS)):
            shape = solver.solve(next(factors) * tensions, start=last)
            times += _processor_times(functools.partial(work, shape), 1)
        return min(times)

    return [
        cold,
        shortest_time(lambda: solver.solve(next(factors) * tensions, start=last), 400),
        derivatives(solver.sensitivity),
        derivatives(lambda shape: solver.tip_covariance(shape, UNCERTAIN)),
        shortest_time(lambda: solver.solve(batch, start=last), 3) / len(batch),
        shortest_time(lambda: solver.solve(batch[:100]), 3) / len(batch[:100]),
    ]


def tip_error(solver: Solver, tensions: np.ndarray) -> float:
    """Return the error of the tip over the length; the reference has an accuracy of 1e-12."""
    finer = Solver(solver.arm, 'exact', base=solver.base, loads=solver.loads, accuracy=1e-12)
    fine = finer.solve(tensions).tip
    return float(np.linalg.norm(solver.solve(tensions).tip - fine) / solver.arm.length)


def measure_stations_and_sections(config: Config, is_compiled: bool) -> None:
    """Measure warm starts of a loaded arm by the numbers of stations and sections."""
    print('\nWarm starts in air, time in us')
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
        factors = itertools.cycle((0.99, 1.01))
        duration = shortest_time(lambda: solver.solve(next(factors) * pulls, start=last), 200)
        print(f'{stations:6} stations {len(case.sections):3} sections {duration * 1e6:10.1f}')


def measure_eight_arms(config: Config, is_compiled: bool) -> None:
    """Measure eight arms in air that fetch, with warm starts."""
    arm, tensions = config.arm.with_density(1080.0), np.array(FETCHING_IN_SPACE)
    loads = Loads(gravity=GRAVITY)
    solver = solver_of(config, arm, loads, compiled=is_compiled)
    steps = 3 if IS_BRIEF else 1000
    backbones = [solver.solve(0.0 * tensions)] * 8
    rounds = []
    for step in range(1, steps + 1):
        fraction = 0.5 - 0.5 * np.cos(np.pi * step / 1000.0)
        start = time.process_time()
        backbones = [solver.follow(fraction * tensions, backbone) for backbone in backbones]
        rounds.append(time.process_time() - start)
    mean, median = 1.0 / np.mean(rounds), 1.0 / np.median(rounds)
    print(
        f'\nEight arms in air that fetch in 1000 steps: {mean:.0f} Hz on one core, '
        f'{median:.0f} Hz by the median step'
    )


def measure_friction() -> None:
    """Compare solves of the prototype with and without friction."""
    arm = load_config(preset_path('renda2012_prototype')).arm
    tensions = np.array([[2.0, 0.3, 0.1, 0.2]])
    wrench = np.array([0.01, 0.02, -0.01, 0.0, 0.0, 0.0])
    print('\nFriction mu = 0.2 on the prototype, NumPy')
    print(f'{"method":24}{"without ms":>12}{"with ms":>12}{"ratio":>8}')
    cases = {'closed_form': None, 'exact': None, 'exact, tip force': wrench}
    for name, tip_wrench in cases.items():
        times = []
        for variant in (arm, dataclasses.replace(arm, friction=(0.2,))):
            solver = Solver(variant, name.partition(',')[0], compiled=False)
            times.append(median_time(functools.partial(solver.solve, tensions, tip_wrench), 100))
        without, rubbing = times
        print(f'{name:24}{1e3 * without:12.3f}{1e3 * rubbing:12.3f}{rubbing / without:8.1f}')


if __name__ == '__main__':
    main()
