"""``octo-arm inverse``: tensions for a target of the tip."""

import argparse
import json
import math

import numpy as np

from octo_arm_model.analysis.inverse import Inverse, find_tensions
from octo_arm_model.analysis.targets import Bending, Stiffness, Target, TipPose, TipPosition
from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import Bar
from octo_arm_model.cli.solve import as_dict, millimetres
from octo_arm_model.rod.backbone import Backbone

SUMMARY = 'find tensions for a target of the tip'
DESCRIPTION = """\
Find the tensions between 0 and --highest that bring the tip of the arm to a target with the least
effort (sum of squares of tension over bound). If the target is out of reach, the nearest tip that
a local search finds is printed, and the exit status is 1. The model is exact, whatever CONFIG
says, unless --model names another.
"""
EPILOG = ''


_HIGHEST = """\
for each tendon the least tension that compresses the cross section at its anchorage by 30 percent,
    bends the arm by two turns, or is 30 percent of that which folds it"""
OPTIONS = f"""\
{arguments.ARM}
--tip X Y Z float: tip in base_frame [m]
--quaternion X Y Z W float: orientation of the tip as well, its x axis along the arm
--bend PLANE ANGLE float: instead of --tip: turn the tip by ANGLE degrees in the plane at PLANE
    degrees about the base, from n towards b
--stiffness X Y Z K float: stiffness K [N/m] of the tip against a force along X Y Z, by
    co-contraction
{arguments.highest_option(_HIGHEST)}
{arguments.JSON}
"""


def run(options: argparse.Namespace) -> int:
    """Find the tensions and print them; return 1 if the target is out of reach."""
    config = arguments.read_config(options, 'exact')
    solver = config.solver()
    stiffness = options.stiffness and Stiffness(options.stiffness[:3], options.stiffness[3])
    highest = arguments.read_highest(options)
    if highest is None:
        highest = default_highest(config.arm)
    target = _target(options)
    with Bar('search'):  # out of reach it takes seconds
        inverse = find_tensions(solver, target, highest, stiffness=stiffness)
    errors = _errors(target, inverse.backbone)
    if options.json:
        content = {
            'reached': inverse.reached,
            'error': inverse.error,
            'distance_error': errors[0],
            'angle_error': errors[1],
            'stiffness': inverse.stiffness,
            'tensions': inverse.backbone.tensions.tolist(),
            'solves': inverse.iterations,
            **as_dict(inverse.backbone, solver),
        }
        print(json.dumps(content))
    else:
        print(_summary(inverse, config.arm, *errors))
    return 0 if inverse.reached else 1


def _target(options: argparse.Namespace) -> Target:
    if (options.tip is None) == (options.bend is None):
        raise ConfigError('expected either --tip X Y Z or --bend PLANE ANGLE')
    if options.bend is not None:
        if options.quaternion is not None:
            raise ConfigError('--quaternion goes with --tip, not with --bend')
        plane, angle = options.bend
        if not 0.0 <= angle <= 180.0:
            raise ConfigError(f'--bend: ANGLE is {angle:g}, expected 0 to 180 [deg]')
        return Bending(math.radians(plane), math.radians(angle))
    if options.quaternion is not None:
        return TipPose(options.tip, options.quaternion)
    return TipPosition(options.tip)


def _errors(target: Target, backbone: Backbone) -> tuple[float | None, float | None]:
    """Return distance [m] and angle [rad] from the target; None if it does not specify one."""
    error = target.error(backbone)
    if isinstance(target, TipPosition):
        return float(np.linalg.norm(error)), None
    assert isinstance(target, TipPose | Bending)
    count = 3 if isinstance(target, TipPose) else 0
    angle = float(np.linalg.norm(error[count:])) / target.length_per_radian
    return float(np.linalg.norm(error[:count])) if count else None, angle


def _summary(inverse: Inverse, arm: Arm, distance: float | None, angle: float | None) -> str:
    word = 'reached' if inverse.reached else 'NOT REACHED, this is as near as it was found to go'
    errors = [] if distance is None else [f'{distance * 1e3:.4g} mm']
    errors += [] if angle is None else [f'{math.degrees(angle):.4g} deg']
    lines = [
        word,
        f'model     {inverse.backbone.model}',
        f'error     {" and ".join(errors)}, after {inverse.iterations} solves',
        f'tip       {millimetres(inverse.backbone.tip)} mm',
    ]
    if inverse.stiffness is not None:
        lines.append(f'stiffness {inverse.stiffness:.5g} N/m')
    width = max(len(name) for name in arm.tendon_names)
    lines += ['', 'tensions [N]']
    for name, tension in zip(arm.tendon_names, inverse.backbone.tensions.ravel(), strict=True):
        lines.append(f'  {name:{width}} {tension:10.4f}')
    return '\n'.join(lines)
