"""Arms beyond the paper's: any tendons, bodies and materials, in Python and in YAML."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    Body,
    Config,
    ConfigError,
    Constant,
    Function,
    Linear,
    Material,
    PointLoad,
    ProfiledBody,
    RoutedSection,
    Section,
    Solver,
    Table,
    Tendon,
    TensionError,
    Uncertainty,
    load_config,
)

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


def test_the_closed_form_of_any_tendons_is_the_full_system_of_three():
    backbone = Solver(HELICAL, 'closed_form', 31).solve(PULLS)
    for i in (0, 12, 20, 25, 30):
        s, section = backbone.s[i], backbone.section[i]
        matrix = np.diag([
            math.pi / 2 * CONE.radius(s) ** 4 * SOFT.shear_modulus,
            *2 * (math.pi / 4 * CONE.radius(s) ** 4 * 1.5e5,),
        ])  # fmt: skip
        right, force = np.zeros(3), 0.0
        tendons = zip(HELICAL.tendons, HELICAL.tendon_section, PULLS, strict=True)
        acting = [(tendon, pull) for tendon, of, pull in tendons if of <= section]
        for tendon, pull in acting:
            at = np.array([s])
            r = np.array([0.0, *np.ravel(tendon.place(at))])
            slope = np.array([0.0, *np.ravel(tendon.slope(at))])
            matrix += pull * (r @ r * np.eye(3) - np.outer(r, r))
            right -= pull * np.cross(r, np.array([1.0, 0.0, 0.0]) + slope)
        omega = np.linalg.solve(matrix, right)
        for tendon, pull in acting:
            r = np.array([0.0, *np.ravel(tendon.place(np.array([s])))])
            force -= pull * (1.0 + np.cross(omega, r)[0])
        got = (backbone.tau[i], backbone.xi[i], backbone.k[i])
        assert_allclose(got, omega, rtol=1e-10, atol=1e-10)
        axial = 1.5e5 * math.pi * CONE.radius(s) ** 2
        assert backbone.q[i] == pytest.approx(force / axial, rel=1e-10)


@pytest.mark.parametrize('model', ['closed_form', 'exact'])
def test_the_same_arm_said_in_other_words_has_the_same_shape(model):
    s = tuple(np.linspace(0.0, 0.3, 61).tolist())
    plain = Arm(SOFT, CONE, (Section(0.3, 0.008, 0.004),))
    quarters = [0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi]
    tabulated = Arm(
        Material(Table(s, 61 * (1.5e5,)), Constant(0.4)),
        ProfiledBody(0.3, Table(s, tuple(CONE.radius(s).tolist()))),
        (RoutedSection(0.3, tuple(
            Tendon(Table((0.0, 0.3), (0.008, 0.004)), Constant(angle)) for angle in quarters
        )),),
    )  # fmt: skip
    functions = Arm(
        Material(Function(lambda s: 1.5e5 + 0 * s, 0.3), 0.4),
        ProfiledBody(0.3, Function(CONE.radius, 0.3)),
        (RoutedSection(0.3, tuple(
            Tendon(Function(lambda s: 0.008 - s / 75, 0.3), Constant(angle)) for angle in quarters
        )),),
    )  # fmt: skip
    pulls = [[0.5, 0.2, 0.0, 0.0]]
    expected = Solver(plain, model).solve(pulls)
    for arm in (tabulated, functions):
        got = Solver(arm, model).solve(pulls)
        assert_allclose(got.position, expected.position, atol=1e-8)
        assert_allclose(got.k, expected.k, rtol=1e-7)


def test_sections_may_differ_in_number_and_tensions_come_in_rows_or_flat():
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


@pytest.mark.parametrize(
    ('arm', 'what'),
    [
        (HELICAL, 'section 2, whose tendons are not straight along n, b, -n, -b'),
        (Arm(SOFT, ProfiledBody(0.3, Linear(0.012, 0.006, 0.3)), (Section(0.3, 0.004, 0.004),)),
         'a body whose radius is not linear in s'),
        (Arm(Material(Table((0.0, 0.3), (1e5, 2e5))), CONE, (Section(0.3, 0.004, 0.004),)),
         'a material that varies along s'),
    ],
)  # fmt: skip
def test_the_papers_model_refuses_what_the_paper_does_not_cover(arm, what):
    with pytest.raises(ConfigError, match=f"'renda2012', which does not cover {what}"):
        Solver(arm, 'renda2012')


@pytest.mark.parametrize(
    ('build', 'message'),
    [
        (lambda: Arm(SOFT, ProfiledBody(0.3, Constant(-1.0)), ()), 'sections is ()'),
        (lambda: Arm(SOFT, ProfiledBody(0.3, Linear(0.01, -0.001, 0.3)), (Section(0.3, 0, 0),)),
         'body.radius at s = '),
        (lambda: ProfiledBody(0.3, Table((0.0, 0.2), (0.01, 0.01))), 'last s of body.profile is'),
        (lambda: Arm(Material(Constant(0.0)), CONE, (Section(0.3, 0, 0),)),
         'material.youngs_modulus at s = 0 m is 0.0, expected a finite number > 0 [Pa]'),
        (lambda: Arm(Material(1e5, Constant(0.6)), CONE, (Section(0.3, 0, 0),)),
         'material.poisson_ratio at s = 0 m is 0.6, expected a finite number in (-1, 0.5]'),
        (lambda: Material.from_moduli(3e5, 5e4), 'material.shear_modulus is 50000.0'),
        (lambda: Section(0.3, 0.0, 0.0, angles=()), 'section.angles is (), expected at least one'),
        (lambda: Section(0.3, 0.0, 0.0, twist=(1.0,)), 'section.twist is (1.0,), expected 4'),
        (lambda: Section(0.3, 0.0, 0.0, angles=(math.nan,)), 'section.angles is nan, expected'),
        (lambda: RoutedSection(0.3, ()), 'section.tendons is (), expected at least one tendon'),
        (lambda: RoutedSection(0.3, (Tendon(Table((0.0, 0.2), (0.0, 0.0)), Constant(0.0)),)),
         'last s of section.tendons[1].offset is 0.2, expected at least 0.3 [m]'),
        (lambda: Arm(SOFT, CONE, (RoutedSection(0.3, (Tendon(Constant(0.007), Constant(0.0)),)),)),
         'sections[1].tendons[1].offset is 0.007, expected at most the radius of the bod'),
        (lambda: Arm(SOFT, Body(0.3, 0.01, 0.01, 0.02), (Section(0.3, 0.021, 0.0),)),
         'sections[1].offset_base is 0.021, expected at most the radius of the discs'),
    ],
)  # fmt: skip
def test_impossible_arms_name_field_value_and_expectation(build, message):
    with pytest.raises(ArmDefinitionError) as refusal:
        build()
    assert str(refusal.value).startswith(message)


# In YAML ----------------------------------------------------------------------------------------

PLAIN = {
    'model': 'exact',
    'material': {'youngs_modulus': 1.5e5, 'poisson_ratio': 0.4},
    'body': {'length': 0.3, 'radius_base': 0.012, 'radius_tip': 0.006},
    'sections': {'anchorage': [0.3], 'offset_base': [0.004], 'offset_anchorage': [0.004]},
}


def read(tmp_path: Path, **changes: object) -> Config:
    path = tmp_path / 'arm.yaml'
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': PLAIN | changes}}))
    return load_config(path)


def test_yaml_says_everything_but_functions(tmp_path):
    config = read(
        tmp_path,
        material={
            'table_s': [0.0, 0.1, 0.3],
            'table_youngs_modulus': [2e5, 1e5, 1e5],
            'table_poisson_ratio': [0.5, 0.4, 0.4],
            'density': 1080.0,
            'youngs_modulus_stddev': 0.05,
        },
        body={'length': 0.3, 'table_s': [0.0, 0.2, 0.3], 'table_radius': [0.02, 0.01, 0.006]},
        sections={'anchorage': [0.3, 0.2], 'tendons': [1, 2]},
        tendons={
            'table_s': [0.0, 0.3],
            'table_offset': [0.005, 0.004, 0.003, 0.003, 0.002, 0.002],
            'table_angle': [0.0, 2.0, 1.0, 1.0, 3.0, 3.0],
        },
        loads={
            'gravity': [0.0, 0.0, -9.81],
            'fluid_density': 1000.0,
            'tip_force': [0.0, 0.001, 0.0],
            'tip_moment': [0.0, 0.0, 1e-5],
            'point_s': [0.1, 0.2],
            'point_force': [0.0, 0.0, 0.01, 0.0, 0.01, 0.0],
            'distributed_s': [0.0, 0.1],
            'distributed_force': [0.0, 0.0, 0.1, 0.0, 0.0, 0.0],
        },
        tension_stddev=0.1,
    )
    arm = config.arm
    assert arm.tension_shape == (3,)
    assert arm.tendon_section.tolist() == [1, 2, 2]
    assert arm.body.radius(0.2) == pytest.approx(0.01)
    assert arm.material.youngs_modulus_at(0.1) == pytest.approx(1e5)
    n, b = arm.tendon_offsets(np.array([0.3]))
    assert_allclose(np.arctan2(b[0], n[0]), 2.0)
    assert config.loads.points[1] == PointLoad(0.2, (0.0, 0.01, 0.0))
    assert config.uncertainty == Uncertainty(0.1, 0.05)
    backbone = config.solver().solve([0.1, 0.2, 0.0])
    assert backbone.residual < 1e-10
