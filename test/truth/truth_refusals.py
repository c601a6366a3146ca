"""Inputs that are refused: the kind of the error, and what it names."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from truth_arms import Parameters
from truth_cases import Case, refusal_of

NAN, INF = math.nan, math.inf
PULL = [[0.2, 0.0, 0.1, 0.0], [0.5, 0.2, 0.0, 0.0], [1.0, 0.0, 0.5, 0.0]]
TABLE4, ROD, PROTOTYPE = 'renda2012_table4', 'rao2021', 'renda2012_prototype'
WINDING, METAL = 'random_07_winding', 'random_13_metal'
WATER = {'loads.gravity': [0.0, 0.0, -9.81], 'loads.fluid_density': 1000.0}
SHEAR = {'material.law': 'linear', 'material.shear': True}

# Parameters of table 4's arm that are changed (None: taken out), the error and what it names.
_PARAMETERS: list[tuple[Parameters, str, str]] = [
    ({'material.youngs_modulus': -1.0}, 'ArmDefinitionError', 'material.youngs_modulus'),
    ({'material.youngs_modulus': NAN}, 'ArmDefinitionError', 'material.youngs_modulus'),
    ({'material.youngs_modulus': None}, 'ConfigError', 'material.youngs_modulus is missing'),
    ({'material.youngs_modulus': 'soft'}, 'ConfigError', 'material.youngs_modulus'),
    ({'material.poisson_ratio': 0.6}, 'ArmDefinitionError', 'material.poisson_ratio'),
    ({'material.poisson_ratio': -1.0}, 'ArmDefinitionError', 'material.poisson_ratio'),
    ({'material.shear_modulus': 1e4}, 'ArmDefinitionError', 'material.shear_modulus'),
    ({'material.density': -1.0}, 'ArmDefinitionError', 'material.density'),
    ({'material.law': 'steel'}, 'ConfigError', 'material.law'),
    ({'material.shear': True}, 'ConfigError', 'material.shear'),
    ({'material.shear': 1}, 'ConfigError', 'material.shear'),
    ({'body.length': 0.0}, 'ArmDefinitionError', 'body.length'),
    ({'body.length': INF}, 'ArmDefinitionError', 'body.length'),
    ({'body.radius_tip': 0.0}, 'ArmDefinitionError', 'body.radius_tip'),
    ({'body.radius_base': -0.01}, 'ArmDefinitionError', 'body.radius_base'),
    ({'body.radius_tip': 1e-7}, 'ArmDefinitionError', 'sections[1].offset_anchorage'),
    ({'body.radius_tip': 1e-7, 'sections.offset_anchorage': [0.0, 0.0035, 0.006]}, 'ConfigError',
     'too thin'),
    ({'body.disc_radius': -1.0}, 'ArmDefinitionError', 'disc_radius'),
    ({'body.table_s': [0.0, 0.2, 0.45], 'body.table_radius': [0.01, 0.01]},
     'ConfigError', 'body.table_radius'),
    ({'body.table_s': [0.0, 0.2], 'body.table_radius': [0.015, 0.01]},
     'ArmDefinitionError', 'last s of body'),
    ({'sections.anchorage': [0.5, 0.315, 0.135]}, 'ArmDefinitionError', 'anchorage'),
    ({'sections.anchorage': [0.135, 0.315, 0.45]}, 'ArmDefinitionError', 'anchorage'),
    ({'sections.anchorage': []}, 'ConfigError', 'sections.offset_base'),
    ({'sections.offset_base': [0.02, 0.0035, 0.006]}, 'ArmDefinitionError', 'offset_base'),
    ({'sections.offset_base': [0.005]}, 'ConfigError', 'sections.offset_base'),
    ({'sections.offset_anchorage': [0.003, 0.0035, 0.006]}, 'ArmDefinitionError',
     'offset_anchorage'),
    ({'sections.tendons': [4, 0, 4]}, 'ConfigError', 'sections.tendons'),
    ({'tendons.angle': [0.0, 1.0]}, 'ConfigError', 'tendons.angle'),
    ({'tendons.twist': [0.0]}, 'ConfigError', 'tendons.twist'),
    ({'tendons.friction': [-0.1]}, 'ArmDefinitionError', 'tendons.friction'),
    ({'tendons.friction': [11.0]}, 'ArmDefinitionError', 'tendons.friction'),
    ({'tendons.friction': [0.1, 0.2]}, 'ArmDefinitionError', 'tendons.friction'),
    ({'tendons.axial_stiffness': [-5.0]}, 'ArmDefinitionError', 'tendons.axial_stiffness'),
    ({'tendons.sheath_stiffness': [NAN]}, 'ArmDefinitionError', 'tendons.sheath_stiffness'),
    ({'tendons.free_length': [-0.1]}, 'ArmDefinitionError', 'tendons.free_length'),
    ({'tendon_names': ['a'] * 12}, 'ArmDefinitionError', 'tendon_names'),
    ({'base.quaternion': [0.0, 0.0, 0.0, 2.0]}, 'ConfigError', 'base.quaternion'),
    ({'base.position': [0.0, NAN, 0.0]}, 'ConfigError', 'base.position'),
    ({'stations': 3}, 'ConfigError', 'stations is 3'),
    ({'stations': 10_001}, 'ConfigError', 'stations is 10001'),
    ({'model': 'magic'}, 'ConfigError', "model is 'magic'"),
    ({'radius': 1.0}, 'ConfigError', 'radius is no parameter'),
    ({'loads.gravity': [0.0, 0.0]}, 'ArmDefinitionError', 'loads.gravity'),
    ({'loads.gravity': [0.0, 0.0, -9.81], 'material.density': 0.0}, 'ArmDefinitionError',
     'material.density'),
    ({'loads.fluid_density': -1.0}, 'ArmDefinitionError', 'loads.fluid_density'),
    ({'loads.tip_force': [1e9, 0.0, 0.0]}, 'ArmDefinitionError', 'loads.tip_force'),
    ({'loads.tip_moment': [0.0, 1e9, 0.0]}, 'ArmDefinitionError', 'loads.tip_moment'),
    ({'loads.point_s': [0.5], 'loads.point_force': [0.0, 0.0, 0.1]}, 'ArmDefinitionError',
     'loads: s is 0.5'),
    ({'loads.point_s': [0.2], 'loads.point_force': [0.0]}, 'ConfigError', 'loads.point_force'),
    ({'loads.distributed_s': [0.2], 'loads.distributed_force': [0.0, 0.0, 1.0]},
     'ArmDefinitionError', 'loads.distributed.s'),
    ({'model': 'renda2012', 'loads.tip_force': [0.0, 0.0, 0.01]}, 'ConfigError', 'renda2012'),
    ({'model': 'closed_form', 'loads.tip_force': [0.0, 0.0, 0.01]}, 'ConfigError', 'closed_form'),
    ({'model': 'renda2012', 'tendons.friction': [0.1]}, 'ConfigError', 'friction'),
    ({'model': 'renda2012', 'tendons.twist': [1.0] * 12}, 'ConfigError', 'section'),
    ({'model': 'closed_form', 'tendons.offset_stddev': 1e-4}, 'ConfigError',
     'tendons.offset_stddev'),
    ({'model': 'closed_form', 'tendons.sheath_stiffness': [1e5]}, 'ConfigError', 'sheath'),
    ({'tension_stddev': -0.1}, 'ArmDefinitionError', 'tension_stddev'),
]  # fmt: skip

# An arm, changes of its parameters, steps, the error and what it names.
_STEPS: list[tuple[str, Parameters, list[dict[str, Any]], str, str]] = [
    (TABLE4, {}, [{'tensions': [[0.1, 0.0, 0.0]]}], 'TensionError', '(..., 3, 4)'),
    (TABLE4, {}, [{'tensions': [[-0.1, 0.0, 0.0, 0.0], *PULL[1:]]}], 'TensionError',
     'tendon_1_1'),
    (TABLE4, {}, [{'tensions': [PULL[0], [0.0, NAN, 0.0, 0.0], PULL[2]]}], 'TensionError',
     'tendon_2_2'),
    (TABLE4, {}, [{'tensions': [*PULL[:2], [0.0, 0.0, 0.0, INF]]}], 'TensionError', 'tendon_3_4'),
    (TABLE4, {}, [{'tensions': 'all'}], 'TensionError', 'tensions'),
    (TABLE4, {}, [{'tensions': [[1e9, 0.0, 0.0, 0.0], *PULL[1:]]}], 'SolveError', 'beyond'),
    (TABLE4, {'model': 'renda2012'}, [{'tensions': [[1e9, 0.0, 0.0, 0.0], *PULL[1:]]}],
     'SolveError', 'beyond'),
    (TABLE4, {'model': 'renda2012'}, [{'tensions': [[5.0, 5.0, 5.0, 5.0], *PULL[1:]]}],
     'SolveError', ''),
    (TABLE4, {'model': 'closed_form'}, [{'tensions': [[5.0, 5.0, 5.0, 5.0], *PULL[1:]]}],
     'SolveError', ''),
    *((PROTOTYPE, changes, [{'tensions': [[6e4, 0.0, 0.0, 0.0]]}], 'SolveError', 'fibre')
      for changes in ({}, WATER, {'tendons.friction': [0.2]})),
    *((ROD, {'material.law': 'neo_hookean'} | changes,
       [{'tensions': [[2.5e6, 0.0, 0.0], [0.0, 0.0, 0.0]]}], 'SolveError', 'shorten a tendon')
      for changes in ({}, WATER, {'tendons.friction': [0.2]})),
    *((ROD, changes, [{'tensions': [[2.5e6, 0.0, 0.0], [0.0, 0.0, 0.0]]}], 'SolveError', '')
      for changes in ({}, WATER, {'tendons.friction': [0.2]})),
    (TABLE4, {'tendons.sheath_stiffness': [2e3]}, [{'tensions': PULL}], 'SolveError', 'sheath'),
    (TABLE4, {}, [{'tensions': PULL, 'tip_wrench': [0.0, 0.0, 0.01]}], 'LoadError', 'tip_wrench'),
    (TABLE4, {}, [{'tensions': PULL, 'tip_wrench': [0.0, 0.0, NAN, 0.0, 0.0, 0.0]}], 'LoadError',
     'tip_wrench'),
    (TABLE4, {}, [{'tensions': PULL, 'tip_wrench': [0.0, 0.0, 1e9, 0.0, 0.0, 0.0]}], 'LoadError',
     'force on the tip'),
    (TABLE4, {}, [{'tensions': PULL, 'tip_wrench': [0.0, 0.0, 0.0, 1e9, 0.0, 0.0]}], 'LoadError',
     'moment on the tip'),
    (TABLE4, {'model': 'closed_form'}, [{'tensions': PULL, 'tip_wrench': [0.1] + 5 * [0.0]}],
     'ConfigError', 'closed_form'),
    (TABLE4, WATER | {'solve_budget.iterations': 1},
     [{'tensions': [[0.3, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0], [0.0, 6.0, 0.0, 0.0]],
       'tip_wrench': [0.0, 0.05, 0.0, 0.0, 0.0, 0.0]}], 'ContinuationError', 'budget'),
    (ROD, {}, [{'tensions': [1.0, 0.0, 0.0]}], 'TensionError', '(..., 2, 3)'),
    (ROD, {}, [{'tensions': [[1.0, 0.0, 0.0], [0.0, -2.0, 0.0]]}], 'TensionError', 'tendon_2_2'),
    (ROD, {'model': 'renda2012'}, [{'tensions': [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]]}],
     'ConfigError', 'section'),
    (WINDING, {'model': 'renda2012'}, [{'tensions': [0.0] * 8}], 'ConfigError', 'section'),
    (WINDING, {}, [{'tensions': [0.0] * 7}], 'TensionError', '(..., 2, 4)'),
    (METAL, {}, [{'tensions': [0.0, -1.0]}], 'TensionError', 'tensions'),
    (ROD, {}, [{'displacements': {'tendon_9_1': 0.001}}], 'TensionError', 'tendon_9_1'),
    (ROD, {}, [{'displacements': {'tendon_1_1': 0.001}, 'tensions': {'tendon_1_1': 1.0}}],
     'TensionError', 'tendon_1_1'),
    (ROD, {}, [{'displacements': {'tendon_1_1': NAN}}], 'TensionError', 'tendon_1_1'),
    (ROD, {}, [{'displacements': {'tendon_1_1': 0.001}, 'tensions': {'tendon_1_2': -1.0}}],
     'TensionError', 'tendon_1_2'),
    (ROD, {}, [{'displacements': {'tendon_1_1': 0.001}, 'tensions': {'nobody': 1.0}}],
     'TensionError', 'nobody'),
    (ROD, {}, [{'displacements': {'tendon_1_1': 0.001}, 'tip_wrench': [1.0]}], 'LoadError',
     'tip_wrench'),
    (ROD, {'model': 'closed_form'}, [{'displacements': {'tendon_1_1': 0.001},
                                      'tip_wrench': [1.0] + 5 * [0.0]}], 'ConfigError',
     'closed_form'),
    (PROTOTYPE, {}, [{'displacements': {'tendon_1_1': 0.5}}], 'TensionError', 'tendon_1_1'),
]  # fmt: skip


def refusals(arms: dict[str, Parameters]) -> Iterator[dict[str, Any]]:
    """The cases, each checked against the solver; what is not as written here raises."""
    found = [(TABLE4, changes, [{'tensions': PULL}], kind, names)
             for changes, kind, names in _PARAMETERS] + _STEPS  # fmt: skip
    for number, (arm, changes, steps, kind, names) in enumerate(found):
        given = {
            name: value
            for name, value in (arms[arm] | {'stations': 31} | changes).items()
            if value is not None
        }
        case = Case(
            f'refusals/{number:02d}', 'refused', given, tuple(steps), [0.0], {'position': None},
            {}, {}, (kind, names), '',
        )  # type: ignore[arg-type]  # fmt: skip
        for compiled in (False, None):
            error = refusal_of(case, compiled)
            classes = [one.__name__ for one in type(error).__mro__]
            if kind not in classes or names not in str(error):
                print(f'{case.name} {changes} {steps}: {type(error).__name__}: {error}, not '
                      f'{kind}: {names}')  # fmt: skip
                break
        else:
            yield {
                'name': case.name, 'kind': case.kind, 'arm': arm,
                'changes': {'stations': 31} | changes, 'steps': steps, 'refused': [kind, names],
            }  # fmt: skip
