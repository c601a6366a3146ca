"""Physics of every model, and the behaviour of `Solver`."""

import copy
import dataclasses
import math
import pickle
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from rods import HELICAL, PULL, helical_arm
from scipy.spatial.transform import Rotation
from strategies import scaled

from octo_arm_model import (
    MODELS,
    Arm,
    Body,
    Config,
    ConfigError,
    Discs,
    LoadError,
    Loads,
    Material,
    OctoArmError,
    PointLoad,
    Pose,
    Section,
    SolveError,
    Solver,
    TensionError,
    TipPose,
    load_config,
    solve,
    solve_displacements,
)
from octo_arm_model.analysis.inverse import find_tensions
from octo_arm_model.analysis.targets import Stiffness, TipPosition
from octo_arm_model.analysis.workspace import sample_workspace
from octo_arm_model.arm.limits import MAX_STATIONS, Budget
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_SPACE

# Different tensions, so that all sections bend in different planes.
MIXED = np.array([[0.1, 0.3, 0.0, 0.05], [1.0, 0.2, 0.0, 2.0], [0.0, 5.0, 1.0, 2.0]])
SHORT = Arm(
    Material(1.1e5),
    Body(0.45, 0.015, 0.004),
    (Section(0.3, 0.0075, 0.002), Section(0.15, 0.006, 0.006)),
)


# Facts of section 5 of the model's description -------------------------------------------------


def test_tensions_of_the_next_tendons_rotate_the_shape_by_90_degrees(table4, model):
    solver = Solver(table4.arm, model)
    before, after = solver.solve(MIXED), solver.solve(np.roll(MIXED, 1, axis=1))
    x, y, z = before.position.T
    assert_allclose(after.position, np.stack([x, -z, y], axis=1), atol=1e-8)
    assert_allclose(after.tau, before.tau, atol=1e-6)
    assert_allclose(after.q, before.q, atol=1e-9)


@pytest.mark.parametrize('panel', BENDING)
def test_bending_plane_equals_the_papers_law(table2, model, panel):
    t1, t2, t3, t4 = BENDING[panel][0]
    law = math.degrees(math.atan2(t3 - t1, t2 - t4))
    tip = table2.solver(model).solve(BENDING[panel]).tip
    # The paper's base has n = (0, -1, 0) and b = (0, 0, -1).
    assert math.degrees(math.atan2(tip[1], -tip[2])) == pytest.approx(law, abs=0.3)
    # Exact to rounding with parallel tendons, whose paths are not approximated.
    sections = tuple(
        Section(one.anchorage, one.offset_anchorage, one.offset_anchorage)
        for one in table2.arm.sections
    )
    parallel = dataclasses.replace(table2.arm, sections=sections)
    tip = Solver(parallel, 'exact', base=table2.base).solve(BENDING[panel]).tip
    assert math.degrees(math.atan2(tip[1], -tip[2])) == pytest.approx(law, abs=1e-7)


@pytest.mark.parametrize(('c', 'young'), [(0.1, 1.1e5), (100.0, 1.1e5), (3.0, 3.3e5)])
def test_shape_scales_with_size_stiffness_and_tension(table4, model, c, young):
    large = dataclasses.replace(scaled(table4.arm, c), material=Material(young))
    before = Solver(table4.arm, model).solve(MIXED)
    after = Solver(large, model).solve(c**2 * young / 1.1e5 * MIXED)
    assert_allclose(after.position / c, before.position, atol=1e-8 * table4.arm.length)
    assert_allclose(after.q, before.q, atol=1e-9)
    for name in ('tau', 'xi', 'k'):
        assert_allclose(getattr(after, name) * c, getattr(before, name), atol=1e-5)


# The straight arm, and the part beyond the last anchorage --------------------------------------


def test_arm_without_tension_is_exactly_straight(preset, model):
    solver = Solver(preset.arm, model)
    backbone = solver.solve(np.zeros(preset.arm.tension_shape))
    for strain in (backbone.tau, backbone.xi, backbone.k, backbone.q):
        assert_array_equal(strain, 0.0)
    assert_allclose(backbone.position[:, 0], backbone.s, rtol=1e-12)
    assert_array_equal(backbone.position[:, 1:], 0.0)
    assert_array_equal(backbone.quaternion, np.tile([0, 0, 0, 1.0], (101, 1)))


def test_arm_is_straight_beyond_the_last_anchorage(model):
    backbone = Solver(SHORT, model).solve([[0.3, 0.1, 0, 0], [0, 0, 2.0, 1.0]])
    beyond = backbone.section == 0
    assert_array_equal(beyond, backbone.s > 0.3)
    for strain in (backbone.tau, backbone.xi, backbone.k, backbone.q):
        assert_array_equal(strain[beyond], 0.0)
    start = np.flatnonzero(beyond)[0] - 1
    tangent = Rotation.from_quat(backbone.quaternion[start]).apply([1.0, 0.0, 0.0])
    expected = backbone.position[start] + np.outer(backbone.s[beyond] - 0.3, tangent)
    assert_allclose(backbone.position[beyond], expected, atol=1e-12)


# Base, batches, stations -----------------------------------------------------------------------


def test_base_pose_moves_the_shape_rigidly(table4, model):
    rotation = Rotation.from_euler('xyz', [0.3, -1.1, 2.0])
    base = Pose((0.1, -0.2, 0.3), tuple(rotation.as_quat()))
    at_origin, at_base = Solver(table4.arm, model), Solver(table4.arm, model, base=base)
    before, after = at_origin.solve(MIXED), at_base.solve(MIXED)
    expected = before.position @ rotation.as_matrix().T + base.position
    assert_allclose(after.position, expected, atol=1e-12)
    rotated = rotation * Rotation.from_quat(before.quaternion)
    assert_allclose(
        Rotation.from_quat(after.quaternion).as_matrix(), rotated.as_matrix(), atol=1e-12
    )
    assert_allclose(after.k, before.k, atol=1e-12)


@pytest.mark.parametrize('lead', [(1,), (2, 1, 2), (70,)])
def test_batch_equals_single_solves(table4, model, lead):
    solver = table4.solver(model)
    tensions = MIXED * np.random.default_rng(1).uniform(0.0, 1.0, (*lead, 3, 4))
    together = solver.solve(tensions)
    assert together.position.shape == (*lead, 101, 3)
    assert together.quaternion.shape == (*lead, 101, 4)
    assert together.tip.shape == (*lead, 3)
    assert together.tau.shape == together.q.shape == (*lead, 101)
    for index in np.ndindex(lead):
        alone = solver.solve(tensions[index])
        assert_allclose(together.position[index], alone.position, atol=2e-8)
        assert_allclose(together.quaternion[index], alone.quaternion, atol=1e-6)
        assert_allclose(together.k[index], alone.k, rtol=1e-6, atol=1e-5)


# With MAX_STATIONS, a table of stations times intervals would not fit into memory.
@pytest.mark.parametrize('stations', [4, 5, 37, 101, 500, MAX_STATIONS])
def test_tip_does_not_depend_on_the_number_of_stations(table4, model, stations):
    backbone = table4.solver(model, stations).solve(FETCHING_IN_SPACE)
    assert backbone.s.size == stations
    assert {0.0, 0.135, 0.315, 0.45} <= set(backbone.s.tolist())
    finest = table4.solver(model, 1601).solve(FETCHING_IN_SPACE)
    assert_allclose(backbone.tip, finest.tip, atol=1e-6 * table4.arm.length)


def test_backbone_is_read_only(table4, model):
    backbone = table4.solver(model).solve(MIXED)
    for value in vars(backbone).values():
        if isinstance(value, np.ndarray):
            with pytest.raises(ValueError, match='read-only'):
                value[...] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        backbone.s = 0  # type: ignore[misc]


def test_function_solve_equals_the_solver(table4, model):
    backbone = solve(table4.arm, MIXED, model, 51, table4.base)
    assert backbone.model == model
    expected = table4.solver(model, 51).solve(MIXED)
    assert_allclose(backbone.position, expected.position, atol=1e-12)


def test_copied_and_pickled_solvers_give_the_same_shape(table4, model):
    solver = table4.solver(model, 51)
    before = solver.solve(MIXED)
    expected = solver.solve(1.01 * MIXED, start=before)
    for other in (copy.deepcopy(solver), pickle.loads(pickle.dumps(solver))):
        assert other is not solver
        start = pickle.loads(pickle.dumps(before))
        shape = other.solve(1.01 * MIXED, start=start)
        assert_allclose(shape.position, expected.position, rtol=0.0, atol=1e-12)


# Errors ----------------------------------------------------------------------------------------


SHAPES = r'expected \(\.\.\., 3, 4\): 3 section\(s\) from the tip, 4 tendons each$'
NO_ROWS = r'numbers in rows of equal length.*\(\.\.\., 3, 4\)'


@pytest.mark.parametrize(
    ('tensions', 'message'),
    [
        *(
            (
                [[0] * 4, [0, 0, bad, 0], [0] * 4],
                f'^tension of tendon_2_3 is {bad!r} N, expected a finite number >= 0$',
            )
            for bad in (-1.0, -1e-300, math.nan, math.inf, -math.inf)
        ),
        *(
            (np.zeros(shape), rf'^tensions have shape {re.escape(str(shape))}, {SHAPES}')
            for shape in ((), (4,), (12,), (4, 3), (2, 4), (3, 3), (3, 4, 1))
        ),
        *(
            (bad, NO_ROWS)
            for bad in (
                [[1, 2, 3, 4], [1, 2]],
                'four',
                [[1, 2, 3, 'x']] * 3,
                {'a': 1},
                [[True, 2, 3, 4]] * 3,
                [[1, 2, 3, np.True_]] * 3,
                np.ones((3, 4), bool),
                [[None] * 4] * 3,
                [[True] * 4] * 3,
            )
        ),
    ],
)
def test_invalid_tensions_are_refused(table4, tensions, message):
    with pytest.raises(TensionError, match=message):
        table4.solver('closed_form').solve(tensions)


def test_error_of_a_fully_compressed_arm_names_the_place(prototype, papers_model):
    # Four equal tensions: q = -4 T / EA, largest at the tip, where EA = 18.92 N.
    axial = 1.1e5 * math.pi * 0.0074**2
    with pytest.raises(SolveError, match=r'at s = 0.27 m \(q = -1.01, must be > -1\)$'):
        prototype.solver(papers_model).solve(np.full((1, 4), 1.01 * axial / 4))
    assert prototype.solver(papers_model).solve(np.full((1, 4), 0.99 * axial / 4)).q.min() > -1.0


def test_error_in_a_batch_names_the_set(prototype, papers_model):
    tensions = np.zeros((150, 1, 4))
    tensions[120] = 30.0
    with pytest.raises(SolveError, match=r'in set 120$'):
        prototype.solver(papers_model).solve(tensions)


def test_unknown_model_and_too_many_stations_are_refused(table4):
    with pytest.raises(ConfigError, match='stations is 10001, expected at most 10000'):
        table4.solver('exact', MAX_STATIONS + 1)
    with pytest.raises(ConfigError, match="model is 'best', expected one of renda2012, closed_f"):
        Solver(table4.arm, 'best')
    assert set(MODELS) == {'renda2012', 'closed_form', 'exact'}


# Sizes and booleans ----------------------------------------------------------------------------


def test_booleans_are_refused_as_numbers(table4):
    solver = table4.solver('exact', 11)
    tensions = np.zeros((3, 4))
    for wrench in ([True, 0, 0, 0, 0, 0], [0.0, 0, 0, 0, 0, np.True_], np.ones(6, bool)):
        with pytest.raises(LoadError, match=r'tip_wrench is .*, expected force and moment'):
            solver.solve(tensions, wrench)
    for build in (
        lambda: Pose((True, 0.0, 0.0)),
        lambda: Loads(gravity=(0.0, False, 0.0)),
        lambda: PointLoad(0.1, (True, 0.0, 0.0)),
        lambda: TipPosition([0.1, True, 0.0]),
        lambda: Stiffness(np.array([1.0, 0.0, 0.0]), True),
        lambda: Stiffness([True, 0.0, 0.0], 1.0),
        lambda: find_tensions(solver, TipPosition([0.4, 0.0, 0.0]), True),
    ):
        with pytest.raises(OctoArmError, match=r'is .*True|is .*False'):
            build()


def test_arguments_of_other_classes_are_refused(table4):
    arm, solver = table4.arm, table4.solver('exact', 11)
    shape = solver.solve(MIXED)
    tip = TipPosition(shape.tip)
    for build, words in (
        (lambda: Solver(table4), 'arm is Config('),
        (lambda: Solver(arm, ['exact']), "model is ['exact'], expected one of renda2012"),
        (lambda: Solver(arm, base=(0, 0, 0)), 'base is (0, 0, 0), expected an instance of Pose'),
        (lambda: Solver(arm, 'exact', loads=5), 'loads is 5, expected an instance of Loads'),
        (lambda: Solver(arm, 'exact', shear='no'), "material.shear is 'no', expected an instance"),
        (lambda: Solver(arm, compiled='numba'), "compiled is 'numba', expected an instance of bo"),
        (lambda: Solver(arm, budget=5.0), 'budget is 5.0, expected an instance of Budget'),
        (lambda: Solver(arm, material=['linear']), "law is ['linear'], expected one of"),
        (lambda: Solver(arm, accuracy='1e-8'), "accuracy is '1e-8', expected a number from"),
        (lambda: solve(arm, MIXED, base=[0, 0, 0]), 'base is [0, 0, 0], expected an instance'),
        (lambda: solve(arm, MIXED, stations=[11]), 'stations is [11], expected an instance of in'),
        (lambda: solver.solve(None), 'tensions are None, expected numbers in rows'),
        (lambda: solver.solve(MIXED, start=5), 'backbone is 5, expected an instance of Backbone'),
        (lambda: solver.follow(MIXED, shape.tip), 'last is ['),
        (lambda: solver.sensitivity(None), 'backbone is None, expected an instance of Backbone'),
        (lambda: solver.sensitivity(shape).tip_covariance(0.1), 'uncertainty is 0.1, expected an'),
        (lambda: solver.tip_covariance(shape, {}), 'uncertainty is {}, expected an instance of'),
        (lambda: solver.sensitivity_to_loads(shape, []), 'loads are [], expected a list of Loads'),
        (lambda: find_tensions(arm, tip, 1.0), 'solver is Arm('),
        (lambda: find_tensions(solver, shape.tip, 1.0), 'target is ['),
        (lambda: find_tensions(solver, tip, 1.0, stiffness=1), 'stiffness is 1, expected an'),
        (lambda: TipPose(shape.tip, shape.quaternion[-1], '0.1'), "per_radian is '0.1', expected"),
        (lambda: sample_workspace('table4', 1.0), "config is 'table4', expected an instance of"),
        (lambda: solve_displacements(arm, {}), 'solver is Arm('),
        (lambda: solve_displacements(solver, [0.01]), 'displacements are'),
        (lambda: solve_displacements(solver, {'tendon_1_1': 0.0}, MIXED), 'tensions are'),
        (lambda: solve_displacements(solver, {5: 0.1}), 'unknown tendon 5; this arm has tendon_1'),
        (lambda: solve_displacements(solver, {}, {'tendon_1_1': True}), 'tension of tendon_1_1'),
        (lambda: load_config(5), 'file or preset is 5, expected an instance of str'),
        (lambda: Config.from_parameters([]), 'values is [], expected an instance of Mapping'),
        (lambda: Budget(seconds=0), 'solve budget: seconds is 0, expected a number > 0'),
        (lambda: Budget(residual=1), 'solve budget: residual is 1, expected at most'),
        (lambda: Discs.evenly(-1, 0.4), 'number of discs is -1, expected'),
        (lambda: Discs.evenly(10**12, 0.4), 'number of discs is 1000000000000, expected at most'),
    ):
        with pytest.raises(OctoArmError, match=re.escape(words)) as refusal:
            build()
        assert ', expected ' in str(refusal.value) or 'unknown' in words


def test_layout_and_type_of_arrays_do_not_matter(table4):
    solver, wide = table4.solver('exact', 11), np.repeat(MIXED, 2, axis=1)
    wide.setflags(write=False)
    for same in (
        wide[:, ::2],
        np.asfortranarray(MIXED),
        MIXED.astype('>f8'),
        MIXED.astype(object),
    ):
        assert_array_equal(solver.solve(same).tip, solver.solve(MIXED).tip)


# What a solver has solved before -----------------------------------------------------------------


def test_derivatives_of_an_old_solution_are_its_own_after_many_others(table4):
    arm, loads = table4.arm.with_density(1080.0), Loads((0.0, 0.0, -9.81), 1000.0)
    solver = Solver(arm, 'exact', 11, loads=loads)
    old = solver.solve(MIXED)
    expected = Solver(arm, 'exact', 11, loads=loads).sensitivity(old).by_tension.tip
    for part in np.linspace(0.2, 0.6, 40):
        solver.solve(part * MIXED)
    solver.solve(0.5 * MIXED, start=old)
    assert_allclose(solver.sensitivity(old).by_tension.tip, expected, rtol=1e-9, atol=1e-12)


SOFT = helical_arm(sheath_stiffness=(2e3,))


@pytest.mark.parametrize('loads', [Loads(), Loads((0.0, 0.0, -1.0))], ids=['alone', 'weight'])
@pytest.mark.parametrize(
    ('arm', 'options'),
    [(SOFT, {}), (HELICAL, {'material': 'linear', 'shear': True})],
    ids=['sheaths', 'shear'],
)
def test_a_refused_pull_leaves_no_trace(arm, options, loads):
    """Lengths and derivatives are those of a solver that has refused nothing."""
    solver, other = (Solver(arm, 'exact', 11, loads=loads, **options) for _ in range(2))
    pull = np.array([[0.0, 0.05, 0.0], [0.0, 0.0, 0.05]])
    before = solver.solve(pull)
    with pytest.raises(SolveError):
        solver.solve([[30.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    after = solver.sensitivity(before), other.sensitivity(before)
    assert_allclose(solver.tendon_lengths(solver.solve(pull)), other.tendon_lengths(before))
    for name in ('by_youngs_modulus', 'by_tension'):
        found, expected = (getattr(one, name) for one in after)
        assert_allclose(found.tip, expected.tip, rtol=1e-7, atol=1e-12)
        assert_allclose(found.tendon_length, expected.tendon_length, rtol=1e-7, atol=1e-12)


def test_an_arm_is_followed_on_as_many_nodes_as_its_shape_needs():
    solver, last, nodes = Solver(HELICAL, 'exact', 11, loads=Loads((0.0, 0.0, -9.81))), None, []
    for part in (0.0, 0.5, 1.0, 1.5, 1.0, 0.5, 0.0):
        last = solver.follow(part * PULL, last)
        nodes.append(solver.local_tensions(last).shape[1])
        assert_allclose(last.tip, solver.solve(part * PULL).tip, atol=1e-8 * HELICAL.length)
    assert min(nodes) == nodes[3] < nodes[0] == nodes[-1]
