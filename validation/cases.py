"""Define the cases: arms of the paper, tensions, meshes and variants.

The paper states neither the tensions of its Figure 8 nor the dimensions of sheaths and discs. The
highest tension of the arm of 5.1 turns its tip by 260 degrees. Sheaths have a diameter of 2 mm, or
less where the wall around them is thin or tendons are close to each other.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from arm_mesh import Mesh
from elasticity import Contact

from octo_arm_model import Arm, load_config
from octo_arm_model.config.paper_data import BENDING
from octo_arm_model.config.parameter_files import preset_path

BASIC, _WIDE, _LONG, _SHORT = Mesh(1, 1), Mesh(2, 1), Mesh(1, 2), Mesh(1, 0.5)
_STUDY = ((_WIDE, BASIC), (_LONG, BASIC))


@dataclass(frozen=True)
class Case:
    """An arm with its loads, meshes and variants.

    Attributes:
        name: short name.
        preset: name of the arm's parameter file.
        pulled: numbers of the tendons under tension.
        tensions: tensions of these tendons in each load [N], (loads, pulled).
        contact: constraints by tendons, discs and base.
        meshes: on the first, loads are followed from the unloaded arm; its solutions are the first
            guesses on the others.
        result: mesh with which the models are compared.
        pairs: meshes whose differences bound the discretisation error across and along the arm.
        varied: numbers of the loads of the variants.
        variants: changes of `Contact` or of poisson_ratio, by name.
        basis: mesh of the variants.
    """

    name: str
    preset: str
    pulled: tuple[int, ...]
    tensions: tuple[tuple[float, ...], ...]
    contact: Contact
    meshes: tuple[Mesh, ...]
    result: Mesh
    pairs: tuple[tuple[Mesh, Mesh], ...]
    varied: tuple[int, ...] = ()
    variants: dict[str, dict[str, Any]] = field(default_factory=dict)
    basis: Mesh = BASIC

    @property
    def arm(self) -> Arm:
        """Load the arm."""
        return load_config(preset_path(self.preset)).arm


_VARIANTS: dict[str, dict[str, Any]] = {
    'tendon kept in its section': {'sheath': None},
    'kept, and no disc': {'sheath': None, 'disc': 0.0},
    'kept, and the base may widen': {'sheath': None, 'clamped': False},
    'kept, and nu = 0.49': {'sheath': None, 'poisson_ratio': 0.49},
    'kept, and nu = 0.45': {'sheath': None, 'poisson_ratio': 0.45},
}

PROTOTYPE = Case(
    name='prototype',
    preset='renda2012_prototype',
    pulled=(0,),
    tensions=tuple((t,) for t in (0.53, 1.09, 2.0, 2.6, 3.06, 3.44, 3.95)),  # Table 1
    contact=Contact(sheath=1e-3, disc=1e-3),
    meshes=(_SHORT, BASIC, _LONG, _WIDE, Mesh(3, 1)),
    result=_WIDE,
    pairs=_STUDY,
    varied=(1, 2, 4, 6),
    variants=_VARIANTS
    | {'sheath half as wide': {'sheath': 0.5e-3}, 'sheath twice as wide': {'sheath': 2e-3}},
)
SECTION_5_1 = Case(
    name='section 5.1',
    preset='renda2012_fem',
    pulled=(0,),
    tensions=((0.01,), (0.02,), (0.05,), (0.1,), (0.15,)),
    contact=Contact(sheath=0.4e-3, disc=0.5e-3),
    meshes=(_SHORT, BASIC, _LONG, _WIDE),
    result=_WIDE,
    pairs=_STUDY,
    varied=(2, 3, 4),
    variants=_VARIANTS | {'sheath half as wide': {'sheath': 0.2e-3}},
)
_PANEL_B = BENDING['B'][0][:2]
TABLE_3 = Case(
    name='Table 3 (B)',
    preset='renda2012_table2',
    pulled=(0, 1),
    tensions=tuple((part * _PANEL_B[0], part * _PANEL_B[1]) for part in (0.25, 0.5, 1.0)),
    contact=Contact(sheath=0.5e-3, disc=1e-3),
    meshes=(_SHORT, BASIC, _LONG, _WIDE),
    result=_WIDE,
    pairs=_STUDY,
    varied=(0, 1, 2),
    variants={'tendon kept in its section': {'sheath': None}},
)
CASES = (SECTION_5_1, PROTOTYPE, TABLE_3)


def coarse_case(case: Case) -> Case:
    """Return ``case`` with two coarse meshes and two loads, which takes about a minute."""
    loads = case.varied[:2]
    return dataclasses.replace(
        case,
        tensions=tuple(case.tensions[i] for i in loads),
        meshes=(_SHORT, BASIC),
        result=BASIC,
        pairs=((BASIC, _SHORT),),
        varied=(0, 1),
        variants={name: case.variants[name] for name in list(case.variants)[:1]},
    )
