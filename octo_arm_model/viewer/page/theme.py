"""The colours and panel of every page."""

from __future__ import annotations

import viser

_BRAND = (200, 85, 61)


def set_theme(gui: viser.GuiApi, title: str) -> None:
    """Set the colours and the title, and dock the panel at the right edge."""
    gui.configure_theme(show_logo=False, show_share_button=False, brand_color=_BRAND)
    gui.set_panel_label(title)
    gui.main_panel.dock_right()
