"""A cache of what belongs to recent equilibria, such as the systems linearised about them."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from typing import Generic, TypeVar

from octo_arm_model.core.hints import FloatArray

_MOST = 16  # for as many arms that are followed in turn
_K = TypeVar('_K')


class _Held(weakref.ref[FloatArray]):
    """A weak reference to an array that knows the identity of it after its end."""

    __slots__ = ('key',)
    key: int


class KeptBalances(Generic[_K]):
    """Data of the `_MOST` equilibria used last, by the identity of one of their arrays.

    The array is the twist of an equilibrium, or its tensions: whoever continues from the
    equilibrium passes the same object. Once nobody has that any more, its data are unused; memory
    that was used a moment ago is in the cache of the processor still.
    """

    def __init__(self) -> None:
        """Begin empty."""
        self._kept: dict[int, tuple[_Held, _K]] = {}
        self._unused: _K | None = None

    def __iter__(self) -> Iterator[_K]:
        """What is known of each."""
        # A list, as arrays may come to their end meanwhile.
        return (known for _, known in list(self._kept.values()))

    def about(self, array: FloatArray) -> _K | None:
        """Data of the equilibrium of this ``array``, which becomes the one used last; or None."""
        kept = self._kept.pop(id(array), None)
        if kept is None:
            return None
        self._kept[id(array)] = kept
        return kept[1]

    def keep(self, array: FloatArray, known: _K) -> None:
        """Keep the data ``known`` of the equilibrium of this ``array``."""
        held = _Held(array, self._on_end)
        held.key = id(array)
        if held.key not in self._kept and len(self._kept) >= _MOST:
            self._kept.pop(next(iter(self._kept)))
        self._kept[held.key] = held, known

    def take_unused(self) -> _K | None:
        """Data no longer kept: of the last array that came to its end, if not taken already.

        Else of the equilibrium used longest ago, if there is no room for another; or None.
        """
        unused, self._unused = self._unused, None
        if unused is None and len(self._kept) >= _MOST:
            unused = self._kept.pop(next(iter(self._kept)))[1]
        return unused

    def _on_end(self, held: _Held) -> None:
        """The array of ``held`` is no longer used by anybody."""
        kept = self._kept.get(held.key)
        if kept is not None and kept[0] is held:
            del self._kept[held.key]
            self._unused = kept[1]
