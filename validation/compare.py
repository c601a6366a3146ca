"""Solve a case with finite elements and compare the models with it.

Lengths in the results are in mm, errors in % of the arm's length.
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
    """Solve ``case`` on all its meshes and with all its variants, and compare the models with it.

    Raises:
        SolveError: if a load has no solution.
    """
    arms: dict[Mesh, ElasticArm] = {}
    shapes: dict[Mesh, list[SolidShape]] = {}
    for mesh in case.meshes:
        report_mesh = _report_with_prefix(report, f'{case.name}, mesh {mesh}')
        arms[mesh] = ElasticArm(case.arm, mesh, case.pulled, case.contact)
        # Solutions on the mesh of the variants, or on the first one, are the guesses.
        nearest = case.basis if case.basis in shapes else case.meshes[0]
        solutions = shapes.get(nearest, [])
        guesses = [arms[mesh].guess(arms[nearest], shape.state) for shape in solutions]
        shapes[mesh] = list(arms[mesh].follow(case.tensions, report_mesh, guesses))
    models = solve_models(case, case.tensions)
    result = shapes[case.result]
    mesh_error = np.sum([_tip_distances(shapes[a], shapes[b]) for a, b in case.pairs], axis=0)
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
                'tips_mm': [_round(1e3 * shape.tip) for shape in found],
                'volume_ratios': [_round(shape.volume) for shape in found],
                'residual': max(float(f'{shape.residual:.0e}') for shape in found),
            }
            for mesh, found in shapes.items()
        },
        'mesh_error_percent': _percent(case, mesh_error),
        'tip_error_percent': {
            name: _percent(case, _tip_distances(backbones, result))
            for name, backbones in models.items()
        },
        'tip_direction_error_deg': {
            name: [round(_angle(b, s), 2) for b, s in zip(backbones, result)]
            for name, backbones in models.items()
        },
        'variants': {
            name: _variant(
                case,
                change,
                arms[case.basis],
                shapes[case.basis],
                models,
                _report_with_prefix(report, f'{case.name}, {name}'),
            )
            for name, change in case.variants.items()
        },
        'midlines_mm': [_round(1e3 * shape.midline[::2]) for shape in result],
    }


def solve_models(case: Case, tensions: Sequence[Sequence[float]]) -> dict[str, list[Backbone]]:
    """Return the backbones of each model at ``tensions`` (loads, pulled) [N]."""
    arm = case.arm
    sets = np.zeros((len(tensions), len(arm.tendons)))
    sets[:, case.pulled] = tensions
    backbones = {}
    for name, (model, law) in MODELS.items():
        solver = Solver(arm, model, _STATIONS, material=law)
        backbones[name] = [solver.solve(each.reshape(arm.tension_shape)) for each in sets]
    return backbones


def _variant(
    case: Case,
    change: dict[str, Any],
    base: ElasticArm,
    shapes: list[SolidShape],
    models: dict[str, list[Backbone]],
    report: Report,
) -> dict[str, Any]:
    """Compare ``case`` after a ``change`` of the contact or of nu with the case and the models."""
    arm, contact = case.arm, dict(change)
    if 'poisson_ratio' in contact:
        ratio = contact.pop('poisson_ratio')
        material = dataclasses.replace(arm.material, poisson_ratio=ratio)
        arm = dataclasses.replace(arm, material=material)
    solid = ElasticArm(arm, case.basis, case.pulled, dataclasses.replace(case.contact, **contact))
    before = [shapes[i] for i in case.varied]
    guesses = [solid.guess(base, shape.state) for shape in before]
    loads = [case.tensions[i] for i in case.varied]
    after = list(solid.follow(loads, report, guesses))
    return {
        'loads': [list(load) for load in loads],
        'tip_change_percent': _percent(case, _tip_distances(after, before)),
        'tip_error_percent': {
            model: _percent(case, _tip_distances([backbones[i] for i in case.varied], after))
            for model, backbones in models.items()
        },
    }


def _report_with_prefix(report: Report, prefix: str) -> Report:
    return lambda line: report(f'{prefix}: {line}')


def _tip_distances(
    shapes: Sequence[Backbone | SolidShape], others: Sequence[Backbone | SolidShape]
) -> FloatArray:
    """Return the distances between the tips [m]."""
    distances = [np.linalg.norm(a.tip - b.tip) for a, b in zip(shapes, others, strict=True)]
    return np.array(distances, dtype=np.float64)


def _percent(case: Case, lengths: FloatArray) -> list[float]:
    return [round(float(x), 3) for x in 100.0 / case.arm.length * lengths]


def _angle(backbone: Backbone, shape: SolidShape) -> float:
    """Return the angle between the tangents of the two tips [deg]."""
    x, y, z, w = backbone.quaternion[-1]
    tangent = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    return float(np.rad2deg(np.arccos(np.clip(tangent @ shape.rotation[:, 0], -1.0, 1.0))))


def _round(values: Any) -> Any:
    return np.round(np.asarray(values, dtype=float), 4).tolist()
