"""A cache of what belongs to recent equilibria, such as the systems linearised about them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, TypeVar

from octo_arm_model.core.hints import FloatArray

_MOST = 16  # for as many arms that are followed in turn
_K = TypeVar('_K')


class KeptBalances(Generic[_K]):
    """Data of the `_MOST` equilibria used last, by the identity of one of their arrays.

    The array is the twist of an equilibrium, or its tensions: whoever continues from the
    equilibrium passes the same object.
    """

    def __init__(self) -> None:
        """Begin empty."""
        # By the identity of the array, which is held so that it stays the only one of that.
        self._kept: dict[int, tuple[FloatArray, _K]] = {}

    def __iter__(self) -> Iterator[_K]:
        """What is known of each."""
        return (known for _, known in self._kept.values())

    def about(self, array: FloatArray) -> _K | None:
        """Data of the equilibrium of this ``array``, which becomes the one used last; or None."""
        kept = self._kept.pop(id(array), None)
        if kept is None:
            return None
        self._kept[id(array)] = kept
        return kept[1]

    def keep(self, array: FloatArray, known: _K) -> None:
        """Keep the data ``known`` of the equilibrium of this ``array``."""
        if id(array) not in self._kept:
            self.take_oldest()
        self._kept[id(array)] = array, known

    def take_oldest(self) -> _K | None:
        """If the cache is full, remove what was used longest ago and return it."""
        if len(self._kept) < _MOST:
            return None
        return self._kept.pop(next(iter(self._kept)))[1]
