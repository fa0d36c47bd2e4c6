"""What the hands of a robot take and let go, told as changes of its configuration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_server.actuators.effector import Effector
from usarsim_server.simulation.snapshot import RobotBody


@dataclass(frozen=True, slots=True)
class Change:
    """One change that the client did not cause by this very line.

    Attributes:
        event: ItemAttached or ItemReleased for things in a hand, ToolAttached or ToolReleased for
            an effector of the robot that a tool changer took or let go.
        wire_type: type of the hand, or of the tool.
        name: of the hand, or of the tool.
    """

    event: str
    wire_type: str
    name: str


class Holdings:
    """Compares what is held from look to look; used by one thread."""

    def __init__(self, effectors: Sequence[Effector]) -> None:
        self._hands = tuple(effectors)
        self._tools = {one.name: one for one in effectors if one.description.detached}
        self._held: dict[str, str | None] | None = None

    def changes(self, state: RobotBody) -> list[Change]:
        """What has changed since the last call; nothing at the first one."""
        if not self._hands:
            return []
        held = {hand.name: state.hand(hand.name).holding for hand in self._hands}
        before, self._held = self._held, held
        if before is None or before == held:
            return []
        changes: list[Change] = []
        for hand in self._hands:
            old, new = before[hand.name], held[hand.name]
            if old == new:
                continue
            if old is not None:
                changes.append(self._change(hand, old, "Released"))
            if new is not None:
                changes.append(self._change(hand, new, "Attached"))
        return changes

    def _change(self, hand: Effector, held: str, end: str) -> Change:
        tool = self._tools.get(held)
        if tool is not None:
            return Change(f"Tool{end}", tool.wire_type, tool.name)
        return Change(f"Item{end}", hand.wire_type, hand.name)
