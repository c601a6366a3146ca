"""The services of the node: solve for tensions, and find tensions for a target."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from builtin_interfaces.msg import Time
from octo_arm_msgs.srv import FindTensions, Solve

from octo_arm_model.analysis.inverse import Inverse, find_tensions
from octo_arm_model.analysis.targets import Bending, Stiffness, Target, TipPose, TipPosition
from octo_arm_model.arm.errors import OctoArmError, TargetError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.messages import (
    backbone_messages,
    pose_message,
    tensions_message,
    wrench_values,
)
from octo_arm_model.ros.work.queued_service import Steps
from octo_arm_model.ros.work.sliced_call import SLICE, SlicedCall
from octo_arm_model.wire.tension_messages import TENDON_TENSIONS


def answer_solve(
    request: Solve.Request, response: Solve.Response, solver: Solver, frame_id: str
) -> Steps:
    """Fill in ``response`` for the tensions and the tip's wrench of ``request``."""
    yield from ()  # a single solve, which has a budget
    try:
        tensions = TENDON_TENSIONS.read(request.tensions, solver.arm)
        wrench = wrench_values(request.tip_wrench)
        backbone = solver.solve(tensions, wrench if wrench.any() else None)
        lengths = solver.tendon_lengths(backbone)
    except OctoArmError as error:
        response.success, response.message = False, str(error)
        return
    response.success = True
    stamp = request.tensions.header.stamp
    response.path, _, response.strains = backbone_messages(backbone, stamp, frame_id)
    response.tendon_length = lengths.ravel().tolist()
    response.residual = float(backbone.residual)
    response.iterations = int(backbone.iterations)


def answer_find_tensions(
    request: FindTensions.Request,
    response: FindTensions.Response,
    solver: Solver,
    frame_id: str,
    now: Time,
) -> Steps:
    """Fill in ``response`` for the target of ``request``; yields in the midst of long searches."""
    try:
        stiffness = None
        if request.stiffness != 0.0:
            along = request.stiffness_direction
            stiffness = Stiffness(np.array([along.x, along.y, along.z]), request.stiffness)
        highest = _highest(request, solver)
        target = _target(request)

        def search(pause: Callable[[], None]) -> Inverse:
            return find_tensions(solver, target, highest, stiffness=stiffness, pause=pause)

        found = yield from SlicedCall(search, SLICE).steps()
    except OctoArmError as error:
        response.success, response.message = False, str(error)
        return
    response.success, response.reached, response.error = True, found.reached, found.error
    response.message = '' if found.reached else 'out of reach; this is as near as was found'
    response.tensions = tensions_message(found.backbone.tensions, solver.arm, now, frame_id)
    response.tip = pose_message(found.backbone.position[-1], found.backbone.quaternion[-1])


def _highest(request: FindTensions.Request, solver: Solver) -> FloatArray:
    given = np.array(request.highest, dtype=np.float64)
    if given.size == 0:
        return default_highest(solver.arm)
    if given.size == 1:
        return np.full(solver.arm.tension_shape, given[0])
    if given.size != len(solver.arm.tendons):
        raise TargetError(
            f'highest has {given.size} values, expected {len(solver.arm.tendons)}, one or none'
        )
    return given.reshape(solver.arm.tension_shape)


def _target(request: FindTensions.Request) -> Target:
    place, turn = request.tip.position, request.tip.orientation
    position = np.array([place.x, place.y, place.z])
    if request.target == FindTensions.Request.TIP_POSITION:
        return TipPosition(position)
    if request.target == FindTensions.Request.TIP_POSE:
        return TipPose(position, np.array([turn.x, turn.y, turn.z, turn.w]))
    if request.target == FindTensions.Request.BENDING:
        return Bending(request.plane, request.angle)
    raise TargetError(f'target is {request.target}, expected 0 position, 1 pose or 2 bending')
