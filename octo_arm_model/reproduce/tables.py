"""The paper's arms, quantities of their shapes, and its tables with the models' numbers."""

import functools
import itertools
from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config import paper_data
from octo_arm_model.config.config import load_config
from octo_arm_model.config.paper_data import Tensions
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.rotations import axes_of
from octo_arm_model.rod.solver import MODELS, Solver

STATIONS = 401  # enough for a smooth drawing of the coiled tip


@functools.cache
def solver(preset: str, model: str) -> Solver:
    """Return a solver by ``model`` of an arm of the paper: fem, prototype, table2 or table4."""
    return load_config(preset_path(f'renda2012_{preset}')).solver(model, STATIONS)


@functools.cache
def solve(preset: str, model: str, tensions: Tensions) -> Backbone:
    """Return the shape of the paper's arm ``preset`` by a ``model`` under ``tensions`` [N]."""
    return solver(preset, model).solve(tensions)


def pull(section: int, tensions: tuple[float, float, float, float], sections: int) -> Tensions:
    """Return tensions [N] of an arm of which one ``section``, numbered from the tip, is pulled."""
    rows = [(0.0, 0.0, 0.0, 0.0)] * sections
    rows[section - 1] = tensions
    return tuple(rows)


def one_cable(tension: float) -> Tensions:
    """Return tensions [N] of an arm of one section of which the first cable is pulled."""
    return pull(1, (tension, 0.0, 0.0, 0.0), 1)


def pair(plane: float) -> tuple[float, float, float, float]:
    """Return tensions of amplitude 1 N that bend the arm in ``plane`` [deg], by the inverse `law`.

    At most two neighbouring tendons are pulled.
    """
    sine, cosine = np.sin(np.deg2rad(plane)), np.cos(np.deg2rad(plane))
    t1, t2, t3, t4 = np.maximum(0.0, np.round((-sine, cosine, sine, -cosine), 15)).tolist()
    return t1, t2, t3, t4


def law(tensions: Tensions) -> float:
    """Return the bending plane [deg] of one loaded section by the paper's law.

    It is measured in the axes b and -n of the base. Source: section 6.1, Figure 10.
    """
    t1, t2, t3, t4 = np.sum(tensions, axis=0)
    return float(np.rad2deg(np.arctan2(t3 - t1, t2 - t4)))


def seen_from_tip(backbone: Backbone) -> FloatArray:
    """Return the points along b and -n of the base (stations, 2) [m], as Figure 10 shows them."""
    axes = axes_of(backbone.quaternion[0])
    local = (backbone.position - backbone.position[0]) @ axes
    return np.stack([local[:, 2], -local[:, 1]], axis=1)


def bending_plane(backbone: Backbone) -> float:
    """Return the direction [deg] of the point furthest from the axis of the base, as in `law`."""
    points = seen_from_tip(backbone)
    along_b, along_minus_n = points[np.hypot(*points.T).argmax()]
    return float(np.rad2deg(np.arctan2(along_minus_n, along_b)))


def angle_between(a: float, b: float) -> float:
    """Return the angle between two directions [deg], from 0 to 180."""
    return abs((a - b + 180.0) % 360.0 - 180.0)


def out_of_plane(backbone: Backbone) -> float:
    """Return the largest distance of a point from the plane that fits all points best [m]."""
    centred = backbone.position - backbone.position.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][-1]
    return float(np.abs(centred @ normal).max())


def turns(backbone: Backbone) -> dict[int, float]:
    """Return the bending angle [deg] of each section of a plane shape, by section, base first."""
    axes, ends = axes_of(backbone.quaternion), {}
    # The heading of the tangent in the plane of t and n of the base, from t towards n (tendon 1).
    along_t, along_n = axes[:, :2, 0].T @ axes[:, 0]
    heading = np.rad2deg(np.unwrap(np.arctan2(along_n, along_t)))
    for section in dict.fromkeys(backbone.section.tolist()):
        stations = np.flatnonzero(backbone.section == section)
        # A section begins where the one before it ends.
        ends[section] = float(heading[stations[-1]] - heading[max(0, stations[0] - 1)])
    return ends


def anchorages(backbone: Backbone) -> list[int]:
    """Return the stations of the anchorages, base first."""
    return [*np.flatnonzero(np.diff(backbone.section)).tolist(), backbone.s.size - 1]


def tip_rotation(backbone: Backbone) -> float:
    """Return the rotation of the tip about the tangent by torsion, the integral of tau [deg]."""
    rate = backbone.tau * (1.0 + backbone.q)
    return float(np.rad2deg(np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(backbone.s))))


def tip_distance(backbone: Backbone) -> float:
    """Return the distance of the tip from the base [m]."""
    return float(np.linalg.norm(backbone.tip - backbone.position[0]))


UNKNOWN_TENSIONS = (0.02, 0.05, 0.1, 0.2)  # [N], for Figure 8, as the paper prints none for it
_ARMS = {
    'Table 2': 'table2',
    'Table 4': 'table4',
    'section 5.1': 'fem',
    'section 5.2': 'prototype',
}


_FETCHING = {'Figure 14': paper_data.FETCHING_IN_PLANE, 'Figure 15': paper_data.FETCHING_IN_SPACE}


@dataclass(frozen=True)
class DataTable:
    """A table in which all columns but the first are numbers."""

    title: str  #: text above the table
    header: tuple[str, ...]  #: names of the columns
    rows: tuple[tuple[str, ...], ...]  #: cells, row by row, as many as the header has in each
    note: str = ''  #: text below the table


def arms() -> DataTable:
    """Return Tables 2 and 4, with the arms of section 5."""
    return DataTable(
        'Tables 2 and 4, sections 5.1 and 5.2. Lengths in mm, E in kPa.',
        ('', 'E', 'ν', 'L = l1', 'Rmin', 'Rmax', 'b1', 'a1', 'b2', 'a2', 'l2', 'b3', 'a3', 'l3'),
        tuple((name, *_parameters(preset)) for name, preset in _ARMS.items()),
        'The paper prints no ν for the arms of section 5, where that of Table 2 stands in, and '
        'no E for that of 5.1, where that of 5.2 stands in (‘all material and geometric '
        'properties of the real prototype have been used’).',
    )


def _parameters(preset: str) -> list[str]:
    given = load_parameters(preset_path(f'renda2012_{preset}'))
    lengths = [given[f'body.{name}'] for name in ('length', 'radius_tip', 'radius_base')]
    of_sections = (
        given[f'sections.{name}'] for name in ('offset_anchorage', 'offset_base', 'anchorage')
    )
    lengths += itertools.chain.from_iterable(zip(*of_sections, strict=True))
    del lengths[5]  # l1 is L
    numbers = [given['material.youngs_modulus'] * 1e-3, given['material.poisson_ratio']]
    numbers += [length * 1e3 for length in lengths]
    return [f'{value:g}' for value in numbers] + ['–'] * (13 - len(numbers))


def finite_elements() -> DataTable:
    """Return the numbers of Figure 8."""
    return DataTable(
        'Figure 8 in numbers: tips of the arm of section 5.1.',
        ('T11 [N]', *_TIPS),
        tuple((f'{tension:g}', *_tips('fem', tension)) for tension in UNKNOWN_TENSIONS),
        'The tensions are ours: the paper prints none.',
    )


def tip_errors() -> DataTable:
    """Return Table 1, with the tips of the models."""
    rows = [
        (f'{tension:.2f}', f'{error:.1f}', *_tips('prototype', tension))
        for tension, error in paper_data.PROTOTYPE_ERRORS.items()
    ]
    rows.append(('average', f'{paper_data.PROTOTYPE_AVERAGE_ERROR:.1f}', *['–'] * len(_TIPS)))
    return DataTable(
        'Table 1: the prototype of section 5.2 at the tensions of the paper.',
        ('T11 [N]', 'the paper’s: its model to the real arm [% of L]', *_TIPS),
        tuple(rows),
        'The second column is not computed: it is the paper’s own measurement, whose midlines '
        'were not published. The last two say how far the choice of the model moves the tip.',
    )


_TIPS = (
    *(f'{model}: tip x, y [mm]' for model in MODELS),
    'closed_form to renda2012 [% of L]',
    'exact to renda2012 [% of L]',
)


def _tips(preset: str, tension: float) -> list[str]:
    """Return the columns `_TIPS` of an arm with one cable."""
    shapes = [solve(preset, model, one_cable(tension)) for model in MODELS]
    first, length = shapes[0], shapes[0].s[-1]
    distances = [float(np.linalg.norm(shape.tip - first.tip)) / length for shape in shapes[1:]]
    return [*(_point(shape) for shape in shapes), *(f'{100.0 * value:.1f}' for value in distances)]


def tensions() -> DataTable:
    """Return Tables 3 and 5."""
    figures = {
        **{f'Figure 11({panel})': rows for panel, rows in paper_data.BENDING.items()},
        **_FETCHING,
    }
    names = ('T11', 'T12', 'T13', 'T14', 'T21', 'T32', 'T33')
    return DataTable(
        'Tables 3 and 5: the tensions [N]; all others are zero.',
        ('', *names),
        tuple(
            (figure, *(f'{rows[int(name[1]) - 1][int(name[2]) - 1]:.4g}' for name in names))
            for figure, rows in figures.items()
        ),
    )


def bending() -> DataTable:
    """Return the planes and tips of Figure 11, by model."""
    rows = []
    for panel, tensions in paper_data.BENDING.items():
        shapes = [solve('table2', model, tensions) for model in MODELS]
        cells = [(f'{bending_plane(shape):.2f}', _point(shape, 3)) for shape in shapes]
        rows.append((f'({panel})', f'{law(tensions):.0f}', *itertools.chain(*cells)))
    return DataTable(
        'Figure 11 in numbers: plane [°] and tip x, y, z [mm].',
        ('', 'caption', *(f'{model}: {part}' for model in MODELS for part in ('plane', 'tip'))),
        tuple(rows),
    )


def fetching() -> DataTable:
    """Return quantities of the shapes of Figures 14 and 15, by model."""
    rows = []
    for figure, tensions in _FETCHING.items():
        for model in MODELS:
            shape = solve('table4', model, tensions)
            rows.append(
                (
                    f'{figure}, {model}',
                    _point(shape, 3),
                    f'{tip_distance(shape) * 1e3:.1f}',
                    f'{100.0 * shape.q.min():.0f}',
                    f'{tip_rotation(shape):.2f}',
                )
            )
    return DataTable(
        'Figures 14 and 15 in numbers.',
        (
            '',
            'tip x, y, z [mm]',
            'tip to base [mm]',
            'strongest compression q [%]',
            'twist of the tip [°]',
        ),
        tuple(rows),
        'The paper takes s for the arc length of midline and cables; what the third column of '
        'numbers shows is how much that leaves out here, and why exact differs.',
    )


def _point(shape: Backbone, axes: int = 2) -> str:
    return ', '.join(f'{1e3 * value:.1f}' for value in shape.tip[:axes])
