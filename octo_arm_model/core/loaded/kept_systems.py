"""Systems linearised about the balances that arms are followed from."""

from __future__ import annotations

from typing import Generic, TypeVar

from octo_arm_model.core.hints import FloatArray

_MOST = 16  # for as many arms that are followed in turn
_S = TypeVar('_S')


class KeptSystems(Generic[_S]):
    """Those of the balances found or followed from last, each known by its very twist."""

    def __init__(self) -> None:
        """Keep none yet."""
        # By the identity of the twist, which is held so that it stays the only one of that.
        self._kept: dict[int, tuple[FloatArray, _S]] = {}

    def about(self, twist: FloatArray) -> _S | None:
        """The system about the balance of this ``twist``, if it is kept: now the one used last."""
        kept = self._kept.pop(id(twist), None)
        if kept is None:
            return None
        self._kept[id(twist)] = kept
        return kept[1]

    def keep(self, twist: FloatArray, system: _S) -> None:
        """Keep the ``system`` about the balance of this ``twist``."""
        self.oldest()
        self._kept[id(twist)] = twist, system

    def oldest(self) -> _S | None:
        """The system used longest ago, no longer kept, if there is no room for another."""
        if len(self._kept) < _MOST:
            return None
        return self._kept.pop(next(iter(self._kept)))[1]
