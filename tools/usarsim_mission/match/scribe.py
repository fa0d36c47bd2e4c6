"""Puts what happens at a gateway into the log of a run.

The gateway speaks the protocol's frame (y to the right, z down), the log MuJoCo's: places are
turned here, once. Its clock is that of the newest truth, so records stand in the order of time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from usarsim_client import frames
from usarsim_server.protocol.json_text import parse_json

if TYPE_CHECKING:
    from usarsim_operator.pages import Page

Tell = Callable[..., object]
"""Takes the kind of a record, and its facts by name."""

MODES = {
    "operator": "teleoperated",
    "autonomous": "autonomous",
    "controller": "autonomous",
    "stopped": "stopped",
}
"""Of the gateway, and of the log: a program of the team's own is autonomous."""
LONGEST = 20_000
"""Characters of a page's text that are kept; more than any that makes sense has."""
_LOOKING = ("select", "camera", "laser")


class Scribe:
    """Observes a station."""

    def __init__(
        self, tell: Tell, tick: Callable[[], int | None] = lambda: None, began: float = 0.0
    ) -> None:
        """Tell a log.

        Args:
            tell: takes what happens. tick: how many have passed in lockstep; None: there are none.
            began: s of the gateway's clock at which the run did; the log counts from there.
        """
        self._tell, self._tick, self._began = tell, tick, began

    def input(self, page: Page, text: str, heard: float) -> None:
        """What a page says, and what it looks at; pings are none of the operator's doing."""
        said: Any = text[:LONGEST]
        if len(text) <= LONGEST:
            try:
                said = parse_json(text)
            except ValueError:
                said = text
        kind = said.get("type") if isinstance(said, dict) else None
        if kind == "ping":
            return
        clock = said.get("clock") if isinstance(said, dict) else None
        told = {"page": page.id, "role": page.role.value, "clock": clock}
        since = round(heard - self._began, 6)
        self._tell("input", **told, gateway_clock=since, **self._ticks(), text=said)
        if kind in _LOOKING and isinstance(said.get("robot"), str):
            facts = {"on": said["on"]} if isinstance(said.get("on"), bool) else {}
            self._tell(str(kind), page=page.id, robot=said["robot"], **facts)

    def note(self, kind: str, facts: Mapping[str, object]) -> None:
        """What the rules did."""
        what = facts.get("what")
        if kind in ("mark_set", "mark_edit", "mark_delete"):
            self._tell(kind, **{**facts, **_turned(facts)})
        elif kind in ("command", "inject", "frame_age", "stands"):
            self._tell(kind, **facts)
        elif kind == "page_clock" and isinstance(offset := facts["offset"], float):
            self._tell(kind, **{**facts, "offset": offset - self._began})
        elif what in ("page comes", "page goes"):
            told = {key: facts.get(key) for key in ("page", "role", "name", "seat")}
            self._tell("connect", **told, on=what == "page comes", **self._ticks())
        elif what == "alarm":
            told = {key: facts[key] for key in ("robot", "text")}
            self._tell("alarm", cause=facts["kind"], on=True, **told)
        elif what == "acknowledged":
            self._tell("acknowledge", robot=facts.get("robot"), cause=facts.get("kind"))

    def _ticks(self) -> dict[str, int]:
        tick = self._tick()
        return {} if tick is None else {"tick": tick}

    def event(self, fields: Mapping[str, object]) -> None:
        """What all pages are told."""
        robot, value = fields["robot"], fields["value"]
        match fields["kind"]:
            case "mode" if isinstance(value, Mapping):
                mode = MODES.get(str(value["mode"]), "stopped")
                by = fields.get("by", "")
                self._tell("mode", robot=robot, mode=mode, policy=value["policy"], by=by)
            case "enabled":
                self._tell("enable", robot=robot, on=value)
            case "estop":
                self._tell("estop", on=value is not None, by=value or "")
            case "sound":
                self._tell("sound", robot=robot, loudness=value)
            case "bumper" if isinstance(value, Mapping):
                self._tell("bumper", robot=robot, **value)
            case "link" if value in ("good", "weak", "lost"):
                self._tell("link", robot=robot, state=value, signal_dbm=fields.get("signal_dbm"))
            case "link" | "battery":
                self._tell("alarm", robot=robot, cause=fields["kind"], on=True, text=str(value))
            case "left":
                self._tell("link", robot=robot, state="lost", signal_dbm=None)


def _turned(facts: Mapping[str, object]) -> dict[str, object]:
    """The place of a mark in MuJoCo's frame."""
    place = facts.get("place")
    if not isinstance(place, list | tuple) or len(place) != 3:
        return {}
    return {"place": list(frames.flip((place[0], place[1], place[2])))}
