"""When a run ends, and why: the `[end]` table of a scenario (exploration reference 4.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from usarsim_exploration.cycle import BASE, Body, Cycle
from usarsim_exploration.events import Fate
from usarsim_exploration.history import Recorder
from usarsim_server.base.fields import field

Reason = Literal["steps", "base knows", "all home", "all lost", "failed"]


@dataclass(frozen=True)
class End:
    """Keys of `[end]`; the first rule that holds ends the run."""

    steps: int = field(default=3000, low=1, high=1_000_000, help="after so many steps")
    base: float | None = field(
        default=95.0,
        above=0.0,
        high=100.0,
        unit="%",
        words={"off": None},
        help="when the base knows so much of the free cells",
    )
    of: Literal["reachable", "all"] = field(
        default="reachable",
        help="which free cells: those that the base can be reached from, or all (MRESim)",
    )
    home: bool = field(
        default=True, help="when all robots that work have nothing more to find and are home"
    )

    events: bool = field(
        default=False,
        help="neither of these two ends a run while an event to come opens more of the world",
    )

    def reason(self, cycle: Cycle, recorder: Recorder, fate: Fate) -> Reason | None:
        """Why a run ends now; None: it goes on. fate: knows what is to come."""
        if self.of == "reachable":
            known, goal = recorder.known_base, recorder.reachable
        else:
            known, goal = recorder.free_base, recorder.free
        waits = self.events and bool(fate.opening(cycle))
        if self.base is not None and 100 * known >= self.base * goal and not waits:
            return "base knows"
        working = [one for one in cycle.bodies if one.works and one is not cycle.bodies[BASE]]
        asleep = any(one.asleep for one in cycle.bodies)
        if not working and not asleep:
            return "all lost"
        if self.home and not asleep and not waits and all(map(_is_home, working)):
            settled = all(not one.moves and not one.found for one in working)
            pending = cycle.messages.pending(cycle.bodies, cycle.links)
            if not cycle.rules.ends or (settled and not pending):
                return "all home"
        return "steps" if cycle.step >= self.steps else None


def _is_home(body: Body) -> bool:
    """At the base, or as near as any way leads; who has just met a wall looks for another way."""
    return body.home and not body.view.path and not body.view.blocked
