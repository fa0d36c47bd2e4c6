"""Who drives what: one holder per robot, an emergency stop that lasts, robots switched off.

Nothing is sent here and no clock is read. Each decision is logged with the ids of both sides.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from usarsim_server.protocol.json_text import parse_json

ANSWER_TIME = 10.0
"""s of the gateway's clock that a holder has to answer; silence is a no."""

Log = Callable[[str, dict[str, object]], None]
"""Takes what happened, and to whom."""


class Outcome(Enum):
    """What became of a wish."""

    GRANTED = "granted"
    ASKED = "asked"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class Holder:
    """Who drives a robot: a page, or (page None) a controller of its own."""

    page: int | None
    name: str


@dataclass(frozen=True, slots=True)
class Decision:
    """What became of a wish to drive. before: who held the robot until now."""

    outcome: Outcome
    why: str = ""
    before: Holder | None = None


@dataclass(frozen=True, slots=True)
class Asking:
    """Somebody waits for the holder's answer. since: s of the gateway's clock."""

    robot: str
    page: int
    name: str
    since: float


@dataclass(frozen=True, slots=True)
class Stop:
    """An emergency stop. by: name of who stopped. time: simulated s."""

    by: str
    time: float


class Arbiter:
    """Locks of all robots, the emergency stop, and which robots are switched off.

    Attributes:
        holders: who drives, by robot. disabled: robots that are switched off. failed: those of them
            that nobody can switch on.
        stop: the emergency stop that holds; None if there is none.
    """

    def __init__(self, latch: Path | None, log: Log) -> None:
        """Begin with no locks, and with the emergency stop that an earlier gateway left.

        Args:
            latch: file that exists while everything is stopped; None: the stop ends with us.
            log: takes each decision.
        """
        self.holders: dict[str, Holder] = {}
        self.disabled: set[str] = set()
        self.failed: set[str] = set()
        self.stop = None if latch is None else _left(latch)
        self._latch = latch
        self._log = log
        self._asking: dict[str, Asking] = {}

    # -- locks --------------------------------------------------------------------------------

    def take(
        self, robot: str, page: int, name: str, now: float, *, force: bool = False
    ) -> Decision:
        """A page wants to drive a robot; the first gets it, later ones ask, an instructor forces.

        Args:
            robot: its name. page, name: who wants it.
            now: s of the gateway's clock.
            force: do not ask; whether a page may do so is the caller's business.
        """
        held = self.holders.get(robot)
        if held is None or held.page == page:
            return self._give(robot, Holder(page, name), held, "took")
        if force:
            return self._give(robot, Holder(page, name), held, "took by force")
        waiting = self._asking.get(robot)
        if waiting is not None and waiting.page != page:
            why = f"{held.name} holds {robot}, and {waiting.name} has asked already"
            return Decision(Outcome.REFUSED, why, held)
        self._asking[robot] = Asking(robot, page, name, now)
        self._note("asked", robot, page, held)
        return Decision(Outcome.ASKED, f"{held.name} holds {robot} and is asked", held)

    def reply(self, robot: str, page: int, to: int, grant: bool) -> Decision:
        """The holder answers who asked; an answer of anybody else, or to nobody, is refused."""
        held, waiting = self.holders.get(robot), self._asking.get(robot)
        if held is None or held.page != page:
            return Decision(Outcome.REFUSED, f"you do not hold {robot}", held)
        if waiting is None or waiting.page != to:
            return Decision(Outcome.REFUSED, f"that page does not ask for {robot}", held)
        del self._asking[robot]
        if grant:
            return self._give(robot, Holder(waiting.page, waiting.name), held, "was granted")
        self._note("refused", robot, waiting.page, held)
        return Decision(Outcome.REFUSED, f"{held.name} keeps {robot}", held)

    def expired(self, now: float) -> list[Asking]:
        """Those whose holder did not answer in time; each is told once."""
        found = [one for one in self._asking.values() if now - one.since >= ANSWER_TIME]
        for one in found:
            del self._asking[one.robot]
            self._note("got no answer", one.robot, one.page, self.holders.get(one.robot))
        return found

    def hand_back(self, robot: str, page: int) -> bool:
        """The holder gives a robot back; False if the page does not hold it."""
        held = self.holders.get(robot)
        if held is None or held.page != page:
            return False
        del self.holders[robot]
        self._asking.pop(robot, None)
        self._note("handed back", robot, page, held)
        return True

    def gone(self, page: int) -> list[str]:
        """A page has gone; the robots that it held, which must stop."""
        for waiting in [one for one in self._asking.values() if one.page == page]:
            del self._asking[waiting.robot]
        held = [robot for robot, one in self.holders.items() if one.page == page]
        for robot in held:
            self.hand_back(robot, page)
        return held

    def forget(self, robot: str) -> None:
        """A robot has left the world."""
        self.holders.pop(robot, None)
        self._asking.pop(robot, None)
        self.disabled.discard(robot)
        self.failed.discard(robot)

    def why_not(self, robot: str, page: int) -> str:
        """Why a page may not drive a robot; empty if it may. A refusal names the holder."""
        held = self.holders.get(robot)
        if held is None:
            return f"nobody holds {robot}: take it first"
        if held.page != page:
            return f"{held.name} holds {robot}"
        if self.stop is not None:
            return f"emergency stop by {self.stop.by}: reset it first"
        if robot in self.failed:
            return f"{robot} has failed"
        if robot in self.disabled:
            return f"{robot} is switched off: enable it first"
        return ""

    def _give(self, robot: str, to: Holder, before: Holder | None, what: str) -> Decision:
        self.holders[robot] = to
        self._asking.pop(robot, None)
        if before != to:
            self._note(what, robot, to.page, before)
        return Decision(Outcome.GRANTED, before=before)

    def _note(self, what: str, robot: str, page: int | None, before: Holder | None) -> None:
        facts: dict[str, object] = {"robot": robot, "page": page}
        facts["holder"] = "nobody" if before is None else before.page
        self._log(what, facts)

    # -- stopping -----------------------------------------------------------------------------

    def enable(self, robot: str, on: bool) -> None:
        """Switch a robot on or off; off, it takes no driving. Switching on moves nothing.

        Raises:
            ValueError: one that has failed is not to be switched on.
        """
        if on and robot in self.failed:
            raise ValueError(f"{robot} has failed")
        (self.disabled.discard if on else self.disabled.add)(robot)

    def fail(self, robot: str, on: bool) -> None:
        """Let a robot fail, or recover from that: then it is on."""
        (self.failed.add if on else self.failed.discard)(robot)
        self.enable(robot, not on)

    def stop_all(self, by: str, page: int, time: float) -> None:
        """Stop everything; holds until `reset`. The file is written by `keep`, after the robots
        were told, for a disk may be slow."""
        if self.stop is None:
            self.stop = Stop(by, time)
        self._log("emergency stop", {"page": page, "by": by})

    def reset(self, by: str, page: int) -> None:
        """End the emergency stop; nothing moves by that."""
        if self.stop is not None:
            self._log("emergency stop ends", {"page": page, "by": by, "stopped_by": self.stop.by})
        self.stop = None

    def keep(self) -> None:
        """Write or remove the file of the emergency stop.

        Raises:
            OSError: if that cannot be done; the stop holds until this gateway ends.
        """
        if self._latch is None:
            return
        if self.stop is None:
            self._latch.unlink(missing_ok=True)
            return
        fresh = self._latch.with_suffix(".new")
        with fresh.open("w", encoding="utf-8") as file:
            json.dump({"by": self.stop.by, "time": self.stop.time}, file)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(self._latch)


def _left(latch: Path) -> Stop | None:
    """The stop that an earlier gateway left; a file that cannot be understood is one, too."""
    try:
        fields = parse_json(latch.read_text(encoding="utf-8"))
        return Stop(str(fields["by"]), float(fields["time"]))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError):
        return Stop("an earlier gateway", 0.0)
