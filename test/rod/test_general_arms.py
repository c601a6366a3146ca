"""Arms beyond the paper: any tendons, bodies, materials and rest shapes, in Python and YAML."""

import dataclasses
import math
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.optimize import brentq

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    Body,
    Config,
    ConfigError,
    Constant,
    Dynamics,
    Function,
    GivenStiffness,
    Inputs,
    Linear,
    Loads,
    Material,
    MotionProperties,
    OctoArmError,
    PointLoad,
    ProfiledBody,
    RectangularBody,
    RestShape,
    RoutedSection,
    Section,
    Solver,
    Sphere,
    Table,
    Tendon,
    TensionError,
    Uncertainty,
    displacements_of,
    modes,
    solve_displacements,
)
from octo_arm_model.arm.body import Geometry
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.tendon import Discs

SOFT = Material(1.5e5, 0.4)
CONE = Body(0.3, 0.012, 0.006)
HELICAL = Arm(
    SOFT,
    CONE,
    (
        Section(0.3, 0.008, 0.004, angles=(0.1, 2.2, 4.0), twist=(3.0, -2.0, 1.0)),
        Section(0.2, 0.005, 0.006, angles=(0.5, 2.2, 4.0, 5.0)),
    ),
)
PULLS = np.array([0.4, 0.1, 0.0, 0.6, 0.0, 0.2, 0.3])


@pytest.mark.parametrize('model', ['closed_form', 'exact'])
def test_tables_and_functions_describe_the_same_arm(model):
    s = tuple(np.linspace(0.0, 0.3, 61).tolist())
    plain = Arm(SOFT, CONE, (Section(0.3, 0.008, 0.004),))

    def profiled(young, ratio, radius, offset):
        tendons = tuple(Tendon(offset, Constant(angle)) for angle in 0.5 * math.pi * np.arange(4))
        body = ProfiledBody(0.3, radius)
        return Arm(Material(young, ratio), body, (RoutedSection(0.3, tendons),))

    tabulated = profiled(
        Table(s, 61 * (1.5e5,)),
        Constant(0.4),
        Table(s, tuple(CONE.radius(s).tolist())),
        Table((0.0, 0.3), (0.008, 0.004)),
    )
    functions = profiled(
        Function(lambda s: 1.5e5 + 0 * s, 0.3),
        0.4,
        Function(CONE.radius, 0.3),
        Function(lambda s: 0.008 - s / 75, 0.3),
    )
    pulls = [[0.5, 0.2, 0.0, 0.0]]
    expected = Solver(plain, model).solve(pulls)
    for arm in (tabulated, functions):
        shape = Solver(arm, model).solve(pulls)
        assert_allclose(shape.position, expected.position, atol=1e-8)
        assert_allclose(shape.k, expected.k, rtol=1e-7)


def test_tensions_of_unequal_sections_are_flat_or_rows():
    solver = Solver(HELICAL, 'exact', 31)
    assert HELICAL.tension_shape == (7,)
    flat = solver.solve(PULLS)
    rows = solver.solve([PULLS[:3].tolist(), PULLS[3:].tolist()])
    assert_allclose(flat.position, rows.position, atol=1e-12)
    several = solver.solve(np.stack([PULLS, 0.5 * PULLS]))
    assert_allclose(several.tip[0], flat.tip, atol=1e-9)
    with pytest.raises(TensionError, match=r'expected \(\.\.\., 7\): 7 tendons, section'):
        solver.solve(PULLS[:6])
    with pytest.raises(TensionError, match=r'tension of tendon_2_1 is -0\.6 N'):
        solver.solve([0.4, 0.1, 0.0, -0.6, 0.0, 0.2, 0.3])


def test_parameters_describe_tables_tendons_and_loads():
    values = {
        'model': 'exact',
        'material.table_s': [0.0, 0.1, 0.3],
        'material.table_youngs_modulus': [2e5, 1e5, 1e5],
        'material.table_poisson_ratio': [0.5, 0.4, 0.4],
        'material.density': 1080.0,
        'material.youngs_modulus_stddev': 0.05,
        'body.length': 0.3,
        'body.table_s': [0.0, 0.2, 0.3],
        'body.table_radius': [0.02, 0.01, 0.006],
        'sections.anchorage': [0.3, 0.2],
        'sections.tendons': [1, 2],
        'tendons.table_s': [0.0, 0.3],
        'tendons.table_offset': [0.005, 0.004, 0.003, 0.003, 0.002, 0.002],
        'tendons.table_angle': [0.0, 2.0, 1.0, 1.0, 3.0, 3.0],
        'loads.gravity': [0.0, 0.0, -9.81],
        'loads.fluid_density': 1000.0,
        'loads.tip_force': [0.0, 0.001, 0.0],
        'loads.tip_moment': [0.0, 0.0, 1e-5],
        'loads.point_s': [0.1, 0.2],
        'loads.point_force': [0.0, 0.0, 0.01, 0.0, 0.01, 0.0],
        'loads.distributed_s': [0.0, 0.1],
        'loads.distributed_force': [0.0, 0.0, 0.1, 0.0, 0.0, 0.0],
        'tension_stddev': 0.1,
    }
    config = Config.from_parameters(values)
    arm = config.arm
    assert arm.tension_shape == (3,)
    assert arm.tendon_section.tolist() == [1, 2, 2]
    assert arm.body.radius(0.2) == pytest.approx(0.01)
    assert arm.material.youngs_modulus_at(0.1) == pytest.approx(1e5)
    n, b = arm.tendon_offsets(np.array([0.3]))
    assert_allclose(np.arctan2(b[:, 0], n[:, 0]), [2.0, 1.0, 3.0])
    assert config.loads.points[1] == PointLoad(0.2, (0.0, 0.01, 0.0))
    assert config.uncertainty == Uncertainty(0.1, 0.05)
    backbone = config.solver().solve([0.1, 0.2, 0.0])
    assert backbone.residual < 1e-10


# Cross sections ----------------------------------------------------------------------------------


LENGTH, YOUNG, DENSITY, OFFSET = 0.2, 6e10, 6450.0, 0.008
METAL = Material(YOUNG, 0.33, DENSITY)
FOUR = (Section(LENGTH, OFFSET, OFFSET),)
TUBE = Arm(METAL, Body(LENGTH, 1e-3, 1e-3, 0.01, 0.8e-3), FOUR)
STRIP = Arm(METAL, RectangularBody(LENGTH, 3e-3, 1e-3, 0.01), FOUR)
GIVEN = dataclasses.replace(
    TUBE, stiffness=GivenStiffness(axial=9e4, bending_n=0.02, bending_b=0.03, torsion=0.025)
)
TUBES_SECOND = 0.25 * math.pi * (1.0 - 0.8**4) * 1e-12
# E J about n and about b.
BENDING = {
    'tube': (TUBE, (YOUNG * TUBES_SECOND, YOUNG * TUBES_SECOND)),
    'strip': (STRIP, (YOUNG * 3e-3 * 1e-9 / 12.0, YOUNG * 1e-3 * 27e-9 / 12.0)),
    'given': (GIVEN, (0.02, 0.03)),
}


@pytest.mark.parametrize('name', BENDING)
def test_curvature_is_moment_over_bending_stiffness(name):
    arm, (about_n, about_b) = BENDING[name]
    solver = Solver(arm, 'exact', material='linear')
    for tensions, xi, k in (([2.0, 0, 0, 0], 0.0, 1.0), ([0, 2.0, 0, 0], -1.0, 0.0)):
        shape = solver.solve([tensions])
        stretch = 1.0 + shape.q
        moment = 2.0 * OFFSET
        assert_allclose(stretch * shape.xi, xi * moment / about_n, rtol=1e-9)
        assert_allclose(stretch * shape.k, k * moment / about_b, rtol=1e-9)
    # closed_form neglects terms in the square of the curvature.
    shape_of_closed_form = Solver(arm, 'closed_form').solve([[2e-3, 1e-3, 0.0, 0.0]])
    assert_allclose(shape_of_closed_form.k[-1], 2e-3 * OFFSET / about_b, rtol=1e-4)
    assert_allclose(shape_of_closed_form.xi[-1], -1e-3 * OFFSET / about_n, rtol=1e-4)


@pytest.mark.parametrize(('ratio', 'factor'), [(1.0, 0.140577), (2.0, 0.228682), (10.0, 0.312325)])
def test_torsion_of_rectangles_equals_saint_venants(ratio, factor):
    for sizes in ((ratio, 1.0), (1.0, ratio)):
        geometry = Geometry.of_rectangle(*(np.array([size]) for size in sizes))
        assert_allclose(geometry.torsion, factor * ratio, rtol=3e-6)
    arm = dataclasses.replace(STRIP, body=RectangularBody(LENGTH, 1e-3 * ratio, 1e-3, 0.01))
    solver = Solver(arm, 'exact', material='linear', loads=Loads(tip_moment=(0.01, 0.0, 0.0)))
    torsion = METAL.shear_modulus * factor * ratio * 1e-12
    assert_allclose(solver.solve(np.zeros((1, 4))).tau, 0.01 / torsion, rtol=3e-6)


def fibres(shape: str) -> tuple[FloatArray, FloatArray, Arm]:
    """Return positions along n and area fractions of the fibres of a soft arm, and the arm."""
    points, weights = np.polynomial.legendre.leggauss(40)
    soft = Material(1e5, 0.5)
    section = (Section(LENGTH, 0.004, 0.004),)
    if shape == 'strip':
        body = RectangularBody(LENGTH, 0.01, 0.02)
        return 5e-3 * points, 0.5 * weights, Arm(soft, body, section)
    angle = np.pi * (np.arange(64) + 0.5) / 64
    radius = 0.008 + 0.002 * points
    areas = np.outer(weights * radius, np.ones(64))
    positions = np.outer(radius, np.cos(angle))
    return (
        positions.ravel(),
        (areas / areas.sum()).ravel(),
        Arm(soft, Body(LENGTH, 0.01, 0.01, 0.0, 0.006), section),
    )


@pytest.mark.parametrize(('shape', 'error'), [('strip', 0.12), ('tube', 0.25)])
def test_rubber_agrees_with_the_sum_over_fibres_to_second_order(shape, error):
    # An ellipse with the same second moments has other fourth moments.
    place, part, arm = fibres(shape)
    area = float(arm.body.geometry(np.zeros(1)).area[0])
    solver = Solver(arm, 'exact')
    for pull in (0.8, 0.4, 0.2):
        solution = solver.solve([[pull, 0.0, 0.0, 0.0]])
        stretch, k = 1.0 + solution.q[-1], solution.k[-1] * (1.0 + solution.q[-1])

        def moment(k, stretch=stretch):
            lengths = stretch - k * place / math.sqrt(stretch)
            slope = 1e5 / 3.0 * (lengths - 1.0 / lengths**2)
            return float((slope * -place * part).sum()) * area / math.sqrt(stretch)

        # The moment of a parallel tendon, for any strain.
        expected = pull * 0.004 / math.sqrt(stretch)
        exact = brentq(lambda k: moment(k) - expected, 0.0, 2.0 * k)
        surface = float(np.abs(place).max()) * k
        assert abs(k / exact - 1.0) < error * surface**2
        assert surface > 0.01


def test_weight_of_a_tube_uses_its_wall_and_buoyancy_its_outline():
    # First-order deflection of a clamped beam under its own weight.
    for fluid, mass in ((0.0, (1.0 - 0.8**2) * DENSITY), (1000.0, 0.36 * DENSITY - 1000.0)):
        loads = Loads(gravity=(0.0, 0.0, -1.0), fluid_density=fluid)
        tip = Solver(TUBE, 'exact', material='linear', loads=loads).solve(np.zeros((1, 4))).tip
        sag = mass * math.pi * 1e-6 * LENGTH**4 / (8.0 * YOUNG * TUBES_SECOND)
        assert_allclose(tip[2], -sag, rtol=1e-5)


@pytest.mark.parametrize('name', BENDING)
def test_frequencies_depend_on_the_section_as_in_beam_theory(name):
    arm, bending = BENDING[name]
    body = arm.body.geometry(np.zeros(1))
    dynamics = Dynamics(Solver(arm, 'exact', material='linear'), MotionProperties(viscosity=1e3))
    frequencies = modes(dynamics, dynamics.at_rest(Inputs(np.zeros((1, 4)))), 24).frequencies
    mass = DENSITY * body.area.item()
    for stiffness in bending:
        bernoulli = 1.8751040687**2 / (2.0 * math.pi * LENGTH**2) * math.sqrt(stiffness / mass)
        assert np.abs(frequencies / bernoulli - 1.0).min() < 3e-4
    torsion = METAL.shear_modulus * body.torsion.item() if name != 'given' else 0.025
    polar = DENSITY * (body.about_n + body.about_b).item()
    axial = YOUNG * body.area.item() if name != 'given' else 9e4
    for speed in (math.sqrt(torsion / polar), math.sqrt(axial / mass)):
        assert np.abs(frequencies * 4.0 * LENGTH / speed - 1.0).min() < 1e-8


# Rest shapes ------------------------------------------------------------------------------------

HELIX = RestShape(3.0, 6.0, 20.0)


@pytest.mark.parametrize('law', ['linear', 'neo_hookean', 'closed_form'])
def test_unloaded_arm_has_its_rest_shape(law):
    model, options = ('closed_form', {}) if law == 'closed_form' else ('exact', {'material': law})
    solver = Solver(dataclasses.replace(TUBE, rest=HELIX), model, 31, **options)
    shape = solver.solve(np.zeros((1, 4)))
    t, n, b = 20.0, 3.0, 6.0
    screw = np.array([[0, -b, n, 1.0], [b, 0, -t, 0], [-n, t, 0, 0], [0, 0, 0, 0]])
    for s, position in zip(shape.s, shape.position, strict=True):
        assert_allclose(position, expm(s * screw)[:3, 3], rtol=0.0, atol=1e-12)
    assert_allclose(
        np.stack([shape.tau, shape.xi, shape.k, shape.q]).T, [[t, n, b, 0.0]] * 31, atol=1e-12
    )


def test_rest_curvature_may_vary_along_the_arm():
    curvature = Table((0.0, 0.05, LENGTH), (4.0, -2.0, 1.0))
    rest = RestShape(curvature_b=curvature, curvature_n=Linear(1.0, 3.0, LENGTH))
    for law in ('linear', 'neo_hookean'):
        solver = Solver(dataclasses.replace(TUBE, rest=rest), 'exact', 41, material=law)
        shape = solver.solve(np.zeros((1, 4)))
        assert_allclose(shape.k, curvature.value(shape.s), atol=1e-8)
        assert_allclose(shape.xi, 1.0 + 2.0 * shape.s / LENGTH, atol=1e-9)


@pytest.mark.parametrize(('model', 'discs'), [('closed_form', 0), ('exact', 0), ('exact', 5)])
def test_tendon_straightens_a_bent_rod_with_the_expected_displacement(model, discs):
    curvature, (arm, (_, bending)) = 4.0, BENDING['tube']
    rest = RestShape(curvature_b=-curvature)
    bent = dataclasses.replace(arm, rest=rest, discs=Discs.evenly(discs, LENGTH))
    pull, angle = bending * curvature / OFFSET, curvature * LENGTH
    solver = Solver(bent, model, 21, **({'material': 'linear'} if model == 'exact' else {}))
    shape = solver.solve([[pull, 0.0, 0.0, 0.0]])
    assert np.abs(shape.k).max() < 1e-9 * curvature
    stretch = 1.0 - pull / (YOUNG * math.pi * 0.36e-6)
    assert_allclose(shape.tip, [LENGTH * stretch, 0.0, 0.0], atol=1e-12)
    # On the outside of the bend the unloaded tendon is longer than the arm, an arc or chords.
    turned = 2.0 * discs * math.sin(0.5 * angle / discs) if discs else angle
    displacement = turned * (1.0 / curvature + OFFSET) - LENGTH * stretch
    assert_allclose(displacements_of(solver, shape)[0, 0], displacement, rtol=1e-9)
    wound = solve_displacements(solver, {bent.tendon_names[0]: displacement}).backbone
    assert_allclose(wound.tensions[0], [pull, 0.0, 0.0, 0.0], rtol=1e-6, atol=1e-9)


def test_stretched_bent_rubber_has_the_curvature_of_a_ring():
    # A force along the chord of a short arc. Sections without a moment have the curvature 1 / w
    # to first order, because all fibres stretch in proportion.
    soft = Arm(
        Material(1e5, 0.5),
        Body(0.02, 0.004, 0.004),
        (Section(0.02, 0.0, 0.0),),
        rest=RestShape(curvature_b=1.0),
    )
    pull = 4.0 * 1e5 / 3.0 * math.pi * 0.004**2 * (1.2 - 1.0 / 1.2**2) / 4.0
    solver = Solver(soft, 'exact', loads=Loads(tip_force=(pull, 0.01 * pull, 0.0)))
    shape = solver.solve(np.zeros((1, 4)))
    assert_allclose(1.0 + shape.q, 1.2, rtol=1e-3)
    assert_allclose(shape.k[-1], math.sqrt(1.2), rtol=2e-3)


# Errors -----------------------------------------------------------------------------------------

PLAIN = Arm(SOFT, CONE, (Section(0.3, 0.0, 0.0),))
OF_PLAIN, OF_TUBE = partial(dataclasses.replace, PLAIN), partial(dataclasses.replace, TUBE)


@pytest.mark.parametrize(
    ('arm', 'what'),
    [
        (HELICAL, 'section 2, whose tendons are not straight along n, b, -n, -b'),
        (
            OF_PLAIN(body=ProfiledBody(0.3, Linear(0.012, 0.006, 0.3))),
            'a body whose radius is not linear in s',
        ),
        (
            OF_PLAIN(material=Material(Table((0.0, 0.3), (1e5, 2e5)))),
            'a material that varies along s',
        ),
        (TUBE, 'tubes'),
        (OF_TUBE(stiffness=GivenStiffness(axial=1.0)), 'sections of given'),
        (OF_TUBE(body=Body(LENGTH, 0.01, 0.01), rest=HELIX), 'an arm that is b'),
    ],
)
def test_renda2012_refuses_arms_beyond_the_paper(arm, what):
    with pytest.raises(ConfigError, match=f"'renda2012', which does not cover {what}"):
        Solver(arm, 'renda2012')


def test_papers_models_refuse_discs_sheaths_and_loads(table4, papers_model):
    arm, papers = table4.arm, Solver(table4.arm, papers_model)
    for name, value in (('discs', Discs.evenly(5, 0.45)), ('sheath_stiffness', (1e5,))):
        with pytest.raises(ConfigError, match=rf'tendons\.{name} goes with model exact'):
            Solver(dataclasses.replace(arm, **{name: value}), papers_model)
    ball = Sphere((0.2, 0.0, 0.1), 0.05, stiffness=1e6)
    for loads in (Loads(tip_force=(0, 0, 1)), Loads(obstacles=(ball,))):
        with pytest.raises(ConfigError, match='no loads but the tendons: choose exact'):
            Solver(arm, papers_model, loads=loads)
    with pytest.raises(ConfigError, match='choose exact'):
        papers.solve(np.zeros((3, 4)), (0, 0, 1, 0, 0, 0))
    papers.solve(np.zeros((3, 4)), np.zeros(6))


def routed(offset):
    """A section with one tendon at ``offset``."""
    return RoutedSection(0.3, (Tendon(offset, Constant(0.0)),))


@pytest.mark.parametrize(
    ('build', 'message'),
    [
        (lambda: OF_PLAIN(sections=()), 'sections is ()'),
        (lambda: OF_PLAIN(body=ProfiledBody(0.3, Linear(1, -0.1, 0.3))), 'body.radius at s = '),
        (lambda: ProfiledBody(0.3, Table((0.0, 0.2), (0.01, 0.01))), 'last s of body.profile is'),
        (
            lambda: OF_PLAIN(material=Material(Constant(0.0))),
            'material.youngs_modulus at s = 0 m is 0.0, expected a finite number > 0 [Pa]',
        ),
        (
            lambda: OF_PLAIN(material=Material(1e5, Constant(0.6))),
            'material.poisson_ratio at s = 0 m is 0.6, expected a finite number in (-1, 0.5]',
        ),
        (lambda: Material.from_moduli(3e5, 5e4), 'material.shear_modulus is 50000.0'),
        (lambda: Section(0.3, 0.0, 0.0, angles=()), 'section.angles is (), expected at least one'),
        (lambda: Section(0.3, 0.0, 0.0, twist=(1.0,)), 'section.twist is (1.0,), expected 4'),
        (lambda: Section(0.3, 0.0, 0.0, angles=(math.nan,)), 'section.angles is nan, expected'),
        (lambda: RoutedSection(0.3, ()), 'section.tendons is (), expected at least one tendon'),
        (
            lambda: routed(Table((0.0, 0.2), (0.0, 0.0))),
            'last s of section.tendons[1].offset is 0.2, expected at least 0.3 [m]',
        ),
        (
            lambda: OF_PLAIN(sections=(routed(Constant(0.007)),)),
            'sections[1].tendons[1].offset is 0.007, expected at most the radius of the bod',
        ),
        (
            lambda: Arm(SOFT, Body(0.3, 0.01, 0.01, 0.02), (Section(0.3, 0.021, 0.0),)),
            'sections[1].offset_base is 0.021, expected at most the radius of the discs',
        ),
        (
            lambda: OF_TUBE(body=Body(LENGTH, 1e-3, 5e-4, 0.01, 8e-4)),
            'body.inner_radius at s = 0.0804688 m is 0.0008, expected less than the radius',
        ),
        (lambda: RectangularBody(LENGTH, 0.0, 1e-3), 'body.width is 0.0, expected a finite num'),
        (
            lambda: OF_TUBE(body=RectangularBody(LENGTH, 0.1, 0.01)),
            'sections[1].tendons[2].offset is 0.008, expected such that the tendon is within the',
        ),
        (lambda: GivenStiffness(axial=-1.0), 'stiffness.axial is -1.0, expected a finite stiffn'),
        (
            lambda: OF_TUBE(stiffness=GivenStiffness(bending_n=Linear(1, -1, 0.2))),
            'stiffness.bending_n at s = 0.1 m is 0.0, expected a finite number > 0',
        ),
        (
            lambda: OF_TUBE(rest=RestShape(curvature_n=130.0)),
            'rest_curvature at s = 0 m is 130.0, expected less than 1 over the distance of what',
        ),
        (lambda: RestShape(torsion=math.nan), 'rest_torsion is nan, expected a finite number'),
        (
            lambda: Dynamics(Solver(STRIP, 'exact'), MotionProperties(normal_drag=1.0)),
            'motion.normal_drag is 1.0, expected 0 of a rectangular body',
        ),
    ],
)
def test_invalid_arms_are_refused(build, message):
    with pytest.raises(ArmDefinitionError) as refusal:
        build()
    assert str(refusal.value).startswith(message)


# Sections in a file ------------------------------------------------------------------------------

THIN = {
    'model': 'exact',
    'material.youngs_modulus': YOUNG,
    'material.law': 'linear',
    'body.length': LENGTH,
    'body.disc_radius': 0.01,
    'sections.anchorage': [LENGTH],
    'sections.offset_base': [OFFSET],
    'sections.offset_anchorage': [OFFSET],
}
ROUND = {'body.radius_base': 1e-3, 'body.radius_tip': 1e-3}
S = [0.0, 0.1, LENGTH]


def test_parameters_describe_sections_and_rest_shapes():
    values = THIN | {
        'body.table_s': S,
        'body.table_width': [3e-3, 2e-3, 1e-3],
        'body.table_height': [1e-3, 1e-3, 2e-3],
        'stiffness.bending': [0.02],
        'rest_torsion': 2.0,
        'stiffness.table_s': S,
        'stiffness.table_axial': [9e4, 8e4, 7e4],
        'rest.table_s': [0.0, LENGTH],
        'rest.table_curvature_b': [1.0, 3.0],
    }
    arm = Config.from_parameters(values).arm
    assert arm == dataclasses.replace(
        STRIP,
        material=Material(YOUNG),
        body=RectangularBody(
            LENGTH,
            Table(tuple(S), (3e-3, 2e-3, 1e-3), 'body.table_width'),
            Table(tuple(S), (1e-3, 1e-3, 2e-3), 'body.table_height'),
            0.01,
        ),
        stiffness=GivenStiffness(
            Table(tuple(S), (9e4, 8e4, 7e4), 'stiffness.table_axial'), 0.02, 0.02
        ),
        rest=RestShape(0.0, Table((0.0, LENGTH), (1.0, 3.0), 'rest.table_curvature_b'), 2.0),
    )
    tube = THIN | ROUND | {'body.inner_radius': 8e-4, 'rest_curvature': [3.0, 6.0]}
    arm = Config.from_parameters(tube).arm
    assert (arm.body, arm.rest) == (TUBE.body, RestShape(3.0, 6.0))


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({}, 'body.radius_base is missing, expected double'),
        ({'body.width': 1e-3}, 'body.height is 0.0, expected a finite number > 0'),
        (ROUND | {'rest_curvature': [1.0]}, 'rest_curvature has 1 values, expected 2, about n an'),
        (ROUND | {'stiffness.bending': [1.0] * 3}, 'stiffness.bending has 3 values, expected 2'),
        (
            ROUND
            | {
                'rest_torsion': 1.0,
                'rest.table_s': [0.0, LENGTH],
                'rest.table_torsion': [1.0, 2.0],
            },
            'rest.table_torsion and the same for all s are given, expected one of both',
        ),
        (ROUND | {'stiffness.table_s': [0.0, LENGTH]}, 'stiffness.table_s has no effect without'),
        (
            {'body.width': 1e-3, 'body.height': 1e-3, 'body.table_s': [0.0, LENGTH]},
            'body.table_s has no effect without',
        ),
        (ROUND | {'rest.table_torsion': [1.0]}, 'rest.table_torsion has 1 values, expected 0'),
    ],
)
def test_contradicting_parameters_are_refused(changes, message):
    with pytest.raises(OctoArmError) as refusal:
        Config.from_parameters(THIN | changes)
    assert str(refusal.value).startswith(message)
