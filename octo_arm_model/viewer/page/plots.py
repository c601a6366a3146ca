"""The plots of the strains over the arc coordinate."""

from __future__ import annotations

import viser
from viser import uplot

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.ros.client.published import PublishedStrains

_LABELS = (
    ('torsion τ [1/m]', 'tau', 1.0),
    ('curvature ξ about n [1/m]', 'xi', 1.0),
    ('curvature k about b [1/m]', 'k', 1.0),
    ('longitudinal strain q [%]', 'q', 100.0),
)
_NODE, _OTHER = '#c8553d', '#4f7cac'
# Smallest range of an axis, in which rounding errors are a flat curve.
_LEAST = 1.0


class StrainPlots:
    """Four plots over s, of the node and of another model if one is chosen."""

    def __init__(self, gui: viser.GuiApi, s: FloatArray) -> None:
        """Add them to ``gui``, for the stations ``s`` [m]."""
        self._s = 1e3 * s
        end = {'pad': 0.1, 'mode': 1}
        self._plots = [
            gui.add_uplot(
                (self._s, 0.0 * s, 0.0 * s),
                series=(
                    uplot.Series(label='s [mm]'),
                    uplot.Series(label='other', stroke=_OTHER, width=2),
                    uplot.Series(label='node', stroke=_NODE, width=2),
                ),
                scales={
                    'x': uplot.Scale(time=False),
                    'y': uplot.Scale(
                        range={'min': {**end, 'soft': -_LEAST}, 'max': {**end, 'soft': _LEAST}}
                    ),
                },
                axes=(
                    uplot.Axis(size=30),
                    uplot.Axis(size=44),
                    # Space for the upper half of the topmost number.
                    uplot.Axis(
                        side=0,
                        size=8,
                        stroke='transparent',
                        grid={'show': False},
                        ticks={'show': False},
                    ),
                ),
                title=label,
                legend=uplot.Legend(show=False),
                height=112,
                # Until there is a shape: zeros are the strains of a straight arm.
                visible=False,
            )
            for label, _, _ in _LABELS
        ]

    def show(self, node: PublishedStrains, other: Backbone | None) -> None:
        """Plot the strains of the node, and those of another model if given."""
        for plot, (_, name, scale) in zip(self._plots, _LABELS, strict=True):
            # Without another model its curve coincides with that of the node, which hides it.
            below = other or node
            plot.data = (self._s, scale * getattr(below, name), scale * getattr(node, name))
            if not plot.visible:
                plot.visible = True
