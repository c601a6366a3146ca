"""Solutions of the paper's arms, and quantities of their shapes."""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config, load_config
from octo_arm_model.config.paper_data import Tensions
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.rotations import axes_of
from octo_arm_model.rod.solver import Solver

# Enough for a smooth drawing of the coiled tip.
STATIONS = 401


@functools.cache
def config(preset: str) -> Config:
    """Configuration of the paper's arm ``preset``: fem, prototype, table2 or table4."""
    return load_config(preset_path(f'renda2012_{preset}'))


@functools.cache
def solver(preset: str, model: str) -> Solver:
    """Solver of the paper's arm ``preset``."""
    return config(preset).solver(model, STATIONS)


@functools.cache
def solve(preset: str, model: str, tensions: Tensions) -> Backbone:
    """Shape of the paper's arm ``preset``."""
    return solver(preset, model).solve(tensions)


def pull(section: int, tensions: tuple[float, float, float, float], sections: int) -> Tensions:
    """``tensions`` [N] of one ``section``, numbered from the tip, of ``sections``."""
    rows = [(0.0, 0.0, 0.0, 0.0)] * sections
    rows[section - 1] = tensions
    return tuple(rows)


def pair(plane: float) -> tuple[float, float, float, float]:
    """Tensions of amplitude 1 N of two neighbours that bend the arm in ``plane`` [deg].

    The inverse of `law`.
    """
    sine, cosine = np.sin(np.deg2rad(plane)), np.cos(np.deg2rad(plane))
    t1, t2, t3, t4 = np.maximum(0.0, np.round((-sine, cosine, sine, -cosine), 15)).tolist()
    return t1, t2, t3, t4


def law(tensions: Tensions) -> float:
    """Bending plane of one loaded section by the paper's law [deg].

    It is measured in the axes b and -n of the base (section 6.1, Figure 10).
    """
    t1, t2, t3, t4 = np.sum(tensions, axis=0)
    return float(np.rad2deg(np.arctan2(t3 - t1, t2 - t4)))


def seen_from_tip(backbone: Backbone) -> FloatArray:
    """Points along b and -n of the base (stations, 2) [m], as Figure 10 shows them."""
    axes = axes_of(backbone.quaternion[0])
    local = (backbone.position - backbone.position[0]) @ axes
    return np.stack([local[:, 2], -local[:, 1]], axis=1)


def bending_plane(backbone: Backbone) -> float:
    """Direction of the point furthest from the axis of the base, measured as `law` is [deg]."""
    points = seen_from_tip(backbone)
    along_b, along_minus_n = points[np.hypot(*points.T).argmax()]
    return float(np.rad2deg(np.arctan2(along_minus_n, along_b)))


def angle_between(one: float, other: float) -> float:
    """Angle between two directions [deg], from 0 to 180."""
    return abs((one - other + 180.0) % 360.0 - 180.0)


def out_of_plane(backbone: Backbone) -> float:
    """Largest distance of a point from the plane that fits all of them best [m]."""
    centred = backbone.position - backbone.position.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][-1]
    return float(np.abs(centred @ normal).max())


def headings(backbone: Backbone) -> FloatArray:
    """Direction of the tangent of a shape in the plane of t and n of its base (stations,) [deg].

    From t towards n: positive on the side of tendon 1.
    """
    axes = axes_of(backbone.quaternion)
    along_t, along_n = axes[:, :2, 0].T @ axes[:, 0]
    return np.rad2deg(np.unwrap(np.arctan2(along_n, along_t)))


def turns(backbone: Backbone) -> dict[int, float]:
    """Angle each section of a plane shape bends by [deg], by section, base first."""
    heading, ends = headings(backbone), {}
    for section in dict.fromkeys(backbone.section.tolist()):
        stations = np.flatnonzero(backbone.section == section)
        # A section begins where the one before it ends.
        ends[section] = float(heading[stations[-1]] - heading[max(0, stations[0] - 1)])
    return ends


def anchorages(backbone: Backbone) -> list[int]:
    """Stations of the anchorages, base first."""
    return [*np.flatnonzero(np.diff(backbone.section)).tolist(), backbone.s.size - 1]


def tip_rotation(backbone: Backbone) -> float:
    """Rotation of the tip about the tangent by torsion, the integral of tau [deg]."""
    rate = backbone.tau * (1.0 + backbone.q)
    return float(np.rad2deg(np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(backbone.s))))


def tip_distance(backbone: Backbone) -> float:
    """Distance of the tip from the base [m]."""
    return float(np.linalg.norm(backbone.tip - backbone.position[0]))
