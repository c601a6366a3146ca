"""A case solved with finite elements, and the models compared with it.

Lengths of the answer are in mm, errors in % of the arm's length.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from arm_mesh import Mesh
from cases import Case
from elasticity import ElasticArm, Report, SolidShape

from octo_arm_model import Backbone, Solver
from octo_arm_model.arm.hints import FloatArray

_STATIONS = 801
MODELS: dict[str, tuple[str, str]] = {  # name of the model and of its elastic law
    'renda2012': ('renda2012', 'linear'),
    'closed_form': ('closed_form', 'linear'),
    'exact': ('exact', 'neo_hookean'),
    'exact, linear': ('exact', 'linear'),
}


def run_case(case: Case, report: Report) -> dict[str, Any]:
    """Compute ``case`` on all its meshes and with all its variants, and compare.

    Raises:
        SolveError: if a load is not reached.
    """
    arms: dict[Mesh, ElasticArm] = {}
    shapes: dict[Mesh, list[SolidShape]] = {}
    for mesh in case.meshes:
        tell = _telling(report, f'{case.name}, mesh {mesh}')
        arms[mesh] = ElasticArm(case.arm, mesh, case.pulled, case.contact)
        # From the finest solution so far; the first is followed from the unloaded arm.
        nearest = case.basis if case.basis in shapes else case.meshes[0]
        known = shapes.get(nearest, [])
        guesses = [arms[mesh].guess(arms[nearest], shape.state) for shape in known]
        shapes[mesh] = list(arms[mesh].follow(case.tensions, tell, guesses))
    models = solve_models(case, case.tensions)
    result = shapes[case.result]
    uncertain = np.sum([_apart(shapes[a], shapes[b]) for a, b in case.pairs], axis=0)
    return {
        'arm': case.preset,
        'tendons': [case.arm.tendon_names[number] for number in case.pulled],
        'tensions_N': [list(load) for load in case.tensions],
        'sheath_radius_mm': 1e3 * (case.contact.sheath or 0.0),
        'disc_mm': 1e3 * case.contact.disc,
        'mesh': str(case.result),
        'meshes': {
            str(mesh): {
                'elements': arms[mesh].mesh.layer.size,
                'unknowns': arms[mesh].solid.size,
                'tips_mm': [_rounded(1e3 * shape.tip) for shape in found],
                'volume_ratios': [_rounded(shape.volume) for shape in found],
                'residual': max(float(f'{shape.residual:.0e}') for shape in found),
            }
            for mesh, found in shapes.items()
        },
        'mesh_error_percent': _percent(case, uncertain),
        'tip_error_percent': {
            name: _percent(case, _apart(found, result)) for name, found in models.items()
        },
        'tip_direction_error_deg': {
            name: [round(_angle(b, s), 2) for b, s in zip(found, result)]
            for name, found in models.items()
        },
        'variants': {
            name: _variant(
                case,
                change,
                arms[case.basis],
                shapes[case.basis],
                models,
                _telling(report, f'{case.name}, {name}'),
            )
            for name, change in case.variants.items()
        },
        'midlines_mm': [_rounded(1e3 * shape.midline[::2]) for shape in result],
    }


def solve_models(case: Case, tensions: Sequence[Sequence[float]]) -> dict[str, list[Backbone]]:
    """Backbones of every model at each of ``tensions`` of the pulled tendons."""
    arm = case.arm
    sets = np.zeros((len(tensions), len(arm.tendons)))
    sets[:, case.pulled] = tensions
    found = {}
    for name, (model, law) in MODELS.items():
        solver = Solver(arm, model, _STATIONS, material=law)
        found[name] = [solver.solve(each.reshape(arm.tension_shape)) for each in sets]
    return found


def _variant(
    case: Case,
    change: dict[str, Any],
    base: ElasticArm,
    shapes: list[SolidShape],
    models: dict[str, list[Backbone]],
    report: Report,
) -> dict[str, Any]:
    """Displacement of the tip of the arm ``base`` by a ``change`` of the contact or of nu."""
    arm, contact = case.arm, dict(change)
    if 'poisson_ratio' in contact:
        ratio = contact.pop('poisson_ratio')
        material = dataclasses.replace(arm.material, poisson_ratio=ratio)
        arm = dataclasses.replace(arm, material=material)
    varied = ElasticArm(arm, case.basis, case.pulled, dataclasses.replace(case.contact, **contact))
    before = [shapes[i] for i in case.varied]
    guesses = [varied.guess(base, shape.state) for shape in before]
    loads = [case.tensions[i] for i in case.varied]
    found = list(varied.follow(loads, report, guesses))
    return {
        'loads': [list(load) for load in loads],
        'tip_change_percent': _percent(case, _apart(found, before)),
        'tip_error_percent': {
            model: _percent(case, _apart([backbones[i] for i in case.varied], found))
            for model, backbones in models.items()
        },
    }


def _telling(report: Report, what: str) -> Report:
    return lambda line: report(f'{what}: {line}')


def _apart(
    some: Sequence[Backbone | SolidShape], others: Sequence[Backbone | SolidShape]
) -> FloatArray:
    """Distances of the tips [m]."""
    apart = [np.linalg.norm(a.tip - b.tip) for a, b in zip(some, others, strict=True)]
    return np.array(apart, dtype=np.float64)


def _percent(case: Case, lengths: FloatArray) -> list[float]:
    return [round(float(x), 3) for x in 100.0 / case.arm.length * lengths]


def _angle(backbone: Backbone, shape: SolidShape) -> float:
    """Between the tangents of the two tips [deg]."""
    x, y, z, w = backbone.quaternion[-1]
    tangent = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    return float(np.rad2deg(np.arccos(np.clip(tangent @ shape.rotation[:, 0], -1.0, 1.0))))


def _rounded(values: Any) -> Any:
    return np.round(np.asarray(values, dtype=float), 4).tolist()
