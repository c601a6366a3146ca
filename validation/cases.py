"""The cases: arms of the paper, tensions, meshes and variants.

The paper prints neither the tensions of its Figure 8 nor how wide sheaths and how thick discs are.
The arm of 5.1 is pulled until its tip has turned by 260 degrees. Sheaths are 2 mm wide where there
is room for them, less where the wall around them is thin or tendons are close to each other.
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
    """An arm, its loads, and how they are computed.

    Attributes:
        name: short name.
        preset: name of the arm's parameter file.
        pulled: numbers of the pulled tendons.
        tensions: their tensions in every load [N], (loads, pulled).
        contact: how tendons, discs and base hold the rubber.
        meshes: the loads are followed on the first, and solved from there on the others.
        result: the mesh the models are compared with.
        pairs: meshes whose difference bounds the error across and along the arm.
        varied: the loads of the variants.
        variants: what else is computed.
        basis: the mesh of the variants.
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
        """The arm."""
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


def coarse(case: Case) -> Case:
    """The same with two coarse meshes and the first two varied loads, in about a minute."""
    picked = case.varied[:2]
    return dataclasses.replace(
        case,
        tensions=tuple(case.tensions[i] for i in picked),
        meshes=(_SHORT, BASIC),
        result=BASIC,
        pairs=((BASIC, _SHORT),),
        varied=(0, 1),
        variants={name: case.variants[name] for name in list(case.variants)[:1]},
    )
