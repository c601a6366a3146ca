"""Picture of an estimate: force and tip over time with bands of 95 %. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from octo_arm_model.experiment.estimating.camera_check import CameraErrors
from octo_arm_model.experiment.estimating.history import Moment, Touch
from octo_arm_model.experiment.figure_files import new_figure

_BAND = 1.96  # standard deviations on either side that hold 95 %
_COLOURS = ('tab:red', 'tab:green', 'tab:blue')
_MOST = 4000  # times drawn


def draw_estimate(
    moments: Sequence[Moment], touches: Sequence[Touch], camera: CameraErrors | None
) -> Any:
    """Force of the contact and position of the tip, and errors against a ``camera``, if any."""
    moments = moments[:: max(1, len(moments) // _MOST)]
    time = np.array([one.time for one in moments])
    has_force = any(np.isfinite(one.wrench[0]) for one in moments)
    rows = 1 + has_force + (camera is not None)
    figure = new_figure(9.0, 0.6 + 2.4 * rows)
    panels = list(np.atleast_1d(figure.subplots(rows, 1, sharex=True)))
    if has_force:
        panel = panels[0]
        values = 1e3 * np.array([one.wrench[:3] for one in moments])
        _draw_bands(panel, time, values, 1e3 * np.array([m.wrench_stddev[:3] for m in moments]))
        panel.set_ylabel('force of the contact [mN]')
        panel.set_title('Estimate and 95 % bands; shaded: touched', fontsize='medium')
        for touch in touches:
            panel.axvspan(touch.start, touch.stop, color='0.9', zorder=0)
    tip = np.array([one.tip for one in moments])
    panel = panels[has_force]
    deviations = 1e3 * np.array([one.tip_stddev for one in moments])
    _draw_bands(panel, time, 1e3 * (tip - tip[0]), deviations)
    panel.set_ylabel('tip, from its first place [mm]')
    if camera is not None:
        panel = panels[-1]
        for values, label, colour in zip(
            camera.tip, ('estimated', 'from the tensions alone'), ('tab:blue', '0.6'), strict=True
        ):
            panel.plot(camera.time, 1e3 * values, '.', markersize=3, color=colour, label=label)
        panel.set_ylabel('error of the tip\nagainst the camera [mm]')
        panel.set_yscale('log')
        panel.legend(frameon=False, fontsize='small')
    panels[-1].set_xlabel('time [s]')
    for panel in panels:
        panel.grid(alpha=0.3)
    return figure


def _draw_bands(panel: Any, time: Any, values: Any, stddev: Any) -> None:
    """Three components with their bands."""
    for axis, colour, value, width in zip('xyz', _COLOURS, values.T, _BAND * stddev.T):
        panel.plot(time, value, color=colour, linewidth=1.0, label=axis)
        panel.fill_between(time, value - width, value + width, color=colour, alpha=0.2, lw=0)
    panel.legend(frameon=False, fontsize='small', ncols=3)
