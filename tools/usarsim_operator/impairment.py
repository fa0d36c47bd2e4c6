"""Links between pages and the gateway as bad as a condition of a study says; knows no socket.

A link delays every message, by the delay and an even jitter, and keeps their order; a bandwidth
lets one message after the other through; of frames (state, pictures, scans, points, poses, maps) a
share is lost. Which ones depends on the seed, the name of the page and the stream alone: the n-th
frame of a stream is lost in each run or in none. Texts that must arrive are late, but never lost.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import read_toml


@dataclass(frozen=True, slots=True)
class Conditions:
    """What a link is like.

    Attributes:
        delay, jitter: s; a message takes from delay - jitter to delay + jitter.
        loss: share of frames that never arrive, 0 to 1.
        bandwidth: bytes/s; 0: no limit.
        seed: of everything that is drawn.
    """

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    bandwidth: float = 0.0
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Plan:
    """Conditions of all pages. pages: of some, by their names; rest: of all others."""

    rest: Conditions
    pages: dict[str, Conditions]

    def of(self, name: str) -> Conditions:
        """Those of a page."""
        return self.pages.get(name, self.rest)


def read_plan(path: Path) -> Plan:
    """Read a file: `[link]` for all pages, `[page.NAME]` for the page of a name.

    Raises:
        UsarsimError: if it cannot be read or says something else.
    """
    top = Table(read_toml(path, UsarsimError, "link"), path, UsarsimError)
    rest = _conditions(top.raw("link"), path, "[link]", Conditions())
    named = top.raw("page")
    if named is not None and not isinstance(named, dict):
        raise top.wrong("page", named, "a table", "[page.NAME]")
    pages = {
        name: _conditions(content, path, f"[page.{name}]", rest)
        for name, content in (named or {}).items()
    }
    top.finish()
    return Plan(rest, pages)


def _conditions(content: object, path: Path, place: str, base: Conditions) -> Conditions:
    if content is None:
        return base
    if not isinstance(content, dict):
        raise UsarsimError(f"{path}: {place}: is no table (write {place} above its keys)")
    table = Table(content, path, UsarsimError, place)
    found = Conditions(
        table.number("delay_ms", base.delay * 1e3, low=0.0, high=10_000.0) / 1e3,
        table.number("jitter_ms", base.jitter * 1e3, low=0.0, high=10_000.0) / 1e3,
        table.number("loss_percent", base.loss * 1e2, low=0.0, high=100.0) / 1e2,
        table.number("bandwidth_kbit", base.bandwidth / 125.0, low=0.0, high=1e6) * 125.0,
        table.count("seed", base.seed, low=0, high=2**31),
    )
    if found.jitter > found.delay:
        raise table.error("jitter_ms", "is more than delay_ms", "write a smaller one")
    table.finish()
    return found


class Way:
    """One direction of a link; times are s of whatever clock the caller has.

    Attributes:
        free: when the next message may be sent. sent, lost: how many.
    """

    def __init__(self, conditions: Conditions, name: str) -> None:
        """name: of the page, and the direction."""
        self.free, self.sent, self.lost = 0.0, 0, 0
        self._conditions, self._name = conditions, name
        self._last = 0.0
        self._jitter = random.Random(f"{conditions.seed}/{name}")
        self._dice: dict[str, random.Random] = {}

    @property
    def limited(self) -> bool:
        """Whether the size of a message counts."""
        return self._conditions.bandwidth > 0.0

    def send(self, size: int, now: float, stream: str = "") -> float | None:
        """Send a message.

        Args:
            size: bytes. now: s.
            stream: whose frame it is; empty for what must arrive.

        Returns:
            When it arrives, later than all before; None: never.
        """
        told = self._conditions
        self.sent += 1
        begun = max(now, self.free)
        self.free = begun + (size / told.bandwidth if told.bandwidth else 0.0)
        if stream and told.loss:
            dice = self._dice.get(stream)
            if dice is None:
                dice = self._dice[stream] = random.Random(f"{told.seed}/{self._name}/{stream}")
            if dice.random() < told.loss:
                self.lost += 1
                return None
        late = told.delay + self._jitter.uniform(-told.jitter, told.jitter)
        self._last = max(self.free + late, self._last + 1e-6)
        return self._last
