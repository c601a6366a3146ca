"""Figures without a display, their files, and colours by tension. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from octo_arm_model.experiment.shapes.mean_midlines import MeasuredShape


def new_figure(
    width: float, height: float, layout: Literal['constrained', 'compressed'] = 'constrained'
) -> Any:
    """An empty figure of so many inches; with equal axes its ``layout`` is 'compressed'."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout=layout)


def save_all(
    pictures: Mapping[str, Callable[[], Any]], folder: Path, progress: Callable[[int, int], None]
) -> None:
    """Draw ``pictures`` that each make a figure of `new_figure`; write them to ``folder`` by name.

    ``progress`` is called with the numbers of pictures done and of all.

    Raises:
        OSError: if a file cannot be written.
    """
    for done, (name, picture) in enumerate(pictures.items()):
        progress(done, len(pictures))
        save(picture(), folder / f'{name}.png')


def save(figure: Any, path: Path) -> None:
    """Write a ``figure`` of `new_figure` to ``path``, a PNG whatever its ending.

    Raises:
        OSError: if it cannot be written.
    """
    figure.savefig(path, format='png', dpi=120, bbox_inches='tight', pad_inches=0.1)


class TensionColours:
    """Colours of steps by the sum of their tensions."""

    def __init__(self, shapes: Sequence[MeasuredShape]) -> None:
        """Scale the colours from zero to the largest tension of ``shapes``."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        highest = max(shape.tension for shape in shapes)
        self._scale: Any = ScalarMappable(Normalize(0.0, max(highest, 1e-9)), 'viridis')

    def of(self, shape: MeasuredShape) -> Any:
        """Colour of a step."""
        return self._scale.to_rgba(shape.tension)

    def add_bar(self, figure: Any, panels: Any) -> None:
        """The scale of colours beside the ``panels`` of a ``figure``."""
        figure.colorbar(self._scale, ax=panels, label='sum of tensions [N]', pad=0.01)
