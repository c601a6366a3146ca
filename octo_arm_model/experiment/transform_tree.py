"""Frames of TF: rigid transforms from child to parent over time, and poses from them.

Between two stamps of a transform its translation is interpolated linearly and its rotation along
the shortest arc, as tf2 does; before the first and after the last it is unknown. Static transforms
hold at all times.
"""

import math
from array import array
from bisect import bisect, bisect_left
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from octo_arm_model.arm.errors import MeasurementError, listed
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.limits import MAX_NAME
from octo_arm_model.arm.pose import Pose
from octo_arm_model.rod.stations import interpolated

_NUMBERS = 7  # numbers of a transform: translation [m], quaternion x, y, z, w
# tf2 refuses quaternions whose norm differs by more; as float32 they differ by less.
_UNIT = 1e-3


@dataclass
class _Link:
    """Transforms from a frame to its parent: stamps [ns], and `_NUMBERS` for each."""

    parent: str
    is_static: bool
    stamps: 'array[int]' = field(default_factory=lambda: array('q'))
    numbers: 'array[float]' = field(default_factory=lambda: array('d'))
    is_ascending: bool = True  # each stamp after the one before

    def add(self, stamp_ns: int, numbers: Iterable[float]) -> None:
        """Append a transform."""
        self.is_ascending &= not self.stamps or stamp_ns > self.stamps[-1]
        self.stamps.append(stamp_ns)
        self.numbers.extend(numbers)

    def clear(self) -> None:
        """Remove all transforms."""
        del self.stamps[:], self.numbers[:]
        self.is_ascending = True

    def around(self, first: int, last: int) -> tuple[IntArray, FloatArray]:
        """Return stamps (n,) [ns] from before ``first`` to after ``last``, and their numbers."""
        self.sort()
        start, stop = bisect(self.stamps, first), bisect(self.stamps, last) + 1
        start = max(start - 1, 0)
        numbers = np.array(self.numbers[_NUMBERS * start : _NUMBERS * stop])
        return np.array(self.stamps[start:stop], np.int64), numbers.reshape(-1, _NUMBERS)

    def forget(self, history_ns: int) -> None:
        """Remove transforms over ``history_ns`` [ns] older than the newest."""
        stamp, numbers = self.stamps[-1], self.numbers[-_NUMBERS:]
        self.sort()
        if stamp < self.stamps[-1] - history_ns:
            self.clear()
            self.add(stamp, numbers)
        gone = bisect_left(self.stamps, self.stamps[-1] - history_ns)
        del self.stamps[:gone], self.numbers[: gone * _NUMBERS]

    def sort(self) -> None:
        """Sort by stamps, and keep each stamp once."""
        if self.is_ascending:
            return
        stamps, order = np.unique(np.array(self.stamps, np.int64), return_index=True)
        numbers = np.array(self.numbers).reshape(-1, _NUMBERS)[order]
        self.clear()
        self.stamps.frombytes(stamps.tobytes())
        self.numbers.frombytes(numbers.tobytes())


class TransformTree:
    """The transforms of a recording."""

    def __init__(self) -> None:
        """Create a tree without transforms."""
        self._links: dict[str, _Link] = {}

    def add(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        translation: FloatArray,
        quaternion: FloatArray,
        is_static: bool,
    ) -> None:
        """Add a transform from ``child`` to ``parent``; of static ones the last one holds.

        Raises:
            MeasurementError: if it is not static and the child has another parent already, or if
                the child is its own parent.
        """
        if parent == child:
            raise MeasurementError(f'the frame {child!r} is its own parent')
        # A static one replaces all before, as in tf2: the frame may be elsewhere now.
        link = None if is_static else self._links.get(child)
        link = link or _Link(parent, is_static)
        if link.parent != parent:
            raise MeasurementError(
                f'the parent of {child!r} is {parent!r}, expected {link.parent!r} as before'
            )
        self._links.pop(child, None)
        self._links[child] = link  # the newest comes last
        if is_static or not link.is_static:
            link.add(stamp_ns, (*translation, *quaternion))

    def connects(self, one: str, other: str) -> bool:
        """Whether transforms connect the frames ``one`` and ``other``."""
        known = {*self._links, *(link.parent for link in self._links.values())}
        return {one, other} <= known and self.chain(one)[-1] == self.chain(other)[-1]

    def moves(self, frame: str, target: str) -> bool:
        """Whether transforms lead from ``frame`` to ``target``, and one of them changes."""
        if not self.connects(frame, target):
            return False
        links = (self._links[child] for child, _ in self._path(frame, target))
        return any(
            np.ptp(np.reshape(link.numbers, (-1, _NUMBERS)), axis=0).any() for link in links
        )

    def chain(self, frame: str) -> list[str]:
        """Return ``frame``, its parent, and so on up to the root.

        Raises:
            MeasurementError: if there is no such frame, or its parents form a cycle.
        """
        known = {*self._links, *(link.parent for link in self._links.values())}
        if frame not in known:
            there = listed(sorted(known))
            raise MeasurementError(f'no frame {frame!r} among the transforms; there are {there}')
        chain = [frame]
        while chain[-1] in self._links:
            chain.append(self._links[chain[-1]].parent)
            if chain[-1] in chain[:-1]:
                raise MeasurementError(f'the parents of frames form a cycle: {" < ".join(chain)}')
        return chain

    def origins(
        self, frame: str, target: str, skip: Callable[[str], None]
    ) -> tuple[IntArray, FloatArray]:
        """Return stamps (n,) [ns] and positions (n, 3) [m] of ``frame`` in ``target``.

        Stamps are those of the first transform from the frame that is not static. ``skip`` is
        called with the reason for each stamp without a known position.

        Raises:
            MeasurementError: if nothing connects the two, or all transforms between are static.
        """
        path = self._path(frame, target)
        moving = [child for child, _ in path if not self._links[child].is_static]
        if not moving:
            raise MeasurementError(
                f'all transforms from {frame!r} to {target!r} are static, expected stamps of a '
                'measurement'
            )
        link = self._links[moving[0]]
        link.sort()
        stamps = np.array(link.stamps, np.int64)
        known = np.ones(len(stamps), dtype=bool)
        points, _ = self._poses(path, stamps, known, skip, needs_turn=False)
        return stamps[known], points[known]

    def pose(self, frame: str, target: str, stamp_ns: int) -> Pose:
        """Return the pose of ``frame`` in ``target`` at ``stamp_ns`` [ns].

        Raises:
            MeasurementError: if nothing connects the two, or a transform between is not known.
            ConfigError: if the position is beyond the bounds of a `Pose`.
        """

        def refuse(reason: str) -> None:
            raise MeasurementError(reason)

        stamps, known = np.array([stamp_ns]), np.ones(1, dtype=bool)
        path = self._path(frame, target)
        places, turns = self._poses(path, stamps, known, refuse, needs_turn=True)
        (x, y, z), (qx, qy, qz, qw) = places[0].tolist(), turns[0].as_quat().tolist()
        of = f'of {frame[:MAX_NAME]!r}'
        names = f'the position {of}', f'the rotation {of}'
        return Pose((x, y, z), (qx, qy, qz, qw), names)

    def _poses(
        self,
        path: Sequence[tuple[str, bool]],
        stamps: IntArray,
        known: np.ndarray,
        skip: Callable[[str], None],
        needs_turn: bool,
    ) -> tuple[FloatArray, Rotation]:
        """Return positions and rotations at the end of a ``path`` at ``stamps``.

        ``known`` is updated. Unless ``needs_turn``, the rotation of the frame itself, on which its
        origin does not depend, is not looked at, and rotations are not those of the frame.
        """
        places, turns = np.zeros((len(stamps), 3)), Rotation.identity(len(stamps))
        for number, (child, is_up) in enumerate(path):
            shift, turn = self._at(
                child, stamps, known, skip, needs_turn or not is_up or number > 0
            )
            if is_up:
                places, turns = turn.apply(places) + shift, turn * turns
            else:
                places, turns = turn.apply(places - shift, inverse=True), turn.inv() * turns
        return places, turns

    def known_until(self, frame: str, target: str) -> float:
        """Return the last stamp [ns] with a known pose of ``frame`` in ``target``; inf if static.

        Raises:
            MeasurementError: if nothing connects the two.
        """
        links = [self._links[child] for child, _ in self._path(frame, target)]
        return min((max(link.stamps) for link in links if not link.is_static), default=math.inf)

    def forget(self, history_ns: int, most: int) -> None:
        """Remove stamps over ``history_ns`` [ns] older than the newest of the same transform.

        If the stamp added last is itself that old, all others are removed: the clock was reset, as
        when a bag is played again, or one stamp was far ahead. Of more than ``most`` frames those
        that came longest ago are removed, static ones last, because these do not come again.
        """
        count, of_static = len(self._links) - most, lambda child: self._links[child].is_static
        for child in sorted(self._links, key=of_static)[: max(0, count)]:
            del self._links[child]
        for link in self._links.values():
            if not link.is_static:
                link.forget(history_ns)

    def _path(self, frame: str, target: str) -> list[tuple[str, bool]]:
        """Return the transforms from ``frame`` to ``target``: child, and whether to its parent.

        MeasurementError if nothing connects the two.
        """
        up, down = self.chain(frame), self.chain(target)
        if up[-1] != down[-1]:
            raise MeasurementError(f'no transforms connect {frame!r} and {target!r}')
        while len(up) > 1 and len(down) > 1 and up[-2] == down[-2]:
            # Transforms above the common ancestor move both frames alike.
            del up[-1], down[-1]
        return [*((child, True) for child in up[:-1]), *((child, False) for child in down[-2::-1])]

    def _at(
        self,
        child: str,
        stamps: IntArray,
        known: np.ndarray,
        skip: Callable[[str], None],
        needs_turn: bool,
    ) -> tuple[FloatArray, Rotation]:
        """Return translation and rotation of a transform at ``stamps``, and update ``known``.

        Unless ``needs_turn`` the rotation is not read, and is the identity.
        """
        link = self._links[child]
        link.sort()
        name = f'the transform from {child!r} to {link.parent!r}'
        first, last = link.stamps[0], link.stamps[-1]
        outside = known & ((stamps < first) | (stamps > last)) & (not link.is_static)
        known &= ~outside
        for stamp in stamps[outside].tolist():
            skip(f'{name} is not known at {1e-9 * stamp:.3f} s')
        at = np.clip(stamps, first, last)
        times, numbers = link.around(int(at.min()), int(at.max()))
        if needs_turn:
            norm = np.linalg.norm(numbers[:, 3:], axis=1)
            good = np.isfinite(numbers).all(axis=1) & (np.abs(norm - 1.0) < _UNIT)
            if not good.all():
                place = int(np.argmin(good))
                raise MeasurementError(
                    f'{name} is {numbers[place].tolist()}, expected finite numbers and a '
                    'quaternion of norm 1'
                )
        else:
            numbers[:, 3:] = 0.0, 0.0, 0.0, 1.0
        # Differences are exact as integers, and small enough as seconds.
        seconds, wanted = 1e-9 * (times - times[0]), 1e-9 * (at - times[0])
        shift = interpolated(wanted, seconds, numbers[:, :3])
        if len(times) == 1:
            return shift, Rotation.from_quat(np.broadcast_to(numbers[0, 3:], (len(at), 4)))
        turns = Slerp(seconds, Rotation.from_quat(numbers[:, 3:]))
        return shift, turns(np.clip(wanted, 0.0, seconds[-1]))
