"""Finds in the records of a run when robots stood, and why.

A robot stands while it has stayed within `NEAR` of its place of `LONG` before. One that turns
round in a dead end and comes back to a place does not stand.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from usarsim_mission.records import Record

LONG, NEAR = 10.0, 0.5
"""s, and m: what standing is."""
UNKNOWN = "nothing tells why"
TOLD = frozenset({"mode", "enable", "link", "stands", "inject"})
"""Kinds of records that tell why one stands."""
_EVERY = 0.5  # s between two places that count
_GAP = 1.0  # s between two rows of the truth that belong together
_UPRIGHT = math.cos(math.radians(45.0))


@dataclass
class Stood:
    """One time in which a robot stood, s of simulated time; why: in words."""

    begins: float
    ends: float
    why: str


@dataclass
class Standing:
    """One robot.

    Attributes:
        spans: when it stood. mode: who drives it. policy: what it does by itself.
        off: whether it is switched off. failed: whether it is let fail.
        cut: whether nothing gets through to it.
        says: why it stands by its own account; empty while it goes on.
    """

    spans: list[Stood] = field(default_factory=list)
    mode: str = ""
    policy: str = ""
    off: bool = False
    failed: bool = False
    cut: bool = False
    says: str = ""
    _last: tuple[float, str] = (-math.inf, UNKNOWN)
    _places: deque[tuple[float, float, float]] = field(default_factory=deque)

    def row(self, time: float, row: Record, stopped: bool) -> None:
        """Note where the robot is.

        Args:
            time: simulated s. row: of the truth, about this robot.
            stopped: whether the emergency stop holds all robots.
        """
        if held := self._why(row, stopped):
            self._last = time, held
        pos, places = row.get("pos"), self._places
        if not pos or pos[0] is None or pos[1] is None:
            places.clear()
            return
        if places and time - places[-1][0] < _EVERY - 1e-6:
            return
        if places and time - places[-1][0] > _GAP:
            places.clear()
        places.append((time, pos[0], pos[1]))
        while time - places[0][0] > LONG + 1e-6:
            places.popleft()
        since, *place = places[0]
        if time - since < LONG - 1e-6 or any(math.dist(one[1:], place) > NEAR for one in places):
            return
        # What held it until just now still tells why it is not farther.
        why = self._last[1] if time - self._last[0] <= LONG else UNKNOWN
        span = self.spans[-1] if self.spans and since <= self.spans[-1].ends else None
        if span is None:
            self.spans.append(Stood(since, time, why))
        elif why == span.why:
            span.ends = time
        elif span.why == UNKNOWN and span.ends - span.begins < 2.0 * LONG:
            span.ends, span.why = time, why  # it was about to tell
        else:
            self.spans.append(Stood(span.ends, time, why))

    def _why(self, row: Record, stopped: bool) -> str:
        """What holds it now; empty if nothing does."""
        quat, battery = row.get("quat"), row.get("battery")
        if quat and None not in quat and 1.0 - 2.0 * (quat[1] ** 2 + quat[2] ** 2) < _UPRIGHT:
            return "it lies on its side or back"
        if isinstance(battery, int | float) and battery <= 0.0:
            return "its battery is empty"
        if self.failed:
            return "the mission lets it fail"
        if self.cut:
            return "its link is lost"
        if stopped:
            return "the emergency stop holds it"
        if self.off:
            return "it is switched off"
        if self.mode == "teleoperated":
            return "whoever drives it lets it stand"
        if self.mode == "stopped" or not self.mode:
            return "nothing drives it"
        if self.policy in ("stop", "hold"):
            return f"its policy is {self.policy}"
        return self.says

    def take(self, record: Record) -> None:
        """Note a record that tells why this robot may stand."""
        match record["kind"]:
            case "mode":
                self.mode, self.policy = record["mode"], str(record.get("policy") or "")
            case "enable":
                self.off = not record["on"]
            case "link":
                self.cut = record["state"] == "lost"
            case "stands":
                self.says = str(record["why"])
            case "inject" if record.get("do") in ("robot_fails", "robot_recovers"):
                if not record.get("why"):
                    self.failed = record["do"] == "robot_fails"
