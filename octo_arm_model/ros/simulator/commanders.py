"""Whether several commanders pull the tendons in turn to what the others do not want."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from rclpy.node import Node

# What is commanded, and the value [N] or [m], by tendon.
Command = Mapping[str, tuple[str, float]]
_SWITCHES = 3  # from one to another that make a contradiction: one is a handover
_APART = 1e9  # distance of commands of other quantities


class Commanders:
    """Finds commands that contradict each other.

    rclpy does not tell which publisher a message is from. A command that is nearer to the one
    before the last than to the last is taken for that of another publisher of its topic, where
    there are several; that of another topic always, unless they are equal.
    """

    def __init__(self, node: Node) -> None:
        """Of the commands that ``node`` hears."""
        self._node = node
        self._last: tuple[str, Command] | None = None
        self._before: dict[str, Command] = {}
        self._switches = 0
        self._topics: Counter[str] = Counter()

    def note(self, topic: str, command: Command) -> None:
        """Take note of an accepted ``command`` on ``topic``."""
        last, self._last = self._last, (topic, command)
        if last is None:
            return
        distance = _distance(command, last[1])
        before = self._before.get(topic)
        self._before[last[0]] = last[1]
        if not distance:
            return
        is_other = last[0] != topic
        if not is_other and before is not None and self._node.count_publishers(topic) > 1:
            is_other = _distance(command, before) < 0.5 * distance
        if is_other:
            self._switches += 1
            self._topics.update((topic, last[0]))

    def report(self) -> str:
        """Which commanders have contradicted each other lately; empty for none."""
        switches, self._switches = self._switches, self._switches // 2
        topics, self._topics = sorted(self._topics), Counter()
        if switches < _SWITCHES or not topics:
            return ''
        named = [f'{topic} of {", ".join(self._publishers(topic))}' for topic in topics]
        return f'commanders contradict each other: {"; ".join(named)}'

    def _publishers(self, topic: str) -> list[str]:
        found = self._node.get_publishers_info_by_topic(topic)
        names = {f'{one.node_namespace.rstrip("/")}/{one.node_name}' for one in found}
        return sorted(names) or ['nobody any more']


def _distance(one: Command, other: Command) -> float:
    """How far two commands are apart, in the tendons that both name."""
    distance = 0.0
    for name in one.keys() & other.keys():
        (kind, value), (other_kind, other_value) = one[name], other[name]
        distance += abs(value - other_value) if kind == other_kind else _APART
    return distance
