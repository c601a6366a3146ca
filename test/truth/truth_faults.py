"""Cases in which the solver that made the file is wrong, and what is right.

* friction, squeezed: a tendon whose direction turns by 2.5 rad within 0.002 of the length, as it
  is compressed to 0.02. Knots are put there ever closer, until its angle at its anchorage,
  4.29217, no longer changes in the eighth digit. From positions of 8001 stations alone the angle
  of the polygon of the tendon is 4.2900, of 4001 stations 4.2877, and so 4.2923 in the limit.
* two worlds: one of the two implementations refuses them, the other one solves them; its answer
  is the right one and does not change with finer runs.
* unstable: a rod under 1.2 times Euler's load, bent to one side and then pulled to the other one
  by a small tension. Across the plane in which it is bent it cannot stay: it is turned about the
  line of the load by the least of moments, by the way round the load does no work, and the
  tendon does. Of the balances in the plane only the one on the side of the tendon is stable. The
  elastica itself has its tip there at (0.201596, -0.195050) m.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from truth_arms import Parameters
from truth_cases import answer_of, distance
from truth_finer import DIGITS, with_knots
from truth_plans import SHAPE

from octo_arm_model import Config

STEEP = 0.0300232  # where the tendon turns [m]


def faults(field: Path) -> list[dict[str, Any]]:
    """The cases; ``field`` has the files of the first three."""
    found = []
    for name, fault in (
        ('friction_squeezed', 'the tension is wrong by a factor of 14 at a residual of 2e-13'),
        ('two_worlds_1', 'refused by NumPy, solved in machine code'),
        ('two_worlds_2', 'refused by NumPy, solved in machine code'),
    ):
        given = json.loads((field / f'{name}.json').read_text())
        parameters = given['d']
        config = Config.from_parameters(parameters)
        steps = [{'tensions': np.reshape(given['T'], config.arm.tension_shape).tolist()}]
        ends = [section.anchorage for section in config.arm.sections]
        finer = _near(config, STEEP) if name == 'friction_squeezed' else _even(config)
        case = _case(f'faults/{name}', parameters, steps, [0.0, *ends[::-1]], finer)
        # To refuse this one is right as well.
        if name == 'friction_squeezed':
            case['refused'] = ['SolveError', '']
        found.append(case | {'fault': fault})
    found.append(_unstable())
    return found


def _even(config: Config) -> list[Config]:
    length = config.arm.length
    return [
        with_knots(config, np.arange(1, knots) * length / knots, stations)
        for knots, stations in ((24, 401), (48, 801))
    ]


def _near(config: Config, s: float) -> list[Config]:
    """Knots ever closer to ``s`` [m]."""
    length = config.arm.length
    coarse = np.arange(1, 48) * length / 48
    found = []
    for count in (40, 80):
        close = s + np.linspace(-0.003, 0.003, count + 1)
        far = np.geomspace(0.001, 0.02, 8)
        knots = [
            *coarse[np.abs(coarse - s) > 0.005],
            *close,
            *(close[0] - far),
            *(close[-1] + far),
        ]
        places = np.unique(np.round([one for one in knots if one > 0.0], 9))
        found.append(with_knots(config, places, 901))
    return found


def _case(
    name: str, parameters: Parameters, steps: list[dict[str, Any]], s: list[float],
    finer: list[Config],
) -> dict[str, Any]:  # fmt: skip
    fine, finest = (
        answer_of(one.solver(), one.uncertainty, tuple(steps), np.array(s), SHAPE) for one in finer
    )
    expected, error = {}, {}
    for quantity, right in finest.items():
        decimals = DIGITS - 1 - math.floor(math.log10(np.abs(right).max()))
        expected[quantity] = np.round(right, decimals).tolist()
        error[quantity] = float(f'{distance(quantity, fine[quantity], right).max():.1e}')
    return {
        'name': name, 'kind': 'fault', 'arm': '', 'changes': parameters, 'steps': steps, 's': s,
        'expected': expected, 'error': error,
    }  # fmt: skip


def _unstable() -> dict[str, Any]:
    length, radius, young, offset = 0.3, 1e-3, 200e9, 8e-3
    bending = young * math.pi * radius**4 / 4.0
    load = 1.2 * math.pi**2 * bending / (4.0 * length**2)
    parameters = {
        'model': 'exact', 'material.law': 'linear', 'material.youngs_modulus': young,
        'material.poisson_ratio': 0.3, 'body.length': length, 'body.radius_base': radius,
        'body.radius_tip': radius, 'body.disc_radius': offset, 'sections.anchorage': [length],
        'sections.offset_base': [offset], 'sections.offset_anchorage': [offset],
        'loads.tip_force': [-load, 0.0, 0.0], 'stations': 101,
    }  # fmt: skip
    config = Config.from_parameters(parameters)
    small = {'tensions': [[0.0, 0.0, 0.12, 0.0]]}
    case = _case(
        'faults/unstable', parameters, [small], [0.0, 0.5 * length, length], _even(config)
    )
    tip = np.array(case['expected']['position'])[-1]
    assert np.abs(tip - _elastica(length, load / bending, -0.12 * offset / bending)).max() < 1e-5
    case['steps'] = [{'tensions': [[0.13, 0.0, 0.0, 0.0]]}, small | {'start': True}]
    return case | {'fault': 'an unstable balance is returned, its tip at y = +0.194 m'}


def _elastica(length: float, pressed: float, bend: float) -> np.ndarray:
    """Tip of a rod that keeps its length, on the side that its end is bent to.

    theta'' = -``pressed`` sin(theta), theta' = ``bend`` at the tip [1/m].
    """

    def end(start: float) -> np.ndarray:
        found = solve_ivp(
            lambda s, y: [y[1], -pressed * math.sin(y[0]), math.cos(y[0]), math.sin(y[0])],
            (0.0, length), [0.0, start, 0.0, 0.0], rtol=1e-11, atol=1e-13,
        )  # fmt: skip
        return np.asarray(found.y[:, -1])

    start = brentq(lambda start: end(start)[1] - bend, -8.0, -2.0, xtol=1e-13)
    return np.array([*end(start)[2:], 0.0])
