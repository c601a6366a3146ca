"""The texts of the page in HTML: numbers in millimetres and degrees, problems and notes."""

import html

import numpy as np

from octo_arm_model.analysis.drawing import Overlap
from octo_arm_model.analysis.inverse import Inverse
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_NAME
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.rotations import axes_of
from octo_arm_model.ros.client.client import ArmClient, PublishedShape
from octo_arm_model.wire.estimate import BackboneCovariance

STALE = 1.0  # [s] without a new shape after which the arm is hidden
_STYLE = (
    '<div class="octo-arm" style="padding:0 1em 0.4em;font-size:0.85em;line-height:1.5;'
    'font-variant-numeric:tabular-nums">{}</div>'
)

_PROBLEM = 'color:#b4410e;min-height:1.5em'


def waiting(topic: str) -> str:
    """Return the text that is shown until the description of an arm arrives."""
    safe = html.escape(topic)
    text = f'Waiting for an <code>octo_arm_node</code>, commanded on <code>{safe}</code> …'
    return _STYLE.format(f'<span class="octo-arm-state">{text}</span>')


def live(client: ArmClient) -> str:
    """Return tip, rate and latency of the newest shape, and the problems of the node."""
    shape = client.shape
    if shape is None:
        return _STYLE.format(_warning(f'{client.problem or "the node is silent"}: no shape yet'))
    x, y, z = 1e3 * shape.position[-1]
    deviation = 1e3 * client.tip_deviation
    spread = ''
    if deviation.any():
        spread = f' &plusmn; {deviation[0]:.1f} {deviation[1]:.1f} {deviation[2]:.1f}'
    distance = 1e3 * np.linalg.norm(shape.position[-1] - shape.position[0])
    rate = client.rate()
    model = html.escape(client.strains.model[:MAX_NAME]) if client.strains else ''
    rows = [
        ('Tip', f'<span class="octo-arm-tip">{x:.2f} {y:.2f} {z:.2f}</span>{spread} mm'),
        ('To the base', f'{distance:.1f} mm, turned by {tip_angle(shape):.0f}°'),
        ('Node', model if np.isnan(rate) else f'{model}, {rate:.0f} Hz'),
        ('Latency', _milliseconds(client.latency)),
    ]
    if client.force is not None and client.covariance is not None:
        rows.append(('Force', contact_force(client.force, client.covariance)))
    table = ''.join(
        f'<tr><td style="padding-right:1em;opacity:0.6">{name}</td><td>{value}</td></tr>'
        for name, value in rows
    )
    problem = client.problem
    if client.age() > STALE:
        problem = f'no shape for {client.age():.0f} s' + (f'; {problem}' if problem else '')
    return _STYLE.format(f'<table>{table}</table>{_warning(problem)}')


def contact_force(force: FloatArray, covariance: BackboneCovariance) -> str:
    """Return an estimated ``force`` (3,) [N], its standard deviations and its place."""
    s, stddev = 1e3 * covariance.contact_s, 1e3 * np.sqrt(covariance.contact.diagonal()[:3])
    place = 'all along' if np.isnan(s) else f'at s = {s:.0f} mm'
    parts = [f'{1e3 * f:.1f} &plusmn; {sd:.1f}' for f, sd in zip(force, stddev, strict=True)]
    return f'<span class="octo-arm-force">{", ".join(parts)}</span> mN {place}'


def overlapping(overlap: Overlap | None) -> str:
    """Return a warning that the arm passes through itself; '' if it does not."""
    if overlap is None:
        return ''
    first, second = (1e3 * s for s in overlap.s)
    return _STYLE.format(
        f'<span class="octo-arm-overlap" style="{_PROBLEM}">The arm passes through itself: at s = '
        f'{first:.0f} and {second:.0f} mm by {1e3 * overlap.depth:.1f} mm. No model here has '
        'contact of the arm with itself.</span>'
    )


def tip_angle(shape: PublishedShape | Backbone) -> float:
    """Return the angle between the tangents at base and tip [deg]."""
    tangent = axes_of(shape.quaternion[[0, -1]])[:, 0]
    cosine = float(np.clip(tangent[:, 0] @ tangent[:, 1], -1.0, 1.0))
    return float(np.rad2deg(np.arccos(cosine)))


def comparison(tip: FloatArray, other: Backbone) -> str:
    """Return a sentence about the distance of the tip of ``other`` from ``tip`` (3,) [m]."""
    distance = 1e3 * np.linalg.norm(other.tip - tip)
    percentage = 100.0 * 1e-3 * distance / other.s[-1]
    return _STYLE.format(
        f'The tip of <b>{other.model}</b> is <span class="octo-arm-apart">{distance:.2f}</span> mm'
        f' from that of the node, {percentage:.1f} % of the length.'
    )


def search_result(answer: Inverse) -> str:
    """Return the result of the search for a target."""
    length = f'{1e3 * max(answer.error, 1e-4):.1f} mm'
    if answer.reached:
        return _STYLE.format(f'reached: the tip is within {length} of the target')
    return _STYLE.format(
        f'out of reach: the nearest found leaves {length}. The search is local and may have '
        'missed nearer ones.'
    )


def error_text(problem: object) -> str:
    """Return an error of a command, a comparison, a search or the description of an arm."""
    return _STYLE.format(_warning(str(problem)))


def note(text: str) -> str:
    """Return the explanation ``text``, which may have HTML tags."""
    return _STYLE.format(f'<span style="opacity:0.7">{text}</span>')


def _milliseconds(latency: float) -> str:
    # Stamps of a bag or of simulated time cannot be compared with the clock of this machine.
    if not -0.01 < latency < 10.0:
        return 'stamps are of another clock'
    return f'{1e3 * latency:.1f} ms from tension to shape'


def _warning(text: str) -> str:
    # The height is constant, so that the page does not move.
    return f'<div class="octo-arm-problem" style="{_PROBLEM}">{html.escape(text)}</div>'
