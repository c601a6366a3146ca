"""A picture of a command profile. Needs matplotlib."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray


def draw_profile(
    times: FloatArray, tensions: FloatArray, arm: Arm, title: str, path: Path
) -> None:
    """Draw ``tensions`` (n, tendons) [N] over ``times`` (n,) [s] into the PNG file ``path``.

    One panel for each section with tensions, which differ much between sections.

    Raises:
        OSError: if the file cannot be written.
    """
    sections = np.unique(arm.tendon_section[tensions.any(axis=0)]).tolist() or [1]
    figure = Figure(figsize=(9.0, 1.2 + 2.2 * len(sections)), layout='constrained')
    figure.suptitle(title)
    panels = figure.subplots(len(sections), 1, sharex=True, squeeze=False)[:, 0]
    for section, axes in zip(sections, panels, strict=True):
        for tendon in np.flatnonzero(arm.tendon_section == section):
            axes.plot(times, tensions[:, tendon], label=arm.tendon_names[tendon])
        axes.set(ylabel='tension [N]')
        axes.margins(x=0.0)
        axes.grid(alpha=0.3)
        axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), frameon=False)
    panels[-1].set(xlabel='time [s]')
    # A PNG for any suffix.
    figure.savefig(path, dpi=120, format='png')
