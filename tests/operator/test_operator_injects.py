"""What instructors make happen at a gateway whose clock is turned by hand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from virtual_station import VirtualPage, VirtualStation

from usarsim_operator.roles import Role


class Notes:
    """An observer that keeps the injects."""

    def __init__(self) -> None:
        self.kept: list[dict[str, Any]] = []

    def input(self, page: object, text: str, heard: float) -> None: ...

    def event(self, fields: Mapping[str, object]) -> None: ...

    def note(self, kind: str, facts: Mapping[str, object]) -> None:
        if kind == "inject":
            self.kept.append(dict(facts))


async def test_a_robot_that_has_failed() -> None:
    """HRI-17: it stands, nobody switches it on, and after its time it works again."""
    station, notes = VirtualStation(), Notes()
    station.observers.add(notes)
    station.spawned("R1")
    station.truth.time = station.clock
    ada = VirtualPage(station, "Ada", Role.OPERATOR)
    ina = VirtualPage(station, "Ina", Role.INSTRUCTOR)
    fail = {"do": "robot_fails", "robot": "R1", "lasts": 2.0}
    assert "may not do that" in (await ada.ask("inject", **fail))["why"]
    assert (await ada.ask("take", robot="R1"))["ok"]
    assert (await ada.ask("drive", robot="R1", left=0.5, right=0.5))["ok"]
    assert (await ina.ask("inject", name="test", **fail))["ok"]
    stopped = station.told("R1")[-1][1]
    assert b"0.5" not in stopped
    for page in (ada, ina):
        assert (await page.ask("enable", robot="R1", on=True))["why"] == "R1 has failed"
    assert (await ada.ask("drive", robot="R1", left=0.5, right=0.5))["why"] == "R1 has failed"

    def keep() -> None:
        station.truth.time = station.clock
        ada.say("ping")
        ina.say("ping")

    await station.run(1.9, keep)
    assert "R1" in station.arbiter.failed
    await station.run(0.2, keep)
    assert (await ada.ask("drive", robot="R1", left=0.5, right=0.5))["ok"]
    did = [(one["name"], one["do"], one["by"], one["done"]) for one in notes.kept]
    assert did == [("test", "robot_fails", "Ina", True), ("test", "robot_recovers", "Ina", True)]
    enabled = [one["value"] for one in ada.texts if one.get("kind") == "enabled"]
    assert enabled == [False, True]
    await station.end(ada, ina)


async def test_other_injects() -> None:
    """HRI-17: a link that is cut carries nothing; what cannot be is answered and noted."""
    station, notes = VirtualStation(), Notes()
    station.observers.add(notes)
    driven = station.spawned("R1")
    ina = VirtualPage(station, "Ina", Role.INSTRUCTOR)
    assert (await ina.ask("inject", do="message", text="Ten minutes"))["ok"]
    assert ("message", "Ten minutes") in {(one.get("kind"), one.get("value")) for one in ina.texts}
    assert (await ina.ask("inject", do="link_drops", robot="R1"))["ok"]
    assert driven.cut
    told = len(station.told("R1"))
    assert (await ina.ask("take", robot="R1"))["ok"]
    await ina.ask("drive", robot="R1", left=1.0, right=1.0)
    assert len(station.told("R1")) == told
    assert (await ina.ask("inject", do="link_returns", robot="R1"))["ok"]
    await ina.ask("drive", robot="R1", left=1.0, right=1.0)
    assert len(station.told("R1")) > told
    for wish, why in (
        ({"do": "robot_fails"}, "robot_fails needs robot"),
        ({"do": "robot_fails", "robot": "R9"}, "R9 is no robot of the console"),
        ({"do": "victim_calls", "victim": "Anna"}, "this server lets nobody call"),
        ({"do": "earthquake"}, "inject: do must be one of"),
        ({"do": "link_drops", "robot": "R1", "lasts": 0}, "inject: lasts must be a number"),
    ):
        answer = await ina.ask("inject", **wish)
        assert (answer["ok"], answer["why"].startswith(why)) == (False, True), answer
    assert [one["done"] for one in notes.kept] == [True, True, True, False, False]
    await station.end(ina)
