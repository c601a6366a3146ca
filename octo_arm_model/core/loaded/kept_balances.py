"""What is known of the balances that arms are followed from, such as systems linearised there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, TypeVar

from octo_arm_model.core.hints import FloatArray

_MOST = 16  # for as many arms that are followed in turn
_K = TypeVar('_K')


class KeptBalances(Generic[_K]):
    """Those found or followed from last, each by a very array of it: its twist, or tensions."""

    def __init__(self) -> None:
        """Keep none yet."""
        # By the identity of the array, which is held so that it stays the only one of that.
        self._kept: dict[int, tuple[FloatArray, _K]] = {}

    def __iter__(self) -> Iterator[_K]:
        """What is known of each."""
        return (known for _, known in self._kept.values())

    def about(self, array: FloatArray) -> _K | None:
        """What is known of the balance of this ``array``, if it is kept: now the one used last."""
        kept = self._kept.pop(id(array), None)
        if kept is None:
            return None
        self._kept[id(array)] = kept
        return kept[1]

    def keep(self, array: FloatArray, known: _K) -> None:
        """Keep what is ``known`` of the balance of this ``array``."""
        self.take_oldest()
        self._kept[id(array)] = array, known

    def take_oldest(self) -> _K | None:
        """What was used longest ago, no longer kept, if there is no room for another."""
        if len(self._kept) < _MOST:
            return None
        return self._kept.pop(next(iter(self._kept)))[1]
