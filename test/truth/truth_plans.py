"""What is done to each arm of the truth: tensions, loads, friction, sheaths, winches, at random.

Sizes are such that arms bend far, by up to some radian, and shorten by up to a third.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from truth_arms import UNCERTAIN, Parameters, digits

from octo_arm_model import Arm, Config, displacements_of

SHAPE = ('position', 'quaternion', 'strain', 'tension', 'length')
PAPERS_DERIVATIVES = ('by_tension', 'by_youngs_modulus', 'covariance')
DERIVATIVES = (
    'by_tension', 'by_youngs_modulus', 'by_poisson_ratio', 'by_offset', 'compliance', 'covariance'
)  # fmt: skip


class Plan(NamedTuple):
    """One case to be solved: changes of the arm's parameters, steps and the quantities."""

    kind: str
    changes: Parameters
    steps: list[dict[str, Any]]
    quantities: tuple[str, ...]


class Scales:
    """Bends and strains of an arm per newton, from its parameters alone."""

    def __init__(self, arm: Arm) -> None:
        s = np.linspace(0.0, arm.length, 801)
        middle = 0.5 * (s[1:] + s[:-1])
        step = s[1] - s[0]
        radius = arm.body.radius(middle)
        young = arm.material.youngs_modulus_at(middle)
        flexibility = 4.0 / (np.pi * young * radius**4)
        offset = np.hypot(*arm.tendon_offsets(middle))
        ends = np.array([arm.sections[number - 1].anchorage for number in arm.tendon_section])
        acts = middle < ends[:, np.newaxis]
        self.bend = (offset * flexibility * acts).sum(axis=1) * step
        self.squeeze = np.where(acts, 1.0 / (np.pi * young * radius**2), 0.0).max(axis=1)
        beyond = arm.length - middle
        # Of a force across the tip that moves it by about the length, and of a moment that turns
        # it by a radian, by the linear theory.
        self.force = arm.length / (beyond**2 * flexibility).sum() / step
        self.moment = 1.0 / flexibility.sum() / step
        self.shape = arm.tension_shape


def pulls(
    scales: Scales, rng: np.random.Generator, bend: float, squeeze: float, part: float = 0.6
) -> Any:
    """Tensions that bend the arm by at most ``bend`` [rad] and shorten it by ``squeeze`` at most.

    About ``part`` of the tendons are taut.
    """
    count = scales.bend.size
    taut = rng.random(count) < part
    taut[rng.integers(count)] = True
    # In parts of what each alone may pull, so that thin sections do not take it all.
    alone = np.minimum(bend / np.maximum(scales.bend, 1e-30), squeeze / scales.squeeze)
    wanted = taut * alone * rng.uniform(0.15, 1.0, count)
    largest = max((scales.bend * wanted).sum() / bend, (scales.squeeze * wanted).sum() / squeeze)
    return digits((wanted / max(largest, 1.0)).reshape(scales.shape))


def wrench(scales: Scales, rng: np.random.Generator, size: float) -> list[float]:
    """A force and a moment on the tip."""
    force, moment = rng.standard_normal((2, 3))
    force *= size * scales.force / np.linalg.norm(force)
    moment *= 0.5 * size * scales.moment / np.linalg.norm(moment)
    return digits([*force, *moment])


def _tip(scales: Scales, rng: np.random.Generator, size: float) -> Parameters:
    both = wrench(scales, rng, size)
    return {'loads.tip_force': both[:3], 'loads.tip_moment': both[3:]}


def _points(scales: Scales, rng: np.random.Generator, length: float) -> Parameters:
    force = rng.standard_normal((2, 3)) * scales.force * 0.25
    return {
        'loads.point_s': [digits(0.35 * length, 3), digits(0.8 * length, 3)],
        'loads.point_force': digits(force.ravel()),
    }


def _distributed(scales: Scales, rng: np.random.Generator, length: float) -> Parameters:
    force = rng.standard_normal((3, 3)) * scales.force / length * 0.6
    return {
        'loads.distributed_s': digits([0.2 * length, 0.6 * length, 0.9 * length], 3),
        'loads.distributed_force': digits(force.ravel()),
    }


AIR = {'loads.gravity': [0.0, 0.0, -9.81]}
WATER = AIR | {'loads.fluid_density': 1000.0}


def makers(name: str, given: Parameters) -> Iterator[Any]:
    arm = Config.from_parameters(given).arm
    scales, length = Scales(arm), arm.length
    metal = given.get('material.law') == 'linear'
    own = 'linear' if metal else 'neo_hookean'
    other = 'neo_hookean' if metal else 'linear'
    is_papers = name.startswith('renda') or 'paper' in name or 'thin' in name
    stiffness = float(np.mean(arm.material.shear_modulus_at(np.linspace(0.0, length, 9))))
    scale = float(np.median(pulls(scales, np.random.default_rng(0), 2.0, 0.2, 1.0)))
    count = len(arm.tendons)

    def stated(rng: np.random.Generator, exact: bool = True) -> Parameters:
        """Standard deviations of what the shape depends on."""
        some = dict(UNCERTAIN) if exact else {'material.youngs_modulus_stddev': 0.05}
        some['tension_stddev'] = digits(0.03 * scale, 2)
        if exact:
            some['tendons.offset_stddev'] = digits(0.01 * length / 20.0, 2)
        return some

    def taut(rng: np.random.Generator, bend: float = 3.5, squeeze: float = 0.3) -> Any:
        return pulls(scales, rng, bend * rng.uniform(0.3, 1.0), squeeze * rng.uniform(0.4, 1.0))

    def simple(kind: str, quantities: tuple[str, ...], more: Any, model: str = 'exact') -> Any:
        """A case of one solve under random tensions, of the parameters that ``more`` makes."""

        def make(rng: np.random.Generator) -> Plan:
            changes = stated(rng, model == 'exact') | {'model': model} | more(rng)
            return Plan(kind, changes, [{'tensions': taut(rng)}], quantities)

        return make

    def rough(rng: np.random.Generator) -> Parameters:
        mu = digits(rng.uniform(0.05, 0.5, count), 2)
        return {'tendons.friction': mu if rng.random() < 0.5 else mu[:1]}

    def soft(rng: np.random.Generator) -> Parameters:
        return {'tendons.sheath_stiffness': [digits(stiffness * rng.uniform(2.0, 12.0), 3)]}

    def of_law(law: str, more: Any = lambda rng: {}) -> Any:
        return lambda rng: {'material.law': law} | more(rng)

    with_shear = of_law('linear', lambda rng: {'material.shear': True})
    # Without loads.
    if is_papers:
        for _ in range(3):
            yield simple('renda2012', SHAPE + PAPERS_DERIVATIVES, lambda rng: {}, 'renda2012')
    for _ in range(2):
        yield simple('closed_form', SHAPE + PAPERS_DERIVATIVES, lambda rng: {}, 'closed_form')
    for _ in range(3):
        yield simple('unloaded', SHAPE + DERIVATIVES + ('length_by_tension',), of_law(own))
    yield simple('unloaded', SHAPE + DERIVATIVES, of_law(other))
    yield simple('shear', SHAPE + DERIVATIVES, with_shear)

    # With loads in the parameters.
    def loaded(kind: str, law: str, *loads: Any, quantities: Any = SHAPE + DERIVATIVES) -> Any:
        def more(rng: np.random.Generator) -> Parameters:
            found: Parameters = {'material.law': law}
            for load in loads:
                found |= load(rng) if callable(load) else load
            return found

        return simple(kind, quantities, more)

    def tip(rng: np.random.Generator) -> Parameters:
        return _tip(scales, rng, rng.uniform(0.1, 0.8))

    def points(rng: np.random.Generator) -> Parameters:
        return _points(scales, rng, length)

    def distributed(rng: np.random.Generator) -> Parameters:
        return _distributed(scales, rng, length)

    yield loaded('tip wrench', own, tip)
    yield loaded('tip wrench', other, tip)
    yield loaded('water', own, WATER)
    yield loaded('water', own, WATER, tip)
    yield loaded('air', own, AIR)
    yield loaded('air', other, AIR)
    yield loaded('point loads', own, points)
    yield loaded('distributed load', own, distributed)
    yield loaded('all loads', own, WATER, tip, points, distributed)
    yield loaded('shear and loads', 'linear', {'material.shear': True}, WATER, tip)
    yield loaded('shear and loads', 'linear', {'material.shear': True}, points, distributed)

    def with_wrench(rng: np.random.Generator) -> Plan:
        step = {'tensions': taut(rng), 'tip_wrench': wrench(scales, rng, rng.uniform(0.1, 0.8))}
        changes = stated(rng) | {'model': 'exact', 'material.law': own} | WATER
        return Plan('tip wrench', changes, [step], SHAPE + DERIVATIVES)

    yield with_wrench

    def from_start(rng: np.random.Generator) -> Plan:
        steps = [
            {'tensions': taut(rng), 'tip_wrench': wrench(scales, rng, 0.4), 'start': number > 0}
            for number in range(4)
        ]
        changes = {'model': 'exact', 'material.law': own} | WATER
        return Plan('from a start', changes, steps, ('tips', *SHAPE, 'compliance'))

    yield from_start

    # Friction.
    slid = SHAPE + DERIVATIVES + ('by_friction',)
    of_papers = SHAPE + PAPERS_DERIVATIVES + ('by_friction',)
    yield simple('friction', of_papers, rough, 'closed_form')
    yield simple('friction', slid, of_law(own, rough))
    yield loaded('friction and loads', own, rough, WATER, tip, quantities=slid)
    yield loaded('friction and loads', 'linear', rough, points, distributed, quantities=slid)

    def history(kind: str, model: str, law: str, more: Any) -> Any:
        def make(rng: np.random.Generator) -> Plan:
            first, second = (np.array(taut(rng)) for _ in range(2))
            parts = [first, 0.5 * first + 0.1 * second, second, 0.9 * second, first]
            number = int(rng.integers(3, 6))
            steps = [{'tensions': digits(part), 'follow': True} for part in parts[:number]]
            changes = {'model': model, 'material.law': law} | more(rng)
            more_of = PAPERS_DERIVATIVES[:1] if model == 'closed_form' else ('compliance',)
            return Plan(kind, changes, steps, ('tips', *SHAPE, 'by_tension', *more_of[-1:]))

        return make

    yield history('history of friction', 'closed_form', own, rough)
    yield history('history of friction', 'exact', own, rough)
    yield history('history of friction and loads', 'exact', own,
                  lambda rng: rough(rng) | WATER | tip(rng))  # fmt: skip
    # Sheaths.
    in_sheath = SHAPE + DERIVATIVES + ('by_sheath_stiffness',)
    yield simple('sheath', in_sheath, of_law(own, soft))
    yield loaded('sheath and loads', own, soft, WATER, tip, quantities=in_sheath)
    yield simple('friction and sheath', in_sheath + ('by_friction',),
                 of_law(own, lambda rng: soft(rng) | rough(rng)))  # fmt: skip
    yield loaded('friction, sheath and loads', own, soft, rough, WATER, tip, quantities=slid)
    yield history('history of friction in sheaths', 'exact', own,
                  lambda rng: soft(rng) | rough(rng) | WATER)  # fmt: skip

    # Winches.
    def lengths(kind: str, more: Any, steps: int = 1, driven_part: float = 1.0,
                on_tip: bool = False) -> Any:  # fmt: skip
        def make(rng: np.random.Generator) -> Plan:
            changes = stated(rng) | {'model': 'exact', 'material.law': own} | {
                'displacement_stddev': digits(1e-3 * length, 2),
                'tendons.axial_stiffness': [digits(scale * rng.uniform(20.0, 200.0), 3)],
                'tendons.free_length': [digits(length * rng.uniform(0.1, 1.0), 3)],
            } | more(rng)  # fmt: skip
            config = Config.from_parameters(given | changes)
            solver = config.solver(compiled=None)
            names = config.arm.tendon_names
            driven = rng.random(count) < driven_part
            driven[rng.integers(count)] = True
            found = []
            for _ in range(steps):
                load = wrench(scales, rng, 0.3) if on_tip else None
                tensions = np.array(taut(rng, 2.5, 0.2))
                shape = solver.solve(tensions, load)
                reeled = displacements_of(solver, shape).ravel()
                # Some are let out, and slack.
                reeled -= 0.02 * length * (rng.random(count) < 0.15)
                step: dict[str, Any] = {
                    'displacements': {
                        tendon: round(float(by), 7)
                        for tendon, by, is_driven in zip(names, reeled, driven) if is_driven
                    },
                    'tensions': {
                        tendon: float(pull)
                        for tendon, pull, by_length in zip(names, tensions.ravel(), driven)
                        if not by_length
                    },
                }  # fmt: skip
                if load is not None:
                    step['tip_wrench'] = load
                found.append(step)
            quantities = (*SHAPE, 'base_tension', 'displacement', 'by_displacement', 'compliance',
                          'by_youngs_modulus', 'by_offset', 'covariance')  # fmt: skip
            if steps > 1:
                quantities = ('tips', *SHAPE, 'base_tension', 'by_displacement')
            return Plan(kind, changes, found, quantities)

        return make

    yield lengths('lengths', lambda rng: {})
    yield lengths('lengths and tensions', lambda rng: {}, 1, 0.5)
    yield lengths('lengths and loads', lambda rng: dict(WATER), 1, 0.7, True)
    yield lengths('lengths, step by step', lambda rng: dict(WATER), 3, 0.8)
    yield lengths('lengths with friction', rough, 1, 0.8)
    yield lengths('lengths with friction and loads', lambda rng: rough(rng) | WATER, 2, 0.8)
    yield lengths('lengths in sheaths', soft, 1, 0.8)
