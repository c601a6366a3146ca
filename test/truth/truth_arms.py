"""The arms of the truth, as parameters: those of the presets, and random ones of many kinds."""

from __future__ import annotations

from typing import Any

import numpy as np

from octo_arm_model.config.parameter_files import load_parameters, preset_path

Parameters = dict[str, Any]
PRESETS = (
    'renda2012_fem', 'renda2012_prototype', 'renda2012_table2', 'renda2012_table4', 'rao2021'
)  # fmt: skip
SEED = 20121
# Of the parameters below, these are for the model exact alone.
UNCERTAIN = {
    'material.youngs_modulus_stddev': 0.05,
    'material.poisson_ratio_stddev': 0.02,
    'model_error_stddev': 0.002,
}


def all_arms() -> dict[str, Parameters]:
    """Parameters of every arm by its name, each with model, stations and uncertainties."""
    found = {name: _preset(name) for name in PRESETS}
    for number, kind in enumerate(_KINDS):
        rng = np.random.default_rng([SEED, number])
        found[f'random_{number:02d}_{kind.__name__[1:]}'] = kind(rng)
    return found


def _preset(name: str) -> Parameters:
    given = load_parameters(preset_path(name))
    metal = name == 'rao2021'
    given['material.density'] = 6450.0 if metal else 1080.0
    if not metal:
        given['base.position'] = [0.0, 0.0, 0.0]
    return given | {'model': 'exact'}


def digits(values: Any, count: int = 4) -> Any:
    """``values`` rounded to so many significant digits, as plain numbers."""
    if np.ndim(values):
        return [digits(value, count) for value in np.asarray(values).tolist()]
    return float(f'{float(values):.{count}g}')


def _base(rng: np.random.Generator) -> Parameters:
    turn = rng.standard_normal(4)
    turn /= np.linalg.norm(turn)
    return {
        'base.position': digits(rng.uniform(-0.5, 0.5, 3)),
        'base.quaternion': [round(float(part), 12) for part in turn],
    }


def _anchorages(rng: np.random.Generator, length: float, count: int, at_tip: bool) -> list[float]:
    gaps = rng.uniform(0.3, 1.0, count)
    last = 0.0 if at_tip else 0.15 * float(rng.uniform(0.5, 1.0))
    stops = np.cumsum(gaps) / gaps.sum() * (1.0 - last)
    return [length * digits(part) for part in stops[::-1]]


def _cone(rng: np.random.Generator, slender: float, taper: float) -> Parameters:
    length = digits(rng.uniform(0.1, 0.8))
    base = length * digits(slender * rng.uniform(0.8, 1.2))
    return {
        'body.length': length, 'body.radius_base': digits(base),
        'body.radius_tip': digits(base * taper),
    }  # fmt: skip


def _radius(given: Parameters, s: float) -> float:
    part = s / given['body.length']
    return (1.0 - part) * given['body.radius_base'] + part * given['body.radius_tip']


def _offsets(rng: np.random.Generator, given: Parameters, low: float, high: float) -> Parameters:
    anchorages = given['sections.anchorage']
    base = [rng.uniform(low, high) * given['body.radius_base'] for _ in anchorages]
    end = [rng.uniform(low, high) * _radius(given, s) for s in anchorages]
    return {'sections.offset_base': digits(base, 3), 'sections.offset_anchorage': digits(end, 3)}


def _rubber(rng: np.random.Generator) -> Parameters:
    return {
        'material.youngs_modulus': digits(10.0 ** rng.uniform(4.5, 6.0), 3),
        'material.poisson_ratio': digits(rng.uniform(0.3, 0.5), 3),
        'material.density': digits(rng.uniform(1020.0, 1200.0), 4),
    }


def _paper(rng: np.random.Generator) -> Parameters:
    """A cone of rubber with four straight tendons a section, as the paper has it."""
    given = _cone(rng, rng.uniform(0.03, 0.06), rng.uniform(0.2, 0.9)) | _rubber(rng) | _base(rng)
    count = int(rng.integers(1, 4))
    at_tip = bool(rng.random() < 0.6)
    given['sections.anchorage'] = _anchorages(rng, given['body.length'], count, at_tip)
    return given | _offsets(rng, given, 0.1, 0.8) | {'model': 'exact'}


def _winding(rng: np.random.Generator) -> Parameters:
    """A cone of rubber with tendons at any angles that wind about the midline."""
    given = _cone(rng, rng.uniform(0.03, 0.05), rng.uniform(0.35, 1.0)) | _rubber(rng) | _base(rng)
    count = int(rng.integers(1, 4))
    given['sections.anchorage'] = _anchorages(rng, given['body.length'], count, True)
    numbers = [int(rng.integers(2, 5)) for _ in range(count)]
    total = sum(numbers)
    return (
        given
        | _offsets(rng, given, 0.2, 0.8)
        | {
            'model': 'exact',
            'sections.tendons': numbers,
            'tendons.angle': digits(rng.uniform(-3.0, 3.0, total), 3),
            'tendons.twist': digits(rng.uniform(-4.0, 4.0, total) * (rng.random(total) < 0.6), 3),
        }
    )


def _table(rng: np.random.Generator) -> Parameters:
    """Radius, modulus and tendons' paths given at some places along the arm."""
    length = digits(rng.uniform(0.2, 0.6))
    places = [0.0, *(length * part for part in (0.27, 0.55, 0.8)), length]
    base = 0.04 * length
    radius = base * np.array([1.0, *np.sort(rng.uniform(0.5, 0.98, 4))[::-1]])
    young = 10.0 ** rng.uniform(4.7, 5.7) * rng.uniform(0.6, 1.4, 5)
    numbers = [int(rng.integers(2, 4)), int(rng.integers(2, 4))]
    offsets, angles = [], []
    for _ in range(sum(numbers)):
        offsets += digits(radius.min() * rng.uniform(0.3, 0.9, 4), 3)
        start = rng.uniform(-3.0, 3.0)
        angles += digits(start + np.array([0.0, *np.cumsum(rng.uniform(-0.4, 0.4, 3))]), 3)
    return _base(rng) | {
        'model': 'exact', 'body.length': length,
        'body.table_s': places, 'body.table_radius': digits(radius),
        'material.table_s': places, 'material.table_youngs_modulus': digits(young),
        'material.table_poisson_ratio': digits(rng.uniform(0.35, 0.5, 5), 3),
        'material.density': 1100.0,
        'sections.anchorage': [length, digits(0.45 * length)],
        'sections.tendons': numbers,
        'tendons.table_s': [0.0, *(length * part for part in (0.3, 0.65)), length],
        'tendons.table_offset': offsets, 'tendons.table_angle': angles,
    }  # fmt: skip


def _metal(rng: np.random.Generator) -> Parameters:
    """A thin rod whose tendons are held by discs, some of them wound."""
    length = digits(rng.uniform(0.2, 0.5))
    radius, disc = digits(rng.uniform(0.0005, 0.0012)), digits(rng.uniform(0.006, 0.012))
    count = int(rng.integers(1, 3))
    numbers = [int(rng.integers(2, 5)) for _ in range(count)]
    total = sum(numbers)
    young = digits(rng.uniform(40e9, 200e9), 3)
    return _base(rng) | {
        'model': 'exact', 'material.law': 'linear', 'body.length': length,
        'body.radius_base': radius, 'body.radius_tip': radius, 'body.disc_radius': disc,
        'material.youngs_modulus': young, 'material.shear_modulus': digits(young / 2.6, 3),
        'material.density': 6450.0,
        'sections.anchorage': _anchorages(rng, length, count, bool(rng.random() < 0.5)),
        'sections.tendons': numbers,
        'sections.offset_base': digits(rng.uniform(0.7, 1.0, count) * disc, 3),
        'sections.offset_anchorage': digits(rng.uniform(0.5, 0.9, count) * disc, 3),
        'tendons.angle': digits(rng.uniform(-3.0, 3.0, total), 3),
        'tendons.twist': digits(rng.uniform(-6.0, 6.0, total) * (rng.random(total) < 0.5), 3),
    }  # fmt: skip


def _thin(rng: np.random.Generator) -> Parameters:
    """A cone with a thin tip and tendons close to its surface."""
    given = _cone(rng, rng.uniform(0.04, 0.07), rng.uniform(0.1, 0.16)) | _rubber(rng) | _base(rng)
    given['sections.anchorage'] = _anchorages(rng, given['body.length'], 3, True)
    return given | _offsets(rng, given, 0.5, 0.98) | {'model': 'exact'}


def _stout(rng: np.random.Generator) -> Parameters:
    """A short cylinder of a stiff polymer, in which shear and torsion matter."""
    length = digits(rng.uniform(0.08, 0.15))
    radius = digits(0.08 * length, 3)
    young = digits(10.0 ** rng.uniform(7.0, 9.0), 3)
    given = _base(rng) | {
        'model': 'exact', 'material.law': 'linear', 'body.length': length,
        'body.radius_base': radius, 'body.radius_tip': radius,
        'material.youngs_modulus': young, 'material.shear_modulus': digits(young / 2.5, 3),
        'material.density': 1400.0, 'sections.anchorage': [length, digits(0.6 * length)],
        'sections.tendons': [3, 3], 'tendons.twist': digits(rng.uniform(-2.0, 2.0, 6), 3),
    }  # fmt: skip
    return given | _offsets(rng, given, 0.4, 0.9)


_KINDS = (
    *5 * (_paper,), *5 * (_winding,), *3 * (_table,), *3 * (_metal,), *2 * (_thin,),
    *2 * (_stout,),
)  # fmt: skip
