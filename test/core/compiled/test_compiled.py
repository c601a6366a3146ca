"""Machine code gives the shapes that NumPy gives, and hands on what it cannot solve."""

from __future__ import annotations

import dataclasses
import itertools
import logging
import subprocess
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helical_arm import HELICAL
from hypothesis import given, settings
from hypothesis import strategies as st

from octo_arm_model import (
    Arm,
    Backbone,
    Body,
    Config,
    DistributedLoad,
    Loads,
    Material,
    PointLoad,
    Pose,
    ProfiledBody,
    Section,
    SolveError,
    Solver,
    Table,
    Uncertainty,
    load_config,
)
from octo_arm_model.analysis.winding.displacement import solve_displacements
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.presets import preset_path
from octo_arm_model.core.arm.loads import DeformedRod, Resultants, Tangent
from octo_arm_model.core.compiled import kernel_cache, kernel_compiler, numba_build
from octo_arm_model.core.compiled.models import frame_kernels, paper_kernels
from octo_arm_model.core.compiled.models.arm_tables import own
from octo_arm_model.core.compiled.section.section_tables import section_tables
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.budget import Budget, Spending
from octo_arm_model.core.loaded.continuation import follow
from octo_arm_model.core.loaded.linearised import TipAnswer
from octo_arm_model.core.loaded.stability import stability_of, tip_answer
from octo_arm_model.core.loaded.state import Condition, Stability
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.rod.picard import TOLERANCE
from octo_arm_model.rod.renda2012 import Renda2012
from octo_arm_model.core.rod.solution import Shape
from octo_arm_model.core.arm.highest_tensions import default_highest
from octo_arm_model.logs import show_logs

pytest.importorskip('numba')

FIELDS = ('position', 'quaternion', 'tau', 'xi', 'k', 'q', 'residual')
TABLE_4 = load_config(preset_path('renda2012_table4'))


def both(config: Config, model: str) -> tuple[Solver, Solver]:
    return config.solver(model, compiled=True), config.solver(model, compiled=False)


@pytest.fixture
def nothing_known(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[tuple[str, bool]]]:
    """As if numba had not been looked for yet, now and afterwards; what is logged then."""
    caches = numba_build.find_shapes, numba_build.fault
    monkeypatch.setattr(kernel_compiler, '_ANNOUNCED', set())
    logger = logging.getLogger('octo_arm_model')
    for name in ('handlers', 'level', 'propagate'):
        monkeypatch.setattr(logger, name, getattr(logger, name))
    logged: list[tuple[str, bool]] = []
    show_logs(lambda text, is_warning: logged.append((text, is_warning)))
    for cached in caches:
        cached.cache_clear()
    yield logged
    for cached in caches:
        cached.cache_clear()


def assert_alike(one: Backbone, other: Backbone) -> None:
    """Equal to rounding, on the scale of each quantity, where both took as many sweeps."""
    # Whether one more sweep is needed may be a matter of rounding.
    same = np.array_equal(one.iterations, other.iterations)
    tolerance = 1e-11 if same else 10.0 * TOLERANCE
    for name in FIELDS:
        a, b = getattr(one, name), getattr(other, name)
        assert a.shape == b.shape and a.dtype == b.dtype
        np.testing.assert_allclose(a, b, rtol=0.0, atol=tolerance * max(1.0, np.abs(b).max()))


def random_tensions(config: Config, count: int, part: float = 0.15) -> np.ndarray:
    """Sets of tensions of which each tendon's alone would compress the arm by up to ``part``."""
    highest = default_highest(config.arm, part)
    return np.random.default_rng(1).random((count, *highest.shape)) * highest


def test_every_arm_of_the_paper_comes_out_as_with_numpy(preset: Config, papers_model: str) -> None:
    machine, numpy = both(preset, papers_model)
    assert machine.is_compiled and not numpy.is_compiled
    tensions = random_tensions(preset, 60)
    assert_alike(machine.solve(tensions), numpy.solve(tensions))
    one, other = machine.solve(tensions[7]), numpy.solve(tensions[7])
    assert_alike(one, other)
    np.testing.assert_allclose(one.twist, other.twist, atol=1e-11)


@settings(max_examples=30)
@given(
    st.lists(st.floats(0.0, 6.0) | st.just(0.0), min_size=12, max_size=12),
    st.sampled_from(['renda2012', 'closed_form']),
    st.sampled_from([4, 51, 101, 300]),
)
def test_any_tensions_come_out_as_with_numpy(
    tensions: list[float], model: str, stations: int
) -> None:
    set_of_them = np.reshape(tensions, (3, 4))
    solvers = (TABLE_4.solver(model, stations, compiled=flag) for flag in (True, False))
    results: list[Backbone | str] = []
    for solver in solvers:
        try:
            results.append(solver.solve(set_of_them))
        except SolveError as error:
            results.append(str(error))
    one, other = results
    if isinstance(one, str) or isinstance(other, str):
        assert one == other
    else:
        assert_alike(one, other)


@pytest.mark.parametrize('lead', [(), (0,), (1,), (3,), (2, 3)])
def test_batches_have_the_shapes_of_single_arms(lead: tuple[int, ...], papers_model: str) -> None:
    solver = TABLE_4.solver(papers_model, compiled=True)
    tensions = random_tensions(TABLE_4, 6)[: int(np.prod(lead))].reshape(*lead, 3, 4)
    found = solver.solve(tensions)
    assert found.position.shape == (*lead, 101, 3) and found.residual.shape == lead
    assert found.tau.shape == (*lead, 101) and found.tensions.shape == (*lead, 3, 4)
    assert (found.twist is None) == (lead != ())
    for index in np.ndindex(lead):
        alone = solver.solve(tensions[index])
        for name in FIELDS:
            one, other = getattr(found, name)[index], getattr(alone, name)
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


def test_it_stands_on_the_base_and_answers_with_its_own_arrays() -> None:
    base = dataclasses.replace(
        TABLE_4.base, position=(0.1, -0.2, 0.3), quaternion=(0.5, 0.5, 0.5, 0.5)
    )
    config = dataclasses.replace(TABLE_4, base=base)
    machine, numpy = both(config, 'renda2012')
    found = machine.solve(FETCHING_IN_SPACE)
    assert_alike(found, numpy.solve(FETCHING_IN_SPACE))
    kept = found.position.copy()
    machine.solve(2.0 * np.array(FETCHING_IN_SPACE))
    np.testing.assert_array_equal(found.position, kept)
    for name in FIELDS:
        assert not getattr(found, name).flags.writeable


def test_sensitivities_of_its_solutions_are_those_of_numpy(papers_model: str) -> None:
    machine, numpy = both(TABLE_4, papers_model)
    one, other = (
        solver.sensitivity(solver.solve(FETCHING_IN_SPACE)).by_tension.pose
        for solver in (machine, numpy)
    )
    np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(other).max())


@pytest.mark.parametrize('part', [1e-5, 1e-3, 1e-2])
def test_derivatives_of_a_followed_arm_are_those_found_anew(part: float) -> None:
    arm, loads = TABLE_4.arm.with_density(1080.0), Loads(gravity=(0.0, 0.0, -9.81))
    followed, anew, numpy = (
        Solver(arm, 'exact', loads=loads, compiled=flag) for flag in (True, True, False)
    )
    tensions = np.array(FETCHING_IN_SPACE)
    last = followed.solve(tensions)
    for step in range(4):
        last = followed.follow((1.0 + part * step) * tensions, last)
        found = followed.sensitivity(last)
        for other, relative in ((anew.sensitivity(last), 1e-12), (numpy.sensitivity(last), 1e-9)):
            for one, two in (
                (found.by_tension, other.by_tension),
                (found.by_offset, other.by_offset),
            ):
                assert one is not None and two is not None
                scale = np.abs(two.pose).max()
                np.testing.assert_allclose(one.pose, two.pose, atol=relative * scale)
        assert last.residual <= Budget().residual


@pytest.mark.parametrize('residual', [1e-9, 1e-11])
@pytest.mark.parametrize('fluid', [0.0, 1000.0])
@pytest.mark.parametrize('part', [1e-4, 1e-2, 1e-1])
def test_a_followed_arm_is_where_one_found_exactly_is(
    part: float, fluid: float, residual: float
) -> None:
    arm = TABLE_4.arm.with_density(1080.0)
    loads = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=fluid)
    followed, exact = (
        Solver(arm, 'exact', loads=loads, compiled=flag, budget=Budget(residual=residual))
        for flag in (True, False)
    )
    rng = np.random.default_rng(3)
    tensions = np.array(FETCHING_IN_SPACE)
    last = followed.solve(tensions)
    for _ in range(20):
        tensions = tensions * (1.0 + part * rng.uniform(-1.0, 1.0, tensions.shape))
        last = followed.follow(tensions, last)
        other = exact.solve(tensions, start=last)
        assert last.residual <= residual
        assert other.residual <= 1e-11
        away = np.linalg.norm(last.position - other.position, axis=1).max()
        assert away <= 1e-7 * arm.length


@pytest.mark.parametrize('law', ['neo_hookean', 'linear'])
@pytest.mark.parametrize('arm', [TABLE_4.arm, HELICAL], ids=['table 4', 'helical'])
@pytest.mark.parametrize(
    'loads',
    [Loads(), Loads(gravity=(0.0, 0.0, -9.81), fluid_density=900.0, tip_force=(0.0, 1e-3, 1e-3))],
    ids=['unloaded', 'loaded'],
)
def test_exact_comes_out_as_with_numpy(arm: Arm, law: str, loads: Loads) -> None:
    arm = arm.with_density(1080.0)
    machine, numpy = (
        Solver(arm, 'exact', material=law, loads=loads, compiled=flag) for flag in (True, False)
    )
    assert machine.is_compiled and not numpy.is_compiled
    random = np.random.default_rng(1)
    tensions = random.random((6, *arm.tension_shape)) * random.integers(0, 2, arm.tension_shape)
    one, other = machine.solve(tensions), numpy.solve(tensions)
    # Both are balanced to the same tolerance, without loads machine code to rounding.
    tolerance = 1e-9 if loads.any else 1e-11
    for name in ('position', 'quaternion', 'tau', 'xi', 'k', 'q'):
        a, b = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(a, b, rtol=0.0, atol=tolerance * max(1.0, np.abs(b).max()))
    assert one.residual.max() < 1e-10
    alone = machine.solve(tensions[3])
    np.testing.assert_allclose(alone.position, one.position[3], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(
        machine.sensitivity(alone).by_tension.pose,
        numpy.sensitivity(numpy.solve(tensions[3])).by_tension.pose,
        atol=1e-7,
    )


HANGING = Loads(
    gravity=(0.0, 2.0, -9.81),
    fluid_density=900.0,
    tip_force=(0.0, 1e-3, 1e-3),
    points=(PointLoad(0.2, (0.0, 1e-3, 0.0)),),
)


@pytest.mark.parametrize('law', ['neo_hookean', 'linear'])
@pytest.mark.parametrize('arm', [TABLE_4.arm, HELICAL], ids=['table 4', 'helical'])
@pytest.mark.parametrize('loads', [Loads(), HANGING], ids=['unloaded', 'loaded'])
def test_derivatives_come_out_as_with_numpy(arm: Arm, law: str, loads: Loads) -> None:
    arm = arm.with_density(1080.0)
    base = Pose((0.1, 0.2, 0.3), (0.5, 0.5, -0.5, 0.5))
    machine, numpy = (
        Solver(arm, 'exact', 41, base, material=law, loads=loads, compiled=flag)
        for flag in (True, False)
    )
    tensions = np.random.default_rng(2).random(arm.tension_shape)
    tensions.flat[1] = 0.0
    backbone = machine.solve(tensions)
    one, other = machine.sensitivity(backbone), numpy.sensitivity(backbone)
    pairs = [(getattr(one, name), getattr(other, name)) for name in vars(one)]
    # Where no load acts yet, and several kinds of them.
    each = (
        Loads(gravity=(1.0, 0.0, 2.0), tip_moment=(1e-3, 0.0, 2e-3)),
        Loads(distributed=(DistributedLoad((0.0, arm.length), ((0, 1, 0), (1, 0, 1))),)),
        Loads(tip_force=(0.0, 1.0, 0.0)),
    )
    pairs.append(tuple(way.sensitivity_to_loads(backbone, each) for way in (machine, numpy)))
    compared = 0
    for quick, slow in pairs:
        assert (quick is None) == (slow is None)
        if quick is None:
            continue
        compared += 1
        for name in vars(quick):
            a, b = getattr(quick, name), getattr(slow, name)
            assert (a is None) == (b is None) == (name == 'tendon_tension')
            if a is None:
                continue
            assert a.shape == b.shape
            np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-10 * np.abs(b).max())
    assert compared == 6


def test_what_points_do_not_resolve_is_found_at_all_nodes() -> None:
    profile = Table((0.0, 0.1, 0.2, 0.4), (0.016, 0.012, 0.015, 0.009))
    arm = Arm(Material(1.1e5), ProfiledBody(0.4, profile), HELICAL.sections)
    machine, numpy = (Solver(arm, 'exact', compiled=flag) for flag in (True, False))
    tensions = np.array([[0.2, 0.1, 0.0], [0.5, 0.0, 0.4]])
    np.testing.assert_allclose(
        machine.solve(tensions).position, numpy.solve(tensions).position, atol=1e-10
    )


# Where it hands on -------------------------------------------------------------------------------


def test_arms_too_hard_for_one_element_are_solved_in_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine, numpy = both(TABLE_4, 'renda2012')
    tensions = random_tensions(TABLE_4, 4)
    # Sweeps over a whole panel diverge, see `test_renda2012`.
    tensions[2] = [[0, 0, 0.5, 0], [0, 4, 4, 0], [0, 0, 0, 0]]
    handed_on = []
    original = Renda2012.solve

    def watched(self: Renda2012, given: np.ndarray) -> object:
        handed_on.append(given)
        return original(self, given)

    monkeypatch.setattr(Renda2012, 'solve', watched)
    found = machine.solve(tensions)
    assert len(handed_on) == 1
    np.testing.assert_array_equal(handed_on[0].reshape(3, 4), tensions[2])
    assert_alike(found, numpy.solve(tensions))
    alone = machine.solve(tensions[2])
    np.testing.assert_allclose(alone.position, found.position[2], atol=1e-12)


def test_an_arm_compressed_to_nothing_is_refused_by_name(papers_model: str) -> None:
    machine, numpy = both(TABLE_4, papers_model)
    tensions = random_tensions(TABLE_4, 5)
    tensions[3] = default_highest(TABLE_4.arm, 2.0)
    tensions[4] = default_highest(TABLE_4.arm, 3.0)
    messages = []
    for solver in (machine, numpy):
        with pytest.raises(SolveError) as e:
            solver.solve(tensions)
        messages.append(str(e.value))
    assert 'compress the arm to nothing' in messages[0]
    assert messages[0] == messages[1] and 'in set 3' in messages[0]


def test_what_the_loops_do_not_cover_is_solved_by_numpy(rod: Config) -> None:
    assert not rod.solver('closed_form', compiled=True).is_compiled
    shearing = Solver(TABLE_4.arm, 'exact', material='linear', shear=True, compiled=True)
    assert not shearing.is_compiled
    tensions = random_tensions(rod, 2)
    one, other = (
        rod.solver('closed_form', compiled=flag).solve(tensions) for flag in (True, False)
    )
    np.testing.assert_allclose(one.position, other.position, atol=1e-12)


# The loops themselves ----------------------------------------------------------------------------


def test_as_plain_python_the_loops_do_the_same() -> None:
    """Their arithmetic is what is written, whatever the compiler makes of it."""
    solver = TABLE_4.solver('renda2012', 4, compiled=True)
    found = solver.solve(FETCHING_IN_SPACE)
    assert solver._compiled is not None and found.twist is not None
    twist = np.empty_like(found.twist)
    residual, sweeps = paper_kernels.find_twist(
        solver._compiled._tables, np.ravel(FETCHING_IN_SPACE), twist
    )
    np.testing.assert_allclose(twist, found.twist, atol=1e-12 * np.abs(twist).max())
    assert sweeps == found.iterations
    np.testing.assert_allclose(residual, found.residual, rtol=1e-4)


def test_two_stations_at_one_node_are_both_filled_in() -> None:
    solver = TABLE_4.solver('closed_form', 11, compiled=True)
    assert solver._compiled is not None
    found = solver.solve(FETCHING_IN_SPACE)
    grid = solver._compiled._grid
    station_node = grid.station_node.copy()
    station_node[3] = station_node[2]
    position, quaternion = np.full((11, 3), np.nan), np.full((11, 4), np.nan)
    twist = np.array(found.twist)
    frame_kernels.integrate_twist(
        grid._replace(station_node=station_node), twist, position, quaternion
    )
    expected = found.position.copy()
    expected[3] = expected[2]
    np.testing.assert_allclose(position, expected, atol=1e-12)
    assert np.isfinite(quaternion).all()


def test_a_stretch_that_is_not_a_number_is_no_answer() -> None:
    solver = TABLE_4.solver('closed_form', compiled=True)
    assert solver._compiled is not None
    twist = np.empty((4, solver.grid.nodes.size))
    _, sweeps = paper_kernels.find_twist(solver._compiled._tables, np.full(12, np.nan), twist)
    assert sweeps < 0


# The compiler ------------------------------------------------------------------------------------


def test_one_compilation_is_for_every_arm_and_batch(papers_model: str, preset: Config) -> None:
    solver = preset.solver(papers_model, 31, compiled=True)
    for count in (0, 1, 5):
        solver.solve(random_tensions(preset, count))
    solver.solve(random_tensions(preset, 1)[0])
    assert len(numba_build.find_shapes().signatures) == 1


def all_kernels() -> dict[str, Any]:
    return {name: made() for name, made in numba_build.KERNELS.items()}


@pytest.fixture
def loaded_anew() -> Iterator[dict[str, Any]]:
    """Every kernel as a process has it that has solved nothing yet, now and afterwards."""
    for made in numba_build.KERNELS.values():
        made.cache_clear()
    yield all_kernels()
    for made in numba_build.KERNELS.values():
        made.cache_clear()


class TipPull:
    """A `Load` that the kernels do not know: a constant force on the tip."""

    knots: tuple[float, ...] = ()
    breaks: tuple[float, ...] = ()

    def resultants(self, rod: DeformedRod) -> Resultants:
        """The force, and no free moment."""
        force = np.zeros((3, rod.s.size))
        force[2] = 0.05
        return Resultants(force, np.zeros_like(force))

    def tangents(self, rod: DeformedRod) -> tuple[Tangent, ...]:
        """It is fixed in base_frame."""
        return ()


def test_one_version_of_every_kernel_serves_all_work(loaded_anew: dict[str, Any]) -> None:
    """Another one would be compiled in the middle of a run, and spoil the file that is kept."""
    weight = Loads(gravity=(0.0, 0.0, -9.81))
    plain = HELICAL.with_density(1080.0)
    sheathed = dataclasses.replace(plain, sheath_stiffness=(2e6,) * len(plain.tendons))
    rough = dataclasses.replace(plain, friction=(0.2,))
    both = dataclasses.replace(sheathed, friction=(0.2,))
    one = np.array([[0.3, 0.0, 0.1], [0.2, 0.4, 0.0]])
    one.setflags(write=False)
    several = np.asfortranarray(np.stack([one, 0.5 * one, 0.2 * one]))
    several.setflags(write=False)
    wrench = np.array([0.01, 0.0, 0.02, 0.0, 1e-4, 0.0])
    wrench.setflags(write=False)
    for arm, model, loads in [
        (plain, 'exact', Loads()), (plain, 'exact', weight),
        (plain, 'exact', Loads(others=(TipPull(),))), (sheathed, 'exact', Loads()),
        (sheathed, 'exact', weight), (rough, 'closed_form', Loads()), (rough, 'exact', Loads()),
        (rough, 'exact', weight), (both, 'exact', Loads()), (both, 'exact', weight),
    ]:  # fmt: skip
        solver = Solver(arm, model, 21, loads=loads, compiled=True)
        for batch in (several[:0], several[:1], several):
            solver.solve(batch)
        found = solver.solve(one)
        solver.tendon_lengths(found)
        solver.sensitivity(found)
        solver.tip_covariance(found, Uncertainty(tension=0.1))
        solver.follow(one[:, ::-1], found)
        if model == 'exact':
            found = solver.solve(one, wrench)
            solver.tip_covariance(found, Uncertainty(tension=0.1))
            solver.follow(one, found, 0.5 * wrench)
            solver.solve(several, np.stack(3 * [wrench]))
            if not (arm.friction or loads.others):
                solver.sensitivity_to_loads(found, [weight])
                name = arm.tendon_names[0]
                held = solve_displacements(solver, {name: 1e-3})
                solve_displacements(solver, {name: 1.1e-3}, start=held)
    for model in ('closed_form', 'renda2012'):
        solver = TABLE_4.solver(model, 21, compiled=True)
        for count in (0, 1, 5):
            solver.solve(random_tensions(TABLE_4, count))
        found = solver.follow(FETCHING_IN_SPACE, None)
        solver.tendon_lengths(found)
        solver.sensitivity(found)
    versions = {name: len(machine.signatures) for name, machine in loaded_anew.items()}
    assert versions == dict.fromkeys(versions, 1)
    for machine in loaded_anew.values():
        assert all(map(kernel_cache.is_whole, kernel_cache.kept_files(machine)))


def test_what_it_is_made_from_decides_whether_it_is_made_anew() -> None:
    files = {Path(file).name for file in kernel_compiler.sources(paper_kernels.find_shapes)}
    assert files >= {'paper_kernels.py', 'arm_tables.py', 'picard.py', 'kinematics.py'}
    assert files >= {'quaternion.py', 'paper_balance.py', 'kernel_compiler.py'}
    assert 'rod_kernels.py' not in files


def test_nothing_that_is_compiled_is_left_out_of_that() -> None:
    known = set()

    def check(function: types.FunctionType, sources: set[str]) -> None:
        code = function.__code__
        if code in known:
            return
        known.add(code)
        assert code.co_filename in sources, f'{code.co_name} in {code.co_filename}'
        for name in code.co_names:
            called = getattr(function.__globals__.get(name), 'py_func', None)
            if called is not None:
                check(called, sources)

    for machine in all_kernels().values():
        check(machine.py_func, set(kernel_compiler.sources(machine.py_func)))
    assert len(known) > 100


def test_no_result_takes_python_to_be_made() -> None:
    # A signal's handler that raises there would end the process, see `rod_kernels.balance`.
    for name, machine in all_kernels().items():
        (signature,) = machine.nopython_signatures
        assert not hasattr(signature.return_type, 'instance_class'), f'{name} gives a NamedTuple'


def test_it_is_kept_and_found_again(nothing_known: list[tuple[str, bool]]) -> None:
    machine = numba_build.find_shapes()
    assert kernel_cache.kept_files(machine)
    # Loaded, and so nothing to say.
    assert sum(machine.stats.cache_hits.values()) == 1 and not nothing_known


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Compiles next to nothing, and keeps it in a folder of its own, which this is."""

    def find_shapes(*arguments: object) -> int:
        return len(arguments)

    numba = sys.modules['numba']
    monkeypatch.setattr(numba.config, 'CACHE_DIR', str(tmp_path))
    find_shapes.__qualname__ = 'find_shapes'
    monkeypatch.setattr(kernel_compiler, '_entry', lambda numba, function: find_shapes)
    return tmp_path


@pytest.mark.endurance
def test_what_one_process_compiles_another_loads() -> None:
    """A kernel whose first call fails would be compiled by every process again."""
    pytest.importorskip('numba')
    script = (
        'from octo_arm_model.core.compiled.numba_build import KERNELS\n'
        'for name, made in KERNELS.items():\n'
        '    print(name, sum(made().stats.cache_misses.values()))\n'
    )
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, '-c', script], capture_output=True, text=True, check=True
        )
    compiled = dict(line.split() for line in done.stdout.splitlines())
    assert len(compiled) > 10 and set(compiled.values()) == {'0'}


@pytest.mark.endurance
def test_kernels_are_compiled_side_by_side_and_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    few = {name: numba_build.KERNELS[name] for name in ('find_lengths', 'find_turn')}
    monkeypatch.setattr(numba_build, 'KERNELS', few)
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))
    numba_build.make_side_by_side()
    kept = {path.name.split('.')[1].rsplit('_', 1)[0] for path in tmp_path.rglob('*.nbc')}
    assert kept == set(few)


@pytest.mark.parametrize('suffix', ['nbi', 'nbc'])
def test_what_was_kept_but_not_whole_is_made_anew(
    quick: Path, suffix: str, nothing_known: list[tuple[str, bool]]
) -> None:
    numba_build.find_shapes()
    (kept,) = quick.rglob(f'*.{suffix}')
    size = kept.stat().st_size
    kept.write_bytes(kept.read_bytes()[: size // 2])
    numba_build.find_shapes.cache_clear()
    assert numba_build.is_available()
    assert kept.stat().st_size == size
    assert [text for text, _ in nothing_known] == 2 * [
        'compiling the models: a minute or two, once on this machine'
    ]


@pytest.mark.parametrize('suffix', ['nbi', 'nbc', 'nbi.sha256', 'nbc.sha256'])
def test_of_what_was_kept_not_one_bit_may_differ(
    quick: Path,
    suffix: str,
    monkeypatch: pytest.MonkeyPatch,
    nothing_known: list[tuple[str, bool]],
) -> None:
    numba_build.find_shapes()
    (kept,) = quick.rglob(f'*.{suffix}')
    data = bytearray(kept.read_bytes())
    data[2 * len(data) // 3] ^= 1
    kept.write_bytes(data)
    # Never unpickled, and so never run.
    caching = pytest.importorskip('numba.core.caching')
    loaded = []
    original = caching.IndexDataCacheFile._load_data

    def watched(self: object, name: str) -> object:
        loaded.append(name)
        return original(self, name)

    monkeypatch.setattr(caching.IndexDataCacheFile, '_load_data', watched)
    numba_build.find_shapes.cache_clear()
    machine = numba_build.find_shapes()
    assert not loaded and sum(machine.stats.cache_misses.values()) == 1
    numba_build.find_shapes.cache_clear()
    assert sum(numba_build.find_shapes().stats.cache_hits.values()) == 1 and len(loaded) == 1
    assert [text for text, _ in nothing_known] == 2 * [
        'compiling the models: a minute or two, once on this machine'
    ]


def test_where_nothing_can_be_kept_it_compiles_all_the_same(
    quick: Path, monkeypatch: pytest.MonkeyPatch, nothing_known: list[tuple[str, bool]]
) -> None:
    caching = pytest.importorskip('numba.core.caching')

    def full(*arguments: object, **options: object) -> None:
        raise OSError('No space left on device')

    monkeypatch.setattr(caching.IndexDataCacheFile, 'save', full)
    assert numba_build.is_available() and numba_build.find_shapes().signatures

    def nowhere(*arguments: object, **options: object) -> None:
        raise RuntimeError('cannot cache function: no locator available')

    monkeypatch.setattr(caching.CacheImpl, '__init__', nowhere)
    numba_build.find_shapes.cache_clear()
    numba_build.fault.cache_clear()
    assert numba_build.is_available() and numba_build.find_shapes().signatures
    assert not any(is_warning for _, is_warning in nothing_known)


def test_without_numba_it_says_so_if_asked_for(
    monkeypatch: pytest.MonkeyPatch, nothing_known: list[tuple[str, bool]]
) -> None:
    monkeypatch.setitem(sys.modules, 'numba', None)
    with pytest.raises(ModuleNotFoundError, match='numba'):
        TABLE_4.solver(compiled=True)
    assert not TABLE_4.solver(compiled=None).is_compiled
    assert numba_build.fault() == '' and not nothing_known


def test_a_numba_that_does_not_work_is_done_without(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, nothing_known: list[tuple[str, bool]]
) -> None:
    (tmp_path / 'numba.py').write_text("raise ImportError('Numba needs NumPy 2.3 or less')")
    monkeypatch.delitem(sys.modules, 'numba')
    monkeypatch.syspath_prepend(tmp_path)
    assert not TABLE_4.solver(compiled=None).is_compiled
    why = 'ImportError: Numba needs NumPy 2.3 or less'
    assert nothing_known == [(f'solving without numba, which does not work: {why}', True)]
    with pytest.raises(ImportError, match='Numba needs'):
        TABLE_4.solver(compiled=True)


def test_a_numba_told_not_to_compile_is_done_without(
    monkeypatch: pytest.MonkeyPatch, nothing_known: list[tuple[str, bool]]
) -> None:
    monkeypatch.setattr(sys.modules['numba'].config, 'DISABLE_JIT', 1)
    assert not TABLE_4.solver(compiled=None).is_compiled
    assert numba_build.fault() == 'RuntimeError: NUMBA_DISABLE_JIT is set'


def test_sections_with_sheaths_are_settled_at_large_bends() -> None:
    arm = load_config(preset_path('renda2012_prototype')).arm
    stiffness = 5.0 * float(arm.material.youngs_modulus)
    arm = dataclasses.replace(arm, sheath_stiffness=(stiffness,) * len(arm.tendons))
    tensions = np.array([0.0, 0.0, 16.0, 16.0])
    statics = Solver(arm, 'exact')._statics
    assert isinstance(statics, Exact)
    tables = own(section_tables(statics.unloaded.at_points))
    twist = np.empty((4, tables.axial.size))
    residual, steps = numba_build.find_minima()(tables, tensions, twist)
    assert residual <= TOLERANCE and steps >= 0


def test_newtons_method_of_a_loaded_rod_is_that_of_numpy() -> None:
    loads = Loads(gravity=(0.0, 2.0, -5.0), points=(PointLoad(0.2, (0.0, 0.01, 0.0)),))
    machine, numpy = (
        Solver(HELICAL, 'exact', loads=loads, compiled=flag)._statics for flag in (True, False)
    )
    assert isinstance(machine, Exact) and isinstance(numpy, Exact)
    tensions = np.linspace(0.1, 0.6, 6)
    condition = Condition(tensions, np.array([0.0, 1e-3, 2e-3, 0.0, 0.0, 0.0]), 1.0)
    shape = numpy._rod(0).unloaded(tensions)
    one, other = (statics._rod(0).newton(condition, shape, 1e-11) for statics in (machine, numpy))
    assert abs(one.iterations - other.iterations) <= 1 and one.iterations > 2
    assert one.corrected == pytest.approx(other.corrected, rel=1e-3)
    problem = numpy._rod(0).equilibrium
    names = 'rotation', 'tangent', 'moment', 'force'
    pairs = [(getattr(one.state, name), getattr(other.state, name)) for name in names]
    for a, b in (*pairs, (one.state.hessian, problem.hessian(other.state))):
        np.testing.assert_allclose(a, b, atol=1e-9 * np.abs(b).max())
    assert one.system == stability_of(problem, other.state) == Stability(True, 1, None)


def test_without_an_energy_the_tip_answers_wrenches_as_by_numpy() -> None:
    loads = Loads(gravity=(0.0, 2.0, -5.0), tip_moment=(1e-4, 0.0, 2e-4))
    machine, numpy = (
        Solver(HELICAL, 'exact', loads=loads, compiled=flag)._statics for flag in (True, False)
    )
    assert isinstance(machine, Exact) and isinstance(numpy, Exact)
    tensions = np.linspace(0.1, 0.6, 6)
    condition = Condition(tensions, np.append(np.zeros(3), loads.tip_moment), 1.0)
    rod, problem = machine._rod(0), numpy._rod(0).equilibrium
    shape = rod.newton(condition, rod.unloaded(tensions), 1e-11).state.shape
    # Nothing is left to do.
    again = rod.newton(condition, shape, 1e-11)
    state = problem.state(condition, shape)
    answer = tip_answer(problem, state, problem.linearised(state))
    assert again.iterations == 0 and isinstance(again.system, TipAnswer)
    assert again.system.sign == answer.sign == 1
    for name in ('compliance', 'twist'):
        a, b = getattr(again.system, name), getattr(answer, name)
        np.testing.assert_allclose(a, b, atol=1e-8 * np.abs(b).max())


def test_a_step_from_the_last_balance_ends_where_one_from_its_copy_does() -> None:
    # What was factorised for the last balance makes the first step from it alone.
    loads = Loads(gravity=(0.0, 2.0, -5.0))
    solver = Solver(HELICAL, 'exact', loads=loads, compiled=True)
    tensions = np.linspace(0.1, 0.6, 6).reshape(2, 3)
    last = solver.solve(tensions)
    assert last.shape is not None
    copy = dataclasses.replace(last, shape=last.shape._replace(twist=last.shape.twist.copy()))
    for part in (1.0, 1.01, 1.3, 0.3):
        one, other = (solver.solve(part * tensions, start=start) for start in (last, copy))
        np.testing.assert_allclose(one.position, other.position, atol=1e-12)
        np.testing.assert_allclose(one.k, other.k, atol=1e-10)


@pytest.mark.parametrize('friction', [(), (0.2,)])
def test_what_was_factorised_stays_known_as_long_as_arms_are_followed_from_it(
    friction: tuple[float, ...],
) -> None:
    arm = dataclasses.replace(HELICAL, friction=friction)
    solver = Solver(arm, 'exact', loads=Loads(gravity=(0.0, 2.0, -5.0)), compiled=True)
    tensions = np.linspace(0.1, 0.6, 6).reshape(2, 3)
    last = solver.solve(tensions)
    statics = solver._statics
    assert isinstance(statics, Exact) and last.shape is not None
    settle = statics._rod(statics.rods.level_of(last.shape.twist)).settle
    assert isinstance(settle, types.MethodType)
    for part in np.linspace(1.0, 1.1, 40):
        solver.solve(part * tensions, start=last)
    assert settle.__self__.known_about(last.shape) is not None


def test_small_movements_are_made_by_the_system_before_until_they_add_up() -> None:
    loads = Loads(gravity=(0.0, 2.0, -5.0))
    solver = Solver(HELICAL, 'exact', loads=loads, compiled=True)
    tensions = np.linspace(0.1, 0.6, 6).reshape(2, 3)
    found = solver.solve(tensions)
    statics = solver._statics
    assert isinstance(statics, Exact) and found.shape is not None
    settle = statics._rod(statics.rods.level_of(found.shape.twist)).settle
    assert isinstance(settle, types.MethodType)
    systems = []
    for part in np.linspace(1.0, 1.1, 400):
        found = solver.solve(part * tensions, start=found)
        assert found.shape is not None
        known = settle.__self__.known_about(found.shape)
        assert known.turned <= 0.1 and known.changed <= 0.02
        systems.append(known.system)
    new = np.count_nonzero([a is not b for a, b in itertools.pairwise(systems)])
    assert 3 <= new < 200
    fresh = Solver(HELICAL, 'exact', loads=loads, compiled=True).solve(1.1 * tensions)
    np.testing.assert_allclose(found.position, fresh.position, atol=1e-11)
    np.testing.assert_allclose(found.k, fresh.k, atol=1e-9)


def test_derivatives_by_several_things_are_those_by_each_alone() -> None:
    arm = TABLE_4.arm.with_density(1080.0)
    loads = Loads(gravity=(0.0, 0.0, -9.81))
    tensions, push = 0.5 * np.array(FETCHING_IN_SPACE), [Loads(tip_force=(1.0, 0.0, 0.0))]
    ways = (
        lambda solver, shape: solver.tip_covariance(shape, Uncertainty(tension=0.1)),
        lambda solver, shape: solver.sensitivity(shape).compliance,
        lambda solver, shape: solver.sensitivity_to_loads(shape, push).strain,
    )

    def found(*these: int) -> list[FloatArray]:
        solver = Solver(arm, 'exact', 21, TABLE_4.base, loads=loads, compiled=True)
        shape = solver.solve(1.01 * tensions, start=solver.solve(tensions))
        return [ways[number](solver, shape) for number in these]

    for alone, together in zip((found(number)[0] for number in range(3)), found(0, 1, 2)):
        np.testing.assert_allclose(together, alone, rtol=1e-9, atol=1e-9 * np.abs(alone).max())


def test_elements_that_turn_far_are_cut_however_even_their_twist() -> None:
    arm = Arm(Material(1e5), Body(0.3, 0.003, 0.003), (Section(0.3, 0.0028, 0.0028),))
    tensions, wrench = [[0.4, 0.0, 0.0, 0.0]], [0.0, 0.0, 1e-12, 0.0, 0.0, 0.0]
    plain, quick = (
        Solver(arm, 'exact', 21, compiled=compiled).solve(tensions, tip_wrench=wrench)
        for compiled in (False, True)
    )
    unloaded = Solver(arm, 'exact', 1601).solve(tensions)
    assert plain.shape is not None and quick.shape is not None
    assert plain.shape.twist.shape == quick.shape.twist.shape
    np.testing.assert_allclose(quick.position, plain.position, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(quick.position, unloaded.position[::80], rtol=0.0, atol=6e-8)


def test_a_stable_balance_that_elements_do_not_resolve_is_gone_on_from() -> None:
    arm = TABLE_4.arm.with_density(5000.0)
    loads = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1000.0)
    solver = Solver(arm, 'exact', 21, TABLE_4.base, loads=loads, compiled=True)
    statics, tensions = solver._statics, np.array(FETCHING_IN_SPACE)
    assert isinstance(statics, Exact)
    rod, spending = statics._rod(0), Spending(Budget())
    assert rod.settle is not None
    known = rod.unloaded(tensions.ravel())
    wanted = Condition(tensions.ravel(), np.zeros(6), 1.0)
    state = follow(
        rod.equilibrium, rod.newton, wanted._replace(factor=0.0), known, wanted, spending
    )
    found = rod.settle(wanted, state.shape, Spending(Budget()))
    assert isinstance(found, Shape) and not rod.resolves(found)
    # So that no more than a few steps on finer elements are left.
    fine = solver.solve(tensions)
    assert fine.shape is not None and fine.shape.twist.shape[1] > rod.points
    again = solver.solve(tensions, start=dataclasses.replace(fine, shape=found))
    assert again.iterations < 8
    np.testing.assert_allclose(again.position, fine.position, atol=1e-10)
