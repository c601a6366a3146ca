"""Recordings as built robots leave them: motors, foreign messages, tables of motion capture.

Written by rosbags and by hand, not by our own writers.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from experiments import PARAMETERS
from recordings import START, TYPES, header, make, message, point, write_bag
from rosbags.typesys import get_types_from_msg

from octo_arm_model import Backbone, Config, displacements_of, solve_displacements
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.rod.stations import interpolated

SPOOL = 0.012  # radius [m]
COUNTS = 4096  # of a turn of a servo
ZERO = 2048  # counts at the unloaded arm
MOTORS = tuple(f'motor_{section}{side}' for section in (1, 2, 3) for side in 'ab')
# Motors of the tendons, section by section from the tip, and which way each reels.
OF_TENDON = tuple(f'motor_{section}{side}' for section in (1, 2, 3) for side in 'abab')
WAYS = (1.0, 1.0, -1.0, -1.0) * 3
MARKER_S = (0.1, 0.2, 0.31)
MARKERS = ('low', 'middle', 'top')
TUBE_S = (0.05, 0.1, 0.15, 0.2, 0.25)  # sensors of the rod of nitinol [m]
REST = (-0.9, 1.6)  # its curvature about n and b [1/m]
BENDING = 0.021  # its E J [N m^2]
DISC_YOUNG, DISC_FRICTION = 5.2e10, 0.18  # of the robot of discs [Pa], [-]
# Tensions that it is pulled by and let go [N].
DISC_PULLS = ((6.0, 1.0, 0.0), (1.0, 6.0, 2.0), (1.0, 2.0, 5.0))
_MARKER = 'string marker_name\ngeometry_msgs/Point translation\nfloat32 residual\n'


def trunk_parameters() -> dict[str, Any]:
    """A trunk of three sections with four tendons each."""
    values = load_parameters('renda2012_table2')
    return {**values, 'model': 'exact', 'stations': 31}


def trunk_shapes(turns: Sequence[Sequence[float]]) -> list[Backbone]:
    """Shapes of the trunk for angles of its six motors [rad]."""
    config = Config.from_parameters(trunk_parameters())
    solver, names, found, last = config.solver(), config.arm.tendon_names, [], None
    for angles in turns:
        angle = dict(zip(MOTORS, angles, strict=True))
        lengths = {
            name: way * SPOOL * angle[motor]
            for name, motor, way in zip(names, OF_TENDON, WAYS, strict=True)
        }
        last = solve_displacements(solver, lengths, start=last)
        found.append(last.backbone)
    return found


def trunk_bag(path: Path, turns: Sequence[Sequence[float]], rng: np.random.Generator) -> Path:
    """Each of the poses held for 3 s: motors at 20 Hz, and markers in another order at 10 Hz."""
    motors, markers, marker = (
        f'trunk_msgs/msg/{kind}' for kind in ('Motors', 'Markers', 'Marker')
    )
    if marker not in TYPES.fielddefs:
        of_motors = 'std_msgs/Header header\nstring[] name\nfloat64[] angle\n'
        of_markers = 'std_msgs/Header header\ntrunk_msgs/Marker[] markers\n'
        for kind, text in ((marker, _MARKER), (motors, of_motors), (markers, of_markers)):
            TYPES.register(get_types_from_msg(text, kind))
    content = []
    for number, (angles, shape) in enumerate(zip(turns, trunk_shapes(turns), strict=True)):
        points = interpolated(np.array(MARKER_S), shape.s, shape.position)
        for step in range(60):
            at = START + round((3.0 * number + 0.05 * step) * 1e9)
            fields = {'header': header(at, 'arm_base'), 'name': list(MOTORS)}
            read = np.array(angles) + 1e-4 * rng.standard_normal(len(angles))
            content.append(message('/motors', motors, at, **fields, angle=read))
            if step % 2:
                continue
            seen = points + 1e-4 * rng.standard_normal(points.shape)
            several = [
                make(marker, marker_name=name, translation=point(place), residual=0.1)
                for name, place in list(zip(MARKERS, seen))[::-1]
            ]
            given = {'header': header(at, 'arm_base'), 'markers': several}
            content.append(message('/mocap', markers, at, **given))
    return write_bag(path, content)


def servo_poses(
    tensions: Sequence[float], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Counts of the servo of the first tendon of the prototype (n,), and tips (n, 3) [m]."""
    config = Config.from_parameters({**PARAMETERS, 'model': 'exact'})
    solver, counts, tips = config.solver(), [], []
    for tension in tensions:
        row = np.zeros(config.arm.tension_shape)
        row.ravel()[0] = tension
        shape = solver.solve(row)
        length = displacements_of(solver, shape).ravel()[0]
        counts.append(round(ZERO + length / (2.0 * np.pi * SPOOL) * COUNTS))
        tips.append(shape.tip + 1e-4 * rng.standard_normal(3))
    return np.array(counts), np.array(tips)


def motive_csv(path: Path, times: np.ndarray, tips: np.ndarray) -> Path:
    """An export of Motive 2: a rigid body at the tip, in millimetres, and a marker beside it."""
    about = 'Format Version,1.23,Take Name,Take 1,Export Frame Rate,120.0,Length Units,Millimeters'
    kinds = ['Rigid Body'] * 7 + ['Marker'] * 3
    names = ['Tip'] * 7 + ['Unlabeled 1'] * 3
    what = ['Rotation'] * 4 + ['Position'] * 3 + ['Position'] * 3
    axes = ['X', 'Y', 'Z', 'W', 'X', 'Y', 'Z', 'X', 'Y', 'Z']
    lines = [about, '']
    lines += [f',{head},{",".join(row)}' for head, row in (('Type', kinds), ('Name', names))]
    lines += [f',,{",".join(what)}', f'Frame,Time (Seconds),{",".join(axes)}']
    for number, (time, tip) in enumerate(zip(times, tips)):
        place = ','.join(f'{1e3 * one:.4f}' for one in tip)
        lines.append(f'{number},{time:.3f},0,0,0,1,{place},,,')
    path.write_text('\n'.join(lines) + '\n')
    return path


def _tube(length: float, radius: float, offset: float) -> dict[str, Any]:
    """Parameters of a straight rod of nitinol as its catalogue has it, with three tendons."""
    return {
        'model': 'exact',
        'material.law': 'linear',
        'material.poisson_ratio': 0.33,
        'body.length': length,
        'body.radius_base': radius,
        'body.radius_tip': radius,
        'sections.anchorage': [length],
        'sections.tendons': [3],
        'sections.offset_base': [offset],
        'sections.offset_anchorage': [offset],
    }


def tube_parameters() -> dict[str, Any]:
    """A tube with three tendons in discs."""
    return {
        **_tube(0.25, 1e-3, 0.008),
        'stations': 41,
        'material.youngs_modulus': 6e10,
        'body.inner_radius': 8.5e-4,
        'body.disc_radius': 0.01,
    }


def tube_csv(path: Path, rng: np.random.Generator) -> Path:
    """Static poses of that tube as it is: weights in grams, and electromagnetic sensors in mm."""
    own = {'stiffness.bending': [BENDING], 'rest_curvature': list(REST)}
    solver = Config.from_parameters({**tube_parameters(), **own}).solver()
    axes = [f'S{number} {axis} (mm)' for number in range(1, 6) for axis in 'xyz']
    lines = [';'.join(['weight 1 [g]', 'weight 2 [g]', 'weight 3 [g]', *axes])]
    for grams in ((0, 0, 0), (400, 0, 0), (0, 300, 0), (0, 0, 300)):
        shape = solver.solve([[9.80665e-3 * one for one in grams]])
        seen = interpolated(np.array(TUBE_S), shape.s, shape.position)
        seen = 1e3 * (seen + 2e-4 * rng.standard_normal(seen.shape))
        lines.append(';'.join([*map(str, grams), *(f'{one:.2f}' for one in seen.ravel())]))
    path.write_text('\n'.join(lines) + '\n')
    return path


def disc_parameters() -> dict[str, Any]:
    """A rod with three discs, a straight tendon and two wound ones."""
    return {
        **_tube(0.24, 7e-4, 0.01),
        'stations': 11,
        'material.youngs_modulus': 5.7e10,
        'body.disc_radius': 0.012,
        'tendons.twist': [0.0, 3.1416, -3.1416],
        'tendons.disc_count': 3,
    }


def disc_csv(path: Path, rng: np.random.Generator) -> Path:
    """That robot as it is, pulled and let go again: newtons, and a tracker at its tip in mm."""
    own = {'material.youngs_modulus': DISC_YOUNG, 'tendons.friction': [DISC_FRICTION]}
    solver, last = Config.from_parameters({**disc_parameters(), **own}).solver(), None
    lines = ['step,F1 (N),F2 (N),F3 (N),tip x (mm),tip y (mm),tip z (mm)']
    for number, pulls in enumerate(DISC_PULLS):
        last = solver.follow([pulls], last)
        tip = 1e3 * (last.tip + 1e-4 * rng.standard_normal(3))
        row = [number, *pulls, *(f'{one:.2f}' for one in tip)]
        lines.append(','.join(map(str, row)))
    path.write_text('\n'.join(lines) + '\n')
    return path
