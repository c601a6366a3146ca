"""Elastic laws of a cross section by their names; `rod.loops` has their energies."""

from __future__ import annotations

from typing import NamedTuple


class Law(NamedTuple):
    """An elastic law.

    Attributes:
        widens: whether a section widens as it is compressed, by 1 / sqrt(stretch).
        meant_for: the kind of arm it is for, in one or two words.
    """

    widens: bool
    meant_for: str


LAWS = {'neo_hookean': Law(True, 'soft'), 'linear': Law(False, 'stiff')}
DEFAULT_LAW = 'neo_hookean'
